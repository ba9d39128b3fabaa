// Receiver points, as textures give them.

#import constants

@group(1) @binding(0) var receiver_position: texture_2d<f32>;
@group(1) @binding(1) var receiver_normal: texture_2d<f32>;

struct Receiver {
    position: vec3f,
    // Negative: there is none.
    object: i32,
    normal: vec3f,
    // Towards the viewer; only with SHADING.
    view: vec3f,
    // The fourth component of the normal.
    normal_w: f32,
    // Of a part of a ray through a medium, metres, whose normal is the unit direction towards the viewer; else 0.
    length: f32,
}

fn load_receiver(pixel: vec2u) -> Receiver {
    let position = textureLoad(receiver_position, pixel, 0);
    // Rounded: a rasteriser's interpolation may leave 0.9999999.
    let object = select(i32(position.w + 0.5), -1, position.w < 0.0);
    let normal = textureLoad(receiver_normal, pixel, 0);
    return Receiver(position.xyz, object, normal.xyz, vec3f(0.0), normal.w, 0.0);
}
