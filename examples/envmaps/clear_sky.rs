//! A clear sky with the sun 40 degrees up: the daylight model of Preetham,
//! Shirley and Smits ("A Practical Analytic Model for Daylight", 1999) at
//! turbidity 2.6, over hazy meadow and hills.
//!
//! The sun is a true disc of the angular size seen from the Earth, darker at
//! its limb, and so bright that 16-bit floats could not hold it.

use std::f32::consts::PI;

use glam::{Mat3, Vec3};

use crate::terrain::{Land, land};

const TURBIDITY: f32 = 2.6;
const SUN_TOWARDS: Vec3 = Vec3::new(0.5, 0.64, -0.58);
/// Angular radius of the sun: 0.2665 degrees.
const SUN_RADIUS: f32 = 0.2665 * PI / 180.0;
/// Irradiance across the sun's rays over that of the sky on level ground.
const SUN_TO_SKY: f32 = 5.0;
const SUN_COLOUR: Vec3 = Vec3::new(1.08, 0.99, 0.83);
/// Brightness lost from the centre of the disc to its limb.
const LIMB_LOSS: f32 = 0.6;
/// Sky irradiance on level ground, which sets the scale of the whole map.
const SKY_IRRADIANCE: f32 = 2.2;

/// The five Perez coefficients of luminance Y and chromaticities x and y.
struct Perez([Vec3; 5]);

pub struct ClearSky {
    sun: Vec3,
    perez: Perez,
    /// Zenith Y, x, y over the Perez function there.
    zenith: Vec3,
    sun_centre: Vec3,
    ground_irradiance: Vec3,
}

/// Samples per side of a texel: many where the sun's edge may cross it.
pub fn samples(direction: Vec3) -> usize {
    if direction.angle_between(SUN_TOWARDS) < 0.02 { 64 } else { 4 }
}

impl ClearSky {
    pub fn new() -> Self {
        let sun = SUN_TOWARDS.normalize();
        let perez = Perez::at(TURBIDITY);
        let to_zenith = perez.value(1.0, sun.y.acos());
        let zenith = zenith_yxy(TURBIDITY, sun.y.acos()) / to_zenith;
        let mut clear = Self { sun, perez, zenith, sun_centre: Vec3::ZERO, ground_irradiance: Vec3::ZERO };
        clear.zenith.x *= SKY_IRRADIANCE / luminance(clear.level_irradiance());
        let sun_irradiance = SUN_COLOUR * (SUN_TO_SKY * SKY_IRRADIANCE);
        clear.sun_centre = sun_irradiance / disc_solid_angle();
        clear.ground_irradiance = clear.level_irradiance() + sun_irradiance * sun.y;
        clear
    }

    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        match land(direction) {
            Some(land) => self.lit_land(&land, direction),
            None => self.sky(direction) + self.disc(direction),
        }
    }

    fn lit_land(&self, land: &Land, direction: Vec3) -> Vec3 {
        let level = Vec3::new(direction.x, 0.02, direction.z).normalize();
        let lit = land.albedo * self.ground_irradiance / PI;
        lit.lerp(0.8 * self.sky(level), land.haze)
    }

    /// The sky's light without the sun.
    fn sky(&self, direction: Vec3) -> Vec3 {
        let from_sun = self.sun.dot(direction).clamp(-1.0, 1.0).acos();
        // The model diverges at the horizon itself.
        let yxy = self.zenith * self.perez.value(direction.y.max(0.015), from_sun);
        rgb_of_yxy(yxy)
    }

    /// The sun's disc. The sine of the angle, from a cross product, stays
    /// precise where the cosine does not.
    fn disc(&self, direction: Vec3) -> Vec3 {
        let outward = self.sun.cross(direction).length() / SUN_RADIUS.sin();
        if outward >= 1.0 || self.sun.dot(direction) < 0.0 {
            return Vec3::ZERO;
        }
        let facing = (1.0 - outward * outward).sqrt();
        self.sun_centre * (1.0 - LIMB_LOSS * (1.0 - facing))
    }

    /// Irradiance of the sky alone on level ground, by midpoint sums.
    fn level_irradiance(&self) -> Vec3 {
        let (rings, spokes) = (64, 128);
        let mut sum = Vec3::ZERO;
        for k in 0..rings * spokes {
            // Equal steps of y squared share the cosine-weighted hemisphere evenly.
            let y = (((k / spokes) as f32 + 0.5) / rings as f32).sqrt();
            let turn = 2.0 * PI * ((k % spokes) as f32 + 0.5) / spokes as f32;
            let level = (1.0 - y * y).sqrt();
            sum += self.sky(Vec3::new(level * turn.sin(), y, level * turn.cos()));
        }
        sum * PI / (rings * spokes) as f32
    }
}

