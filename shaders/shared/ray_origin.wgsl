const NO_OBJECT: u32 = 0xffffffffu;

// What a ray leaves: a piece of a surface that does not see itself.
struct RayOrigin {
    // World position, metres.
    position: vec3f,
    object: u32,
    // 1 where it looks to the side that the mesh's normals point to, else -1.
    side: f32,
    // From end to end, metres.
    extent: f32,
}
