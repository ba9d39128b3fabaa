// Rays against the scene's triangles. CPU twin: src/tracing/mod.rs; layout: src/tracing/stackless.rs.
//
// Two levels: objects in the world, and the triangles of their meshes. Nodes of both lie in depth-first order, and each knows the node
// after those below it: a traversal needs no stack. Meshes are in normalised space, whose units are some thousandths of their size.

#import ray_origin

// Texels in a row of `geometry`: nodes of two texels each (low corner of the box, and the node after those below; high corner, and of
// a leaf eight bits for the number of its objects or triangles below the index of the first). First those over the objects, in metres,
// and the objects of four texels each (three rows of the matrix from metres to units; the first texel of the mesh, the number of its
// nodes, the object's number above two bits for who sees it, units per metre). Then, mesh by mesh, its nodes and its triangles of four
// texels each (three of a corner and its normal; the sum of the normals), in units.
@group(3) @binding(0) var geometry: texture_2d<u32>;
@group(3) @binding(1) var<uniform> ray_uniforms: RayUniforms;

struct RayUniforms {
    // Of nodes over objects.
    node_count: u32,
    // Rays start this far off a surface, metres.
    offset: f32,
}

const NO_TRIANGLE: u32 = 0xffffffffu;

// Which objects a ray meets, by two bits of theirs: a mask, and what it must leave of them.
const MEETS_FOR_LIGHT: vec2u = vec2u(2u, 2u);
const MEETS_FOR_CAMERA: vec2u = vec2u(1u, 1u);
// Emitters, through which light passes.
const MEETS_EMITTERS: vec2u = vec2u(2u, 0u);

struct RayHit {
    // Metres.
    distance: f32,
    // The first of its texels. NO_TRIANGLE: nothing was hit.
    triangle: u32,
    // The first texel of its object.
    instance: u32,
    // Weights of its second and third corner.
    weights: vec2f,
    // The traversal was not cut short.
    is_complete: bool,
    // Iterations of its loops.
    work: u32,
}

struct Triangle {
    // Units of the object.
    corners: array<vec3f, 3>,
    normals: array<vec3f, 3>,
}

struct Instance {
    // From metres to units: the rows of the matrix, as columns, and the translation. v * rows applies it; as it turns and scales, rows * v
    // turns back.
    rows: mat3x3f,
    translation: vec3f,
    first_texel: u32,
    node_count: u32,
    object: u32,
    seen_by: u32,
    units_per_metre: f32,
}

fn geometry_texel(index: u32) -> vec4u {
    return textureLoad(geometry, vec2u(index % GEOMETRY_ROW, index / GEOMETRY_ROW), 0);
}

fn load_instance(first: u32) -> Instance {
    let x = bitcast<vec4f>(geometry_texel(first));
    let y = bitcast<vec4f>(geometry_texel(first + 1u));
    let z = bitcast<vec4f>(geometry_texel(first + 2u));
    let of_mesh = geometry_texel(first + 3u);
    return Instance(
        mat3x3f(x.xyz, y.xyz, z.xyz), vec3f(x.w, y.w, z.w), of_mesh.x, of_mesh.y, of_mesh.z >> 2u, of_mesh.z & 3u,
        bitcast<f32>(of_mesh.w),
    );
}

fn load_triangle(first: u32) -> Triangle {
    let a = geometry_texel(first);
    let b = geometry_texel(first + 1u);
    let c = geometry_texel(first + 2u);
    return Triangle(
        array(bitcast<vec3f>(a.xyz), bitcast<vec3f>(b.xyz), bitcast<vec3f>(c.xyz)),
        array(unpacked_normal(a.w), unpacked_normal(b.w), unpacked_normal(c.w)),
    );
}

// A unit vector from its place on an octahedron.
fn unpacked_normal(packed: u32) -> vec3f {
    // As unpack2x16snorm, which some drivers round differently.
    let xy = vec2f(vec2i(extractBits(i32(packed), 0u, 16u), extractBits(i32(packed), 16u, 16u))) / 32767.0;
    let z = 1.0 - abs(xy.x) - abs(xy.y);
    let fold = max(-z, 0.0);
    return normalize(vec3f(xy + select(vec2f(-fold), vec2f(fold), xy < vec2f(0.0)), z));
}

// A direction of an object's units in the world, times units per metre.
fn world_from_units(direction: vec3f, instance: Instance) -> vec3f {
    return instance.rows * direction;
}

// The triangle's normal in the world, of any length and towards either side.
fn face_normal(hit: RayHit) -> vec3f {
    let triangle = load_triangle(hit.triangle);
    let face = cross(triangle.corners[1] - triangle.corners[0], triangle.corners[2] - triangle.corners[0]);
    return world_from_units(face, load_instance(hit.instance));
}

// The nearest triangle along a unit direction before an end in metres or, with `any_hit`, one of them.
fn trace(leaving: RayOrigin, direction: vec3f, end: f32, any_hit: bool) -> RayHit {
    return trace_some(leaving, direction, ray_uniforms.offset, end, any_hit, MEETS_FOR_LIGHT);
}

// The same from a start in metres, among some of the objects.
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

fn sum_of_normals(triangle: u32) -> vec3f {
    return bitcast<vec3f>(geometry_texel(triangle + 3u).xyz);
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

// Iterations of the loops of all rays of this invocation.
var<private> ray_work: u32;
// None of them was cut short.
var<private> rays_are_complete: bool = true;

// Whether anything lies between a piece of a surface and a point that far away in a unit direction; what lies at the end does not count.
fn is_occluded(leaving: RayOrigin, direction: vec3f, distance: f32) -> bool {
    let end = distance * (1.0 - END_SLACK) - ray_uniforms.offset;
    let hit = trace(leaving, direction, end, true);
    ray_work += hit.work;
    rays_are_complete = rays_are_complete && hit.is_complete;
    return hit.triangle != NO_TRIANGLE;
}
