// Lamps in previews: what they are, and where rays see them. CPU twins: src/base/scene/lamp.rs and src/render/engine/preview/views.rs; layout:
// src/render/engine/preview/on_gpu/near_light.rs. The importing shader declares `preview` and `near_light`, which holds lamps of LAMP_TEXELS each,
// then parts of near emitters of PART_TEXELS each, then the texels of slides.

#import preview
#import microfacets

struct PreviewLamp {
    position: vec3f,
    radius: f32,
    // Radiant intensity where its beam is brightest, W/sr.
    intensity: vec3f,
    // BEAM_NONE and so on.
    beam: u32,
    direction: vec3f,
    half_angle: f32,
    up: vec3f,
    softness: f32,
    // The first texel of its slide, and its width and height.
    slide: vec3u,
}

// A texel that holds floats.
fn near_light_texel(index: u32) -> vec4f {
    return bitcast<vec4f>(near_light[index]);
}

fn load_lamp(index: u32) -> PreviewLamp {
    let first = index * LAMP_TEXELS;
    let a = near_light_texel(first);
    let b = near_light_texel(first + 1u);
    let c = near_light_texel(first + 2u);
    let d = near_light_texel(first + 3u);
    return PreviewLamp(
        a.xyz, a.w, b.xyz, near_light[first + 1u].w, c.xyz, c.w, d.xyz, d.w, near_light[first + 4u].xyz,
    );
}

// Radiant intensity in a unit direction away from it, W/sr.
fn lamp_intensity(lamp: PreviewLamp, direction: vec3f) -> vec3f {
    if lamp.beam == BEAM_NONE {
        return lamp.intensity;
    }
    let along = dot(direction, lamp.direction);
    if along <= 0.0 {
        return vec3f(0.0);
    }
    if lamp.beam == BEAM_CONE {
        let angle = atan2(length(cross(direction, lamp.direction)), along);
        let t = saturate((lamp.half_angle - angle) / max(lamp.softness * lamp.half_angle, 1e-6));
        return t * t * (3.0 - 2.0 * t) * lamp.intensity;
    }
    let right = cross(lamp.direction, lamp.up);
    let scale = 1.0 / (along * tan(lamp.half_angle));
    return lamp.intensity * slide_at(lamp.slide, scale * vec2f(dot(direction, right), dot(direction, lamp.up)));
}

// Radiance of its disc as it is seen from a point, W/(m²·sr).
fn lamp_radiance(lamp: PreviewLamp, point: vec3f) -> vec3f {
    return lamp_intensity(lamp, normalize(point - lamp.position)) / (PI * lamp.radius * lamp.radius);
}

// A slide at a place, bilinear: the upper edge is at y = 1, the right one at x = width / height. Black outside.
fn slide_at(slide: vec3u, place: vec2f) -> vec3f {
    let size = vec2f(slide.yz);
    let at = vec2f(0.5 * (place.x * size.y + size.x), 0.5 * (1.0 - place.y) * size.y);
    if !(all(at >= vec2f(0.0)) && all(at <= size)) {
        return vec3f(0.0);
    }
    let inside = max(at - 0.5, vec2f(0.0));
    let low = min(vec2u(inside), slide.yz - 1u);
    let part = inside - vec2f(low);
    let high = min(low + 1u, slide.yz - 1u);
    let upper = mix(slide_texel(slide, low.x, low.y), slide_texel(slide, high.x, low.y), part.x);
    let lower = mix(slide_texel(slide, low.x, high.y), slide_texel(slide, high.x, high.y), part.x);
    return mix(upper, lower, part.y);
}

fn slide_texel(slide: vec3u, x: u32, y: u32) -> vec3f {
    return near_light_texel(slide.x + y * slide.y + x).rgb;
}

// The radiance of lamps that a ray with a unit direction meets before an end, metres, through a medium of some extinction.
fn lamps_met(ray: Ray, end: f32, extinction: vec3f) -> vec3f {
    var radiance = vec3f(0.0);
    for (var k = 0u; k < preview.lamp_count; k++) {
        let lamp = load_lamp(k);
        let to = lamp.position - ray.origin;
        let along = dot(to, ray.direction);
        let radius2 = lamp.radius * lamp.radius;
        if along > 0.0 && along < end && dot(to, to) > radius2 && dot(to, to) - along * along < radius2 {
            radiance += exp(-length(to) * extinction) * lamp_radiance(lamp, ray.origin);
        }
    }
    return radiance;
}
