// What a sample sees around itself. CPU twin: src/sums/pinhole/cpu/visibility.rs; how the maps are traced and laid out:
// src/sums/pinhole/visibility.rs.

#import frame
#import gather_inputs
#import ray_origin

override VISIBILITY: bool = false;

// The index of a map on which nothing is occluded.
const UNOCCLUDED = 0xffffffffu;

// One side of a sample.
struct VisibilityMap {
    index: u32,
    // How far the texels are shifted.
    texel_jitter: vec2f,
    // The sample's frame; the last axis points to the side in question.
    axes: mat3x3f,
    // Whether rays from here tell what the map leaves in doubt.
    is_traced: bool,
    leaving: RayOrigin,
}

// The map of one side (1 or -1) of a sample with unit normal n, which has two maps where it has two sides.
fn visibility_map(first_map: u32, texel_jitter: vec2f, n: vec3f, side: f32) -> VisibilityMap {
    let frame = tangent_frame(n);
    return VisibilityMap(
        select(first_map, first_map + 1u, side < 0.0),
        texel_jitter,
        mat3x3f(frame.u, frame.v, side * n),
        false,
        RayOrigin(),
    );
}

struct MapPlace {
    texel: vec2u,
    // Of the four texels from there.
    part: vec2f,
}

fn map_place(direction: vec3f, map: VisibilityMap) -> MapPlace {
    let d = vec2f(direction.x, direction.y);
    let scale = 0.5 / (abs(d.x) + abs(d.y) + max(direction.z, 0.0));
    let place = vec2f(d.x + d.y, d.x - d.y) * scale + 0.5;
    let n = f32(uniforms.map_resolution);
    let texel = clamp(place * n - 0.5 - map.texel_jitter, vec2f(0.0), vec2f(n - 1.0));
    let first = min(vec2u(texel), vec2u(uniforms.map_resolution - 2u));
    return MapPlace(first, texel - vec2f(first));
}

// The fraction of a receiver at l, metres from the sample in world space, that the sample sees.
fn visible_fraction(l: vec3f, map: VisibilityMap) -> f32 {
    let local = l * map.axes;
    let place = map_place(local, map);
    let texels = texels_at(place, map);
    return between(texels, in_front(texels, local), place.part);
}

// Whether a footprint is mostly a lobe, wider than a texel of the maps: it sees the sky as a whole, not tap by tap.
fn is_wide_lobe(lobe: f32, change_1: vec3f, change_2: vec3f) -> bool {
    let texel2 = 6.2831853 / f32(uniforms.map_resolution * uniforms.map_resolution);
    return lobe * lobe > texel2 && is_mostly_lobe(lobe, change_1, change_2);
}

// The fraction of the sky within `width` radians around a direction, in world space, that the sample sees.
fn sky_fraction(direction: vec3f, width: f32, map: VisibilityMap) -> f32 {
    if !VISIBILITY || map.index == UNOCCLUDED {
        return 1.0;
    }
    let local = direction * map.axes;
    let place = map_place(local, map);
    let texels = width * map_density(local) * f32(uniforms.map_resolution);
    if texels > MAX_INTERPOLATED_WIDTH {
        return sky_fraction_of_square(vec2f(place.texel) + place.part + 0.5, texels, map);
    }
    let row = map.index * uniforms.map_resolution + place.texel.y;
    let upper = (sky_masks[row] >> place.texel.x) & 3u;
    let lower = (sky_masks[row + 1u] >> place.texel.x) & 3u;
    let sky = vec4f(vec4u(upper & 1u, upper >> 1u, lower & 1u, lower >> 1u));
    if upper == lower && (upper == 0u || upper == 3u) {
        return sky.x;
    }
    if map.is_traced {
        return select(1.0, 0.0, is_occluded(map.leaving, normalize(direction), 3e38));
    }
    return between(texels_at(place, map), sky, place.part);
}

