// Frames of unit vectors. CPU twin: src/sums/pinhole/visibility.rs.

struct TangentFrame {
    u: vec3f,
    v: vec3f,
}

// Two unit tangents (Duff et al. 2017, Building an Orthonormal Basis, Revisited).
fn tangent_frame(n: vec3f) -> TangentFrame {
    let sign = select(1.0, -1.0, n.z < 0.0);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    return TangentFrame(vec3f(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), vec3f(b, sign + n.y * n.y * a, -n.y));
}
