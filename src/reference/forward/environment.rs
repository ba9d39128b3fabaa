//! Directions of the environment's light, chosen where it may be bright.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec2, DVec3};

use super::origins::{spot_direction, spot_irradiance};
use crate::cone::Cone;
use crate::light::Light;
use crate::scene::{EnvironmentSource, Light as Source};

/// Boxes of azimuth and height about +Y, of equal solid angles.
const COLUMNS: usize = 256;
const ROWS: usize = 128;
/// Spots of a larger standard deviation than this, radians, are treated as maps are.
const SMALL_SPOT_RAD: f64 = 0.1;

/// How directions are chosen.
pub(crate) enum Directions<'a> {
    None,
    Spot { towards: DVec3, sigma: f64, irradiance: DVec3 },
    Boxes { light: &'a Light, cumulative: Vec<f64> },
}

impl<'a> Directions<'a> {
    pub fn new(source: &EnvironmentSource, light: &'a Light) -> Self {
        if light.is_dark() {
            return Self::None;
        }
        if let Source::Spot { direction, sigma_rad, .. } = &source.light
            && f64::from(*sigma_rad) < SMALL_SPOT_RAD
        {
            let turned = DMat3::from_rotation_y(f64::from(source.rotation_rad)) * direction.as_dvec3();
            let (sigma, irradiance) = (f64::from(*sigma_rad), spot_irradiance(source));
            return Self::Spot { towards: turned.normalize(), sigma, irradiance };
        }
        let mut sum = 0.0;
        let bounds = (0..COLUMNS * ROWS).map(|k| light.bound(&cone(k)));
        let cumulative = bounds.map(|bound| {
            sum += bound;
            sum
        });
        Self::Boxes { light, cumulative: cumulative.collect() }
    }

    /// A unit direction to light, and the radiance from there over the density, W/m²: its mean is the irradiance from all around.
    pub fn sample(&self, [u, v, w]: [f64; 3]) -> Option<(DVec3, DVec3)> {
        match self {
            Self::None => None,
            Self::Spot { towards, sigma, irradiance } => {
                let place = u.sqrt() * DVec2::from_angle(TAU * v);
                let (direction, factor) = spot_direction(*towards, *sigma, place);
                Some((direction, factor * *irradiance))
            }
            Self::Boxes { light, cumulative } => {
                let total = *cumulative.last()?;
                let index = cumulative.partition_point(|sum| *sum <= u * total).min(cumulative.len() - 1);
                let before = if index == 0 { 0.0 } else { cumulative[index - 1] };
                let direction = place(index, [v, w]);
                let solid_angle = 2.0 * TAU / (COLUMNS * ROWS) as f64;
                let density = (cumulative[index] - before) / total / solid_angle;
                Some((direction, light.radiance(direction) / density))
            }
        }
    }
}

/// A direction of a box.
fn place(index: usize, [u, v]: [f64; 2]) -> DVec3 {
    let azimuth = ((index % COLUMNS) as f64 + u) / COLUMNS as f64 * TAU;
    let height = -1.0 + 2.0 * ((index / COLUMNS) as f64 + v) / ROWS as f64;
    let across = (1.0 - height * height).max(0.0).sqrt();
    DVec3::new(across * azimuth.cos(), height, across * azimuth.sin())
}

/// A cone around a box.
fn cone(index: usize) -> Cone {
    let axis = place(index, [0.5; 2]);
    let corners = [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]].map(|corner| place(index, corner));
    let widest = corners.iter().map(|corner| crate::cone::angle(axis, *corner)).fold(0.0, f64::max);
    // Sides bulge between their corners.
    Cone { axis, half_angle: (1.05 * widest + 1e-3).min(PI) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use rand::{RngExt, SeedableRng};

    /// The mean is the irradiance from all around: of a constant 4π L, of a spot 2πσ² L.
    #[test]
    fn all_light_is_chosen() {
        let spot = |sigma_rad| Source::Spot { direction: Vec3::new(0.6, 0.0, 0.8), sigma_rad, radiance: Vec3::ONE };
        let cases =
            [(Source::Constant(Vec3::ONE), 2.0 * TAU), (spot(0.01), TAU * 1e-4), (spot(0.12), TAU * 0.0144 * 0.9953)];
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(8);
        for (source, expected) in cases {
            let source = EnvironmentSource { light: source, rotation_rad: 0.4, intensity: 1.0 };
            let light = Light::new(&source).unwrap();
            let directions = Directions::new(&source, &light);
            let chosen = (0..100_000).filter_map(|_| directions.sample([(); 3].map(|()| rng.random())));
            let mean = chosen.map(|(_, irradiance)| irradiance.x).sum::<f64>() / 1e5;
            assert!((mean / expected - 1.0).abs() < 0.01, "{source:?}: {mean} {expected}");
        }
    }
}
