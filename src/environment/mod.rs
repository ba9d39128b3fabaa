//! What shines: environment images, spots and constants, as a cube map with mips.
//!
//! Data flows `import` → `layout` → [`Field`] (radiance by direction, world space) → [`CubeMap`] (what the
//! gather looks up) and irradiance. This module must not know samples, receivers or wgpu.

mod bounds;
mod builtin;
mod cube;
mod field;
mod import;
mod importance;
mod irradiance;
mod layout;

pub(crate) use bounds::FINEST_BOUNDS;
pub use bounds::{Bound, LightBounds};
pub use builtin::{BUILT_IN_MAPS, BuiltInMap};
pub use cube::{CubeMap, FACES, face_direction, face_of_direction, texel_solid_angle_sr};
pub use field::Field;
pub use import::RgbImage;
pub use importance::LightSampler;
pub(crate) use layout::resolve_layout;

use std::path::PathBuf;

use glam::Vec3;
use serde::Deserialize;

use crate::scene::{EnvironmentSource, MapLayout};
use crate::words::NumberOrWord;

/// The largest face edge, texels: 4096² × 6 texels of 16 bytes with mips are 2.1 GB.
pub const MAX_CUBE_SIZE: u32 = 4096;

/// A light source around the scene, ready to be looked up.
#[derive(Clone, Debug)]
pub struct Environment {
    /// Radiance by direction, at the source's own resolution.
    pub field: Field,
    /// Radiance, W/(m²·sr), prefiltered.
    pub cube: CubeMap,
    /// Irradiance by the receiver's normal, W/m², unoccluded; one level.
    pub irradiance: CubeMap,
    /// What was repaired while importing.
    pub notes: Vec<String>,
}

impl Environment {
    /// Reads and prefilters a light.
    pub fn load(source: &EnvironmentSource, cube_size: CubeSize) -> Result<Self, EnvironmentError> {
        let (field, notes) = Field::load(source)?;
        let size = match cube_size {
            CubeSize::Texels(size) => size,
            CubeSize::Auto => field.cube_size(),
        };
        if size > MAX_CUBE_SIZE {
            return Err(EnvironmentError::TooFine { size, limit: MAX_CUBE_SIZE });
        }
        let cube = CubeMap::from_radiance_of_rows(size, field.detail_rad(), |row| field.radiance_of_all(row));
        let irradiance = cube.irradiance();
        Ok(Self { field, cube, irradiance, notes })
    }

    /// Irradiance of an unoccluded receiver with this normal, W/m².
    pub fn irradiance(&self, normal: Vec3) -> Vec3 {
        self.irradiance.fetch(normal, 0.0)
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

/// Why a light could not be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EnvironmentError {
    /// The file could not be opened.
    #[error("cannot read environment map '{}': {reason}; check the path (maps without an extension are built-in: {})", path.display(), builtin::names())]
    Read {
        /// File.
        path: PathBuf,
        /// The system's reason.
        reason: String,
    },
    /// Not an image, or damaged.
    #[error("environment map '{}' is damaged or not an .exr or .hdr image: {reason}; export it again", path.display())]
    Damaged {
        /// File.
        path: PathBuf,
        /// The decoder's reason.
        reason: String,
    },
    /// Neither .exr nor .hdr.
    #[error("environment map '{}' has the extension '{extension}'; convert it to .exr or .hdr", path.display())]
    Format {
        /// File.
        path: PathBuf,
        /// Extension.
        extension: String,
    },
    /// No pixels.
    #[error("environment map '{}' has no pixels ({width}×{height}); export it again", path.display())]
    NoPixels {
        /// File.
        path: PathBuf,
        /// Width.
        width: usize,
        /// Height.
        height: usize,
    },
    /// A NaN or an infinity.
    #[error("environment map '{}': pixel ({x}, {y}) is not a finite number; repair the image", path.display())]
    NotFinite {
        /// File.
        path: PathBuf,
        /// Column.
        x: usize,
        /// Row.
        y: usize,
    },
    /// The picture's shape does not fit the layout.
    #[error("environment map '{}' is {width}×{height} pixels, which is no {layout:?} layout; {remedy}", path.display())]
    Layout {
        /// File.
        path: PathBuf,
        /// Width.
        width: usize,
        /// Height.
        height: usize,
        /// The layout asked for.
        layout: MapLayout,
        /// What to do.
        remedy: String,
    },
    /// No built-in map of that name.
    #[error(
        "there is no built-in environment map '{name}'; known are: {} (a file needs its extension, .exr or .hdr)",
        builtin::names()
    )]
    UnknownBuiltIn {
        /// The name asked for.
        name: String,
    },
    /// The light is finer than any cube map.
    #[error(
        "this light needs a cube map of {size}² texels a face, but {limit}² is the largest; use a wider spot or a smaller map, or set --cube-size (which blurs the light)"
    )]
    TooFine {
        /// Texels needed.
        size: u32,
        /// Texels allowed.
        limit: u32,
    },
}
