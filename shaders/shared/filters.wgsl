// Mean radiance over a footprint: one look-up strategy a filter. CPU twin: src/sums/pinhole/cpu/filters.rs.

#import gather_inputs
#import cube
#import footprint
#import visibility

override FILTER: u32 = FILTER_ANISOTROPIC;

// The view of surroundings that is looked up.
var<private> looked_up_view: u32;

// Iterations of the loops of all look-ups of this invocation.
var<private> filter_work: u32;

// Mean over footprints of the light that the sample with this visibility map sees; a = fetches.
fn mean_over_footprints(look_ups: LookUps, max_taps: f32, map: VisibilityMap) -> vec4f {
    if FILTER == FILTER_ISOTROPIC || FILTER == FILTER_HARDWARE {
        return mean_by_one_fetch_each(look_ups, map);
    }
    let first = taps_over(look_ups.r, look_ups.first, max_taps);
    var second = no_taps();
    if look_ups.count == 2u {
        second = taps_over(look_ups.r, look_ups.second, max_taps);
    }
    return mean_over_taps(look_ups.r, first, second, map);
}

// Look-ups at the middles of a grid of fields around a direction, row by row.
struct Taps {
    count: f32,
    columns: f32,
    // The grid's sides.
    along: vec3f,
    across: vec3f,
    // Radians of the sky around a tap that have to be visible.
    width: f32,
    level: f32,
}

fn no_taps() -> Taps {
    return Taps(0.0, 1.0, vec3f(0.0), vec3f(0.0), 0.0, 0.0);
}

// One look-up, `width` radians wide.
fn one_tap(width: f32, level: f32) -> Taps {
    return Taps(1.0, 1.0, vec3f(0.0), vec3f(0.0), width, level);
}

// Where the filter looks a footprint around r up.
fn taps_over(r: vec3f, sides: FootprintSides, max_taps: f32) -> Taps {
    if FILTER == FILTER_NONE {
        return one_tap(0.0, 0.0);
    }
    let axes = footprint_axes(sides);
    let texel = texel_width(light_from_world(r), uniforms.texel_rad);
    if FILTER == FILTER_EWA {
        return taps_over_ellipse(r, axes, texel);
    }
    let count = clamp(ceil(axes.major / max(TAP_SHARPNESS * axes.minor, texel)), 1.0, max_taps);
    let width = max(axes.minor, axes.major / count);
    return Taps(count, count, axes.direction, vec3f(0.0), width, level_of(TAP_SHARPNESS * width, texel));
}

// The elliptical weighted average (Heckbert 1989): look-ups at most a texel apart all over the ellipse.
fn taps_over_ellipse(r: vec3f, axes: FootprintAxes, texel: f32) -> Taps {
    let width = max(max(EWA_TEXEL * axes.minor, texel), 2.0 * EWA_RADIUS * axes.major / EWA_MAX_COLUMNS);
    let columns = max(ceil(2.0 * EWA_RADIUS * axes.major / width), 1.0);
    let rows = max(ceil(2.0 * EWA_RADIUS * axes.minor / width), 1.0);
    let across = cross(r, axes.direction) * (axes.minor / max(axes.major, 1e-20));
    let along = 2.0 * EWA_RADIUS * axes.direction;
    return Taps(columns * rows, columns, along, 2.0 * EWA_RADIUS * across, width, level_of(width, texel));
}

