//! How far two pictures are apart.

use super::Image;

/// ‖E − R‖₂ / ‖R‖₂ over all channels of all pixels, or of those where `mask` is true. The pictures must have one size.
pub fn rel_l2(estimate: &Image, reference: &Image, mask: Option<&[bool]>) -> f64 {
    assert_eq!((estimate.width, estimate.height), (reference.width, reference.height), "pictures of one size");
    let (mut difference, mut norm) = (0.0, 0.0);
    for (i, (e, r)) in estimate.pixels.iter().zip(&reference.pixels).enumerate() {
        if mask.is_none_or(|m| m[i]) {
            difference += (e.as_dvec3() - r.as_dvec3()).length_squared();
            norm += r.as_dvec3().length_squared();
        }
    }
    (difference / norm).sqrt()
}
