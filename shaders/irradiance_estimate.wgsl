// A rough estimate of a picture's irradiance, to which a relative tolerance refers: the mean at some of its receivers from some of
// the samples, or a part of the root mean square where a few receivers get nearly all of the light and that is more.
// CPU counterpart: `estimate_irradiance` in src/sums/pinhole/cpu/hierarchical/mod.rs, which picks other receivers.

#import no_rays
#import cell_tree
#import near_light_cells

// Sums over a workgroup's receivers: irradiance, its square, how many there are.
@group(2) @binding(0) var<storage, read_write> partial_sums: array<vec4f, ESTIMATE_WORKGROUPS>;
@group(2) @binding(1) var<storage, read_write> tolerance: Tolerance;

var<workgroup> sums: array<vec3f, WORKGROUP_SIZE>;

@compute @workgroup_size(WORKGROUP_SIZE)
fn estimate(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    // Even steps might follow a picture's columns: those of the golden ratio, here in 32 bits of fraction, do not.
    let fraction = f32((id.x * 2654435769u) >> 8u) / 16777216.0;
    let count = tree.size.x * tree.size.y;
    let asks_all = count <= ESTIMATE_WORKGROUPS * WORKGROUP_SIZE;
    let place = select(min(u32(fraction * f32(count)), count - 1u), id.x, asks_all);
    // Beyond the last row there are no receivers.
    sums[lane] = moments_at(receiver_at(vec2u(place % tree.size.x, place / tree.size.x)));
    workgroupBarrier();
    if lane == 0u {
        var all = vec3f(0.0);
        for (var k = 0u; k < WORKGROUP_SIZE; k++) {
            all += sums[k];
        }
        partial_sums[workgroup.x] = vec4f(all, 0.0);
    }
}

// Sums over a receiver's three channels.
fn moments_at(receiver: Receiver) -> vec3f {
    if receiver.object < 0 {
        return vec3f(0.0);
    }
    let step = max((tree.sample_count + ESTIMATE_MAX_SAMPLE_NODES - 1u) / ESTIMATE_MAX_SAMPLE_NODES, 1u);
    var sum = vec3f(0.0);
    for (var k = 0u; k < tree.sample_count; k += step) {
        sum += sample_contribution(k, receiver);
    }
    sum *= f32(step);
    return vec3f(sum.r + sum.g + sum.b, dot(sum, sum), 3.0);
}

fn sample_contribution(sample: u32, receiver: Receiver) -> vec3f {
    let cell = load_cell(sample_nodes[sample].node);
    let pair = pair_of(cell, receiver);
    if !(pair.cosine_product > 0.0) {
        return vec3f(0.0);
    }
    var weight = weight_of(cell, pair, receiver);
    if VISIBILITY {
        weight *= visible_fraction(-pair.d, map_of_sample(sample, receiver_side(cell.flags, pair.dn)));
    }
    let map = map_of_sample(sample, sky_side(cell.flags, pair.dn));
    return weight * reflected_scale(cell, pair, receiver) * radiance_of(cell, pair, map);
}

// Mean unoccluded radiance over a cell's footprint.
fn radiance_of(cell: Cell, pair: Pair, map: VisibilityMap) -> vec3f {
    if LIGHT != LIGHT_ENVIRONMENT {
        let light = near_light_at(cell, pair, f32(uniforms.taps));
        if VISIBILITY {
            return light.radiance.rgb * visible_fraction(light.towards, map);
        }
        return light.radiance.rgb;
    }
    var look_ups: LookUps;
    var seen = 1.0;
    var seen_map = map;
    if is_lobe_of_mirror(cell) {
        let cosine = abs(pair.dn) * pair.inverse_l;
        look_ups = lobe_parts(pair.r, cell.normal, cosine, sharp_footprint_of(cell, pair), cell.lobe, pair.third);
        if VISIBILITY && is_wide_lobe(cell.lobe, cell.change_1, cell.change_2) {
            seen = lobe_fraction(pair.r, cell.lobe, map);
            seen_map.index = UNOCCLUDED;
        }
    } else {
        look_ups = one_look_up(pair.r, footprint_of(cell, pair));
    }
    let light_r = light_from_world(look_ups.r);
    var sum = vec3f(0.0);
    var looked_up = look_ups.first;
    for (var k = 0u; k < look_ups.count; k++) {
        let fraction = sky_fraction_of_footprint(look_ups.r, looked_up, seen_map);
        sum += fraction * fetch(light_r, isotropic_level(light_r, looked_up));
        looked_up = look_ups.second;
    }
    return seen / f32(look_ups.count) * sum;
}

@compute @workgroup_size(1)
fn set_tolerance() {
    var all = vec3f(0.0);
    for (var k = 0u; k < ESTIMATE_WORKGROUPS; k++) {
        all += partial_sums[k].xyz;
    }
    let count = max(all.z, 1.0);
    let irradiance = max(max(all.x / count, ESTIMATE_RMS_SHARE * sqrt(all.y / count)), 1.2e-38);
    tolerance.error = tolerance.relative_error * irradiance;
}
