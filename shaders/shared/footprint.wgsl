// Footprints: the part of the environment that a sample's region reflects to one receiver point (WS-18).

struct FootprintAxes {
    major: f32,
    minor: f32,
    direction: vec3f,
}

// How the unit reflected direction r changes along a side of the region: the derivative of
// (d − 2(d·n)n)/|d| for dd = side, dn = change, where the side is tangent (side·n = 0).
fn reflected_side(side: vec3f, change: vec3f, d: vec3f, n: vec3f, dn: f32, inverse_l: f32, r: vec3f) -> vec3f {
    let v = side - 2.0 * dot(d, change) * n - 2.0 * dn * change;
    return (v - r * dot(r, v)) * inverse_l;
}

// Principal axes of the parallelogram with sides v1, v2, as the rectangle with the same second moments: lengths of its
// sides, and the longer side itself.
fn footprint_axes(v1: vec3f, v2: vec3f) -> FootprintAxes {
    let g11 = dot(v1, v1);
    let g12 = dot(v1, v2);
    let g22 = dot(v2, v2);
    let half_difference = 0.5 * (g11 - g22);
    let mean = 0.5 * (g11 + g22);
    let radius = sqrt(half_difference * half_difference + g12 * g12);
    let major = sqrt(mean + radius);
    let minor = sqrt(max(mean - radius, 0.0));
    // The eigenvector of the larger eigenvalue, in the form that does not cancel.
    var x = half_difference + radius;
    var y = g12;
    if half_difference < 0.0 {
        x = g12;
        y = radius - half_difference;
    }
    let length2 = max(x * x + y * y, 1e-30);
    let scale = inverseSqrt(length2);
    return FootprintAxes(major, minor, scale * (x * v1 + y * v2));
}
