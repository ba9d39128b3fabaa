//! The description of environment lighting: images in memory, built-in maps, spots and constants.

use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

use super::assets::{Assets, readable_name};
use crate::image::{DecodeError, RgbImage};

/// The largest radiance, intensity, and product of the two, W/(m²·sr): sums and products of larger ones may exceed the
/// range of 32-bit numbers.
pub const MAX_RADIANCE: f32 = 1e36;

/// The environment lighting of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentSource {
    /// The light itself.
    pub light: Light,
    /// Rotation about +Y, counter-clockwise, radians.
    pub rotation_rad: f32,
    /// Factor on every radiance.
    pub intensity: f32,
}

/// The kinds of environment light.
#[derive(Clone, Debug, PartialEq)]
pub enum Light {
    /// An image, or six faces.
    Map(EnvironmentMap),
    /// One of the maps embedded in the library, by name.
    BuiltInMap(String),
    /// A Gaussian spot in an otherwise black environment: L(θ) = radiance · exp(−θ²/2σ²).
    Spot {
        /// Towards the light; unit length.
        direction: Vec3,
        /// Standard deviation σ, radians.
        sigma_rad: f32,
        /// Peak radiance, W/(m²·sr).
        radiance: Vec3,
    },
    /// The same radiance from all directions, W/(m²·sr).
    Constant(Vec3),
}

impl Light {
    /// The largest radiance of any channel; `None` for a built-in map, which is not decoded yet.
    pub(super) fn brightest(&self) -> Option<f32> {
        match self {
            Self::Map(map) => Some(map.brightest()),
            Self::BuiltInMap(_) => None,
            Self::Spot { radiance, .. } | Self::Constant(radiance) => Some(radiance.max_element()),
        }
    }

    /// A map by its name in scene files and on the command line: a built-in map (without extension), a file, or a layer of one
    /// (`sky.exr#key-light`). The second part of the result notes what was repaired.
    ///
    /// ```
    /// use std::path::Path;
    ///
    /// use pinspot::scene::{Light, MapLayout};
    ///
    /// let (mut scene, _) = pinspot::load("ring")?;
    /// let (light, _notes) = Light::map(Path::new("."), "forest", MapLayout::Latlong)?;
    /// scene.environment.light = light;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn map(
        assets: &(impl Assets + ?Sized),
        name: &str,
        layout: MapLayout,
    ) -> Result<(Self, Vec<String>), MapError> {
        if Path::new(name).extension().is_none() {
            return Ok((Self::BuiltInMap(name.to_owned()), Vec::new()));
        }
        let (map, notes) = EnvironmentMap::load(assets, &[name], layout)?;
        Ok((Self::Map(map), notes))
    }
}

/// One image or six, and the layout that maps directions to pixels.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    images: Vec<Arc<RgbImage>>,
    layout: MapLayout,
}

impl PartialEq for EnvironmentMap {
    /// Whether both share the same images in memory. Pixels are not compared.
    fn eq(&self, other: &Self) -> bool {
        self.layout == other.layout
            && self.images.len() == other.images.len()
            && self.images.iter().zip(&other.images).all(|(a, b)| Arc::ptr_eq(a, b))
    }
}

impl EnvironmentMap {
    /// One image, or six for [`MapLayout::Faces`] in the order +X −X +Y −Y +Z −Z, each with a name for messages.
    pub fn new(images: Vec<(String, Arc<RgbImage>)>, layout: MapLayout) -> Result<Self, MapError> {
        for (name, image) in &images {
            image.check(name)?;
        }
        if let ([(_, column)], MapLayout::Auto) = (images.as_slice(), layout)
            && column.height == 6 * column.width
        {
            return Ok(Self { images: column.faces_of_column().map(Arc::new).into(), layout: MapLayout::Faces });
        }
        let layout = resolved(&images, layout)?;
        Ok(Self { images: images.into_iter().map(|(_, image)| image).collect(), layout })
    }

