//! Twin of `shaders/shared/footprint.wgsl`.

use super::lanes::{F, V3, abs, splat};

pub(super) struct FootprintAxes {
    pub major: F,
    pub minor: F,
    pub direction: V3,
}

/// How the unit reflected direction r changes along a side of the region: the derivative of (d − 2(d·n)n)/|d| for
/// dd = side, dn = change, where the side is tangent (side·n = 0).
#[inline(always)]
pub(super) fn reflected_side(side: V3, change: V3, d: V3, n: V3, dn: F, inverse_l: F, r: V3) -> V3 {
    let v = side - n * (splat(2.0) * d.dot(change)) - change * (dn + dn);
    (v - r * r.dot(v)) * inverse_l
}

/// A footprint blurred by a lobe: a parallelogram with the second moments of both together. The lobe around r is `lobe` wide in
/// the plane of incidence and, as normals turn the light less there, narrower by the cosine across it.
#[inline(always)]
pub(super) fn blurred(v1: V3, v2: V3, r: V3, n: V3, cosine: F, lobe: F) -> (V3, V3) {
    let in_plane = n - r * n.dot(r);
    // Perpendicular incidence knows no plane: any will do.
    let V3([x, y, z]) = r;
    let steep = abs(y).simd_gt(splat(0.7));
    let any = V3([steep.bitselect(z, F::ZERO), steep.bitselect(F::ZERO, -z), steep.bitselect(-x, y)]);
    let perpendicular = in_plane.dot(in_plane).simd_lt(splat(1e-6));
    let in_plane = V3([0, 1, 2].map(|k| perpendicular.bitselect(any.0[k], in_plane.0[k])));
    let e1 = in_plane * (F::ONE / in_plane.dot(in_plane).sqrt());
    let e2 = r.cross(e1);
    let (a1x, a1y, a2x, a2y) = (v1.dot(e1), v1.dot(e2), v2.dot(e1), v2.dot(e2));
    let across = lobe * cosine;
    let m11 = a1x * a1x + a2x * a2x + lobe * lobe;
    let m12 = a1x * a1y + a2x * a2y;
    let m22 = a1y * a1y + a2y * a2y + across * across;
    // Cholesky's factor: sides with these moments.
    let l11 = m11.sqrt();
    let l21 = m12 / l11;
    (e1 * l11 + e2 * l21, e2 * (m22 - l21 * l21).max(F::ZERO).sqrt())
}

/// Principal axes of the parallelogram with sides v1, v2: side lengths of the rectangle with the same second moments, and
/// the longer side itself.
#[inline(always)]
pub(super) fn footprint_axes(v1: V3, v2: V3) -> FootprintAxes {
    let (g11, g12, g22) = (v1.dot(v1), v1.dot(v2), v2.dot(v2));
    let half_difference = splat(0.5) * (g11 - g22);
    let mean = splat(0.5) * (g11 + g22);
    let radius = (half_difference * half_difference + g12 * g12).sqrt();
    let major = (mean + radius).sqrt();
    let minor = (mean - radius).max(F::ZERO).sqrt();
    // The eigenvector of the larger eigenvalue, in the form that does not cancel.
    let second_larger = half_difference.simd_lt(F::ZERO);
    let x = second_larger.bitselect(g12, half_difference + radius);
    let y = second_larger.bitselect(radius - half_difference, g12);
    let scale = F::ONE / (x * x + y * y).max(splat(1e-30)).sqrt();
    FootprintAxes { major, minor, direction: v1 * (x * scale) + v2 * (y * scale) }
}
