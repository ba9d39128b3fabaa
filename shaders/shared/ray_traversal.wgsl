// How rays find triangles: by a traversal of the hierarchies in `geometry`. ray_queries.wgsl does the same on devices that do this by
// themselves. CPU twin: src/sums/tracing/mod.rs.
//
// Two levels: objects in the world, and the triangles of their meshes. Nodes of both lie in depth-first order, and each knows the node
// after those below it: a traversal needs no stack.

// The nearest triangle along a unit direction from a start to an end in metres or, with `any_hit`, one of them, among some of the objects.
fn trace_some(leaving: RayOrigin, direction: vec3f, start: f32, end: f32, any_hit: bool, meets: vec2u) -> RayHit {
    var found = RayHit(min(end, 3e38), NO_TRIANGLE, 0u, vec2f(0.0), false, 0u);
    let inverse = inverse_direction(direction);
    var node = 0u;
    loop {
        if node >= ray_uniforms.node_count {
            found.is_complete = true;
            break;
        }
        found.work += 1u;
        let low = geometry_texel(2u * node);
        let high = geometry_texel(2u * node + 1u);
        if !passes_box(low, high, leaving.position, inverse, start, found.distance) {
            node = low.w;
            continue;
        }
        let count = high.w & 255u;
        for (var k = 0u; k < count; k++) {
            let first = 2u * ray_uniforms.node_count + 4u * ((high.w >> 8u) + k);
            if !trace_mesh(first, leaving, direction, start, any_hit, meets, &found) {
                return found;
            }
            if any_hit && found.triangle != NO_TRIANGLE {
                found.is_complete = true;
                return found;
            }
        }
        node += 1u;
    }
    return found;
}

fn inverse_direction(direction: vec3f) -> vec3f {
    return 1.0 / select(direction, vec3f(1e-12), abs(direction) < vec3f(1e-12));
}

fn passes_box(low: vec4u, high: vec4u, origin: vec3f, inverse: vec3f, start: f32, end: f32) -> bool {
    let a = (bitcast<vec3f>(low.xyz) - origin) * inverse;
    let b = (bitcast<vec3f>(high.xyz) - origin) * inverse;
    let enter = min(a, b);
    let leave = max(a, b);
    let near = max(max(enter.x, enter.y), max(enter.z, start));
    let far = min(min(leave.x, leave.y), min(leave.z, end));
    // More than what is lost by rounding.
    return near <= 1.000001 * far;
}

// Looks for a nearer triangle of an object. Returns whether the traversal was not cut short.
fn trace_mesh(
    first_of_instance: u32, leaving: RayOrigin, direction: vec3f, start: f32, any_hit: bool, meets: vec2u,
    found: ptr<function, RayHit>,
) -> bool {
    let instance = load_instance(first_of_instance);
    if (instance.seen_by & meets.x) != meets.y {
        return true;
    }
    let origin = leaving.position * instance.rows + instance.translation;
    // As long as there are units to a metre, so that distances stay in metres.
    let along = direction * instance.rows;
    let inverse = inverse_direction(along);
    // The piece that the ray leaves is a little curved, and its middle may lie below its triangles.
    let own_extent = select(0.0, leaving.extent, instance.object == leaving.object);
    let first_triangle = instance.first_texel + 2u * instance.node_count;
    var node = 0u;
    loop {
        if node >= instance.node_count {
            return true;
        }
        (*found).work += 1u;
        let low = geometry_texel(instance.first_texel + 2u * node);
        let high = geometry_texel(instance.first_texel + 2u * node + 1u);
        if !passes_box(low, high, origin, inverse, start, (*found).distance) {
            node = low.w;
            continue;
        }
        let count = high.w & 255u;
        (*found).work += count;
        for (var k = 0u; k < count; k++) {
            let triangle = first_triangle + 4u * ((high.w >> 8u) + k);
            let hit = meet(triangle, origin, along, start, (*found).distance);
            // Distance 0: none.
            if hit.x > 0.0 && !(hit.x < own_extent && leaving.side * dot(sum_of_normals(triangle), along) > 0.0) {
                (*found).distance = hit.x;
                (*found).weights = hit.yz;
                (*found).triangle = triangle;
                (*found).instance = first_of_instance;
            }
        }
        if any_hit && (*found).triangle != NO_TRIANGLE {
            return true;
        }
        node += 1u;
    }
    return false;
}

// Möller–Trumbore with inclusive edges: the distance, or 0 where there is no hit, and the weights of the second and third corner.
fn meet(triangle: u32, origin: vec3f, along: vec3f, start: f32, end: f32) -> vec3f {
    let a = bitcast<vec3f>(geometry_texel(triangle).xyz);
    let ab = bitcast<vec3f>(geometry_texel(triangle + 1u).xyz) - a;
    let ac = bitcast<vec3f>(geometry_texel(triangle + 2u).xyz) - a;
    let p = cross(along, ac);
    let inverse = 1.0 / dot(ab, p);
    let s = origin - a;
    let u = dot(s, p) * inverse;
    let q = cross(s, ab);
    let v = dot(along, q) * inverse;
    let distance = dot(ac, q) * inverse;
    let is_inside = u >= -TRIANGLE_SLACK && v >= -TRIANGLE_SLACK && u + v <= 1.0 + TRIANGLE_SLACK;
    return vec3f(select(0.0, distance, is_inside && distance > start && distance < end), u, v);
}
