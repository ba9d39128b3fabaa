// Emitters as a face of the environment's cube map sees them from its centre, with a z-buffer: the number of the nearest at each point.
// CPU twin: src/sums/environment/rasterization.rs.

struct EmitterUniforms {
    // Depth is 0 at infinity.
    clip_from_mesh: mat4x4f,
    // From 1 on.
    number: u32,
}

@group(0) @binding(0) var<uniform> emitter: EmitterUniforms;

@vertex
fn place(@location(0) position: vec3f) -> @builtin(position) vec4f {
    return emitter.clip_from_mesh * vec4f(position, 1.0);
}

@fragment
fn number() -> @location(0) u32 {
    return emitter.number;
}
