// Emitters before the environment: the texels of a face of the cube map, from the points of each that show emitters and from what lies
// behind. CPU twin: `blend` in src/sums/environment/rasterization.rs.

#import cube

struct LitFace {
    face: u32,
    // Points along a texel's edge; 0: the face shows no emitter.
    points: u32,
    // From the background's texels to this cube's.
    background_factor: f32,
}

@group(0) @binding(0) var<uniform> lit_face: LitFace;
// Numbers of emitters, from 1 on; 0: the background.
@group(0) @binding(1) var emitter_numbers: texture_2d<u32>;
@group(0) @binding(2) var background: texture_cube<f32>;
@group(0) @binding(3) var trilinear: sampler;
// Of each emitter, over the radiance scale.
@group(0) @binding(4) var<storage, read> emitter_radiance: array<vec4f>;
@group(0) @binding(5) var lit: texture_storage_2d_array<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn light_texels(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(lit).x;
    if any(id.xy >= vec2u(size)) {
        return;
    }
    // The texel's centre: the texel itself is looked up.
    let st = (2.0 * vec2f(id.xy) + 1.0) / f32(size) - 1.0;
    let direction = from_cube(OnCube(lit_face.face, st));
    let behind = lit_face.background_factor * textureSampleLevel(background, trilinear, direction, 0.0).rgb;
    var sum = vec3f(0.0);
    var drawn = 0.0;
    for (var k = 0u; k < lit_face.points * lit_face.points; k++) {
        let point = lit_face.points * id.xy + vec2u(k % lit_face.points, k / lit_face.points);
        let number = textureLoad(emitter_numbers, point, 0).x;
        if number > 0u {
            sum += emitter_radiance[number - 1u].rgb;
            drawn += 1.0;
        }
    }
    let count = max(f32(lit_face.points * lit_face.points), 1.0);
    textureStore(lit, id.xy, lit_face.face, vec4f((sum + (count - drawn) * behind) / count, 1.0));
}
