// What cells mirror or refract of the environment. CPU twin: `cell_radiance` in
// src/sums/pinhole/cpu/hierarchical/evaluation.rs.

#import cell_tree
#import filters

// Mean radiance over a cell's footprint, as the texture has it: from one look-up where the pair's contribution ranges over less than
// its error budget, else from the fewer, the smaller that range is. a = fetches.
fn cell_radiance(
    cell: Cell, pair: Pair, sides: FootprintSides, contribution_range: f32, error_budget: f32, map: VisibilityMap,
) -> vec4f {
    let is_even = contribution_range < error_budget;
    let taps = taps_for(contribution_range, error_budget);
    var look_ups = one_look_up(pair.r, sides);
    if is_lobe_of_mirror(cell) {
        let cosine = abs(pair.dn) * pair.inverse_l;
        look_ups = lobe_parts(pair.r, cell.normal, cosine, sharp_footprint_of(cell, pair), cell.lobe, pair.third);
    }
    if (FILTER == FILTER_ISOTROPIC || FILTER == FILTER_HARDWARE) && !is_even {
        return mean_by_one_fetch_each(look_ups, map);
    }
    let first = taps_over_cell(cell, look_ups.r, look_ups.first, is_even, taps);
    var second = no_taps();
    if look_ups.count == 2u {
        second = taps_over_cell(cell, look_ups.r, look_ups.second, is_even, taps);
    }
    return mean_over_taps(look_ups.r, first, second, map);
}

fn taps_over_cell(cell: Cell, r: vec3f, sides: FootprintSides, is_even: bool, max_taps: f32) -> Taps {
    if is_even {
        return one_tap_over(cell, r, sides);
    }
    return taps_over(r, sides, max_taps);
}

// A single look-up in a footprint. Adjacent cells together are as good as a wide kernel and lose nothing over the mirrors' edges; blur has
// to be kept.
fn one_tap_over(cell: Cell, r: vec3f, sides: FootprintSides) -> Taps {
    let width = sqrt(0.5 * (dot(sides.v1, sides.v1) + dot(sides.v2, sides.v2)));
    let texel = texel_width(light_from_world(r), uniforms.texel_rad);
    if cell.lobe == 0.0 {
        return one_tap(width, floor(level_of(width * EVEN_LIGHT_SHARPNESS, texel) + 0.5));
    }
    return one_tap(width, level_of(width * TAP_SHARPNESS, texel));
}
