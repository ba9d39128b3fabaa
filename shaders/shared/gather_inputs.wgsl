// What every gather reads: its parameters, the light and what samples see and reflect. CPU twin: src/sums/pinhole/cpu/mod.rs;
// Rust layouts: src/sums/pinhole/layout.rs, src/render/pinhole/gpu/near_light.rs, src/render/pinhole/gpu/medium.rs.

#import constants
#import beam

// From where surroundings are seen.
struct Viewpoints {
    count: u32,
    // What planes are to be multiplied by.
    plane_scale: f32,
    // w = one over the distance of the nearest surface, 1/m.
    places: array<vec4f, MAX_VIEWPOINTS>,
    // Normals of the surfaces that they lie on; zero where it does not matter.
    normals: array<vec4f, MAX_VIEWPOINTS>,
}

// What lies between cells and receivers; see src/base/scene/medium.rs.
struct Medium {
    // 1/m
    extinction: vec3f,
    // Mean cosine of the angle by which light is scattered.
    g: f32,
    // 1: it also lies between lamps and mirrors.
    lamps_in_medium: u32,
    // Bounds of the environment's mean along arcs, by powers of two of their lengths up to 1 radian.
    max_along_arcs: array<vec4f, ARC_STEP_VECTORS>,
}

struct GatherUniforms {
    sample_count: u32,
    taps: u32,
    attenuation: u32,
    own_scale: f32,
    epsilon_scale: f32,
    epsilon: f32,
    texel_rad: f32,
    radiance_scale: f32,
    map_resolution: u32,
    // Of the environment's rotation about +Y.
    rotation_cos: f32,
    rotation_sin: f32,
    // See CellShapes in src/sums/pinhole/cell_shapes.rs.
    reach: f32,
    cell_area: f32,
    // Never read where it is not the light.
    lamp: Lamp,
    viewpoints: Viewpoints,
    // Never read where there is none.
    medium: Medium,
}

// What the light is: LIGHT_ENVIRONMENT and so on.
override LIGHT: u32 = LIGHT_ENVIRONMENT;

@group(0) @binding(0) var<uniform> uniforms: GatherUniforms;
@group(0) @binding(1) var environment: texture_cube<f32>;
@group(0) @binding(2) var trilinear: sampler;
@group(0) @binding(3) var anisotropic: sampler;
// Reflectance by the cosine of the angle of incidence, from 0 to 1, CURVE_POINTS for each curve.
@group(0) @binding(4) var<storage, read> curves: array<vec4f>;
// The samples' visibility maps; never read without VISIBILITY.
@group(0) @binding(5) var<storage, read> planes: array<vec4f>;
@group(0) @binding(6) var<storage, read> sky_masks: array<u32>;
// The slide of a lamp's beam.
@group(0) @binding(7) var slide: texture_2d<f32>;
// The views of surroundings.
@group(0) @binding(8) var view_radiance: texture_cube_array<f32>;
// The planes of what is seen, 1/m: unit normals, away from the viewpoint, over the planes' distances.
@group(0) @binding(9) var view_planes: texture_cube_array<f32>;

// A world direction in the environment's own frame: R_y(-rotation). The cube and its bounds are looked up there; what a sample
// sees of the sky stays in world space.
fn light_from_world(d: vec3f) -> vec3f {
    let c = uniforms.rotation_cos;
    let s = uniforms.rotation_sin;
    return vec3f(c * d.x - s * d.z, d.y, s * d.x + c * d.z);
}

// 1/l², kept finite. Without branches: on drivers without real ones every lane would take both.
fn attenuation(l2: f32, area: f32, same_object: bool) -> f32 {
    let min_l2 = select(0.0, uniforms.own_scale * area, same_object);
    let inverse = 1.0 / max(l2 + uniforms.epsilon_scale * area + uniforms.epsilon, min_l2);
    return select(1.0, inverse, uniforms.attenuation != 0u);
}

// Upper bound of the attenuation for any pair of objects.
fn max_attenuation(l2: f32, area: f32) -> f32 {
    let inverse = 1.0 / max(l2 + uniforms.epsilon_scale * area + uniforms.epsilon, 1e-20);
    return select(1.0, inverse, uniforms.attenuation != 0u);
}

// Reflectance at a cosine of the angle of incidence: `constant`, unless there is a curve.
fn reflectance(constant: vec3f, curve: u32, cosine: f32) -> vec3f {
    // The same for all lanes.
    if curve == NO_CURVE {
        return constant;
    }
    let place = min(cosine, 1.0) * f32(CURVE_POINTS - 1u);
    let first = min(u32(place), CURVE_POINTS - 2u);
    let start = curve * CURVE_POINTS + first;
    return mix(curves[start].rgb, curves[start + 1u].rgb, place - f32(first));
}
