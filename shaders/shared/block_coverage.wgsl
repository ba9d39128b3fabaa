// What visibility maps say about whole blocks of receivers, and about the light that a cell reflects to them.
// CPU counterpart: `Coverage` in src/sums/pinhole/cpu/visibility.rs.

#import cell_tree
#import doubts
#import tile_batch

// How much of a block, or of the light that a cell reflects to it, a sample sees.
const NONE: u32 = 0u;
const FULL: u32 = 1u;
const PARTIAL: u32 = 2u;

// The most texels that are read to classify a region.
const MAX_COVERAGE_TEXELS: u32 = 64u;

// Texels of a map, first and last, both included.
struct MapRegion {
    first: vec2u,
    last: vec2u,
    is_small: bool,
}

// The texels that look-ups within an angle around a direction of the sample's frame read.
fn map_region(local: vec3f, angle: f32, map: VisibilityMap) -> MapRegion {
    let place = map_place(local, map);
    let n = f32(uniforms.map_resolution);
    // Near the horizon a radian is up to 1.12 edges of a map wide.
    let margin = 1.12 * angle * n;
    let at = vec2f(place.texel) + place.part;
    let first = vec2u(max(at - margin, vec2f(0.0)));
    let last = min(vec2u(at + margin) + 1u, vec2u(uniforms.map_resolution - 1u));
    let size = last - first + 1u;
    return MapRegion(first, last, angle < 0.5 && size.x * size.y <= MAX_COVERAGE_TEXELS);
}

// How much of a block of points on an object a sample sees.
fn receiver_coverage(sample: u32, block: Block, object: i32) -> u32 {
    let node = sample_nodes[sample];
    let l = block.centre - node.position;
    let distance = length(l);
    let height = dot(l, node.normal);
    let map = map_of_sample(sample, receiver_side(node.object_flags, -height));
    let local = l * map.axes;
    let region = map_region(local, asin(min(block.radius / distance, 1.0)), map);
    // Maps are not certain about what is seen at small angles.
    let is_grazing = tree.traces_rays != 0u && abs(height) - block.radius < MIN_CERTAIN_SINE * (distance + block.radius);
    // Or seen from both sides, or from too near.
    if is_grazing || !region.is_small || (has_two_maps(node.object_flags) && abs(height) < block.radius) {
        return PARTIAL;
    }
    var all = PARTIAL;
    for (var j = region.first.y; j <= region.last.y; j++) {
        for (var i = region.first.x; i <= region.last.x; i++) {
            let texel = (map.index * uniforms.map_resolution + j) * uniforms.map_resolution + i;
            let coverage = coverage_by_texel(texel, local, block, object);
            if coverage == PARTIAL || (all != PARTIAL && all != coverage) {
                return PARTIAL;
            }
            all = coverage;
        }
    }
    return all;
}

// How much of a block around a point of the sample's frame lies in front of what a texel shows.
fn coverage_by_texel(texel: u32, local: vec3f, block: Block, object: i32) -> u32 {
    let plane = planes[texel];
    let depth = dot(plane.xyz, local);
    let slack = length(plane.xyz) * block.radius;
    if depth - slack > 1.0 + plane.w {
        return NONE;
    }
    let farthest = length(local) + block.radius;
    let is_certain = tree.traces_rays == 0u || !is_in_doubt(texel, depth + slack, farthest * farthest, object);
    return select(PARTIAL, FULL, depth + slack <= 1.0 + plane.w && is_certain);
}
