// How rays find triangles: by ray queries, on devices that have them. ray_traversal.wgsl does the same without.

// The scene's objects. An instance's custom data is its place among the objects of `geometry`.
@group(3) @binding(2) var ray_scene: acceleration_structure;

// The nearest triangle along a unit direction from a start to an end in metres or, with `any_hit`, one of them, among some of the objects.
fn trace_some(leaving: RayOrigin, direction: vec3f, start: f32, end: f32, any_hit: bool, meets: vec2u) -> RayHit {
    let far = min(end, 3e38);
    if ray_uniforms.node_count == 0u || far <= start {
        return RayHit(far, NO_TRIANGLE, 0u, vec2f(0.0), true, 0u);
    }
    let flags = select(RAY_FLAG_NONE, RAY_FLAG_TERMINATE_ON_FIRST_HIT, any_hit)
        | select(RAY_FLAG_FORCE_NO_OPAQUE, RAY_FLAG_FORCE_OPAQUE, leaving.extent == 0.0);
    var query: ray_query;
    rayQueryInitialize(&query, ray_scene, RayDesc(flags, cull_mask(meets), start, far, leaving.position, direction));
    while rayQueryProceed(&query) {
        let candidate = rayQueryGetCandidateIntersection(&query);
        if candidate.kind == RAY_QUERY_INTERSECTION_TRIANGLE && !is_of_own_piece(candidate, leaving, direction) {
            rayQueryConfirmIntersection(&query);
        }
    }
    let met = rayQueryGetCommittedIntersection(&query);
    if met.kind != RAY_QUERY_INTERSECTION_TRIANGLE {
        return RayHit(far, NO_TRIANGLE, 0u, vec2f(0.0), true, 1u);
    }
    let first = first_of_instance(met.instance_custom_data);
    let triangle = triangle_of(load_instance(first), met.primitive_index);
    return RayHit(met.t, triangle, first, met.barycentrics, true, 1u);
}

// The bits of an instance's mask with which a ray meets it: for the rays that see the object, then for those that do not.
fn cull_mask(meets: vec2u) -> u32 {
    return meets.y | ((meets.x & ~meets.y) << SEEN_BY_BITS);
}

// The first texel of an object.
fn first_of_instance(instance: u32) -> u32 {
    return 2u * ray_uniforms.node_count + 4u * instance;
}

// The piece that the ray leaves is a little curved, and its middle may lie below its triangles.
fn is_of_own_piece(candidate: RayIntersection, leaving: RayOrigin, direction: vec3f) -> bool {
    if candidate.t >= leaving.extent {
        return false;
    }
    let instance = load_instance(first_of_instance(candidate.instance_custom_data));
    let normals = sum_of_normals(triangle_of(instance, candidate.primitive_index));
    return instance.object == leaving.object && leaving.side * dot(normals, direction * instance.rows) > 0.0;
}

// The first texel of a triangle.
fn triangle_of(instance: Instance, number: u32) -> u32 {
    return instance.first_texel + 2u * instance.node_count + 4u * number;
}
