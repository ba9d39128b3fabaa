//! The floor of the wood: litter and moss in shade, with flecks of sun.

use glam::Vec3;

use super::trees::{Tree, open_around};
use super::{EYE, Hit};
use crate::noise::{fbm, gradient, smoothstep};

/// The floor in `direction`, if it looks down.
pub fn meet(trees: &[Tree], direction: Vec3) -> Option<Hit> {
    if direction.y >= -0.004 {
        return None;
    }
    let distance = -EYE / direction.y;
    let place = direction * distance;
    let sun = Vec3::new(1.0, 0.88, 0.66) * (15.0 * flecks(place, distance));
    let shade = Vec3::new(0.36, 0.42, 0.33) * (0.25 + 0.75 * open_around(trees, place));
    Some(Hit { distance, radiance: albedo(place, distance) * (sun + shade) })
}

fn albedo(place: Vec3, distance: f32) -> Vec3 {
    // Detail finer than the texels fades out with distance.
    let near = smoothstep(9.0, 1.5, distance);
    let litter = near * fbm(place * Vec3::new(7.0, 0.0, 7.0), 3, 81);
    let patch = fbm(place * Vec3::new(0.55, 0.0, 0.55), 4, 82);
    let brown = Vec3::new(0.17, 0.115, 0.065) * (1.0 + 0.9 * litter);
    let moss = Vec3::new(0.10, 0.115, 0.058) * (1.0 + 0.5 * litter);
    brown.lerp(moss, smoothstep(-0.1, 0.35, patch))
}

/// Share of the floor that the sun reaches, 0 to 1: pools of light under the
/// gaps of the crown, broken up by leaves.
fn flecks(place: Vec3, distance: f32) -> f32 {
    let flat = Vec3::new(place.x, 0.0, place.z);
    let pool = smoothstep(0.0, 0.5, fbm(flat * 0.65, 3, 83));
    let leaf = gradient(flat * 4.6, 84) + 0.8 * gradient(flat * 10.3, 85);
    let sharp = smoothstep(0.0, 0.4, leaf + 0.65 * pool - 0.5);
    let even = 0.3;
    let near = smoothstep(22.0, 6.0, distance);
    pool * (even + (sharp - even) * near)
}
