// Bounds of the light, computed on the GPU for light that changes: pyramids of extremes of the cube and of its mips. Every texel
// covers its 3×3 neighbourhood, across the faces' seams, so that one read bounds a cone. CPU twin: src/sums/environment/bounds.rs.
//
// A pyramid's finest level and the extremes of the next one are read from the cube; all others from the extremes of the level above.

#import constants
#import cube

struct BoundsUniforms {
    // Texels along the edge of the level that is made.
    size: u32,
    // The first of its extremes, and of those of the level above; a pair of vectors each.
    first: u32,
    first_above: u32,
    // Texels of the cube's mip along an edge, for each of the finest level.
    detail: u32,
    // The mip of the cube that is bounded.
    mip: u32,
    radiance_scale: f32,
}

@group(0) @binding(0) var<uniform> level: BoundsUniforms;
@group(0) @binding(1) var environment: texture_cube<f32>;
@group(0) @binding(2) var nearest: sampler;
// Least and greatest radiance, by turns.
@group(0) @binding(3) var<storage, read_write> extremes: array<vec4f>;
@group(1) @binding(0) var bounds: texture_storage_2d_array<rg32float, write>;

struct Extremes {
    low: vec3f,
    high: vec3f,
}

fn join(a: Extremes, b: Extremes) -> Extremes {
    return Extremes(min(a.low, b.low), max(a.high, b.high));
}

// The extremes of a square of texels of the cube's mip, `edge` wide, in units of them.
fn extremes_of_cube(face: u32, first: vec2u, edge: u32, size: u32) -> Extremes {
    var all = Extremes(vec3f(3e38), vec3f(-3e38));
    for (var k = 0u; k < edge * edge; k++) {
        let texel = vec2f(first + vec2u(k % edge, k / edge)) + 0.5;
        let direction = from_cube(OnCube(face, 2.0 * texel / f32(size) - 1.0));
        let radiance = level.radiance_scale * textureSampleLevel(environment, nearest, direction, f32(level.mip)).rgb;
        all = join(all, Extremes(radiance, radiance));
    }
    return all;
}

// The texel of a level beside a face's edge, or within the face.
fn across_seams(face: u32, texel: vec2i, size: u32) -> OnCube {
    let centre = 2.0 * (vec2f(texel) + 0.5) / f32(size) - 1.0;
    let outside = vec2<bool>(texel < vec2i(0)) | vec2<bool>(texel >= vec2i(i32(size)));
    let pushed = clamp(centre, vec2f(-1.0), vec2f(1.0)) * select(vec2f(0.9999), vec2f(1.0001), outside);
    return on_cube(from_cube(OnCube(face, pushed)));
}

fn texel_of(on: OnCube, size: u32) -> vec2u {
    return min(vec2u((0.5 * on.st + 0.5) * f32(size)), vec2u(size - 1u));
}

fn store_bound(texel: vec3u, all: Extremes) {
    let contrast = all.high - all.low;
    let bound = vec2f(max(all.high.r, max(all.high.g, all.high.b)), max(contrast.r, max(contrast.g, contrast.b)));
    textureStore(bounds, texel.xy, texel.z, vec4f(bound, 0.0, 0.0));
}

// Whether a neighbour lies beyond a corner of the cube, where there is none: two others cover what is around it.
fn is_beyond_corner(texel: vec2i, size: u32) -> bool {
    return all((texel < vec2i(0)) | (texel >= vec2i(i32(size))));
}

// The extremes of a texel and its neighbours; those of the finest level are in the cube.
fn around(texel: vec3u, of_cube: bool) -> Extremes {
    let size = level.size;
    var all = Extremes(vec3f(3e38), vec3f(-3e38));
    for (var k = 0; k < 9; k++) {
        let near = vec2i(texel.xy) + vec2i(k % 3 - 1, k / 3 - 1);
        if is_beyond_corner(near, size) {
            continue;
        }
        let on = across_seams(texel.z, near, size);
        let there = texel_of(on, size);
        if of_cube {
            all = join(all, extremes_of_cube(on.face, level.detail * there, level.detail, size * level.detail));
        } else {
            all = join(all, stored(level.first, vec3u(there, on.face), size));
        }
    }
    return all;
}

// The finest level.
@compute @workgroup_size(BOUNDS_WORKGROUP_EDGE, BOUNDS_WORKGROUP_EDGE)
fn bound_cube(@builtin(global_invocation_id) texel: vec3u) {
    if all(texel.xy < vec2u(level.size)) {
        store_bound(texel, around(texel, true));
    }
}

// The extremes of the level below the finest one.
@compute @workgroup_size(BOUNDS_WORKGROUP_EDGE, BOUNDS_WORKGROUP_EDGE)
fn downsample_cube(@builtin(global_invocation_id) texel: vec3u) {
    let size = level.size;
    if any(texel.xy >= vec2u(size)) {
        return;
    }
    let edge = 2u * level.detail;
    store_extremes(texel, extremes_of_cube(texel.z, edge * texel.xy, edge, size * edge));
}

// The extremes of any level below that.
@compute @workgroup_size(BOUNDS_WORKGROUP_EDGE, BOUNDS_WORKGROUP_EDGE)
fn downsample(@builtin(global_invocation_id) texel: vec3u) {
    if any(texel.xy >= vec2u(level.size)) {
        return;
    }
    var all = Extremes(vec3f(3e38), vec3f(-3e38));
    for (var k = 0u; k < 4u; k++) {
        let above = vec3u(2u * texel.xy + vec2u(k & 1u, k >> 1u), texel.z);
        all = join(all, stored(level.first_above, above, 2u * level.size));
    }
    store_extremes(texel, all);
}

// Any level but the finest.
@compute @workgroup_size(BOUNDS_WORKGROUP_EDGE, BOUNDS_WORKGROUP_EDGE)
fn bound(@builtin(global_invocation_id) texel: vec3u) {
    if all(texel.xy < vec2u(level.size)) {
        store_bound(texel, around(texel, false));
    }
}

fn place(texel: vec3u, size: u32) -> u32 {
    return 2u * ((texel.z * size + texel.y) * size + texel.x);
}

fn store_extremes(texel: vec3u, all: Extremes) {
    let at = level.first + place(texel, level.size);
    extremes[at] = vec4f(all.low, 0.0);
    extremes[at + 1u] = vec4f(all.high, 0.0);
}

fn stored(first: u32, texel: vec3u, size: u32) -> Extremes {
    let at = first + place(texel, size);
    return Extremes(extremes[at].rgb, extremes[at + 1u].rgb);
}
