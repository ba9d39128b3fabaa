// What a sample sees around itself. CPU twin: src/pinhole/cpu/visibility.rs; how the maps are made and laid out:
// src/pinhole/visibility.rs.
//
// The importing pass declares `planes` and `open_rows`.

override VISIBILITY: bool = false;

struct Surroundings {
    map: u32,
    resolution: u32,
    // Texel coordinates of the map's corner.
    phase: vec2f,
    // The sample's frame; the last points to the side in question.
    axes: mat3x3f,
}

var<private> surroundings: Surroundings;

// Looks around on one side (1 or -1) of a sample with unit normal n and two maps where it has two sides.
fn look_around(first_map: u32, phase: vec2f, resolution: u32, n: vec3f, side: f32) {
    let sign = select(1.0, -1.0, n.z < 0.0);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    let axes = mat3x3f(
        vec3f(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        vec3f(b, sign + n.y * n.y * a, -n.y),
        side * n,
    );
    surroundings = Surroundings(select(first_map, first_map + 1u, side < 0.0), resolution, phase, axes);
}

struct MapPlace {
    texel: vec2u,
    // Of the four texels from there.
    part: vec2f,
}

fn map_place(direction: vec3f) -> MapPlace {
    let d = vec2f(direction.x, direction.y);
    let scale = 0.5 / (abs(d.x) + abs(d.y) + max(direction.z, 0.0));
    let place = vec2f(d.x + d.y, d.x - d.y) * scale + 0.5;
    let n = f32(surroundings.resolution);
    let texel = clamp(place * n - 0.5 - surroundings.phase, vec2f(0.0), vec2f(n - 1.0));
    let first = min(vec2u(texel), vec2u(surroundings.resolution - 2u));
    return MapPlace(first, texel - vec2f(first));
}

// The part of a receiver at l, metres from the sample on in world space, that the sample sees.
fn visible_part(l: vec3f) -> f32 {
    let local = l * surroundings.axes;
    let place = map_place(local);
    let texels = texels_at(place);
    return between(texels, in_front(texels, local), place.part);
}

// The part of the environment around a direction, in world space, that is not hidden from the sample.
fn seen_part_of_environment(direction: vec3f) -> f32 {
    let place = map_place(direction * surroundings.axes);
    let row = surroundings.map * surroundings.resolution + place.texel.y;
    let upper = (open_rows[row] >> place.texel.x) & 3u;
    let lower = (open_rows[row + 1u] >> place.texel.x) & 3u;
    let open = vec4f(vec4u(upper & 1u, upper >> 1u, lower & 1u, lower >> 1u));
    if upper == lower && (upper == 0u || upper == 3u) {
        return open.x;
    }
    return between(texels_at(place), open, place.part);
}

// Four texels: of two rows, two each.
fn texels_at(place: MapPlace) -> mat4x4f {
    let n = surroundings.resolution;
    let first = (surroundings.map * n + place.texel.y) * n + place.texel.x;
    return mat4x4f(planes[first], planes[first + 1u], planes[first + n], planes[first + n + 1u]);
}

// In front of the planes of which of them a place is.
fn in_front(texels: mat4x4f, local: vec3f) -> vec4f {
    return select(vec4f(0.0), vec4f(1.0), vec4f(local, -1.0) * texels <= vec4f(1.0));
}

// What lies between four values, each of which gives way to the next where its texel says.
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
