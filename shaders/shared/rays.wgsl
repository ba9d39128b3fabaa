// Rays against the scene's triangles. CPU twin: src/tracing/mod.rs; layout: src/tracing/skip_list.rs.
//
// Nodes lie in depth-first order, and each knows the node after those below it: a traversal needs no stack.

#import ray_origin

// Texels in a row of `geometry`: nodes of two texels each (low corner of the box, and the node after those below; high corner, and of
// a leaf eight bits for the number of its triangles below the index of the first), then triangles of four (three corners; the sum of
// their normals, and the object). Positions are in units.
@group(3) @binding(0) var geometry: texture_2d<u32>;
@group(3) @binding(1) var<uniform> ray_uniforms: RayUniforms;

struct RayUniforms {
    node_count: u32,
    // Units per metre.
    scale: f32,
    // Rays start this far off a surface, units.
    offset: f32,
}

const NO_TRIANGLE: u32 = 0xffffffffu;

struct RayHit {
    // Metres.
    distance: f32,
    // NO_TRIANGLE: nothing was hit.
    triangle: u32,
    // The traversal was not cut short.
    is_complete: bool,
    // Iterations of its loops.
    work: u32,
}

struct Triangle {
    corners: array<vec3f, 3>,
    normals: vec3f,
    object: u32,
}

fn geometry_texel(index: u32) -> vec4u {
    return textureLoad(geometry, vec2u(index % GEOMETRY_ROW, index / GEOMETRY_ROW), 0);
}

fn load_triangle(index: u32) -> Triangle {
    let first = 2u * ray_uniforms.node_count + 4u * index;
    let normals = geometry_texel(first + 3u);
    return Triangle(
        array(
            bitcast<vec3f>(geometry_texel(first).xyz), bitcast<vec3f>(geometry_texel(first + 1u).xyz),
            bitcast<vec3f>(geometry_texel(first + 2u).xyz),
        ),
        bitcast<vec3f>(normals.xyz),
        normals.w,
    );
}

// The nearest triangle along a unit direction before an end in metres or, with `any_hit`, one of them.
fn trace(leaving: RayOrigin, direction: vec3f, end: f32, any_hit: bool) -> RayHit {
    let origin = ray_uniforms.scale * leaving.position;
    let inverse = 1.0 / select(direction, vec3f(1e-12), abs(direction) < vec3f(1e-12));
    var found = RayHit(min(ray_uniforms.scale * end, 3e38), NO_TRIANGLE, false, 0u);
    var node = 0u;
    loop {
        if node >= ray_uniforms.node_count {
            found.is_complete = true;
            break;
        }
        found.work += 1u;
        let low = geometry_texel(2u * node);
        let high = geometry_texel(2u * node + 1u);
        let a = (bitcast<vec3f>(low.xyz) - origin) * inverse;
        let b = (bitcast<vec3f>(high.xyz) - origin) * inverse;
        let enter = min(a, b);
        let leave = max(a, b);
        let near = max(max(enter.x, enter.y), max(enter.z, ray_uniforms.offset));
        let far = min(min(leave.x, leave.y), min(leave.z, found.distance));
        // More than what is lost by rounding.
        if !(near <= 1.000001 * far) {
            node = low.w;
            continue;
        }
        let count = high.w & 255u;
        found.work += count;
        for (var k = 0u; k < count; k++) {
            let triangle = (high.w >> 8u) + k;
            let distance = hit_distance(triangle, leaving, origin, direction, found.distance);
            if distance > 0.0 {
                found.distance = distance;
                found.triangle = triangle;
            }
        }
        if any_hit && found.triangle != NO_TRIANGLE {
            found.is_complete = true;
            break;
        }
        node += 1u;
    }
    found.distance /= ray_uniforms.scale;
    return found;
}

// Möller–Trumbore with inclusive edges: the distance in units, or 0 where there is no hit, or none that counts.
fn hit_distance(index: u32, leaving: RayOrigin, origin: vec3f, direction: vec3f, end: f32) -> f32 {
    let triangle = load_triangle(index);
    let ab = triangle.corners[1] - triangle.corners[0];
    let ac = triangle.corners[2] - triangle.corners[0];
    let p = cross(direction, ac);
    let inverse = 1.0 / dot(ab, p);
    let s = origin - triangle.corners[0];
    let u = dot(s, p) * inverse;
    let q = cross(s, ab);
    let v = dot(direction, q) * inverse;
    let distance = dot(ac, q) * inverse;
    let is_inside = u >= -TRIANGLE_SLACK && v >= -TRIANGLE_SLACK && u + v <= 1.0 + TRIANGLE_SLACK;
    if !(is_inside && distance > ray_uniforms.offset && distance < end) {
        return 0.0;
    }
    // The piece that the ray leaves is a little curved, and its middle may lie below its triangles.
    let is_own = triangle.object == leaving.object && distance < ray_uniforms.scale * leaving.extent
        && leaving.side * dot(triangle.normals, direction) > 0.0;
    return select(distance, 0.0, is_own);
}

// Iterations of the loops of all rays of this invocation.
var<private> ray_work: u32;
// None of them was cut short.
var<private> rays_are_complete: bool = true;

// Whether anything lies between a piece of a surface and a point that far away in a unit direction; what lies at the end does not count.
fn is_occluded(leaving: RayOrigin, direction: vec3f, distance: f32) -> bool {
    let end = distance * (1.0 - END_SLACK) - ray_uniforms.offset / ray_uniforms.scale;
    let hit = trace(leaving, direction, end, true);
    ray_work += hit.work;
    rays_are_complete = rays_are_complete && hit.is_complete;
    return hit.triangle != NO_TRIANGLE;
}
