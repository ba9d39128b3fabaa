// What rays of whole pictures meet first, many rays at a time. CPU twins: `camera_hit` and `secondary_hit` in src/sums/tracing/mod.rs.

#import constants
#import hits
#import ray_batch

struct BatchHit {
    // As in `Hit`.
    position: vec3f,
    // Metres.
    distance: f32,
    normal: vec3f,
    // NO_OBJECT: nothing.
    object: u32,
    face_normal: vec3f,
    // IS_FRONT, IS_UNFINISHED.
    flags: u32,
}

const IS_FRONT: u32 = 1u;

@group(0) @binding(2) var<storage, read_write> batch_hits: array<BatchHit>;

// Rays of the camera.
@compute @workgroup_size(64)
fn trace_camera_rays(@builtin(global_invocation_id) id: vec3u) {
    trace_ray(id.x, 0.0, MEETS_FOR_CAMERA);
}

// Rays that leave surfaces.
@compute @workgroup_size(64)
fn trace_secondary_rays(@builtin(global_invocation_id) id: vec3u) {
    trace_ray(id.x, ray_uniforms.offset, MEETS_FOR_LIGHT);
}

fn trace_ray(index: u32, start: f32, meets: vec2u) {
    if index >= batch.count {
        return;
    }
    let ray = batch_rays[index];
    let met = trace_some(free_ray(ray.origin), ray.direction, start, 3e38, false, meets);
    let unfinished = select(IS_UNFINISHED, 0u, met.is_complete);
    if met.triangle == NO_TRIANGLE {
        batch_hits[index] = BatchHit(vec3f(0.0), 0.0, vec3f(0.0), NO_OBJECT, vec3f(0.0), unfinished);
        return;
    }
    let hit = describe(met, ray.direction);
    let flags = select(0u, IS_FRONT, hit.is_front) | unfinished;
    batch_hits[index] = BatchHit(hit.position, met.distance, hit.normal, hit.object, hit.face_normal, flags);
}
