// Nothing but look-ups: directions and levels that wander as those of one pixel do from sample to sample.

struct Uniforms { count: u32, level: f32, level_spread: f32, padding: u32 }
@group(0) @binding(0) var<uniform> uniforms: Uniforms;
@group(0) @binding(1) var environment: texture_cube<f32>;
@group(0) @binding(2) var trilinear: sampler;

@vertex
fn full_screen(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return vec4f(2.0 * corner - 1.0, 0.0, 1.0);
}

@fragment
fn bare(@builtin(position) position: vec4f) -> @location(0) vec4f {
    var sum = vec4f(0.0);
    var angle = position.y * 0.37;
    for (var i = 0u; i < uniforms.count; i++) {
        angle += 0.61;
        let direction = vec3f(fract(angle * 0.065) * 2.0 - 1.0 + 0.004 * position.x, 0.7, fract(angle * 0.145) * 2.0 - 1.0);
        sum += textureSampleLevel(environment, trilinear, direction, uniforms.level + uniforms.level_spread * fract(angle * 0.31 + 0.01 * position.x));
    }
    return sum;
}
