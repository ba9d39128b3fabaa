//! Radiance by direction, in world space, at the light's own resolution.

use std::path::Path;

use glam::{Mat3, Vec3};

use super::layout::Layout;
use super::{BUILT_IN_MAPS, EnvironmentError, RgbImage};
use crate::scene::{EnvironmentSource, Light, MapLayout};

/// A light around the scene.
#[derive(Clone, Debug)]
pub struct Field {
    kind: Kind,
    light_from_world: Mat3,
    intensity: f32,
}

#[derive(Clone, Debug)]
enum Kind {
    Map(Layout),
    Spot { direction: Vec3, sigma_rad: f32, radiance: Vec3 },
    Constant(Vec3),
}

impl Field {
    /// Reads the light's files. The second part of the result notes what was repaired.
    pub fn load(source: &EnvironmentSource) -> Result<(Self, Vec<String>), EnvironmentError> {
        let mut notes = Vec::new();
        let mut read = |path: &Path| -> Result<RgbImage, EnvironmentError> {
            let (image, note) = RgbImage::load(path)?;
            notes.extend(note);
            Ok(image)
        };
        let kind = match &source.light {
            Light::Constant(radiance) => Kind::Constant(*radiance),
            Light::Spot { direction, sigma_rad, radiance } => {
                Kind::Spot { direction: *direction, sigma_rad: *sigma_rad, radiance: *radiance }
            }
            Light::BuiltInMap(name) => Kind::Map(built_in(name)?),
            Light::Map { files, layout } => {
                let paths: Vec<&Path> = files.iter().map(AsRef::as_ref).collect();
                let images = paths.iter().map(|path| read(path)).collect::<Result<_, _>>()?;
                Kind::Map(Layout::new(&paths, images, *layout)?)
            }
        };
        let light_from_world = Mat3::from_rotation_y(-source.rotation_rad);
        Ok((Self { kind, light_from_world, intensity: source.intensity }, notes))
    }

    /// Radiance that arrives from a unit direction in world space, W/(m²·sr).
    pub fn radiance(&self, direction_in_world: Vec3) -> Vec3 {
        self.look_up(direction_in_world, Layout::radiance)
    }

    /// Puts the radiance in place of each of many unit directions; much faster than one by one for equirectangular maps.
    pub fn radiance_of_all(&self, directions_in_world: &mut [Vec3]) {
        match &self.kind {
            Kind::Map(layout) => {
                directions_in_world.iter_mut().for_each(|d| *d = self.light_from_world * *d);
                layout.radiance_of_all(directions_in_world);
                directions_in_world.iter_mut().for_each(|radiance| *radiance *= self.intensity);
            }
            _ => directions_in_world.iter_mut().for_each(|d| *d = self.radiance(*d)),
        }
    }

    /// The same, reconstructed more smoothly: for the eye, not for measurements.
    pub fn smooth_radiance(&self, direction_in_world: Vec3) -> Vec3 {
        self.look_up(direction_in_world, Layout::smooth_radiance)
    }

    fn look_up(&self, direction_in_world: Vec3, in_map: impl Fn(&Layout, Vec3) -> Vec3) -> Vec3 {
        let d = self.light_from_world * direction_in_world;
        self.intensity
            * match &self.kind {
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
        match &self.kind {
            Kind::Map(layout) => Some(std::f32::consts::FRAC_PI_2 / layout.texels_per_quarter() as f32),
            // A Gaussian needs no more than two samples per σ.
            Kind::Spot { sigma_rad, .. } => Some(1.5 * sigma_rad),
            Kind::Constant(_) => None,
        }
    }

    /// The cube map's face size that keeps the light's detail: a quarter of a map's width; a texel of at most σ/2 for
    /// a spot; at least 256. A power of two.
    pub fn cube_size(&self) -> u32 {
        let wanted = match &self.kind {
            Kind::Map(layout) => layout.texels_per_quarter() as u32,
            // A face spans [−1, 1]: 2/size radians a texel at its centre.
            Kind::Spot { sigma_rad, .. } => (4.0 / sigma_rad).ceil() as u32,
            Kind::Constant(_) => 0,
        };
        wanted.max(256).next_power_of_two()
    }
}

fn built_in(name: &str) -> Result<Layout, EnvironmentError> {
    let map = BUILT_IN_MAPS
        .iter()
        .find(|m| m.name == name)
        .ok_or_else(|| EnvironmentError::UnknownBuiltIn { name: name.into() })?;
    let path = Path::new(name);
    let (image, _) = RgbImage::decode(path, "exr", map.exr)?;
    Layout::new(&[path], vec![image], MapLayout::Latlong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spot_has_the_radiance_and_solid_angle_of_its_definition() {
        let source = EnvironmentSource {
            light: Light::Spot { direction: Vec3::Z, sigma_rad: 0.1, radiance: Vec3::splat(3.0) },
            rotation_rad: std::f32::consts::FRAC_PI_2,
            intensity: 2.0,
        };
        let (field, _) = Field::load(&source).unwrap();
        // A quarter turn about +Y takes +Z to +X.
        assert!((field.radiance(Vec3::X).x - 6.0).abs() < 1e-5);
        let off = Vec3::new(0.1f32.cos(), 0.0, 0.1f32.sin());
        assert!((field.radiance(off).x - 6.0 * (-0.5f32).exp()).abs() < 1e-4);
    }
}