// Weighted mean of the look-ups of one grid or, if it has any, of two that count alike, each times the part of it that is visible;
// a = fetches. Where nothing is visible nothing is read. All look-ups are in this one place: drivers compile what it calls once.
fn mean_over_taps(r: vec3f, first: Taps, second: Taps, map: VisibilityMap) -> vec4f {
    // In the environment's frame: taps need not be rotated one by one.
    let light_r = light_from_world(r);
    var taps = first;
    var light_along = light_from_world(taps.along);
    var light_across = light_from_world(taps.across);
    var sum = vec4f(0.0);
    var weights = 0.0;
    var mean_of_first = vec3f(0.0);
    filter_work += 1u + u32(first.count + second.count);
    var k = 0.0;
    for (var n = 0.0; n < first.count + second.count; n += 1.0) {
        if n == first.count {
            mean_of_first = sum.rgb / weights;
            sum = vec4f(0.0, 0.0, 0.0, sum.a);
            weights = 0.0;
            taps = second;
            light_along = light_from_world(taps.along);
            light_across = light_from_world(taps.across);
            k = 0.0;
        }
        var x = (k + 0.5) / taps.columns - 0.5;
        var y = 0.0;
        var weight = 1.0;
        if FILTER == FILTER_EWA {
            let row = floor((k + 0.5) / taps.columns);
            x -= row;
            y = (row + 0.5) * taps.columns / taps.count - 0.5;
            // 1 − ρ²
            weight = max(1.0 - 4.0 * (x * x + y * y), 0.0);
        }
        weights += weight;
        k += 1.0;
        var fraction = weight;
        if VISIBILITY && weight > 0.0 {
            fraction *= sky_fraction(r + (x * taps.along + y * taps.across), taps.width, map);
        }
        if fraction > 0.0 {
            let direction = light_r + (x * light_along + y * light_across);
            sum += vec4f(fraction * fetch(direction, taps.level), 1.0);
        }
    }
    let mean = sum.rgb / weights;
    return vec4f(select(mean, 0.5 * (mean_of_first + mean), second.count > 0.0), sum.a);
}

// One look-up a footprint; a = fetches.
fn mean_by_one_fetch_each(look_ups: LookUps, map: VisibilityMap) -> vec4f {
    let first = filtered_by_one_fetch(look_ups.r, look_ups.first, map);
    if look_ups.count == 1u {
        return first;
    }
    let second = filtered_by_one_fetch(look_ups.r, look_ups.second, map);
    return vec4f(0.5 * (first.rgb + second.rgb), first.a + second.a);
}

// One look-up, of the adapter's anisotropic sampler or as wide as the footprint is long; a = fetches.
fn filtered_by_one_fetch(r: vec3f, sides: FootprintSides, map: VisibilityMap) -> vec4f {
    let fraction = sky_fraction_of_footprint(r, sides, map);
    let light_r = light_from_world(r);
    if FILTER == FILTER_HARDWARE {
        let filtered =
            textureSampleGrad(environment, anisotropic, light_r, light_from_world(sides.v1), light_from_world(sides.v2));
        return vec4f(fraction * filtered.rgb, 1.0);
    }
    if fraction > 0.0 {
        return vec4f(fraction * fetch(light_r, isotropic_level(light_r, sides)), 1.0);
    }
    return vec4f(0.0);
}

// The level of a look-up in the environment's frame that is as wide as the footprint is long.
fn isotropic_level(light_r: vec3f, sides: FootprintSides) -> f32 {
    return level_of(footprint_axes(sides).major, texel_width(light_r, uniforms.texel_rad));
}

// The part of the sky that is visible, from four places in a footprint.
fn sky_fraction_of_footprint(r: vec3f, sides: FootprintSides, map: VisibilityMap) -> f32 {
    let width = 0.5 * sqrt(min(dot(sides.v1, sides.v1), dot(sides.v2, sides.v2)));
    var sum = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let x = select(-0.25, 0.25, (k & 1u) == 0u);
        let y = select(-0.25, 0.25, k == 0u || k == 3u);
        sum += sky_fraction(r + (x * sides.v1 + y * sides.v2), width, map);
    }
    return 0.25 * sum;
}

// A look-up in the environment's own frame.
fn fetch(light_direction: vec3f, level: f32) -> vec3f {
    if LIGHT == LIGHT_SURROUNDINGS {
        return textureSampleLevel(view_radiance, trilinear, light_direction, looked_up_view, level).rgb;
    }
    return textureSampleLevel(environment, trilinear, light_direction, level).rgb;
}