/// Solid angle of the disc, weighed by its mean brightness over the centre's.
fn disc_solid_angle() -> f32 {
    PI * SUN_RADIUS.sin().powi(2) * (1.0 - LIMB_LOSS / 3.0)
}

impl Perez {
    fn at(t: f32) -> Self {
        let line = |slope: [f32; 3], start: [f32; 3]| Vec3::from(slope) * t + Vec3::from(start);
        Self([
            line([0.1787, -0.0193, -0.0167], [-1.4630, -0.2592, -0.2608]),
            line([-0.3554, -0.0665, -0.0950], [0.4275, 0.0008, 0.0092]),
            line([-0.0227, -0.0004, -0.0079], [5.3251, 0.2125, 0.2102]),
            line([0.1206, -0.0641, -0.0441], [-2.5771, -0.8989, -1.6537]),
            line([-0.0670, -0.0033, -0.0109], [0.3703, 0.0452, 0.0529]),
        ])
    }

    /// The Perez function of the cosine from the zenith and the angle from the sun.
    fn value(&self, cos_zenith: f32, from_sun: f32) -> Vec3 {
        let [a, b, c, d, e] = self.0;
        let height = Vec3::ONE + a * (b / cos_zenith).exp();
        height * (Vec3::ONE + c * (d * from_sun).exp() + e * from_sun.cos().powi(2))
    }
}

/// Luminance (kcd/m^2) and chromaticity of the zenith.
fn zenith_yxy(t: f32, sun_angle: f32) -> Vec3 {
    let s = sun_angle;
    let chi = (4.0 / 9.0 - t / 120.0) * (PI - 2.0 * s);
    let luminance = (4.0453 * t - 4.9710) * chi.tan() - 0.2155 * t + 2.4192;
    let cubic = |k: [f32; 4]| ((k[0] * s + k[1]) * s + k[2]) * s + k[3];
    let x = t * t * cubic([0.00166, -0.00375, 0.00209, 0.0])
        + t * cubic([-0.02903, 0.06377, -0.03202, 0.00394])
        + cubic([0.11693, -0.21196, 0.06052, 0.25886]);
    let y = t * t * cubic([0.00275, -0.00610, 0.00317, 0.0])
        + t * cubic([-0.04214, 0.08970, -0.04153, 0.00516])
        + cubic([0.15346, -0.26756, 0.06670, 0.26688]);
    Vec3::new(luminance, x, y)
}

/// Linear Rec.709 of luminance and chromaticity given as (Y, x, y).
fn rgb_of_yxy(yxy: Vec3) -> Vec3 {
    let (luminance, x, y) = (yxy.x, yxy.y, yxy.z);
    let xyz = Vec3::new(x / y, 1.0, (1.0 - x - y) / y) * luminance;
    let to_rgb = Mat3::from_cols(
        Vec3::new(3.2406, -0.9689, 0.0557),
        Vec3::new(-1.5372, 1.8758, -0.2040),
        Vec3::new(-0.4986, 0.0415, 1.0570),
    );
    (to_rgb * xyz).max(Vec3::ZERO)
}

fn luminance(rgb: Vec3) -> f32 {
    rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}
