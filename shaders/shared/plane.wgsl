// Planes of pictures: square texels that parallel rays or rays from a point pass. CPU twin: src/render/image_space/projection.rs; layout:
// src/render/image_space/gpu/layout.rs.

struct Plane {
    // The point that rays leave, or the origin of the plane that parallel rays leave.
    origin: vec3f,
    // The edge of a texel: metres of parallel views, tangents of central ones.
    texel: f32,
    right: vec3f,
    // The corner of the first texel.
    low_x: f32,
    down: vec3f,
    low_y: f32,
    forward: vec3f,
    is_parallel: u32,
}

// Where points appear that lie behind the one that rays leave.
const BEHIND_PLANE: f32 = -1e9;

// A place in texels, in the unit of the plane.
fn on_plane_at(plane: Plane, at: vec2f) -> vec2f {
    return vec2f(plane.low_x, plane.low_y) + plane.texel * at;
}

// Where a point appears, in texels.
fn projected(plane: Plane, point: vec3f) -> vec2f {
    let offset = point - plane.origin;
    let local = vec3f(dot(offset, plane.right), dot(offset, plane.down), dot(offset, plane.forward));
    let depth = select(local.z, 1.0, plane.is_parallel != 0u);
    if depth <= 0.0 {
        return vec2f(BEHIND_PLANE);
    }
    return (local.xy / depth - vec2f(plane.low_x, plane.low_y)) / plane.texel;
}

// How far a point lies along the view axis, metres.
fn depth_along(plane: Plane, point: vec3f) -> f32 {
    return dot(point - plane.origin, plane.forward);
}

// The point at a place, in texels, and a depth.
fn point_at(plane: Plane, at: vec2f, depth: f32) -> vec3f {
    let across = on_plane_at(plane, at) * select(depth, 1.0, plane.is_parallel != 0u);
    return plane.origin + across.x * plane.right + across.y * plane.down + depth * plane.forward;
}
