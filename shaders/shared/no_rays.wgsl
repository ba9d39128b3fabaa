// Takes the place of rays.wgsl in passes that trace none.

#import ray_origin

fn is_occluded(leaving: RayOrigin, direction: vec3f, distance: f32) -> bool {
    return false;
}
