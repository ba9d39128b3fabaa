//! From radiance to display: exposure, the Khronos PBR Neutral tone mapper, and sRGB.

use glam::Vec3;

/// Applies an exposure in stops.
pub fn exposed(colour: Vec3, ev: f32) -> Vec3 {
    colour * ev.exp2()
}

/// Khronos PBR Neutral (2024): preserves colours up to about 0.8, compresses brighter ones and desaturates them towards
/// white. Linear Rec.709 in and out; the result is in [0, 1].
pub fn display(colour: Vec3) -> Vec3 {
    const START: f32 = 0.8 - 0.04;
    const DESATURATION: f32 = 0.15;
    let colour = colour.max(Vec3::ZERO);
    let least = colour.min_element();
    let offset = if least < 0.08 { least - 6.25 * least * least } else { 0.04 };
    let colour = colour - offset;
    let peak = colour.max_element();
    if peak < START {
        return colour;
    }
    let d = 1.0 - START;
    let new_peak = 1.0 - d * d / (peak + d - START);
    let towards_white = 1.0 - 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    (colour * (new_peak / peak)).lerp(Vec3::splat(new_peak), towards_white).clamp(Vec3::ZERO, Vec3::ONE)
}

/// Encodes display-linear values as 8-bit sRGB.
pub fn srgb8(colour: Vec3) -> [u8; 3] {
    let encode = |c: f32| if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
    colour.clamp(Vec3::ZERO, Vec3::ONE).to_array().map(|c| (255.0 * encode(c) + 0.5) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tone_curve_is_monotone_and_ends_at_white() {
        let grey: Vec<f32> = (0..200).map(|i| display(Vec3::splat((i as f32 * 0.1 - 8.0).exp2())).x).collect();
        assert!(grey.windows(2).all(|w| w[0] <= w[1]));
        assert!(grey[199] > 0.99 && grey[199] <= 1.0);
        let red = display(Vec3::new(1000.0, 1.0, 1.0));
        assert!(red.min_element() > 0.8, "bright colours fade to white: {red}");
    }

    #[test]
    fn srgb_has_its_known_values() {
        assert_eq!(srgb8(Vec3::new(0.0, 1.0, 0.214_041_14)), [0, 255, 128]);
    }
}
