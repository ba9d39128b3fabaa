// Receivers as a pyramid of blocks, the smallest level first: where the points of a block are, which way they face, and whether
// sixteen of them stand for all. One workgroup looks at one block. CPU twin: src/pinhole/cpu/hierarchical/blocks.rs.

#import pair
#import cube
#import footprint
#import filters
#import visibility
#import hierarchy
#import work

// How far a point may lie from where its block's sixteen points lead one to expect it, in radii of the block; and a normal.
const SMOOTH_POSITION: f32 = 0.01;
const SMOOTH_NORMAL: f32 = 0.02;

struct Extent {
    low: vec3f,
    least_object: i32,
    high: vec3f,
    most_object: i32,
    normal: vec3f,
    count: u32,
}

const LANES: u32 = 64u;
var<workgroup> extents: array<Extent, LANES>;
var<workgroup> far: array<f32, LANES>;
var<workgroup> rough: array<u32, LANES>;
var<workgroup> positions: array<vec3f, POINTS>;
var<workgroup> normals: array<vec3f, POINTS>;

fn join(a: Extent, b: Extent) -> Extent {
    return Extent(
        min(a.low, b.low), min(a.least_object, b.least_object), max(a.high, b.high), max(a.most_object, b.most_object),
        a.normal + b.normal, a.count + b.count,
    );
}

@compute @workgroup_size(64)
fn look_at_blocks(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) lane: u32) {
    let at = place_of_block(workgroup.x);
    let step = at.edge / 8u;
    let own = at.origin + step * vec2u(lane % 8u, lane / 8u);

    var extent = Extent(vec3f(1e30), 0x7fffffff, vec3f(-1e30), -1, vec3f(0.0), 0u);
    for (var k = 0u; k < step * step; k++) {
        let receiver = receiver_at(own + vec2u(k % step, k / step));
        if receiver.object >= 0 {
            let p = receiver.position;
            extent = join(extent, Extent(p, receiver.object, p, receiver.object, receiver.normal, 1u));
        }
    }
    extents[lane] = extent;
    if lane < POINTS {
        let along = points_along(at.edge);
        let receiver = receiver_at(at.origin + vec2u(along[lane % 4u], along[lane / 4u]));
        positions[lane] = receiver.position;
        normals[lane] = receiver.normal;
    }
    for (var half = LANES / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            extents[lane] = join(extents[lane], extents[lane + half]);
        }
    }
    workgroupBarrier();
    let all = extents[0];
    let length2 = dot(all.normal, all.normal);
    let mean = select(vec3f(0.0, 1.0, 0.0), all.normal * inverseSqrt(length2), length2 > 1e-20);
    let centre = 0.5 * (all.low + all.high);
    let radius = distance(all.high, centre);

    var farthest = 0.0;
    for (var k = 0u; k < step * step; k++) {
        let receiver = receiver_at(own + vec2u(k % step, k / step));
        if receiver.object >= 0 {
            farthest = max(farthest, distance(receiver.normal, mean));
        }
    }
    far[lane] = farthest;
    rough[lane] = select(0u, 1u, is_off(at, vec2u(lane % 8u, lane / 8u), SMOOTH_POSITION * radius));
    for (var half = LANES / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            far[lane] = max(far[lane], far[lane + half]);
            rough[lane] = max(rough[lane], rough[lane + half]);
        }
    }
    workgroupBarrier();
    if lane > 0u {
        return;
    }
    let whole = all.count == at.edge * at.edge && all.least_object == all.most_object && rough[0] == 0u;
    var kind = select(ROUGH, SMOOTH, whole && tree.may_interpolate != 0u && parts_are_smooth(at));
    if all.count == 0u {
        kind = EMPTY;
    }
    blocks[at.index] = Block(centre, radius, mean, far[0], kind);
}

// Whether one of 8×8 points is not where a bicubic through the sixteen leads.
fn is_off(at: BlockPlace, place: vec2u, tolerance: f32) -> bool {
    let offset = at.edge / 16u + place * (at.edge / 8u);
    let columns = weights_along(at.edge, offset.x);
    let rows = weights_along(at.edge, offset.y);
    var position = vec3f(0.0);
    var normal = vec3f(0.0);
    for (var k = 0u; k < POINTS; k++) {
        let weight = columns[k % 4u] * rows[k / 4u];
        position += weight * positions[k];
        normal += weight * normals[k];
    }
    let receiver = receiver_at(at.origin + offset);
    // As negations: what is not a number is off.
    return !(distance(receiver.position, position) <= tolerance) || !(distance(receiver.normal, normal) <= SMOOTH_NORMAL);
}

fn parts_are_smooth(at: BlockPlace) -> bool {
    if at.level + 1u == LEVELS {
        return true;
    }
    var smooth_parts = 0u;
    for (var k = 0u; k < 4u; k++) {
        let part = at.tile * BLOCKS + block_in_tile(at.level + 1u, 2u * at.block + vec2u(k & 1u, k >> 1u));
        smooth_parts += select(0u, 1u, blocks[part].kind == SMOOTH);
    }
    return smooth_parts == 4u;
}
