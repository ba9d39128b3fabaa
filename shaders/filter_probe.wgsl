// Asks the adapter's anisotropic sampler for the mean over given footprints, to see whether it honours explicit
// gradients on cube maps. Rust: src/pinhole/gpu/hardware_check.rs. One fragment a probe.

struct Probe {
    direction: vec3f,
    side_1: vec3f,
    side_2: vec3f,
}

@group(0) @binding(0) var<storage, read> probes: array<Probe>;
@group(0) @binding(1) var environment: texture_cube<f32>;
@group(0) @binding(2) var anisotropic: sampler;

@vertex
fn full_screen(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return vec4f(2.0 * corner - 1.0, 0.0, 1.0);
}

@fragment
fn probe(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let p = probes[u32(position.x)];
    return textureSampleGrad(environment, anisotropic, p.direction, p.side_1, p.side_2);
}
