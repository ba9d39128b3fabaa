// Mean radiance over a footprint: one look-up strategy a filter. CPU twin: src/pinhole/cpu/filters.rs.
//
// The importing pass declares `environment`, a cube map, the samplers `trilinear` and `anisotropic`, and two functions of a world
// direction: `open_part`, what part of the light from there counts, and `light_from_world`, the same direction in the
// environment's own frame, which may be rotated. It imports `cube` and `footprint`.

const FILTER_NONE: u32 = 0u;
const FILTER_ISOTROPIC: u32 = 1u;
const FILTER_ANISOTROPIC: u32 = 2u;
const FILTER_HARDWARE: u32 = 3u;
const FILTER_EWA: u32 = 4u;

override FILTER: u32 = FILTER_ANISOTROPIC;

// Bilinear interpolation blurs a level's texels by more than their width, so a tap reads a level a little finer than its
// share of the footprint. Measured: 1 blurs the ring's caustic (error .376 at 100 samples, here .361), 0.7 sharpens it
// further (.342) but shows gaps between footprints where a sun is focused (cup, 1,000 samples: .18, here .20, .26).
const SHARPNESS: f32 = 0.9;

// The ellipse's semi-axes in sides of the footprint: 1/√2, at which the weights 1 − ρ² have a parallelogram's second moments.
const EWA_RADIUS: f32 = 0.70710678;
// Texels of the level read, in minor axes, and the most columns along the major axis.
const EWA_TEXEL: f32 = 0.5;
const EWA_COLUMNS: f32 = 256.0;

// Mean over the parallelogram with sides v1, v2 around the unit direction r of what counts; a = fetches.
fn mean_over_footprint(r: vec3f, v1: vec3f, v2: vec3f, most_taps: f32, texel_rad: f32) -> vec4f {
    if FILTER == FILTER_NONE {
        return open_light(r, light_from_world(r), 0.0, 1.0);
    }
    let light_r = light_from_world(r);
    if FILTER == FILTER_HARDWARE {
        let open = open_part_of_footprint(r, v1, v2);
        let filtered =
            textureSampleGrad(environment, anisotropic, light_r, light_from_world(v1), light_from_world(v2));
        return vec4f(open * filtered.rgb, 1.0);
    }
    let axes = footprint_axes(v1, v2);
    let texel = texel_width(light_r, texel_rad);
    if FILTER == FILTER_ISOTROPIC {
        let part = open_part_of_footprint(r, v1, v2);
        if part > 0.0 {
            return vec4f(part * fetch(light_r, level_of(axes.major, texel)), 1.0);
        }
        return vec4f(0.0);
    }
    if FILTER == FILTER_EWA {
        return mean_over_ellipse(r, light_r, axes, texel);
    }
    let taps = clamp(ceil(axes.major / max(SHARPNESS * axes.minor, texel)), 1.0, most_taps);
    let level = level_of(SHARPNESS * max(axes.minor, axes.major / taps), texel);
    let light_axis = light_from_world(axes.direction);
    var sum = vec4f(0.0);
    for (var k = 0.5; k < taps; k += 1.0) {
        let along = k / taps - 0.5;
        sum += open_light(r + along * axes.direction, light_r + along * light_axis, level, 1.0);
    }
    return vec4f(sum.rgb / taps, sum.a);
}

// The part of the light that counts, from four places in a footprint.
fn open_part_of_footprint(r: vec3f, v1: vec3f, v2: vec3f) -> f32 {
    let a = 0.25 * (v1 + v2);
    let b = 0.25 * (v1 - v2);
    return 0.25 * (open_part(r + a) + open_part(r - a) + open_part(r + b) + open_part(r - b));
}

// One look-up times `weight` and the part of it that counts; a = fetches. Where nothing counts nothing is read. The direction
// comes in world space and in the environment's frame: taps along a line need not be rotated one by one.
fn open_light(direction: vec3f, light_direction: vec3f, level: f32, weight: f32) -> vec4f {
    let part = weight * open_part(direction);
    if part > 0.0 {
        return vec4f(part * fetch(light_direction, level), 1.0);
    }
    return vec4f(0.0);
}

// The elliptical weighted average (Heckbert 1989) with weights 1 − ρ²: look-ups at most a texel apart all over the ellipse.
fn mean_over_ellipse(r: vec3f, light_r: vec3f, axes: FootprintAxes, texel: f32) -> vec4f {
    let width = max(max(EWA_TEXEL * axes.minor, texel), 2.0 * EWA_RADIUS * axes.major / EWA_COLUMNS);
    let level = level_of(width, texel);
    let columns = max(ceil(2.0 * EWA_RADIUS * axes.major / width), 1.0);
    let rows = max(ceil(2.0 * EWA_RADIUS * axes.minor / width), 1.0);
    let across = cross(r, axes.direction) * (axes.minor / max(axes.major, 1e-20));
    let light_axis = light_from_world(axes.direction);
    let light_across = light_from_world(across);
    var sum = vec4f(0.0);
    var weights = 0.0;
    for (var j = 0.5; j < rows; j += 1.0) {
        let y = 2.0 * j / rows - 1.0;
        for (var i = 0.5; i < columns; i += 1.0) {
            let x = 2.0 * i / columns - 1.0;
            let weight = 1.0 - x * x - y * y;
            if weight > 0.0 {
                let direction = r + EWA_RADIUS * (x * axes.direction + y * across);
                let light_direction = light_r + EWA_RADIUS * (x * light_axis + y * light_across);
                sum += open_light(direction, light_direction, level, weight);
                weights += weight;
            }
        }
    }
    return vec4f(sum.rgb / weights, sum.a);
}

// A look-up in the environment's own frame.
fn fetch(light_direction: vec3f, level: f32) -> vec3f {
    return textureSampleLevel(environment, trilinear, light_direction, level).rgb;
}
