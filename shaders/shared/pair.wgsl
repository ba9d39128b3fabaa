// A sample and a receiver: what does not depend on the light. CPU twin: src/pinhole/cpu/mod.rs; Rust layout of the uniforms:
// src/pinhole/layout.rs.
//
// The importing pass declares `uniforms: GatherUniforms`, and `curves`: reflectance by the cosine of the angle of incidence,
// from 0 to 1, CURVE_POINTS for each curve.

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
}

const CURVE_POINTS: u32 = 128u;

// A world direction in the environment's own frame: R_y(-rotation). The cube and its bounds are looked up there; what a sample
// sees of the sky stays in world space.
fn light_from_world(d: vec3f) -> vec3f {
    let c = uniforms.rotation_cos;
    let s = uniforms.rotation_sin;
    return vec3f(c * d.x - s * d.z, d.y, s * d.x + c * d.z);
}

// 1/l², kept finite (WS-7). Without branches: drivers without real ones would go through all.
fn attenuation(l2: f32, area: f32, same_object: bool) -> f32 {
    let least = select(0.0, uniforms.own_scale * area, same_object);
    let inverse = 1.0 / max(l2 + uniforms.epsilon_scale * area + uniforms.epsilon, least);
    return select(1.0, inverse, uniforms.attenuation != 0u);
}

// What is mirrored at a cosine of the angle of incidence: `constant`, unless its w is the number of a curve, from 1.
fn reflectance(constant: vec4f, cosine: f32) -> vec3f {
    // The same for all lanes.
    if constant.w == 0.0 {
        return constant.rgb;
    }
    let place = min(cosine, 1.0) * f32(CURVE_POINTS - 1u);
    let first = min(u32(place), CURVE_POINTS - 2u);
    let start = (u32(constant.w) - 1u) * CURVE_POINTS + first;
    return mix(curves[start].rgb, curves[start + 1u].rgb, place - f32(first));
}
