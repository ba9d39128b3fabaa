//! Twin of `shaders/shared/footprint.wgsl`.

use super::lanes::{F, V3, splat};

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
