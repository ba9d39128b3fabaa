//! LDR FLIP: how different two pictures look to a viewer.

use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageRgb8};

use crate::image::{Image, display, exposed, srgb8};

/// What a viewer would notice: the FLIP error of every pixel, 0 to 1.
#[derive(Clone, Debug)]
pub(super) struct FlipMap {
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
pub(super) fn flip(estimate: &Image, reference: &Image, exposure_ev: f32) -> FlipMap {
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
    fn flip_sees_what_an_eye_sees() {
        let reference = Image::new(64, 64).map(|_| Vec3::splat(0.2));
        assert!(flip(&reference, &reference, 0.0).mean(None) < 1e-6);
        let little = flip(&reference.map(|p| p * 1.05), &reference, 0.0).mean(None);
        let much = flip(&reference.map(|p| p * 2.0), &reference, 0.0).mean(None);
        assert!(little > 0.0 && little < 0.1 && much > 2.0 * little && much < 1.0, "{little} {much}");
    }
}