    /// Reads image files; of an `.exr` with several layers one is named as in `sky.exr#key-light`. The second part of the result
    /// notes what was repaired.
    pub fn load(
        assets: &(impl Assets + ?Sized),
        files: &[&str],
        layout: MapLayout,
    ) -> Result<(Self, Vec<String>), MapError> {
        let mut notes = Vec::new();
        let mut image = |reference: &&str| {
            let (file, layer) = RgbImage::split_layer(reference);
            let name = readable_name(assets, Path::new(file));
            RgbImage::check_format(&name)?;
            let bytes = assets
                .read(Path::new(file))
                .map_err(|error| MapError::Read { name: name.clone(), reason: error.to_string() })?;
            let (image, note) = RgbImage::decode_layer(&name, layer, &bytes)?;
            notes.extend(note);
            Ok((name, Arc::new(image)))
        };
        let images = files.iter().map(&mut image).collect::<Result<_, MapError>>()?;
        Ok((Self::new(images, layout)?, notes))
    }

    /// One image, or six.
    pub fn images(&self) -> &[Arc<RgbImage>] {
        &self.images
    }

    /// The largest radiance of any channel.
    fn brightest(&self) -> f32 {
        let pixels = self.images.iter().flat_map(|image| image.pixels.as_flattened());
        pixels.copied().fold(0.0, f32::max)
    }

    /// The layout; never [`MapLayout::Auto`].
    pub fn layout(&self) -> MapLayout {
        self.layout
    }
}

/// The layout of an environment image: how directions map to pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MapLayout {
    /// By aspect ratio: 2:1 latlong, 1:1 angular, 3:4 vertical cross, 4:3 horizontal cross, 1:6 the six faces of OpenEXR's cube maps.
    Auto,
    /// Equirectangular.
    Latlong,
    /// Debevec's light probe.
    Angular,
    /// Three faces wide, four high.
    VerticalCross,
    /// Four faces wide, three high.
    HorizontalCross,
    /// Six square images.
    Faces,
}

/// Why an environment map cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MapError {
    /// The file could not be opened.
    #[error(
        "cannot read environment map '{name}': {reason}; check the path (a name without an extension is a built-in map's)"
    )]
    Read {
        /// File.
        name: String,
        /// The system's reason.
        reason: String,
    },
    /// The file is not a readable image.
    #[error(transparent)]
    Image(#[from] DecodeError),
    /// Neither one image nor six.
    #[error("an environment map is one image or six, not {count}")]
    Count {
        /// Number of images.
        count: usize,
    },
    /// The picture's shape does not fit the layout.
    #[error("environment map '{name}' is {width}×{height} pixels, which is no {layout:?} layout; {remedy}")]
    Layout {
        /// File.
        name: String,
        /// Width.
        width: usize,
        /// Height.
        height: usize,
        /// The requested layout.
        layout: MapLayout,
        /// What to do.
        remedy: String,
    },
}

