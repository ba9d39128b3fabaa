//! The land under the two open skies: a near meadow, and two ranges of hills
//! that lose themselves in the haze.

use glam::Vec3;

use crate::noise::{fbm, smoothstep};

/// What a direction sees of the land.
pub struct Land {
    pub albedo: Vec3,
    /// Share of the light that is haze in front of the land, 0 to 1.
    pub haze: f32,
}

/// One range of hills: its crest is a noise around the horizon.
struct Hills {
    base: f32,
    rise: f32,
    detail: f32,
    seed: u32,
    haze: f32,
}

const RANGES: [Hills; 2] = [
    Hills { base: 0.004, rise: 0.050, detail: 5.0, seed: 11, haze: 0.42 },
    Hills { base: 0.040, rise: 0.085, detail: 2.6, seed: 12, haze: 0.72 },
];

/// Height of the viewer's eye above the meadow, in metres.
const EYE: f32 = 1.7;

/// The land in `direction`, or None where it sees the sky.
pub fn land(direction: Vec3) -> Option<Land> {
    if direction.y < 0.0 {
        return Some(meadow(direction));
    }
    let around = Vec3::new(direction.x, 0.0, direction.z).normalize_or_zero();
    let range = RANGES.iter().find(|range| direction.y < crest(range, around))?;
    let mottle = fbm(direction * Vec3::new(30.0, 90.0, 30.0), 3, range.seed + 5);
    Some(Land { albedo: Vec3::new(0.10, 0.13, 0.07) * (1.0 + 0.4 * mottle), haze: range.haze })
}

/// The sine of the elevation of a range's crest.
fn crest(range: &Hills, around: Vec3) -> f32 {
    let rolling = fbm(around * range.detail, 5, range.seed);
    range.base + range.rise * (0.5 + 0.5 * rolling).max(0.0)
}

fn meadow(direction: Vec3) -> Land {
    let distance = EYE / (-direction.y).max(1e-4);
    let place = direction * distance;
    let wide = fbm(place * Vec3::new(0.11, 0.0, 0.11), 4, 21);
    // Tufts shrink below a texel with distance: let them fade to their mean.
    let near = smoothstep(14.0, 2.0, distance);
    let tufts = near * fbm(place * Vec3::new(2.2, 0.0, 2.2), 2, 22);
    let dryness = smoothstep(-0.5, 0.6, wide);
    let green = Vec3::new(0.20, 0.24, 0.11);
    let straw = Vec3::new(0.32, 0.28, 0.18);
    Land {
        albedo: green.lerp(straw, dryness) * (1.0 + 0.25 * wide + 0.35 * tufts),
        haze: 0.42 * (1.0 - (-distance / 400.0).exp()),
    }
}
