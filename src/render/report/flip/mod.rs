//! LDR FLIP: how different two pictures look to a viewer who alternates between them.
//!
//! After Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images". The color pipeline compares
//! colours in the detail that the eye resolves; where the feature pipeline finds edges or points in one picture alone,
//! the difference of colours counts for more.

mod colour;
mod filters;

use glam::{Vec3, Vec4};

use crate::image::{Image, display, exposed, srgb8};
use crate::parallel;
use filters::{ContrastSensitivity, FeatureDetectors, Grid};

/// Pixels per degree of visual angle: a screen 0.7 m wide with 3840 columns, seen from 0.7 m.
const PIXELS_PER_DEGREE: f32 = 67.0;

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

/// LDR FLIP at 67 pixels per degree, after the same exposure and tone map of both.
pub(super) fn flip(estimate: &Image, reference: &Image, exposure_ev: f32) -> FlipMap {
    let shown = |image: &Image| {
        let bytes: Vec<_> = image.pixels.iter().map(|p| srgb8(display(exposed(*p, exposure_ev)))).collect();
        percepts(image.width, &bytes)
    };
    difference(&shown(estimate), &shown(reference))
}

/// What the eye makes of a pixel.
#[derive(Clone, Copy)]
struct Percept {
    /// L*a*b*, adjusted for the Hunt effect.
    colour: Vec3,
    /// Strength of edges and of points.
    features: [f32; 2],
}

/// Of sRGB pixels, row by row.
fn percepts(width: u32, srgb: &[[u8; 3]]) -> Vec<Percept> {
    let opponent: Vec<Vec3> = parallel::map(srgb, &|p| colour::opponent_from_srgb(*p));
    let (colours, features) = (colours(width, &opponent), features(width, &opponent));
    colours.into_iter().zip(features).map(|(colour, features)| Percept { colour, features }).collect()
}

/// The color pipeline up to the metric: YCxCz without the detail that the eye does not resolve, then Hunt-adjusted
/// L*a*b*.
fn colours(width: u32, opponent: &[Vec3]) -> Vec<Vec3> {
    let contrast = ContrastSensitivity::new(PIXELS_PER_DEGREE);
    let channels = Grid::new(width, opponent.iter().map(|c| Vec4::new(c.x, c.y, c.z, c.z)).collect());
    let filtered = channels.convolved(&contrast.kernel, &contrast.kernel);
    parallel::map(&filtered.values, &|c| colour::hunt_lab_from_opponent(contrast.merged(*c)))
}

/// The feature pipeline up to the metric: edges and points of the achromatic channel.
fn features(width: u32, opponent: &[Vec3]) -> Vec<[f32; 2]> {
    let detectors = FeatureDetectors::new(PIXELS_PER_DEGREE);
    let grey = Grid::new(width, opponent.iter().map(|c| Vec4::splat(colour::relative_luminance(*c))).collect());
    let derivatives = grey.convolved(&detectors.horizontal, &detectors.vertical);
    derivatives.values.into_iter().map(|d| [d.x.hypot(d.y), d.z.hypot(d.w)]).collect()
}

/// The final difference: that of colours, raised by that of features.
fn difference(estimate: &[Percept], reference: &[Percept]) -> FlipMap {
    let pixel = |k: usize| {
        let (a, b) = (&estimate[k], &reference[k]);
        colour::difference(a.colour, b.colour).powf(1.0 - feature_difference(a.features, b.features))
    };
    FlipMap { values: parallel::collect(estimate.len().min(reference.len()), &pixel) }
}