/// The requested layout or, for [`MapLayout::Auto`], the one that the image's aspect ratio implies.
fn resolved(images: &[(String, Arc<RgbImage>)], layout: MapLayout) -> Result<MapLayout, MapError> {
    let fail = |index: usize, remedy: String| {
        let (name, image) = &images[index];
        Err(MapError::Layout { name: name.clone(), width: image.width, height: image.height, layout, remedy })
    };
    let (w, h) = match images {
        [(_, first), ..] if images.len() == 1 || images.len() == 6 => (first.width, first.height),
        _ => return Err(MapError::Count { count: images.len() }),
    };
    if images.len() == 6 {
        return match images.iter().position(|(_, face)| face.width != w || face.height != w) {
            Some(face) => fail(face, format!("all six faces must be squares of one size ({w}×{w} here)")),
            None => Ok(MapLayout::Faces),
        };
    }
    let (fits, remedy) = match layout {
        MapLayout::Auto => {
            let by_shape = [
                (w == 2 * h, MapLayout::Latlong),
                (w == h, MapLayout::Angular),
                (4 * w == 3 * h, MapLayout::VerticalCross),
                (3 * w == 4 * h, MapLayout::HorizontalCross),
            ];
            if let Some((_, found)) = by_shape.into_iter().find(|(fits, _)| *fits) {
                return Ok(found);
            }
            (
                false,
                "set layout to latlong, angular, vertical-cross or horizontal-cross, or give an image of aspect 2:1, 1:1, 3:4, 4:3 or 1:6",
            )
        }
        MapLayout::Latlong => (true, ""),
        MapLayout::Angular => (w == h, "an angular map is square"),
        MapLayout::VerticalCross => {
            (4 * w == 3 * h && w % 3 == 0, "a vertical cross is three faces wide and four high")
        }
        MapLayout::HorizontalCross => {
            (3 * w == 4 * h && w % 4 == 0, "a horizontal cross is four faces wide and three high")
        }
        MapLayout::Faces => (false, "six faces are six files"),
    };
    if fits { Ok(layout) } else { fail(0, remedy.into()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width: usize, height: usize) -> (String, Arc<RgbImage>) {
        ("map.exr".into(), Arc::new(RgbImage { width, height, pixels: vec![[0.5; 3]; width * height] }))
    }

    #[test]
    fn a_wrong_aspect_is_named() {
        let message = EnvironmentMap::new(vec![grey(50, 20)], MapLayout::Auto).unwrap_err().to_string();
        assert!(message.contains("map.exr") && message.contains("50×20") && message.contains("2:1"), "{message}");
    }

    /// Directions of OpenEXR's cube maps (`ImfEnvmap.h`), each with its column and row in its face, as in WebGPU's.
    #[test]
    fn openexrs_cube_maps_have_their_faces() {
        let size = 8;
        // Of a pixel of a face that lies in the column: its direction, as OpenEXR has it.
        let direction = |face: usize, x: usize, y: usize| {
            let at = |k: usize| 2.0 * (k as f32 + 0.5) / size as f32 - 1.0;
            let (x, y) = (at(x), at(y));
            [[1.0, -y, x], [-1.0, -y, -x], [x, 1.0, -y], [x, -1.0, y], [-x, -y, 1.0], [x, -y, -1.0]][face]
        };
        let pixels =
            (0..6 * size * size).map(|k| direction(k / (size * size), k % size, k / size % size)).collect::<Vec<_>>();
        // Radiances are not negative.
        let pixels = pixels.into_iter().map(|d| d.map(|value| value + 1.0)).collect();
        let column = Arc::new(RgbImage { width: size, height: 6 * size, pixels });
        let map = EnvironmentMap::new(vec![("cube.exr".into(), column)], MapLayout::Auto).unwrap();
        assert_eq!((map.layout(), map.images().len()), (MapLayout::Faces, 6));
        // WebGPU: the column and the row of a direction in its face.
        let place = |face: usize, [x, y, z]: [f32; 3]| [[-z, -y], [z, -y], [x, z], [x, -z], [x, -y], [-x, -y]][face];
        for (face, image) in map.images().iter().enumerate() {
            for (k, pixel) in image.pixels.iter().enumerate() {
                let found = place(face, pixel.map(|value| value - 1.0));
                let expected = [k % size, k / size].map(|at| 2.0 * (at as f32 + 0.5) / size as f32 - 1.0);
                assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{face} {k}: {found:?}");
            }
        }
    }

    #[test]
    fn maps_made_in_code_are_checked() {
        let map = EnvironmentMap::new(vec![grey(4, 2)], MapLayout::Auto).unwrap();
        assert_eq!((map.layout(), map.images().len()), (MapLayout::Latlong, 1));
        assert!(EnvironmentMap::new(vec![grey(4, 4), grey(4, 4)], MapLayout::Faces).is_err());
        let pixels = vec![[0.5, f32::NAN, 0.5]];
        let broken = RgbImage { width: 1, height: 1, pixels };
        let message = EnvironmentMap::new(vec![("made".into(), broken.into())], MapLayout::Auto).unwrap_err();
        assert!(message.to_string().contains("pixel (0, 0) is not a finite number"), "{message}");
    }
}
