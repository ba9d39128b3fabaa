//! Twin of `shaders/shared/footprint.wgsl` and, where footprints have a third side, of `widened` in `medium.wgsl`.

use crate::lanes::{F, Select, Simd, SimdBase, SimdFloat, V3, splat};

pub(super) struct FootprintAxes<S: Simd> {
    pub major: F<S>,
    pub minor: F<S>,
    pub direction: V3<S>,
}

/// Change of the unit reflected direction r along a side of the cell: the derivative of (d − 2(d·n)n)/|d| for
/// dd = side, dn = change, where the side is tangent (side·n = 0).
#[inline(always)]
pub(super) fn reflected_side<S: Simd>(
    side: V3<S>,
    change: V3<S>,
    d: V3<S>,
    n: V3<S>,
    dn: F<S>,
    inverse_l: F<S>,
    r: V3<S>,
) -> V3<S> {
    let v = side.plus(n, d.dot(change) * -2.0).plus(change, dn * -2.0);
    v.plus(r, -r.dot(v)) * inverse_l
}

/// A footprint convolved with a lobe and, if there is one, with a third side: a parallelogram with the sum of their second moments. The lobe
/// around r has one width in the plane of incidence and another one across it.
#[inline(always)]
pub(super) fn widened<S: Simd>(
    simd: S,
    [v1, v2]: [V3<S>; 2],
    third: Option<V3<S>>,
    (r, n): (V3<S>, V3<S>),
    (along, across): (F<S>, F<S>),
) -> (V3<S>, V3<S>) {
    let in_plane = n - r * n.dot(r);
    // Perpendicular incidence has no plane of incidence: any will do.
    let V3([x, y, z]) = r;
    let zero = splat(simd, 0.0);
    let steep = y.abs().simd_gt(0.7);
    let any = V3([steep.select(z, zero), steep.select(zero, -z), steep.select(-x, y)]);
    let perpendicular = in_plane.dot(in_plane).simd_lt(1e-6);
    let in_plane = V3::select(perpendicular, any, in_plane);
    let e1 = in_plane * (1.0 / in_plane.dot(in_plane).sqrt());
    let e2 = r.cross(e1);
    let (a1x, a1y, a2x, a2y) = (v1.dot(e1), v1.dot(e2), v2.dot(e1), v2.dot(e2));
    let mut m11 = a1x * a1x + a2x * a2x + along * along;
    let mut m12 = a1x * a1y + a2x * a2y;
    let mut m22 = a1y * a1y + a2y * a2y + across * across;
    if let Some(third) = third {
        let (x, y) = (third.dot(e1), third.dot(e2));
        m11 += x * x;
        m12 += x * y;
        m22 += y * y;
        // One side along the third one, which is often the longest, and one across it: sides with these moments.
        let (squared, one, zero) = (x * x + y * y, splat(simd, 1.0), splat(simd, 0.0));
        let is_short = squared.simd_le(m11 * 1e-10 + m22 * 1e-10);
        let length = squared.sqrt().max(f32::MIN_POSITIVE);
        let (x, y) = (is_short.select(one, x / length), is_short.select(zero, y / length));
        let (along_x, along_y) = (m11 * x + m12 * y, m12 * x + m22 * y);
        let scale = 1.0 / (along_x * x + along_y * y).sqrt().max(f32::MIN_POSITIVE);
        let (along_x, along_y) = (along_x * scale, along_y * scale);
        let (off, across) = (along_y * x - along_x * y, m11 * y * y - m12 * (x * y * 2.0) + m22 * x * x);
        let across = (across - off * off).max(0.0).sqrt();
        return (e1 * along_x + e2 * along_y, e2 * (x * across) - e1 * (y * across));
    }
    // Cholesky's factor: sides with these moments.
    let l11 = m11.sqrt();
    let l21 = m12 / l11.max(f32::MIN_POSITIVE);
    (e1 * l11 + e2 * l21, e2 * (m22 - l21 * l21).max(0.0).sqrt())
}

/// Principal axes of the parallelogram with sides v1, v2: side lengths of the rectangle with the same second moments, and
/// its longer side as a vector.
#[inline(always)]
pub(super) fn footprint_axes<S: Simd>(v1: V3<S>, v2: V3<S>) -> FootprintAxes<S> {
    let (g11, g12, g22) = (v1.dot(v1), v1.dot(v2), v2.dot(v2));
    let half_difference = (g11 - g22) * 0.5;
    let mean = (g11 + g22) * 0.5;
    let radius = (half_difference * half_difference + g12 * g12).sqrt();
    let major = (mean + radius).sqrt();
    let minor = (mean - radius).max(0.0).sqrt();
    // The eigenvector of the larger eigenvalue, in the form that does not cancel.
    let second_larger = half_difference.simd_lt(0.0);
    let x = second_larger.select(g12, half_difference + radius);
    let y = second_larger.select(radius - half_difference, g12);
    // Every direction is an axis of a square.
    let square = radius.simd_le(mean * 1e-6);
    let (x, y) = (square.select(mean, x), square.select(g12, y));
    let scale = 1.0 / (x * x + y * y).max(1e-30).sqrt();
    FootprintAxes { major, minor, direction: v1 * (x * scale) + v2 * (y * scale) }
}
