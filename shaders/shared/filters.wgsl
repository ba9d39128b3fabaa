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

// Mean over the parallelogram with the given sides around the unit direction r of the light that the sample with this visibility map
// sees; a = fetches.
fn mean_over_footprint(r: vec3f, sides: FootprintSides, max_taps: f32, map: VisibilityMap) -> vec4f {
    if FILTER == FILTER_NONE {
        return visible_light(r, light_from_world(r), 0.0, 0.0, 1.0, map);
    }
    let light_r = light_from_world(r);
    if FILTER == FILTER_HARDWARE {
        let fraction = sky_fraction_of_footprint(r, sides, map);
        let filtered =
            textureSampleGrad(environment, anisotropic, light_r, light_from_world(sides.v1), light_from_world(sides.v2));
        return vec4f(fraction * filtered.rgb, 1.0);
    }
    let axes = footprint_axes(sides);
    let texel = texel_width(light_r, uniforms.texel_rad);
    if FILTER == FILTER_ISOTROPIC {
        let fraction = sky_fraction_of_footprint(r, sides, map);
        if fraction > 0.0 {
            return vec4f(fraction * fetch(light_r, level_of(axes.major, texel)), 1.0);
        }
        return vec4f(0.0);
    }
    if FILTER == FILTER_EWA {
        return mean_over_ellipse(r, light_r, axes, texel, map);
    }
    let taps = clamp(ceil(axes.major / max(TAP_SHARPNESS * axes.minor, texel)), 1.0, max_taps);
    let width = max(axes.minor, axes.major / taps);
    let level = level_of(TAP_SHARPNESS * width, texel);
    let light_axis = light_from_world(axes.direction);
    var sum = vec4f(0.0);
    filter_work += u32(taps);
    for (var k = 0.5; k < taps; k += 1.0) {
        let along = k / taps - 0.5;
        sum += visible_light(r + along * axes.direction, light_r + along * light_axis, width, level, 1.0, map);
    }
    return vec4f(sum.rgb / taps, sum.a);
}

// The part of the sky that is visible, from four places in a footprint.
fn sky_fraction_of_footprint(r: vec3f, sides: FootprintSides, map: VisibilityMap) -> f32 {
    let a = 0.25 * (sides.v1 + sides.v2);
    let b = 0.25 * (sides.v1 - sides.v2);
    let width = 0.5 * sqrt(min(dot(sides.v1, sides.v1), dot(sides.v2, sides.v2)));
    let opposite = sky_fraction(r + a, width, map) + sky_fraction(r - a, width, map);
    return 0.25 * (opposite + sky_fraction(r + b, width, map) + sky_fraction(r - b, width, map));
}

// One look-up times `weight` and the part of it, `width` radians wide, that is visible; a = fetches. Where nothing is visible nothing
// is read. The direction comes in world space and in the environment's frame: taps along a line need not be rotated one by one.
fn visible_light(
    direction: vec3f, light_direction: vec3f, width: f32, level: f32, weight: f32, map: VisibilityMap,
) -> vec4f {
    let fraction = weight * sky_fraction(direction, width, map);
    if fraction > 0.0 {
        return vec4f(fraction * fetch(light_direction, level), 1.0);
    }
    return vec4f(0.0);
}

// The elliptical weighted average (Heckbert 1989) with weights 1 − ρ²: look-ups at most a texel apart all over the ellipse.
fn mean_over_ellipse(r: vec3f, light_r: vec3f, axes: FootprintAxes, texel: f32, map: VisibilityMap) -> vec4f {
    let width = max(max(EWA_TEXEL * axes.minor, texel), 2.0 * EWA_RADIUS * axes.major / EWA_MAX_COLUMNS);
    let level = level_of(width, texel);
    let columns = max(ceil(2.0 * EWA_RADIUS * axes.major / width), 1.0);
    let rows = max(ceil(2.0 * EWA_RADIUS * axes.minor / width), 1.0);
    let across = cross(r, axes.direction) * (axes.minor / max(axes.major, 1e-20));
    let light_axis = light_from_world(axes.direction);
    let light_across = light_from_world(across);
    var sum = vec4f(0.0);
    var weights = 0.0;
    filter_work += u32(rows * (columns + 1.0));
    for (var j = 0.5; j < rows; j += 1.0) {
        let y = 2.0 * j / rows - 1.0;
        for (var i = 0.5; i < columns; i += 1.0) {
            let x = 2.0 * i / columns - 1.0;
            let weight = 1.0 - x * x - y * y;
            if weight > 0.0 {
                let direction = r + EWA_RADIUS * (x * axes.direction + y * across);
                let light_direction = light_r + EWA_RADIUS * (x * light_axis + y * light_across);
                sum += visible_light(direction, light_direction, width, level, weight, map);
                weights += weight;
            }
        }
    }
    return vec4f(sum.rgb / weights, sum.a);
}

// A look-up in the environment's own frame.
fn fetch(light_direction: vec3f, level: f32) -> vec3f {
    if LIGHT == LIGHT_SURROUNDINGS {
        return textureSampleLevel(view_radiance, trilinear, light_direction, looked_up_view, level).rgb;
    }
    return textureSampleLevel(environment, trilinear, light_direction, level).rgb;
}
