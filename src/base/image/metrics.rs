//! Error metrics.

use super::Image;

/// ‖E − R‖₂ / ‖R‖₂ over all channels of all pixels, or of those where `mask` is true. NaN for pictures of different
/// sizes, or where the reference is black.
///
/// ```
/// use pinspot::glam::Vec3;
/// use pinspot::image::{Image, rel_l2};
///
/// let reference = Image::new(2, 2).map(|_| Vec3::ONE);
/// let estimate = reference.map(|colour| 1.25 * colour);
/// assert_eq!(rel_l2(&estimate, &reference, None), 0.25);
/// ```
pub fn rel_l2(estimate: &Image, reference: &Image, mask: Option<&[bool]>) -> f64 {
    let (mut difference, mut norm) = no_error(estimate, reference);
    for (e, r) in pairs(estimate, reference, mask) {
        difference += (e - r).length_squared();
        norm += r.length_squared();
    }
    (difference / norm).sqrt()
}

/// Mean of (E − R)² / (R + 0.01)² over channels and pixels, as pbrt's imgtool: an error in the dark counts as much as
/// one in the light.
pub fn mrse(estimate: &Image, reference: &Image, mask: Option<&[bool]>) -> f64 {
    let (mut sum, mut count) = no_error(estimate, reference);
    for (e, r) in pairs(estimate, reference, mask) {
        let relative = (e - r) / (r + 0.01);
        sum += relative.length_squared();
        count += 3.0;
    }
    sum / count
}

/// The indices of pixels that stand out: the mean of their channels differs from the median of the 3×3 pixels around them by more than the
/// reference does at any of these pixels, and by `threshold` times the median plus the mean of the reference. Pixels at the
/// pictures' edges are left out; pictures of different sizes have none.
///
/// ```
/// use pinspot::glam::Vec3;
/// use pinspot::image::{Image, speckles};
///
/// let reference = Image::new(9, 9).map(|_| Vec3::ONE);
/// let mut estimate = reference.clone();
/// estimate.pixels[40] = Vec3::splat(1.5);
/// assert_eq!(speckles(&estimate, &reference, 0.2), [40]);
/// ```
pub fn speckles(estimate: &Image, reference: &Image, threshold: f32) -> Vec<usize> {
    let (width, height) = (reference.width as usize, reference.height as usize);
    if (estimate.width, estimate.height) != (reference.width, reference.height) {
        return Vec::new();
    }
    let grey = |image: &Image| image.pixels.iter().map(|p| p.element_sum() / 3.0).collect::<Vec<f32>>();
    let [estimate, reference] = [estimate, reference].map(grey);
    let around = |k: usize| [k - width, k, k + width].map(|row| [row - 1, row, row + 1]).concat();
    let inner: Vec<usize> =
        (width..width * height.saturating_sub(1)).filter(|k| k % width > 0 && k % width + 1 < width).collect();
    let deviation = |picture: &[f32], k: usize| {
        let mut values: Vec<f32> = around(k).into_iter().map(|other| picture[other]).collect();
        values.sort_by(f32::total_cmp);
        ((picture[k] - values[4]).abs(), values[4])
    };
    let mut of_reference = vec![(0.0, 0.0); reference.len()];
    for &k in &inner {
        of_reference[k] = deviation(&reference, k);
    }
    let mean = reference.iter().sum::<f32>() / reference.len().max(1) as f32;
    let stands_out = |&k: &usize| {
        let allowed = around(k).into_iter().map(|other| of_reference[other].0).fold(0.0, f32::max);
        deviation(&estimate, k).0 > allowed + threshold * (of_reference[k].1 + mean)
    };
    inner.into_iter().filter(stands_out).collect()
}

/// Where sums begin: at nothing, or at NaN for pictures that cannot be compared.
fn no_error(estimate: &Image, reference: &Image) -> (f64, f64) {
    let is_alike = (estimate.width, estimate.height) == (reference.width, reference.height);
    if is_alike { (0.0, 0.0) } else { (f64::NAN, f64::NAN) }
}

fn pairs<'a>(
    estimate: &'a Image,
    reference: &'a Image,
    mask: Option<&'a [bool]>,
) -> impl Iterator<Item = (glam::DVec3, glam::DVec3)> + 'a {
    let all = estimate.pixels.iter().zip(&reference.pixels).enumerate();
    all.filter(move |(i, _)| mask.is_none_or(|m| m.get(*i) == Some(&true)))
        .map(|(_, (e, r))| (e.as_dvec3(), r.as_dvec3()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn errors_have_their_closed_forms() {
        let reference = Image::new(40, 30).map(|_| Vec3::splat(0.5));
        let estimate = reference.map(|p| p * 1.1);
        assert!((rel_l2(&estimate, &reference, None) - 0.1).abs() < 1e-6);
        assert!((mrse(&estimate, &reference, None) - (0.05f64 / 0.51).powi(2)).abs() < 1e-7);
        let mut mask = vec![false; 1200];
        mask[7] = true;
        let mut spoiled = estimate.clone();
        spoiled.pixels[8] = Vec3::splat(100.0);
        assert!((rel_l2(&spoiled, &reference, Some(&mask)) - 0.1).abs() < 1e-6, "the mask hides what is outside");
    }
}
