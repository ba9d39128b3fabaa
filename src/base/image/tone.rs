//! From radiance to display: exposure, tone mapping, and sRGB.

use glam::Vec3;

/// Applies an exposure in stops.
pub fn exposed(colour: Vec3, ev: f32) -> Vec3 {
    colour * ev.exp2()
}

/// Display-linear luminance that metering gives to the middle tone of a picture.
pub const MIDDLE_GREY: f32 = 0.22;
/// Display-linear luminance, before tone mapping, that a fiftieth of a picture may exceed.
pub const HIGHLIGHT: f32 = 2.5;

/// The exposure in stops that shows radiance well: the median becomes a middle grey, unless the brightest parts, which are
/// often what a picture is about, would wash out. 0 if everything is black.
pub fn metered_ev(radiance: impl Iterator<Item = Vec3>) -> f32 {
    let luminance = |c: Vec3| c.dot(Vec3::new(0.2126, 0.7152, 0.0722));
    let mut lit: Vec<f32> = radiance.map(luminance).filter(|y| y.is_normal() && *y > 0.0).collect();
    if lit.is_empty() {
        return 0.0;
    }
    let last = (lit.len() - 1) as f32;
    let mut at = |part: f32| *lit.select_nth_unstable_by((part * last) as usize, f32::total_cmp).1;
    (MIDDLE_GREY / at(0.5)).min(HIGHLIGHT / at(0.98)).log2().clamp(-64.0, 64.0)
}

/// How exposed radiance, linear Rec.709, becomes a display's: linear, from 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum ToneMap {
    /// Khronos PBR Neutral (2024): preserves colours up to about 0.8, compresses brighter ones and desaturates them towards white.
    #[default]
    Neutral,
    /// A curve like film's, with soft shadows and highlights (Narkowicz 2016, *ACES Filmic Tone Mapping Curve*), channel by channel.
    Filmic,
    /// No curve: brighter values than 1 are cut off. For measurements by eye.
    Linear,
}

impl ToneMap {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Neutral, Self::Filmic, Self::Linear];

    /// Its name in scene files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Neutral => "neutral",
            Self::Filmic => "filmic",
            Self::Linear => "linear",
        }
    }

    /// The display's colour.
    pub fn apply(self, colour: Vec3) -> Vec3 {
        match self {
            Self::Neutral => neutral(colour),
            Self::Filmic => filmic(colour),
            Self::Linear => colour.clamp(Vec3::ZERO, Vec3::ONE),
        }
    }
}

impl std::fmt::Display for ToneMap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// Applies the default tone map, Khronos PBR Neutral. Linear Rec.709 in and out; the result is in [0, 1].
pub fn display(colour: Vec3) -> Vec3 {
    ToneMap::default().apply(colour)
}

fn filmic(colour: Vec3) -> Vec3 {
    // The fit is to exposures 1/0.6 times as large; the limit keeps squares finite.
    let x = 0.6 * colour.clamp(Vec3::ZERO, Vec3::splat(1e6));
    ((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)).clamp(Vec3::ZERO, Vec3::ONE)
}

fn neutral(colour: Vec3) -> Vec3 {
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
    fn tone_curves_are_monotone_and_end_at_white() {
        for tone_map in ToneMap::ALL {
            let grey = |stops: f32| tone_map.apply(Vec3::splat(stops.exp2())).x;
            let steps: Vec<f32> = (0..400).map(|i| grey(i as f32 * 0.1 - 8.0)).collect();
            assert!(steps.windows(2).all(|w| w[0] <= w[1]), "{tone_map}");
            assert!(steps[399] > 0.99 && steps[399] <= 1.0 && grey(120.0) > 0.99, "{tone_map}: {}", steps[399]);
        }
        let grey: Vec<f32> = (0..200).map(|i| display(Vec3::splat((i as f32 * 0.1 - 8.0).exp2())).x).collect();
        assert!(grey[199] > 0.99 && grey[199] <= 1.0);
        let red = display(Vec3::new(1000.0, 1.0, 1.0));
        assert!(red.min_element() > 0.8, "bright colours fade to white: {red}");
    }

    #[test]
    fn exposures_are_metered_for_the_middle_and_the_highlights() {
        let even = |value: f32| std::iter::repeat_n(Vec3::splat(value), 100);
        assert!((metered_ev(even(0.22 * 8.0)) + 3.0).abs() < 1e-4);
        // A tenth of the picture is a hundred times as bright.
        let lit = even(0.01).take(90).chain(even(1.0).take(10));
        assert!((metered_ev(lit) - HIGHLIGHT.log2()).abs() < 1e-4);
        assert_eq!(metered_ev([Vec3::ZERO, Vec3::splat(f32::NAN)].into_iter()), 0.0);
        assert_eq!(metered_ev(std::iter::empty()), 0.0);
    }

    #[test]
    fn srgb_has_its_known_values() {
        assert_eq!(srgb8(Vec3::new(0.0, 1.0, 0.214_041_14)), [0, 255, 128]);
    }
}
