// A direction of shadow rays.
struct LightDirection {
    // In the world.
    direction: vec3f,
    // Over the density of directions.
    radiance: vec3f,
}
