// Shadow rays of whole pictures: how much of the light arrives at points, and which single rays are blocked. CPU twins: `fractions` in
// src/render/engine/shadows.rs, `is_blocked` in src/sums/tracing/mod.rs.

#import constants
#import hits
#import light_direction
#import ray_batch

// Irradiance by a set of directions, W/m².
struct ArrivingLight {
    // What is not blocked.
    arriving: vec3f,
    // Rays that the adapter ended early.
    unfinished: u32,
    // What there would be without shadows.
    all: vec3f,
}

const IS_BLOCKED: u32 = 1u;

@group(0) @binding(2) var<storage, read> directions: array<LightDirection>;
@group(0) @binding(3) var<storage, read_write> sums: array<ArrivingLight>;
@group(0) @binding(4) var<storage, read_write> blocked: array<u32>;

// Adds the light of some directions to that which arrives at points.
@compute @workgroup_size(64)
fn add_light(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= batch.count {
        return;
    }
    let point = batch_rays[id.x];
    var sum = sums[id.x];
    for (var k = 0u; k < batch.direction_count; k++) {
        let light = directions[batch.first_direction + k];
        let cosine = dot(light.direction, point.direction);
        if cosine <= 0.0 {
            continue;
        }
        let irradiance = cosine * light.radiance;
        sum.all += irradiance;
        let met = trace(free_ray(point.origin), light.direction, 3e38, true);
        sum.unfinished += select(1u, 0u, met.is_complete);
        if met.triangle == NO_TRIANGLE {
            sum.arriving += irradiance;
        }
    }
    sums[id.x] = sum;
}

// Which of the rays meet anything.
@compute @workgroup_size(64)
fn find_blocked(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= batch.count {
        return;
    }
    let ray = batch_rays[id.x];
    let met = trace(free_ray(ray.origin), ray.direction, 3e38, true);
    blocked[id.x] = select(IS_BLOCKED, 0u, met.triangle == NO_TRIANGLE) | select(IS_UNFINISHED, 0u, met.is_complete);
}
