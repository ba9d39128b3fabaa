//! What shines: environment images, spots and constants, as a cube map with mips.
//!
//! Data flows from the scene's images → `layout` → [`EnvironmentRadiance`] (radiance by direction) → [`CubeMap`] (what the
//! sums look up) and irradiance. [`LightGeometry`] is drawn into a copy of the cube map, every frame if it moves. All of it is in the light's own frame: whoever looks something up rotates the direction
//! and scales the result. This module must not know samples, receivers or wgpu.

mod bounds;
mod cube;
mod field;
mod importance;
mod irradiance;
mod layout;
mod light_geometry;
mod rasterization;
mod strips;

/// The first mip whose bounds are kept beside those of the light itself; those of all coarser ones are, too.
pub const FIRST_BOUNDED_MIP: u32 = 2;

pub use bounds::{Bound, LightBounds};
pub use bounds::{FINEST_BOUNDS, mip_of_pyramid};
pub use cube::{CubeMap, FACES, face_direction, face_of_direction, texel_solid_angle_sr};
pub use field::EnvironmentRadiance;
pub use importance::LightSampler;
pub use irradiance::{irradiance_map, irradiance_map_of_frame};
pub use light_geometry::emitter_from;
pub use light_geometry::{LightGeometry, LitBy};
pub use rasterization::FaceAxes;
pub use strips::ARC_STEPS;

pub use pinspot_base::maps::{BUILT_IN_MAPS, BuiltInMap, EnvironmentError, built_in_map};

use serde::Deserialize;

use crate::scene::Light;
use crate::words::NumberOrWord;

/// The largest face edge, texels: 4096² × 6 texels of 16 bytes with mips are 2.1 GB.
pub const MAX_CUBE_SIZE: u32 = 4096;

/// A light around the scene, ready to be looked up, in its own frame and at its own brightness.
#[derive(Clone, Debug)]
pub struct Environment {
    /// Radiance by direction, at the source's own resolution.
    pub radiance: EnvironmentRadiance,
    /// Radiance, W/(m²·sr), prefiltered.
    pub cube: CubeMap,
}

impl Environment {
    /// Reads and prefilters a light.
    pub fn new(light: &Light, cube_size: CubeSize) -> Result<Self, EnvironmentError> {
        let radiance = EnvironmentRadiance::new(light)?;
        Self::of_radiance(radiance, cube_size, 0)
    }

    /// Reads and prefilters a light; unless it is given, its cube map has at least so many texels along an edge.
    pub fn at_least(light: &Light, cube_size: CubeSize, least: u32) -> Result<Self, EnvironmentError> {
        Self::of_radiance(EnvironmentRadiance::new(light)?, cube_size, least)
    }

    fn of_radiance(radiance: EnvironmentRadiance, cube_size: CubeSize, least: u32) -> Result<Self, EnvironmentError> {
        let size = match cube_size {
            CubeSize::Texels(size) => size,
            CubeSize::Auto => radiance.cube_size().max(least),
        };
        if size > MAX_CUBE_SIZE {
            return Err(EnvironmentError::TooFine { size, limit: MAX_CUBE_SIZE });
        }
        let resolved = radiance.resolved_by(2.0 / size as f32);
        let cube = CubeMap::from_radiance_of_rows(size, resolved.detail_rad(), |row| resolved.radiance_of_all(row));
        Ok(Self { radiance, cube })
    }
}

impl Environment {
    /// This environment with a cube map of at most so many texels along an edge.
    #[must_use]
    pub fn coarser(&self, size: u32) -> Self {
        Self { radiance: self.radiance.clone(), cube: self.cube.coarser(size) }
    }

    /// This environment behind light geometry. Radiance is that of the world, scaled by the environment's intensity, in the same frame.
    /// The cube map keeps its size.
    #[must_use]
    pub fn behind(&self, front: LitBy) -> Self {
        let cube = front.draw(&self.cube);
        Self { radiance: self.radiance.behind(front), cube }
    }
}

/// The cube map's face size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(try_from = "NumberOrWord")]
pub enum CubeSize {
    /// From the map's width or the spot's σ.
    #[default]
    Auto,
    /// Texels; a power of two from 16 to [`MAX_CUBE_SIZE`].
    Texels(u32),
}

impl TryFrom<NumberOrWord> for CubeSize {
    type Error = String;
    fn try_from(value: NumberOrWord) -> Result<Self, String> {
        value.to_string().parse()
    }
}

impl std::str::FromStr for CubeSize {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match (text, text.parse::<u32>()) {
            ("auto", _) => Ok(Self::Auto),
            (_, Ok(n)) if n.is_power_of_two() && (16..=MAX_CUBE_SIZE).contains(&n) => Ok(Self::Texels(n)),
            _ => Err(format!("'{text}' is no cube size; give auto or a power of two from 16 to {MAX_CUBE_SIZE}")),
        }
    }
}

#[cfg(all(test, feature = "builtin-maps"))]
mod tests {
    use super::*;
    use crate::image::RgbImage;

    #[test]
    fn the_suns_energy_survives_the_cube_map() {
        use crate::scene::Light;
        let light = Light::BuiltInMap("clear-sky".into());
        let environment = Environment::new(&light, Default::default()).unwrap();
        let (sky, _) = RgbImage::decode("sky.exr", BUILT_IN_MAPS[0].exr).unwrap();
        let row_sr = |y: usize| {
            let edge = |k: usize| (std::f64::consts::PI * k as f64 / sky.height as f64).cos();
            (edge(y) - edge(y + 1)) * std::f64::consts::TAU / sky.width as f64
        };
        let in_map: f64 = sky.pixels.iter().enumerate().map(|(i, p)| f64::from(p[1]) * row_sr(i / sky.width)).sum();
        let n = environment.cube.size();
        let texel = |(i, t): (usize, &glam::Vec4)| {
            let k = i as u32 % (n * n);
            f64::from(t.y) * texel_solid_angle_sr(n, k % n, k / n)
        };
        let in_cube: f64 = environment.cube.level(0).iter().enumerate().map(texel).sum();
        assert!((in_cube / in_map - 1.0).abs() < 5e-3, "{in_cube} {in_map}");
    }
}
