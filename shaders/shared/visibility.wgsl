// What a sample sees around itself. CPU twin: src/pinhole/cpu/visibility.rs; how the maps are traced and laid out:
// src/pinhole/visibility.rs.

#import gather_inputs

override VISIBILITY: bool = false;

// One side of a sample.
struct VisibilityMap {
    index: u32,
    // How far the texels are shifted.
    texel_jitter: vec2f,
    // The sample's frame; the last axis points to the side in question.
    axes: mat3x3f,
}

// The map of one side (1 or -1) of a sample with unit normal n, which has two maps where it has two sides.
fn visibility_map(first_map: u32, texel_jitter: vec2f, n: vec3f, side: f32) -> VisibilityMap {
    let frame = tangent_frame(n);
    return VisibilityMap(
        select(first_map, first_map + 1u, side < 0.0),
        texel_jitter,
        mat3x3f(frame.u, frame.v, side * n),
    );
}

struct TangentFrame {
    u: vec3f,
    v: vec3f,
}

// Two unit tangents (Duff et al. 2017, Building an Orthonormal Basis, Revisited).
fn tangent_frame(n: vec3f) -> TangentFrame {
    let sign = select(1.0, -1.0, n.z < 0.0);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    return TangentFrame(vec3f(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), vec3f(b, sign + n.y * n.y * a, -n.y));
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

// The fraction of the sky around a direction, in world space, that the sample sees.
fn sky_fraction(direction: vec3f, map: VisibilityMap) -> f32 {
    if !VISIBILITY {
        return 1.0;
    }
    let place = map_place(direction * map.axes, map);
    let row = map.index * uniforms.map_resolution + place.texel.y;
    let upper = (sky_masks[row] >> place.texel.x) & 3u;
    let lower = (sky_masks[row + 1u] >> place.texel.x) & 3u;
    let sky = vec4f(vec4u(upper & 1u, upper >> 1u, lower & 1u, lower >> 1u));
    if upper == lower && (upper == 0u || upper == 3u) {
        return sky.x;
    }
    return between(texels_at(place, map), sky, place.part);
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
