// The scene's triangles, and what rays meet of them. CPU twin: src/sums/tracing/mod.rs; layout: src/sums/tracing/stackless.rs.
//
// Meshes are in normalised space, whose units are some thousandths of their size.

#import ray_origin
#import ray_traversal
#import unit_vectors

// Texels in a row of `geometry`: nodes of two texels each (low corner of the box, and the node after those below; high corner, and of
// a leaf eight bits for the number of its objects or triangles below the index of the first). First those over the objects, in metres,
// and the objects of four texels each (three rows of the matrix from metres to units; the first texel of the mesh, the number of its
// nodes, the object's number above SEEN_BY_BITS for who sees it, units per metre). Then, mesh by mesh, its nodes and its triangles of four
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

// Which objects a ray meets, by the bits of theirs for who sees them: a mask, and what it must leave of them.
const MEETS_FOR_LIGHT: vec2u = vec2u(2u, 2u);
const MEETS_FOR_CAMERA: vec2u = vec2u(1u, 1u);
// For the camera, by way of a mirror: what light meets, and near emitters.
const MEETS_FOR_MIRRORS: vec2u = vec2u(4u, 4u);
const MEETS_DISTANT_EMITTERS: vec2u = vec2u(4u, 0u);

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
        mat3x3f(x.xyz, y.xyz, z.xyz), vec3f(x.w, y.w, z.w), of_mesh.x, of_mesh.y, of_mesh.z >> SEEN_BY_BITS, extractBits(of_mesh.z, 0u, SEEN_BY_BITS),
        bitcast<f32>(of_mesh.w),
    );
}

fn load_triangle(first: u32) -> Triangle {
    let a = geometry_texel(first);
    let b = geometry_texel(first + 1u);
    let c = geometry_texel(first + 2u);
    return Triangle(
        array(bitcast<vec3f>(a.xyz), bitcast<vec3f>(b.xyz), bitcast<vec3f>(c.xyz)),
        array(unpacked_unit(a.w), unpacked_unit(b.w), unpacked_unit(c.w)),
    );
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

fn sum_of_normals(triangle: u32) -> vec3f {
    return bitcast<vec3f>(geometry_texel(triangle + 3u).xyz);
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
