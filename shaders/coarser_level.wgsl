// A level of a cube map from the next finer one: means over 2×2 texels, weighted by solid angle. CPU twin: `downsample` in
// src/sums/environment/cube.rs.

@group(0) @binding(0) var finer: texture_2d_array<f32>;
@group(0) @binding(1) var coarser: texture_storage_2d_array<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn average(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(coarser).x;
    if any(id.xy >= vec2u(size)) {
        return;
    }
    var sum = vec3f(0.0);
    var weights = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let texel = 2u * id.xy + vec2u(k & 1u, k >> 1u);
        let weight = solid_angle(texel, 2u * size);
        sum += weight * textureLoad(finer, texel, id.z, 0).rgb;
        weights += weight;
    }
    textureStore(coarser, id.xy, id.z, vec4f(sum / weights, 1.0));
}

// The solid angle of a texel over its area on the face: Gauss's quadrature of 1/|d|³ by 2×2 points.
fn solid_angle(texel: vec2u, size: u32) -> f32 {
    var sum = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let within = 0.5 + 0.5 * 0.57735027 * select(vec2f(-1.0), vec2f(1.0), vec2u(k & 1u, k >> 1u) == vec2u(1u));
        let st = 2.0 * (vec2f(texel) + within) / f32(size) - 1.0;
        sum += pow(1.0 + dot(st, st), -1.5);
    }
    return 0.25 * sum;
}
