//! How far two pictures are apart.

use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageRgb8};

use super::{Image, display, exposed, srgb8};

/// ‖E − R‖₂ / ‖R‖₂ over all channels of all pixels, or of those where `mask` is true. The pictures must have one size.
pub fn rel_l2(estimate: &Image, reference: &Image, mask: Option<&[bool]>) -> f64 {
    let (mut difference, mut norm) = (0.0, 0.0);
    for (e, r) in pairs(estimate, reference, mask) {
        difference += (e - r).length_squared();
        norm += r.length_squared();
    }
    (difference / norm).sqrt()
}

/// Mean of (E − R)² / (R + 0.01)² over channels and pixels, as pbrt's imgtool: an error in the dark counts as much as one
/// in the light.
pub fn mrse(estimate: &Image, reference: &Image, mask: Option<&[bool]>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (e, r) in pairs(estimate, reference, mask) {
        let relative = (e - r) / (r + 0.01);
        sum += relative.length_squared();
        count += 3.0;
    }
    sum / count
}

fn pairs<'a>(
    estimate: &'a Image,
    reference: &'a Image,
    mask: Option<&'a [bool]>,
) -> impl Iterator<Item = (glam::DVec3, glam::DVec3)> + 'a {
    assert_eq!((estimate.width, estimate.height), (reference.width, reference.height), "pictures of one size");
    let all = estimate.pixels.iter().zip(&reference.pixels).enumerate();
    all.filter(move |(i, _)| mask.is_none_or(|m| m[*i])).map(|(_, (e, r))| (e.as_dvec3(), r.as_dvec3()))
}

/// What a viewer would notice: the FLIP error of every pixel, 0 to 1.
#[derive(Clone, Debug)]
pub struct FlipMap {
    /// Row by row from the top left.
    pub values: Vec<f32>,
}

impl FlipMap {
    /// The mean, over all pixels or those of a mask.
    pub fn mean(&self, mask: Option<&[bool]>) -> f64 {
        let chosen = self.values.iter().enumerate().filter(|(i, _)| mask.is_none_or(|m| m[*i]));
        let (sum, count) = chosen.fold((0.0, 0.0), |(sum, count), (_, v)| (sum + f64::from(*v), count + 1.0));
        sum / count
    }
}

/// LDR FLIP (Andersson et al. 2020) at 67 pixels per degree, after the same exposure and tone map of both.
pub fn flip(estimate: &Image, reference: &Image, exposure_ev: f32) -> FlipMap {
    let shown = |image: &Image| {
        let bytes: Vec<u8> = image.pixels.iter().flat_map(|p| srgb8(display(exposed(*p, exposure_ev)))).collect();
        FlipImageRgb8::with_data(image.width, image.height, &bytes)
    };
    let map = nv_flip::flip(shown(reference), shown(estimate), DEFAULT_PIXELS_PER_DEGREE);
    FlipMap { values: map.to_vec() }
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

    #[test]
    fn flip_sees_what_an_eye_sees() {
        let reference = Image::new(64, 64).map(|_| Vec3::splat(0.2));
        assert!(flip(&reference, &reference, 0.0).mean(None) < 1e-6);
        let little = flip(&reference.map(|p| p * 1.05), &reference, 0.0).mean(None);
        let much = flip(&reference.map(|p| p * 2.0), &reference, 0.0).mean(None);
        assert!(little > 0.0 && little < 0.1 && much > 2.0 * little && much < 1.0, "{little} {much}");
    }
}
