// How bright a picture is, roughly: the mean irradiance of some of its receivers from some of the roots, or where a few get
// nearly all of it a tenth of the root mean square, if that is more. CPU twin: `typical` in src/pinhole/cpu/hierarchical/mod.rs.

#import pair
#import cube
#import footprint
#import filters
#import visibility
#import hierarchy

const LANES: u32 = 64u;
const WORKGROUPS: u32 = 64u;
// Roots that are asked.
const SCOUTED: u32 = 512u;

// Sums over a workgroup's receivers: irradiance, its square, how many there are.
@group(2) @binding(0) var<storage, read_write> reports: array<vec4f, WORKGROUPS>;
// What is allowed, W/m², in all of its components: out. As a part of what is typical: in.
struct Tolerance {
    allowed: vec4f,
    part: f32,
}
@group(2) @binding(1) var<storage, read_write> tolerance: Tolerance;

var<workgroup> sums: array<vec3f, LANES>;

@compute @workgroup_size(64)
fn scout(@builtin(global_invocation_id) id: vec3u, @builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) lane: u32) {
    // Even steps might follow a picture's columns: those of the golden ratio, here in 32 bits of fraction, do not.
    let fraction = f32((id.x * 2654435769u) >> 8u) / 16777216.0;
    let count = tree.size.x * tree.size.y;
    let place = min(u32(fraction * f32(count)), count - 1u);
    let receiver = receiver_at(vec2u(place % tree.size.x, place / tree.size.x));
    var moments = vec3f(0.0);
    if receiver.object >= 0 {
        let every = max((tree.roots + SCOUTED - 1u) / SCOUTED, 1u);
        var sum = vec3f(0.0);
        for (var k = 0u; k < tree.roots; k += every) {
            sum += brought_by_root(k, receiver);
        }
        sum *= f32(every);
        moments = vec3f(sum.r + sum.g + sum.b, dot(sum, sum), 3.0);
    }
    sums[lane] = moments;
    workgroupBarrier();
    if lane == 0u {
        var all = vec3f(0.0);
        for (var k = 0u; k < LANES; k++) {
            all += sums[k];
        }
        reports[workgroup.x] = vec4f(all, 0.0);
    }
}

fn brought_by_root(root: u32, receiver: Receiver) -> vec3f {
    let cell = load_cell(roots[root].map_node.y);
    let pair = pair_of(cell, receiver);
    if !(pair.cosines > 0.0) {
        return vec3f(0.0);
    }
    var weight = weight_of(cell, pair, receiver);
    if VISIBILITY {
        let side = select(1.0, -1.0, cell.two_sided && pair.dn > 0.0);
        look_around(roots[root].map_node.x, roots[root].most_phase.yz, uniforms.map_resolution, cell.normal, side);
        weight *= visible_part(-pair.d);
    }
    let sides = footprint_of(cell, pair);
    let axes = footprint_axes(sides.v1, sides.v2);
    let open = open_part_of_footprint(pair.r, sides.v1, sides.v2);
    let light_r = light_from_world(pair.r);
    let radiance = fetch(light_r, level_of(axes.major, texel_width(light_r, uniforms.texel_rad)));
    return weight * open * factor_of(cell, pair) * radiance;
}

@compute @workgroup_size(1)
fn settle() {
    var all = vec3f(0.0);
    for (var k = 0u; k < WORKGROUPS; k++) {
        all += reports[k].xyz;
    }
    let count = max(all.z, 1.0);
    let typical = max(max(all.x / count, 0.1 * sqrt(all.y / count)), 1.2e-38);
    tolerance.allowed = vec4f(tolerance.part * typical);
}
