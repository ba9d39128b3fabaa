// Cube-map texels: how wide they are, and which level matches a width.

// Width of a texel around a unit direction, radians: texels shrink towards a face's corners. The solid angle of a
// texel is texel_rad² · m³ with m the largest component.
fn texel_width(direction: vec3f, texel_rad: f32) -> f32 {
    let a = abs(direction);
    let m = max(a.x, max(a.y, a.z));
    return texel_rad * m * sqrt(m);
}

// The level whose texels are `width` wide.
fn level_of(width: f32, texel: f32) -> f32 {
    return max(log2(width / texel), 0.0);
}