/// 0 to 1: of edges or of points, whichever differs more.
fn feature_difference(a: [f32; 2], b: [f32; 2]) -> f32 {
    let larger = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
    (larger / 2_f32.sqrt()).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: u32 = 48;
    const HEIGHT: u32 = 40;
    /// Columns and rows: corners, a border, features and between.
    const PLACES: [(u32, u32); 6] = [(0, 0), (12, 10), (24, 20), (31, 5), (47, 17), (47, 39)];

    /// Two pictures, and what nv-flip 0.1.2 (NVIDIA's implementation) gives for them at 67 pixels per degree.
    struct Case {
        name: &'static str,
        reference: fn(u32, u32) -> [u8; 3],
        estimate: fn(u32, u32) -> [u8; 3],
        mean: f64,
        /// At `PLACES`.
        values: [f32; 6],
    }

    fn gradient(x: u32, y: u32) -> [u8; 3] {
        [5 * x, 6 * y, 250 - 2 * x - 3 * y].map(|c| c as u8)
    }

    fn checkers(size: u32, x: u32, y: u32) -> bool {
        (x / size + y / size).is_multiple_of(2)
    }

    /// A dot and a vertical line on dark grey.
    fn dot_and_line(dot: (u32, u32), line: u32, x: u32, y: u32) -> [u8; 3] {
        match (x, y) {
            _ if (x, y) == dot => [255; 3],
            _ if x == line => [255, 220, 160],
            _ => [16; 3],
        }
    }

    /// A hash of place and seed.
    fn noise(seed: u32, x: u32, y: u32) -> [u8; 3] {
        [0, 1, 2].map(|channel| {
            let h = (x + 64 * (y + 64 * (channel + 3 * seed))).wrapping_mul(0x9e37_79b1);
            ((h ^ (h >> 15)).wrapping_mul(0x85eb_ca77) >> 24) as u8
        })
    }

    const CASES: [Case; 6] = [
        Case {
            name: "shifted gradient",
            reference: gradient,
            estimate: |x, y| gradient(x + 2, y),
            mean: 0.12656,
            values: [0.08137, 0.06609, 0.13000, 0.14745, 0.19759, 0.18179],
        },
        Case {
            name: "detail that the eye does not resolve",
            reference: |x, y| if checkers(1, x, y) { [120, 90, 60] } else { [70, 90, 140] },
            estimate: |x, y| if checkers(1, x, y) { [70, 90, 140] } else { [120, 90, 60] },
            mean: 0.00458,
            values: [0.18302, 0.00015, 0.00015, 0.00022, 0.00266, 0.18301],
        },
        Case {
            name: "checkers without contrast",
            reference: |x, y| if checkers(5, x, y) { [96, 110, 120] } else { [170, 150, 130] },
            estimate: |_, _| [133, 130, 125],
            mean: 0.26424,
            values: [0.44132, 0.17425, 0.08706, 0.24031, 0.39716, 0.43402],
        },
        Case {
            name: "dot and line",
            reference: |x, y| dot_and_line((12, 10), 30, x, y),
            estimate: |x, y| dot_and_line((24, 20), 31, x, y),
            mean: 0.10279,
            values: [0.00000, 0.82105, 0.81069, 0.42641, 0.00000, 0.00000],
        },
        Case {
            name: "noise",
            reference: |x, y| noise(0, x, y),
            estimate: |x, y| noise(1, x, y),
            mean: 0.47232,
            values: [0.82743, 0.44545, 0.36414, 0.42448, 0.45127, 0.61188],
        },
        Case {
            name: "the largest distances",
            reference: |x, _| if x < 24 { [0, 255, 0] } else { [255; 3] },
            estimate: |x, _| if x < 24 { [0, 0, 255] } else { [0; 3] },
            mean: 0.98462,
            values: [1.00000, 1.00000, 0.98489, 0.97000, 0.96739, 0.96739],
        },
    ];

    fn seen(pixel: fn(u32, u32) -> [u8; 3]) -> Vec<Percept> {
        let pixels: Vec<_> = (0..WIDTH * HEIGHT).map(|i| pixel(i % WIDTH, i / WIDTH)).collect();
        percepts(WIDTH, &pixels)
    }

    #[test]
    fn flip_sees_what_an_eye_sees() {
        let reference = Image::new(64, 64).map(|_| Vec3::splat(0.2));
        assert!(flip(&reference, &reference, 0.0).mean(None) < 1e-6);
        let little = flip(&reference.map(|p| p * 1.05), &reference, 0.0).mean(None);
        let much = flip(&reference.map(|p| p * 2.0), &reference, 0.0).mean(None);
        assert!(little > 0.0 && little < 0.1 && much > 2.0 * little && much < 1.0, "{little} {much}");
    }

    #[test]
    fn errors_agree_with_nvidias_implementation() {
        for case in CASES {
            let map = difference(&seen(case.estimate), &seen(case.reference));
            let (name, mean) = (case.name, map.mean(None));
            assert!((mean - case.mean).abs() < 1e-4, "{name}: a mean of {mean}, expected {}", case.mean);
            for ((x, y), expected) in PLACES.into_iter().zip(case.values) {
                let value = map.values[(y * WIDTH + x) as usize];
                assert!((value - expected).abs() < 1e-4, "{name} at {x}, {y}: {value}, expected {expected}");
            }
        }
    }
}
