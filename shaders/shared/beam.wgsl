// Lamps and their beams. CPU twin: src/base/scene/lamp.rs. The importing shader declares `slide`, a texture with the slide of its lamp.

#import constants

// A lamp; see src/base/scene/lamp.rs.
struct Lamp {
    position: vec3f,
    radius: f32,
    // Of its disc where its beam is brightest, W/(m²·sr).
    radiance: vec3f,
    // No channel has more from anywhere.
    max_radiance: f32,
    // Along the axis of its beam, away from it; unit length.
    direction: vec3f,
    // From there to the edge of the beam, radians.
    half_angle: f32,
    // Up in its slide.
    up: vec3f,
    softness: f32,
    // BEAM_NONE and so on.
    beam: u32,
}

// The part of a lamp's light that its beam lets pass in a unit direction away from it.
fn beam_transmittance(lamp: Lamp, direction: vec3f) -> vec3f {
    if lamp.beam == BEAM_NONE {
        return vec3f(1.0);
    }
    let along = dot(direction, lamp.direction);
    if along <= 0.0 {
        return vec3f(0.0);
    }
    if lamp.beam == BEAM_CONE {
        let angle = atan2(length(cross(direction, lamp.direction)), along);
        let t = saturate((lamp.half_angle - angle) / max(lamp.softness * lamp.half_angle, 1e-6));
        return vec3f(t * t * (3.0 - 2.0 * t));
    }
    let right = cross(lamp.direction, lamp.up);
    let scale = 1.0 / (along * tan(lamp.half_angle));
    return slide_at(scale * vec2f(dot(direction, right), dot(direction, lamp.up)));
}

// The slide at a place, bilinear: the upper edge is at y = 1, the right one at x = width / height. Black outside.
fn slide_at(place: vec2f) -> vec3f {
    let size = vec2f(textureDimensions(slide));
    let at = vec2f(0.5 * (place.x * size.y + size.x), 0.5 * (1.0 - place.y) * size.y);
    if !(all(at >= vec2f(0.0)) && all(at <= size)) {
        return vec3f(0.0);
    }
    let inside = max(at - 0.5, vec2f(0.0));
    let low = vec2u(inside);
    let part = inside - vec2f(low);
    let high = min(low + 1u, vec2u(size) - 1u);
    let upper = mix(slide_pixel(low.x, low.y), slide_pixel(high.x, low.y), part.x);
    let lower = mix(slide_pixel(low.x, high.y), slide_pixel(high.x, high.y), part.x);
    return mix(upper, lower, part.y);
}

fn slide_pixel(x: u32, y: u32) -> vec3f {
    return textureLoad(slide, vec2u(x, y), 0).rgb;
}
