//! The maps of `envmaps/`, embedded, and why a light could not be loaded.

use std::sync::Arc;

use crate::image::RgbImage;
use crate::scene::{EnvironmentMap, MapError, MapLayout};

/// A built-in map.
#[derive(Clone, Copy, Debug)]
pub struct BuiltInMap {
    /// What scene files call it.
    pub name: &'static str,
    /// What it shows.
    pub about: &'static str,
    /// The EXR file.
    pub exr: &'static [u8],
}

#[cfg(feature = "builtin-maps")]
macro_rules! maps {
    ($($name:literal: $about:literal,)*) => {
        &[$(BuiltInMap { name: $name, about: $about, exr: include_bytes!(concat!("../../envmaps/", $name, ".exr")) }),*]
    };
}

/// All built-in maps; none without the feature `builtin-maps`.
#[cfg(not(feature = "builtin-maps"))]
pub static BUILT_IN_MAPS: &[BuiltInMap] = &[];

/// All built-in maps; none without the feature `builtin-maps`.
// A constant would be embedded in every crate that names it.
#[cfg(feature = "builtin-maps")]
pub static BUILT_IN_MAPS: &[BuiltInMap] = maps! {
    "clear-sky": "a clear sky with a true sun",
    "overcast": "an overcast sky",
    "forest": "light through leaves",
    "studio": "a dark studio with soft boxes",
    "city": "a city at night",
};

/// A built-in map, decoded.
pub fn built_in_map(name: &str) -> Result<EnvironmentMap, EnvironmentError> {
    let map = BUILT_IN_MAPS.iter().find(|map| map.name == name);
    let map = map.ok_or_else(|| EnvironmentError::UnknownBuiltIn { name: crate::words::escaped(name) })?;
    let name = format!("{name}.exr");
    let (image, _) = RgbImage::decode(&name, map.exr).map_err(MapError::from)?;
    Ok(EnvironmentMap::new(vec![(name, Arc::new(image))], MapLayout::Latlong)?)
}

fn names() -> String {
    if BUILT_IN_MAPS.is_empty() {
        return "none, as this program was built without the feature 'builtin-maps'".to_owned();
    }
    BUILT_IN_MAPS.iter().map(|m| m.name).collect::<Vec<_>>().join(", ")
}

/// Why a light could not be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EnvironmentError {
    /// The map itself.
    #[error(transparent)]
    Map(#[from] MapError),
    /// A light made in code with values out of their range.
    #[error("the environment light cannot be used: {what}")]
    Invalid {
        /// Which value.
        what: String,
    },
    /// No built-in map of that name.
    #[error(
        "there is no built-in environment map '{name}'; known are: {} (a file needs its extension, .exr or .hdr)",
        names()
    )]
    UnknownBuiltIn {
        /// The name asked for.
        name: String,
    },
    /// The light is finer than any cube map.
    #[error(
        "this light needs a cube map of {size}² texels a face, but {limit}² is the largest; use a wider spot or a smaller map, or give a cube size (which blurs the light)"
    )]
    TooFine {
        /// Texels needed.
        size: u32,
        /// Texels allowed.
        limit: u32,
    },
}

#[cfg(all(test, feature = "builtin-maps"))]
mod tests {
    use super::*;

    #[test]
    fn maps_are_small_equirectangular_and_bright_enough() {
        for map in BUILT_IN_MAPS {
            assert!(map.exr.len() <= 1 << 20, "{}: {} bytes", map.name, map.exr.len());
            let (image, note) = RgbImage::decode("map.exr", map.exr).unwrap();
            assert!(image.width == 2 * image.height && note.is_empty(), "{}", map.name);
        }
        // The clear sky's sun is a true one: far beyond half floats.
        let (sky, _) = RgbImage::decode("sky.exr", BUILT_IN_MAPS[0].exr).unwrap();
        assert!(sky.pixels.iter().any(|p| p[1] > 65504.0));
    }
}