// The fraction of a lobe around a mirrored direction, `width` radians wide, that comes from the visible sky.
fn lobe_fraction(direction: vec3f, width: f32, map: VisibilityMap) -> f32 {
    let local = direction * map.axes + vec3f(0.0, 0.0, LOBE_SHIFT * width);
    let place = map_place(local, map);
    let centre = vec2f(place.texel) + place.part + 0.5;
    let texels = width * map_density(local) * f32(uniforms.map_resolution);
    let core = sky_fraction_of_square(centre, max(LOBE_CORE * texels, 1.0), map);
    return mix(core, sky_fraction_of_square(centre, max(LOBE_TAIL * texels, 1.0), map), LOBE_TAIL_SHARE);
}

// Edge lengths of a map per radian around a direction in the sample's frame: a texel of n^2 subtends 2(|x| + |y| + z)^3 / n^2 sr.
fn map_density(local: vec3f) -> f32 {
    let norm = (abs(local.x) + abs(local.y) + max(local.z, 0.0)) * inverseSqrt(dot(local, local));
    return inverseSqrt(2.0 * norm * norm * norm);
}

// The part of a square of a map that sees the environment, estimated from eight lines across it. The square is clipped to the map: a
// lobe's energy is that above the horizon. The centre and the width are in texels.
fn sky_fraction_of_square(centre: vec2f, width: f32, map: VisibilityMap) -> f32 {
    let n = uniforms.map_resolution;
    let first = max(centre - 0.5 * width, vec2f(0.0));
    let last = min(centre + 0.5 * width, vec2f(f32(n)));
    let step = (last.y - first.y) / 8.0;
    let upper = sky_masks_at(first.y + step * vec4f(0.5, 1.5, 2.5, 3.5), map);
    let lower = sky_masks_at(first.y + step * vec4f(4.5, 5.5, 6.5, 7.5), map);
    let sky = sky_texels_before(upper, last.x) + sky_texels_before(lower, last.x) - sky_texels_before(upper, first.x) - sky_texels_before(lower, first.x);
    return dot(sky, vec4f(0.125)) / (last.x - first.x);
}

fn sky_masks_at(rows: vec4f, map: VisibilityMap) -> vec4u {
    let at = map.index * uniforms.map_resolution + min(vec4u(rows), vec4u(uniforms.map_resolution - 1u));
    return vec4u(sky_masks[at.x], sky_masks[at.y], sky_masks[at.z], sky_masks[at.w]);
}

// Texels of rows that see the environment, up to a place from 0 to 32; a partly covered texel counts in proportion.
fn sky_texels_before(masks: vec4u, place: f32) -> vec4f {
    let whole = u32(place);
    if whole >= 32u {
        return vec4f(countOneBits(masks));
    }
    let texels = (masks >> vec4u(whole)) & vec4u(1u);
    return vec4f(countOneBits(masks & vec4u((1u << whole) - 1u))) + fract(place) * vec4f(texels);
}

// Four texels: of two rows, two each.
fn texels_at(place: MapPlace, map: VisibilityMap) -> mat4x4f {
    let n = uniforms.map_resolution;
    let first = (map.index * n + place.texel.y) * n + place.texel.x;
    return mat4x4f(planes[first], planes[first + 1u], planes[first + n], planes[first + n + 1u]);
}

// Which texels' planes a point lies in front of.
fn in_front(texels: mat4x4f, local: vec3f) -> vec4f {
    return select(vec4f(0.0), vec4f(1.0), vec4f(local, -1.0) * texels <= vec4f(1.0));
}

// Interpolates four values, each of which gives way to the next where its texel says.
fn between(texels: mat4x4f, values: vec4f, part: vec2f) -> f32 {
    let top = mix(values.x, values.y, across(texels[0], part.x, 8u));
    let bottom = mix(values.z, values.w, across(texels[2], part.x, 8u));
    return mix(top, bottom, mix(across(texels[0], part.y, 0u), across(texels[1], part.y, 0u), part.x));
}

// How far past the edge between a texel and the next, from 0 to 1; `part` of the way there.
fn across(texel: vec4f, part: f32, shift: u32) -> f32 {
    let bits = bitcast<u32>(texel.w) >> shift;
    let edge = f32((bits >> 2u) & 63u) / 64.0;
    let half_width = 0.125 * f32(1u << (bits & 3u));
    let low = max(edge - half_width, 0.0);
    let high = min(edge + half_width, 1.0);
    return saturate((part - low) / (high - low));
}
