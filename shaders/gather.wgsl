// The gather (Wand & Straßer 2003, Sections 3.1 and 3.3): adds one batch of pinhole samples to the irradiance of
// every receiver point. CPU twin: src/pinhole/cpu/, the same names. Rust layouts: src/pinhole/layout.rs.
//
// Each instance of the full-screen triangle is one batch of samples; the target accumulates by additive blending, or
// the batch starts from the previous target where 32-bit targets do not blend (gather_onto_previous).
// Output: rgb = irradiance, W/m², or with SHADING the radiance reflected to the viewer, W/(m²·sr); a = number of fetches.

#import pair
#import cube
#import footprint
#import filters
#import visibility
#import brdf

// Whole vec4s: some drivers pay per load, not per byte.
struct PinholeSample {
    position_area: vec4f,
    normal_object: vec4f,
    reflectance: vec4f,
    side_1: vec4f,
    side_2: vec4f,
    change_1: vec4f,
    change_2: vec4f,
}

const BATCH_SIZE: u32 = 256u;
@group(0) @binding(0) var<uniform> uniforms: GatherUniforms;
// One batch: a window on the buffer of all samples. A uniform binding, because its loads are broadcast: a storage binding
// costs lavapipe half as much again (every lane loads for itself).
@group(0) @binding(1) var<uniform> samples: array<PinholeSample, BATCH_SIZE>;
@group(0) @binding(2) var environment: texture_cube<f32>;
@group(0) @binding(3) var trilinear: sampler;
@group(0) @binding(4) var anisotropic: sampler;
@group(0) @binding(5) var<storage, read> curves: array<vec4f>;
// The samples' maps of visibility; never read without VISIBILITY.
@group(0) @binding(6) var<storage, read> planes: array<vec4f>;
@group(0) @binding(7) var<storage, read> open_rows: array<u32>;
@group(1) @binding(0) var receiver_position: texture_2d<f32>;
@group(1) @binding(1) var receiver_normal: texture_2d<f32>;
// Towards the viewers, and what the objects do with light; never read without SHADING.
@group(1) @binding(2) var receiver_view: texture_2d<f32>;
@group(1) @binding(3) var<storage, read> materials: array<Material>;
@group(1) @binding(4) var<storage, read> tables: array<vec4f>;
@group(2) @binding(0) var previous: texture_2d<f32>;

struct Receiver {
    position: vec3f,
    normal: vec3f,
    object: u32,
    view: vec3f,
}

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
    let position = textureLoad(receiver_position, pixel, 0);
    if position.w < 0.0 {
        return vec4f(0.0);
    }
    // Rounded: a rasteriser's interpolation may leave 0.9999999.
    let object = u32(position.w + 0.5);
    let normal = textureLoad(receiver_normal, pixel, 0).xyz;
    let receiver = Receiver(position.xyz, normal, object, textureLoad(receiver_view, pixel, 0).xyz);
    var sum = vec4f(0.0);
    let count = min(uniforms.sample_count - batch * BATCH_SIZE, BATCH_SIZE);
    for (var i = 0u; i < count; i++) {
        sum += sample_irradiance(i, receiver);
    }
    return sum;
}

// What one sample adds: rgb = irradiance, a = fetches.
fn sample_irradiance(i: u32, receiver: Receiver) -> vec4f {
    let position_area = samples[i].position_area;
    let normal_object = samples[i].normal_object;
    let area = position_area.w;
    let n = normal_object.xyz;
    // ±(object + 1), negative where both sides reflect.
    let two_sided = normal_object.w < 0.0;
    let d = position_area.xyz - receiver.position;
    let l2 = dot(d, d);
    let dn = dot(d, n);
    let facing = select(max(-dn, 0.0), abs(dn), two_sided);
    let inverse_l = inverseSqrt(l2);
    let cosines = facing * max(dot(d, receiver.normal), 0.0) * inverse_l * inverse_l;
    // Also false where the sample lies on the receiver point and the quotient is not a number.
    if !(cosines > 0.0) {
        return vec4f(0.0);
    }
    let same_object = u32(abs(normal_object.w)) == receiver.object + 1u;
    var weight = area * cosines * attenuation(l2, area, same_object);
    if VISIBILITY {
        let phase = vec2f(samples[i].change_1.w, samples[i].change_2.w);
        let side = select(1.0, -1.0, dn > 0.0);
        look_around(u32(samples[i].side_2.w) - 1u, phase, uniforms.map_resolution, n, side);
        weight *= visible_part(-d);
        if weight == 0.0 {
            return vec4f(0.0);
        }
    }
    let r = (d - 2.0 * dn * n) * inverse_l;
    let radiance = filtered_radiance(i, d, n, dn, inverse_l, r);
    var factor = weight * uniforms.radiance_scale * reflectance(samples[i].reflectance, facing * inverse_l);
    if SHADING {
        let solid_angle = area * facing * inverse_l * inverse_l * inverse_l;
        factor *= brdf(receiver.object, receiver.normal, d * inverse_l, receiver.view, solid_angle);
    }
    return vec4f(factor * radiance.rgb, radiance.a);
}

// The part of the environment around a direction that counts: see filters.
fn open_part(direction: vec3f) -> f32 {
    if VISIBILITY {
        return seen_part_of_environment(direction);
    }
    return 1.0;
}

// Mean radiance over the sample's footprint around the reflected direction r; a = fetches.
fn filtered_radiance(i: u32, d: vec3f, n: vec3f, dn: f32, inverse_l: f32, r: vec3f) -> vec4f {
    if FILTER == FILTER_NONE {
        return open_light(r, light_from_world(r), 0.0, 1.0);
    }
    let side_1 = samples[i].side_1;
    let v1 = reflected_side(side_1.xyz, samples[i].change_1.xyz, d, n, dn, inverse_l, r);
    let v2 = reflected_side(samples[i].side_2.xyz, samples[i].change_2.xyz, d, n, dn, inverse_l, r);
    var sides = FootprintSides(v1, v2);
    // The same for all lanes: w is the width of the lobe that blurs the footprint.
    if side_1.w > 0.0 {
        sides = blurred(sides, r, n, abs(dn) * inverse_l, side_1.w);
    }
    return mean_over_footprint(r, sides.v1, sides.v2, f32(uniforms.taps), uniforms.texel_rad);
}
