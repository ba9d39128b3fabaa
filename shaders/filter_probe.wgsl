// Asks a filter for the mean over given footprints: the gather's own filters, or the adapter's anisotropic sampler, of which
// several ignore explicit gradients on cube maps. Rust: src/pinhole/gpu/probe.rs. One fragment a probe.

#import cube
#import footprint
#import filters

struct Probe {
    direction: vec3f,
    taps: f32,
    side_1: vec3f,
    texel_rad: f32,
    side_2: vec3f,
}

const WIDTH: u32 = 256u;

@group(0) @binding(0) var<storage, read> probes: array<Probe>;
@group(0) @binding(1) var environment: texture_cube<f32>;
@group(0) @binding(2) var trilinear: sampler;
@group(0) @binding(3) var anisotropic: sampler;

// Nothing is hidden from a probe.
fn open_part(direction: vec3f) -> f32 {
    return 1.0;
}

// The environment of a probe is not rotated.
fn light_from_world(d: vec3f) -> vec3f {
    return d;
}

@vertex
fn full_screen(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return vec4f(2.0 * corner - 1.0, 0.0, 1.0);
}

@fragment
fn probe(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let index = u32(position.y) * WIDTH + u32(position.x);
    // Past the last one: any probe will do.
    let p = probes[min(index, arrayLength(&probes) - 1u)];
    return mean_over_footprint(p.direction, p.side_1, p.side_2, p.taps, p.texel_rad);
}
