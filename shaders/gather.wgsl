// The gather (Wand & Straßer 2003, Sections 3.1 and 3.3): adds one batch of pinhole samples to the irradiance of
// every receiver point. CPU twin: src/sums/pinhole/cpu/mod.rs. Rust layouts: src/sums/pinhole/layout.rs.
//
// Each instance of the full-screen triangle is one batch of samples; the target accumulates by additive blending, or
// the batch starts from the previous target where 32-bit targets do not blend (gather_onto_previous).
// Output: rgb = irradiance, W/m², or with SHADING the radiance reflected to the viewer, W/(m²·sr); a = number of fetches.

#import no_rays
#import gather_inputs
#import receivers
#import filters
#import brdf
#import interface
#import lobe
#import medium
#import near_light

struct PinholeSample {
    position: vec3f,
    area: f32,
    normal: vec3f,
    // OBJECT_SCALE times the object's index, plus LIGHTS_FRONT and so on.
    object_flags: u32,
    reflectance: vec3f,
    // Its curve of reflectance, or NO_CURVE; of an interface the bits of its relative refractive index.
    curve: u32,
    side_1: vec3f,
    // Width of the lobe that blurs the footprint, radians.
    lobe: f32,
    side_2: vec3f,
    // Its first visibility map.
    map: u32,
    change_1: vec3f,
    texel_jitter_u: f32,
    change_2: vec3f,
    texel_jitter_v: f32,
}

// One batch: a window on the buffer of all samples. A uniform binding, because its loads are broadcast: a storage binding
// costs lavapipe half as much again (every lane loads for itself).
@group(0) @binding(10) var<uniform> samples: array<PinholeSample, BATCH_SIZE>;
@group(2) @binding(0) var previous: texture_2d<f32>;

struct Varyings {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) batch: u32,
}

