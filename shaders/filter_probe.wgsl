// Asks a filter for the mean over given footprints: the gather's own filters, or the adapter's anisotropic sampler, of which
// several ignore explicit gradients on cube maps. Rust: src/render/pinhole/gpu/probe.rs. One fragment a probe.

#import no_rays
#import gather_inputs
#import filters

struct Probe {
    direction: vec3f,
    side_1: vec3f,
    side_2: vec3f,
}

@group(0) @binding(10) var<storage, read> probes: array<Probe>;

@vertex
fn full_screen(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return vec4f(2.0 * corner - 1.0, 0.0, 1.0);
}

@fragment
fn probe(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let index = u32(position.y) * PROBES_PER_ROW + u32(position.x);
    // Past the last one: any probe will do.
    let p = probes[min(index, arrayLength(&probes) - 1u)];
    // Nothing is hidden from a probe: without VISIBILITY no map is read.
    var map: VisibilityMap;
    return mean_over_footprints(one_look_up(p.direction, FootprintSides(p.side_1, p.side_2)), f32(uniforms.taps), map);
}
