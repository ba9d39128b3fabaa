// What a ray meets. CPU twin: `describe` in src/sums/tracing/mod.rs.

#import rays

struct Hit {
    object: u32,
    position: vec3f,
    // Interpolated, and the triangle's own; towards the ray.
    normal: vec3f,
    face_normal: vec3f,
    is_front: bool,
}

fn describe(hit: RayHit, direction: vec3f) -> Hit {
    let instance = load_instance(hit.instance);
    let triangle = load_triangle(hit.triangle);
    let weights = vec3f(1.0 - hit.weights.x - hit.weights.y, hit.weights);
    let place = weights.x * triangle.corners[0] + weights.y * triangle.corners[1] + weights.z * triangle.corners[2];
    let mixed = weights.x * triangle.normals[0] + weights.y * triangle.normals[1] + weights.z * triangle.normals[2];
    let normal = normalize(world_from_units(mixed, instance));
    let face = normalize(
        world_from_units(cross(triangle.corners[1] - triangle.corners[0], triangle.corners[2] - triangle.corners[0]), instance)
    );
    let towards_normal = select(-face, face, dot(face, normal) >= 0.0);
    let is_front = dot(towards_normal, direction) <= 0.0;
    // The inverse of a matrix that turns and scales.
    let scale2 = instance.units_per_metre * instance.units_per_metre;
    return Hit(
        instance.object,
        world_from_units(place - instance.translation, instance) / scale2,
        select(-normal, normal, is_front),
        select(-towards_normal, towards_normal, is_front),
        is_front,
    );
}

// A ray that leaves no surface in particular.
fn free_ray(position: vec3f) -> RayOrigin {
    return RayOrigin(position, NO_OBJECT, 1.0, 0.0);
}
