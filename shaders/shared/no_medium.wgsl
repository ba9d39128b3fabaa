// The interface of medium.wgsl in scenes without a medium: drivers need not compile the rest.

#import footprint
#import interface
#import receivers

fn is_part_of_ray(object: i32) -> bool {
    return false;
}

fn with_length(loaded: Receiver) -> Receiver {
    return loaded;
}

fn half_part(receiver: Receiver) -> vec3f {
    return vec3f(0.0);
}

fn cos_at_receiver_l(d: vec3f, l: f32, receiver: Receiver) -> f32 {
    return dot(d, receiver.normal);
}

fn turn_along_part(
    receiver: Receiver, d: vec3f, n: vec3f, inverse_l: f32, r: vec3f, crossing: Crossing, is_crossed: bool,
) -> vec3f {
    return vec3f(0.0);
}

fn has_side(third: vec3f) -> bool {
    return false;
}

fn widened(sides: FootprintSides, r: vec3f, n: vec3f, widths: vec2f, third: vec3f) -> FootprintSides {
    return blurred(sides, r, n, widths);
}

fn passed_medium(d: vec3f, l: f32, dn: f32, is_of_interface: bool, receiver: Receiver) -> vec3f {
    return vec3f(1.0);
}

fn passed_from_lamp(distance: f32, is_of_interface: bool) -> vec3f {
    return vec3f(1.0);
}

fn max_relative_phase(cosine: f32, angle: f32) -> f32 {
    return 1.0;
}

fn phase_slope() -> f32 {
    return 1.0;
}

fn scattered_within(d: vec3f, inverse_l: f32, receiver: Receiver, size: f32) -> vec2f {
    return vec2f(1.0, 0.0);
}

fn max_transmittance(distance: f32) -> f32 {
    return 1.0;
}

fn max_along_arc(length: f32) -> f32 {
    return 3e38;
}
