// Cube-map texels: how wide they are, which level matches a width, and where on the cube a direction points.

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

// A place on the cube: the face, and where on it, from −1 to 1.
struct OnCube {
    face: u32,
    st: vec2f,
}

// Where a direction of any length meets the cube.
fn on_cube(d: vec3f) -> OnCube {
    let a = abs(d);
    if a.x >= a.y && a.x >= a.z {
        return OnCube(select(0u, 1u, d.x < 0.0), vec2f(select(-d.z, d.z, d.x < 0.0), -d.y) / a.x);
    }
    if a.y >= a.z {
        return OnCube(select(2u, 3u, d.y < 0.0), vec2f(d.x, select(d.z, -d.z, d.y < 0.0)) / a.y);
    }
    return OnCube(select(4u, 5u, d.z < 0.0), vec2f(select(d.x, -d.x, d.z < 0.0), -d.y) / a.z);
}

// The direction of a place on the cube, of any length.
fn from_cube(on: OnCube) -> vec3f {
    let s = on.st.x;
    let t = on.st.y;
    switch on.face {
        case 0u: { return vec3f(1.0, -t, -s); }
        case 1u: { return vec3f(-1.0, -t, s); }
        case 2u: { return vec3f(s, 1.0, t); }
        case 3u: { return vec3f(s, -1.0, -t); }
        case 4u: { return vec3f(s, -t, 1.0); }
        default: { return vec3f(-s, -t, -1.0); }
    }
}
