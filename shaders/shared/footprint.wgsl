// Footprints: the part of the environment that a sample's region reflects to one receiver point (Wand & Straßer 2003, Section 3.3).
// CPU twin: src/sums/pinhole/cpu/footprint.rs.

struct FootprintSides {
    v1: vec3f,
    v2: vec3f,
}

// What is looked up around a direction: one footprint, or two parts of a rough mirror's lobe that count alike.
struct LookUps {
    // 1 or 2.
    count: u32,
    // Their unit direction.
    r: vec3f,
    first: FootprintSides,
    second: FootprintSides,
}

fn one_look_up(r: vec3f, sides: FootprintSides) -> LookUps {
    return LookUps(1u, r, sides, sides);
}

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

// Second moments in a frame around a direction: e1 is in the plane of incidence, e2 across it.
struct FootprintMoments {
    e1: vec3f,
    e2: vec3f,
    m11: f32,
    m12: f32,
    m22: f32,
}

// Of a footprint and a lobe together. The lobe around r has one width in the plane of incidence and another one across it.
fn blurred_moments(sides: FootprintSides, r: vec3f, n: vec3f, widths: vec2f) -> FootprintMoments {
    var in_plane = n - r * dot(n, r);
    // At perpendicular incidence the plane is undefined: any will do.
    if dot(in_plane, in_plane) < 1e-6 {
        in_plane = select(vec3f(0.0, -r.z, r.y), vec3f(r.z, 0.0, -r.x), abs(r.y) > 0.7);
    }
    let e1 = in_plane * inverseSqrt(dot(in_plane, in_plane));
    let e2 = cross(r, e1);
    let a1 = vec2f(dot(sides.v1, e1), dot(sides.v1, e2));
    let a2 = vec2f(dot(sides.v2, e1), dot(sides.v2, e2));
    let m11 = a1.x * a1.x + a2.x * a2.x + widths.x * widths.x;
    let m12 = a1.x * a1.y + a2.x * a2.y;
    let m22 = a1.y * a1.y + a2.y * a2.y + widths.y * widths.y;
    return FootprintMoments(e1, e2, m11, m12, m22);
}

// A footprint blurred by a lobe: a parallelogram with the second moments of both together.
fn blurred(sides: FootprintSides, r: vec3f, n: vec3f, widths: vec2f) -> FootprintSides {
    let m = blurred_moments(sides, r, n, widths);
    // Cholesky's factor: sides with these moments.
    let l11 = sqrt(m.m11);
    let l21 = m.m12 / l11;
    return FootprintSides(m.e1 * l11 + m.e2 * l21, m.e2 * sqrt(max(m.m22 - l21 * l21, 0.0)));
}

// The widths of a mirror's lobe: across the plane of incidence normals turn the light less, by the cosine.
fn mirrored_blur(lobe: f32, cosine: f32) -> vec2f {
    return vec2f(lobe, lobe * cosine);
}

// Whether a footprint whose normals change like this is mostly a rough mirror's lobe.
fn is_mostly_lobe(lobe: f32, change_1: vec3f, change_2: vec3f) -> bool {
    return lobe * lobe > 4.0 * (dot(change_1, change_1) + dot(change_2, change_2));
}

// Principal axes of the parallelogram, as the rectangle with the same second moments: lengths of its
// sides, and the longer side itself.
fn footprint_axes(sides: FootprintSides) -> FootprintAxes {
    let v1 = sides.v1;
    let v2 = sides.v2;
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
    // A square has no preferred axis.
    if radius <= 1e-6 * mean {
        x = mean;
        y = g12;
    }
    let length2 = max(x * x + y * y, 1e-30);
    let scale = inverseSqrt(length2);
    return FootprintAxes(major, minor, scale * (x * v1 + y * v2));
}
