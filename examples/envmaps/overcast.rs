//! An overcast day: the luminance of the CIE standard overcast sky (three
//! times brighter at the zenith than at the horizon) with soft cloud
//! structure, over a muted meadow and hills.

use std::f32::consts::PI;

use glam::Vec3;

use crate::noise::{fbm, smoothstep};
use crate::terrain::land;

const ZENITH: f32 = 1.25;
/// Level irradiance of the CIE overcast sky is 7 pi / 9 of its zenith radiance.
const GROUND_IRRADIANCE: f32 = 7.0 * PI / 9.0 * ZENITH;
/// Where the hidden sun makes the cloud a little brighter.
const SUN_TOWARDS: Vec3 = Vec3::new(-0.35, 0.72, 0.60);
const SHADE: Vec3 = Vec3::new(0.76, 0.83, 0.93);
const LIGHT: Vec3 = Vec3::new(1.06, 1.04, 1.01);

pub fn radiance(direction: Vec3) -> Vec3 {
    let Some(land) = land(direction) else {
        return sky(direction);
    };
    let grey = Vec3::splat(land.albedo.element_sum() / 3.0);
    let muted = land.albedo.lerp(grey, 0.35);
    let lit = muted * GROUND_IRRADIANCE / PI;
    lit.lerp(LIGHT * cie(0.0) * 0.95, land.haze)
}

/// The CIE overcast sky at the sine of an elevation.
fn cie(up: f32) -> f32 {
    ZENITH * (1.0 + 2.0 * up) / 3.0
}

fn sky(direction: Vec3) -> Vec3 {
    let up = direction.y.max(0.0);
    let towards_sun = direction.dot(SUN_TOWARDS).max(0.0);
    let veil = 1.0 + 0.35 * towards_sun.powi(12);
    let thickness = clouds(direction) * smoothstep(0.0, 0.22, up);
    let tint = LIGHT.lerp(SHADE, (0.5 + thickness).clamp(0.0, 1.0));
    tint * (cie(up) * veil * (1.0 - 0.42 * thickness))
}

/// Thickness of the cloud about its mean, -0.7 to 0.7.
fn clouds(direction: Vec3) -> f32 {
    // The cloud base is a shell around a small Earth, so that its structure
    // shrinks towards the horizon but does not vanish there.
    let (base, earth) = (1.0, 6.0);
    let up = direction.y * earth;
    let reach = (up * up + base * (2.0 * earth + base)).sqrt() - up;
    let place = direction * reach * Vec3::new(0.75, 1.5, 1.0);
    let drift = Vec3::new(fbm(place * 0.6, 3, 41), 0.0, fbm(place * 0.6, 3, 42));
    let billow = fbm(place * 1.1 + 0.8 * drift, 6, 43);
    0.8 * billow.clamp(-0.9, 0.9)
}