@vertex
fn full_screen(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Varyings {
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return Varyings(vec4f(2.0 * corner - 1.0, 0.0, 1.0), instance);
}

@fragment
fn gather(in: Varyings) -> @location(0) vec4f {
    return gather_batch(vec2u(in.position.xy), in.batch);
}

@fragment
fn gather_onto_previous(in: Varyings) -> @location(0) vec4f {
    let pixel = vec2u(in.position.xy);
    return textureLoad(previous, pixel, 0) + gather_batch(pixel, in.batch);
}

fn gather_batch(pixel: vec2u, batch: u32) -> vec4f {
    var receiver = with_length(load_receiver(pixel));
    if receiver.object < 0 {
        return vec4f(0.0);
    }
    receiver.view = view_direction(pixel);
    var sum = vec4f(0.0);
    let count = min(uniforms.sample_count - batch * BATCH_SIZE, BATCH_SIZE);
    for (var i = 0u; i < count; i++) {
        sum += sample_irradiance(i, receiver);
    }
    return sum;
}

// What one sample adds: rgb = irradiance, a = fetches.
fn sample_irradiance(i: u32, receiver: Receiver) -> vec4f {
    let area = samples[i].area;
    let n = samples[i].normal;
    let flags = samples[i].object_flags;
    let d = samples[i].position - receiver.position;
    let l2 = dot(d, d);
    let dn = dot(d, n);
    // The cosine at the sample, times l.
    let cos_at_sample_l = max(facing(flags, dn), 0.0);
    let inverse_l = inverseSqrt(l2);
    let at_receiver = cos_at_receiver_l(d, l2 * inverse_l, receiver);
    var cosine_product = cos_at_sample_l * max(at_receiver, 0.0) * inverse_l * inverse_l;
    var r = (d - 2.0 * dn * n) * inverse_l;
    var crossing: Crossing;
    if is_interface(flags) {
        crossing = crossing_of(bitcast<f32>(samples[i].curve), (flags & IS_FRESNEL) != 0u, dn * inverse_l);
        r = crossed_direction(crossing, d * inverse_l, n);
        cosine_product *= crossing.factor;
    }
    // Also false where the sample lies on the receiver point and the quotient is not a number.
    if !(cosine_product > 0.0) {
        return vec4f(0.0);
    }
    var weight = area * cosine_product * attenuation(l2, area, i32(flags / OBJECT_SCALE) == receiver.object);
    var map: VisibilityMap;
    if VISIBILITY {
        let texel_jitter = vec2f(samples[i].texel_jitter_u, samples[i].texel_jitter_v);
        map = visibility_map(samples[i].map, texel_jitter, n, receiver_side(flags, dn));
        weight *= visible_fraction(-d, map);
        if is_interface(flags) {
            map = visibility_map(samples[i].map, texel_jitter, n, sky_side(flags, dn));
        }
        if weight == 0.0 {
            return vec4f(0.0);
        }
    }
    let is_wide = !is_interface(flags) && is_wide_lobe(samples[i].lobe, samples[i].change_1, samples[i].change_2);
    if VISIBILITY && LIGHT == LIGHT_ENVIRONMENT && FILTER != FILTER_NONE && is_wide {
        weight *= lobe_fraction(r, samples[i].lobe, map);
        map.index = UNOCCLUDED;
        if weight == 0.0 {
            return vec4f(0.0);
        }
    }
    let third = turn_along_part(receiver, d, n, inverse_l, r, crossing, is_interface(flags));
    let radiance = filtered_radiance(i, d, n, dn, inverse_l, r, crossing, third, map);
    let cosine = cos_at_sample_l * inverse_l;
    var factor = weight * uniforms.radiance_scale *
        reflectance(samples[i].reflectance, select(samples[i].curve, NO_CURVE, is_interface(flags)), cosine) *
        passed_medium(d, l2 * inverse_l, dn, is_interface(flags), receiver);
    if SHADING {
        let solid_angle = area * cosine * inverse_l * inverse_l;
        factor *= brdf(u32(receiver.object), receiver.normal, d * inverse_l, receiver.view, solid_angle);
    }
    return vec4f(factor * radiance.rgb, radiance.a);
}

// Mean radiance over the sample's footprint around the direction r of its light; a = fetches. `third`: its side along a part of a ray.
fn filtered_radiance(
    i: u32, d: vec3f, n: vec3f, dn: f32, inverse_l: f32, r: vec3f, crossing: Crossing, third: vec3f, map: VisibilityMap,
) -> vec4f {
    if LIGHT == LIGHT_ENVIRONMENT && FILTER == FILTER_NONE {
        return mean_over_taps(r, one_tap(0.0, 0.0), no_taps(), map);
    }
    let lobe = samples[i].lobe;
    let cosine = abs(dn) * inverse_l;
    let surface = FootprintSides(samples[i].side_1, samples[i].side_2);
    var widths = mirrored_blur(lobe, cosine);
    var reflected: FootprintSides;
    if is_interface(samples[i].object_flags) {
        let towards = d * inverse_l;
        reflected.v1 = crossed_side(crossing, surface.v1, samples[i].change_1, towards, n, inverse_l);
        reflected.v2 = crossed_side(crossing, surface.v2, samples[i].change_2, towards, n, inverse_l);
        widths = crossed_blur(crossing, lobe);
    } else {
        reflected.v1 = reflected_side(surface.v1, samples[i].change_1, d, n, dn, inverse_l, r);
        reflected.v2 = reflected_side(surface.v2, samples[i].change_2, d, n, dn, inverse_l, r);
    }
    let changes = FootprintSides(samples[i].change_1, samples[i].change_2);
    let light = footprint_on_light(samples[i].position, n, samples[i].area, surface, changes, r, reflected, lobe, third);
    var seen = vec3f(1.0);
    if LIGHT == LIGHT_LAMP {
        seen = passed_from_lamp(length(light.towards), is_interface(samples[i].object_flags));
    }
    if VISIBILITY && LIGHT != LIGHT_ENVIRONMENT {
        seen *= visible_fraction(light.towards, map);
    }
    // The same for all lanes.
    var look_ups: LookUps;
    if !is_interface(samples[i].object_flags) && is_mostly_lobe(lobe, samples[i].change_1, samples[i].change_2) {
        look_ups = lobe_parts(light.r, n, cosine, light.sides, lobe, light.third);
    } else {
        look_ups = one_look_up(light.r, light.sides);
        if lobe > 0.0 || has_side(light.third) {
            look_ups.first = widened(light.sides, light.r, n, widths, light.third);
        }
    }
    let taps = f32(uniforms.taps);
    return vec4f(seen, 1.0) * mean_of_light(samples[i].position, n, surface, light, look_ups, taps, map);
}
