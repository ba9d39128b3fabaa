// Receivers as a pyramid of blocks, the smallest level first: where the points of a block are, which way they face, and whether
// sixteen of them stand for all. One workgroup makes one block. CPU counterpart: src/sums/pinhole/cpu/hierarchical/blocks.rs.

#import no_rays
#import tile_batch

struct Extent {
    low: vec3f,
    min_object: i32,
    high: vec3f,
    max_object: i32,
    normal: vec3f,
    count: u32,
    tolerated: f32,
}

var<workgroup> extents: array<Extent, WORKGROUP_SIZE>;
var<workgroup> normal_radii: array<f32, WORKGROUP_SIZE>;
var<workgroup> rough: array<u32, WORKGROUP_SIZE>;
var<workgroup> positions: array<vec3f, INTERPOLATION_POINTS>;
var<workgroup> normals: array<vec3f, INTERPOLATION_POINTS>;

fn join(a: Extent, b: Extent) -> Extent {
    return Extent(
        min(a.low, b.low), min(a.min_object, b.min_object), max(a.high, b.high), max(a.max_object, b.max_object),
        a.normal + b.normal, a.count + b.count, min(a.tolerated, b.tolerated),
    );
}

@compute @workgroup_size(WORKGROUP_SIZE)
fn make_block(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) lane: u32) {
    let at = place_of_block(workgroup.x);
    if lane < INTERPOLATION_POINTS {
        let receiver = interpolation_point(at, lane);
        positions[lane] = receiver.position;
        normals[lane] = receiver.normal;
    }
    let all = extent_of_block(at, lane);
    let length2 = dot(all.normal, all.normal);
    let mean = select(vec3f(0.0, 1.0, 0.0), all.normal * inverseSqrt(length2), length2 > 1e-20);
    let centre = 0.5 * (all.low + all.high);
    let radius = distance(all.high, centre);

    normal_radii[lane] = normal_radius_of_share(at, lane, mean);
    rough[lane] = select(0u, 1u, is_not_bicubic(at, vec2u(lane % 8u, lane / 8u), SMOOTH_POSITION_TOLERANCE * radius));
    for (var half = WORKGROUP_SIZE / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            normal_radii[lane] = max(normal_radii[lane], normal_radii[lane + half]);
            rough[lane] = max(rough[lane], rough[lane + half]);
        }
    }
    workgroupBarrier();
    if lane > 0u {
        return;
    }
    let whole = all.count == at.edge * at.edge && all.min_object == all.max_object && rough[0] == 0u;
    var kind = select(ROUGH, SMOOTH, whole && tree.may_interpolate != 0u && parts_are_smooth(at));
    if all.count == 0u {
        kind = EMPTY;
    }
    blocks[at.index] = Block(centre, radius, mean, normal_radii[0], kind, all.tolerated, all.max_object);
}

// A lane's share of a block are the points of one of 8×8 squares; this is the k-th of them.
fn point_of_share(at: BlockPlace, lane: u32, k: u32) -> Receiver {
    let step = at.edge / 8u;
    return receiver_at(at.origin + step * vec2u(lane % 8u, lane / 8u) + vec2u(k % step, k / step));
}

fn points_per_share(at: BlockPlace) -> u32 {
    let step = at.edge / 8u;
    return step * step;
}

fn extent_of_block(at: BlockPlace, lane: u32) -> Extent {
    var extent = Extent(vec3f(1e30), 0x7fffffff, vec3f(-1e30), -1, vec3f(0.0), 0u, 1e30);
    for (var k = 0u; k < points_per_share(at); k++) {
        let receiver = point_of_share(at, lane, k);
        if receiver.object >= 0 {
            let p = receiver.position;
            let half = abs(half_part(receiver));
            let tolerated = tolerated_error(receiver);
            extent = join(extent, Extent(p - half, receiver.object, p + half, receiver.object, receiver.normal, 1u, tolerated));
        }
    }
    extents[lane] = extent;
    for (var half = WORKGROUP_SIZE / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            extents[lane] = join(extents[lane], extents[lane + half]);
        }
    }
    workgroupBarrier();
    return extents[0];
}

// How far the normals of a lane's share are from the block's mean one.
fn normal_radius_of_share(at: BlockPlace, lane: u32, mean: vec3f) -> f32 {
    var radius = 0.0;
    for (var k = 0u; k < points_per_share(at); k++) {
        let receiver = point_of_share(at, lane, k);
        if receiver.object >= 0 {
            radius = max(radius, distance(receiver.normal, mean));
        }
    }
    return radius;
}

// Whether one of 8×8 points is not where a bicubic through the sixteen predicts it.
fn is_not_bicubic(at: BlockPlace, place: vec2u, tolerance: f32) -> bool {
    let offset = at.edge / 16u + place * (at.edge / 8u);
    let columns = weights_along(at.edge, offset.x);
    let rows = weights_along(at.edge, offset.y);
    var position = vec3f(0.0);
    var normal = vec3f(0.0);
    for (var k = 0u; k < INTERPOLATION_POINTS; k++) {
        let weight = columns[k % 4u] * rows[k / 4u];
        position += weight * positions[k];
        normal += weight * normals[k];
    }
    let receiver = receiver_at(at.origin + offset);
    // As negations: NaN is not bicubic.
    return !(distance(receiver.position, position) <= tolerance) || !(distance(receiver.normal, normal) <= SMOOTH_NORMAL_TOLERANCE);
}

fn parts_are_smooth(at: BlockPlace) -> bool {
    if at.level + 1u == BLOCK_LEVELS {
        return true;
    }
    var smooth_parts = 0u;
    for (var k = 0u; k < 4u; k++) {
        let part = at.tile * BLOCKS_PER_TILE + block_in_tile(at.level + 1u, 2u * at.block + vec2u(k & 1u, k >> 1u));
        smooth_parts += select(0u, 1u, blocks[part].kind == SMOOTH);
    }
    return smooth_parts == 4u;
}
