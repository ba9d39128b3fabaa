// The scene's homogeneous medium: it attenuates light between cells and receivers, and receivers may be parts of camera rays through
// it, where it scatters light towards the viewer. In scenes without one, no_medium.wgsl is imported in its place. CPU twins:
// src/sums/pinhole/cpu/medium.rs, and src/sums/pinhole/cpu/pair.rs for the footprints of parts of rays.

#import footprint
#import gather_inputs
#import interface
#import receivers

// Whether an object's index says that receivers are parts of rays.
fn is_part_of_ray(object: i32) -> bool {
    return object == i32(MEDIUM_OBJECT);
}

// A receiver as it was loaded, or a part of a ray: instead of a normal it comes with the way from its one end to the other.
fn with_length(loaded: Receiver) -> Receiver {
    var receiver = loaded;
    if is_part_of_ray(loaded.object) {
        receiver.length = length(loaded.normal);
        receiver.normal = loaded.normal / max(receiver.length, 1.2e-38);
    }
    return receiver;
}

// From the middle of a part of a ray to its end.
fn half_part(receiver: Receiver) -> vec3f {
    return 0.5 * receiver.length * receiver.normal;
}

// The cosine at a receiver, times l; parts of rays receive light from everywhere.
fn cos_at_receiver_l(d: vec3f, l: f32, receiver: Receiver) -> f32 {
    return select(dot(d, receiver.normal), l, is_part_of_ray(receiver.object));
}

// How far the direction of the light turns from one end of a part of a ray to the other: the light that crosses it comes from a strip
// of directions.
fn turn_along_part(
    receiver: Receiver, d: vec3f, n: vec3f, inverse_l: f32, r: vec3f, crossing: Crossing, is_crossed: bool,
) -> vec3f {
    let moved = -receiver.length * receiver.normal;
    if is_crossed {
        return crossed_side(crossing, moved, vec3f(0.0), d * inverse_l, n, inverse_l);
    }
    let mirrored = moved - 2.0 * dot(moved, n) * n;
    return (mirrored - dot(r, mirrored) * r) * inverse_l;
}

// Whether footprints have a third side.
fn has_side(third: vec3f) -> bool {
    return any(third != vec3f(0.0));
}

// A footprint blurred by a lobe, and spread along a third side: a parallelogram with the second moments of all together.
fn widened(sides: FootprintSides, r: vec3f, n: vec3f, widths: vec2f, third: vec3f) -> FootprintSides {
    let m = blurred_moments(sides, r, n, widths);
    let along = vec2f(dot(third, m.e1), dot(third, m.e2));
    let m11 = m.m11 + along.x * along.x;
    let m12 = m.m12 + along.x * along.y;
    let m22 = m.m22 + along.y * along.y;
    // One side along the third one, which is often the longest, and one across it: sides with these moments.
    let squared = dot(along, along);
    let is_short = squared <= 1e-10 * (m11 + m22);
    let axis = select(along * inverseSqrt(max(squared, 1.2e-38)), vec2f(1.0, 0.0), is_short);
    let moment = vec2f(m11 * axis.x + m12 * axis.y, m12 * axis.x + m22 * axis.y);
    let side = moment * inverseSqrt(max(dot(moment, axis), 1.2e-38));
    let off = side.y * axis.x - side.x * axis.y;
    let across2 = m11 * axis.y * axis.y - 2.0 * m12 * axis.x * axis.y + m22 * axis.x * axis.x;
    let across = sqrt(max(across2 - off * off, 0.0));
    return FootprintSides(side.x * m.e1 + side.y * m.e2, across * (axis.x * m.e2 - axis.y * m.e1));
}

fn transmittance(distance: f32) -> vec3f {
    return exp(-distance * uniforms.medium.extinction);
}

// The part of a cell's light that comes through the medium and, for a part of a ray, 4π times the phase function.
fn passed_medium(d: vec3f, l: f32, dn: f32, is_of_interface: bool, receiver: Receiver) -> vec3f {
    var factor = vec3f(1.0);
    // In front of an interface there is no medium.
    if !is_of_interface || dn > 0.0 {
        factor = transmittance(l);
    }
    if is_part_of_ray(receiver.object) {
        factor *= relative_phase(-dot(d, receiver.normal) / l);
    }
    return factor;
}

// The part of a lamp's light that comes through the medium to a cell.
fn passed_from_lamp(distance: f32, is_of_interface: bool) -> vec3f {
    if uniforms.medium.lamps_in_medium == 0u || is_of_interface {
        return vec3f(1.0);
    }
    return transmittance(distance);
}

// 4π times the phase function (Henyey and Greenstein 1941) at the cosine of the angle by which light is turned: 1 where light is
// scattered evenly.
fn relative_phase(cosine: f32) -> f32 {
    let g = uniforms.medium.g;
    let squared = max(1.0 + g * g - 2.0 * g * cosine, 1e-9);
    return select((1.0 - g * g) / (squared * sqrt(squared)), 1.0, g == 0.0);
}

// The largest of these where light is turned by the angle of a cosine, or by one that differs so much from it, radians.
fn max_relative_phase(cosine: f32, angle: f32) -> f32 {
    let own = acos(clamp(cosine, -1.0, 1.0));
    // It falls from one end to the other.
    let brightest = select(min(own + angle, WHOLE_SPHERE_RAD), max(own - angle, 0.0), uniforms.medium.g > 0.0);
    return relative_phase(cos(brightest));
}

// How much faster than directions the phase function changes with them.
fn phase_slope() -> f32 {
    return 1.0 / (1.0 - abs(uniforms.medium.g));
}

// Upper bound of what the medium scatters of a cell's light at a part of a ray, for a cell of this relative size; and the part of it by
// which that differs within the cell, scaled as an error.
fn scattered_within(d: vec3f, inverse_l: f32, receiver: Receiver, size: f32) -> vec2f {
    let cosine = -dot(d, receiver.normal) * inverse_l;
    let maximum = max_relative_phase(cosine, size);
    return vec2f(maximum, (maximum - relative_phase(cosine)) / maximum * CONTRAST_ERROR_SCALE);
}

// Upper bound of what the medium leaves of light over this distance or a longer one, in any channel.
fn max_transmittance(distance: f32) -> f32 {
    let extinction = uniforms.medium.extinction;
    return exp(-min(extinction.r, min(extinction.g, extinction.b)) * max(distance, 0.0));
}

// How bright the environment's mean along an arc of such a length, radians, is at most in any channel. CPU twin:
// src/sums/environment/strips.rs.
fn max_along_arc(length: f32) -> f32 {
    // The exponent of the next power of two below.
    let exponent = i32(bitcast<u32>(length) >> 23u) - 127;
    let step = min(exponent, 0) + i32(ARC_STEPS) - 1;
    if step < 0 {
        return 3e38;
    }
    return uniforms.medium.max_along_arcs[step / 4][step % 4];
}
