//! Radiance by direction, in the light's own frame and at its own resolution.

use glam::Vec3;

use super::layout::Layout;
use super::{EnvironmentError, built_in_map};
use crate::scene::Light;

/// The radiance of a light around the scene, before it is rotated and scaled.
#[derive(Clone, Debug)]
pub struct EnvironmentRadiance(Kind);

#[derive(Clone, Debug)]
enum Kind {
    Map(Layout),
    Spot { direction: Vec3, sigma_rad: f32, radiance: Vec3 },
    Constant(Vec3),
}

impl EnvironmentRadiance {
    /// The light that a scene describes.
    pub fn new(light: &Light) -> Result<Self, EnvironmentError> {
        let kind = match light {
            Light::Constant(radiance) => Kind::Constant(*radiance),
            Light::Spot { direction, sigma_rad, radiance } => {
                Kind::Spot { direction: *direction, sigma_rad: *sigma_rad, radiance: *radiance }
            }
            Light::BuiltInMap(name) => Kind::Map(Layout::new(&built_in_map(name)?)),
            Light::Map(map) => Kind::Map(Layout::new(map)),
        };
        Ok(Self(kind))
    }

    /// Radiance that arrives from a unit direction in the light's frame, W/(m²·sr).
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        self.look_up(direction, Layout::radiance)
    }

    /// The same, reconstructed more smoothly: for the eye, not for measurements.
    pub fn smooth_radiance(&self, direction: Vec3) -> Vec3 {
        self.look_up(direction, Layout::smooth_radiance)
    }

    fn look_up(&self, d: Vec3, in_map: impl Fn(&Layout, Vec3) -> Vec3) -> Vec3 {
        match &self.0 {
            Kind::Map(layout) => in_map(layout, d),
            Kind::Constant(radiance) => *radiance,
            Kind::Spot { direction, sigma_rad, radiance } => {
                // The chord gives small angles without the cancellation of acos.
                let angle = 2.0 * (0.5 * (d - *direction).length()).min(1.0).asin();
                *radiance * (-0.5 * (angle / sigma_rad).powi(2)).exp()
            }
        }
    }

    /// The smallest angle over which the radiance changes much, radians; `None` for a constant.
    pub fn detail_rad(&self) -> Option<f32> {
        match &self.0 {
            Kind::Map(layout) => Some(std::f32::consts::FRAC_PI_2 / layout.texels_per_quarter() as f32),
            // A Gaussian needs no more than two samples per σ.
            Kind::Spot { sigma_rad, .. } => Some(1.5 * sigma_rad),
            Kind::Constant(_) => None,
        }
    }

    /// The cube map's face size that keeps the light's detail: a quarter of a map's width; a texel of at most σ/2 for
    /// a spot; at least 256. A power of two.
    pub fn cube_size(&self) -> u32 {
        let wanted = match &self.0 {
            Kind::Map(layout) => layout.texels_per_quarter() as u32,
            // A face spans [−1, 1]: 2/size radians a texel at its centre.
            Kind::Spot { sigma_rad, .. } => (4.0 / sigma_rad).ceil() as u32,
            Kind::Constant(_) => 0,
        };
        wanted.max(256).next_power_of_two()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spot_has_the_radiance_and_solid_angle_of_its_definition() {
        let light = Light::Spot { direction: Vec3::X, sigma_rad: 0.1, radiance: Vec3::splat(6.0) };
        let spot = EnvironmentRadiance::new(&light).unwrap();
        assert!((spot.radiance(Vec3::X).x - 6.0).abs() < 1e-5);
        let off = Vec3::new(0.1f32.cos(), 0.0, 0.1f32.sin());
        assert!((spot.radiance(off).x - 6.0 * (-0.5f32).exp()).abs() < 1e-4);
    }
}
