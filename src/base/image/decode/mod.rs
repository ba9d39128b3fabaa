//! Environment images: decodes .exr and .hdr files in memory to linear RGB. Independent of directions.

mod exr;
mod exr_layers;
mod hdr;
mod primaries;

pub(crate) use primaries::rec_709_from_xyz;

use std::path::Path;

use glam::Vec3;

/// A linear RGB image, stored by rows from the top left.
#[derive(Clone, PartialEq)]
pub struct RgbImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` pixels.
    pub pixels: Vec<[f32; 3]>,
}

impl std::fmt::Debug for RgbImage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "RgbImage({}×{})", self.width, self.height)
    }
}

/// Why an image file cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// Not an image, or damaged.
    #[error("image '{name}' is damaged or not an .exr or .hdr image: {reason}; export it again")]
    Damaged {
        /// File.
        name: String,
        /// The decoder's reason.
        reason: String,
    },
    /// An unsupported kind of image.
    #[error("image '{name}' {reason}")]
    Unsupported {
        /// File.
        name: String,
        /// What it is and what to do.
        reason: String,
    },
    /// Neither .exr nor .hdr.
    #[error("image '{name}' has the extension '{extension}'; convert it to .exr or .hdr")]
    Format {
        /// File.
        name: String,
        /// Extension.
        extension: String,
    },
    /// No pixels.
    #[error("image '{name}' has no pixels ({width}×{height}); export it again")]
    NoPixels {
        /// File.
        name: String,
        /// Width.
        width: usize,
        /// Height.
        height: usize,
    },
    /// A NaN, an infinity, or a number too large for later arithmetic.
    #[error("image '{name}': pixel ({x}, {y}) {what}; repair the image")]
    Pixel {
        /// File.
        name: String,
        /// Column.
        x: usize,
        /// Row.
        y: usize,
        /// What is wrong with it.
        what: &'static str,
    },
}

/// Why a decoder failed: the file is damaged, or of an unsupported kind.
enum Refusal {
    Damaged(String),
    Unsupported(String),
}

impl RgbImage {
    /// The largest number of pixels that is read: 16384².
    const MAX_PIXELS: usize = 1 << 28;

    /// Decodes a file's bytes; the extension of its name, `.exr` or `.hdr`, selects the format. The second part of the
    /// result notes what was repaired or converted, and what is missing.
    pub fn decode(name: &str, bytes: &[u8]) -> Result<(Self, Vec<String>), DecodeError> {
        Self::decode_layer(name, None, bytes)
    }

    /// The same of a layer of an `.exr` by its name. Without one, the file's only layer is read, or the one without a name.
    pub fn decode_layer(name: &str, layer: Option<&str>, bytes: &[u8]) -> Result<(Self, Vec<String>), DecodeError> {
        Self::check_format(name)?;
        let extension = Path::new(name).extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let decoded = match extension.as_str() {
            "exr" => exr::decode(bytes, layer),
            _ => hdr::decode(bytes),
        };
        let (mut image, notes) = decoded.map_err(|refusal| match refusal {
            Refusal::Damaged(reason) => DecodeError::Damaged { name: name.into(), reason: one_line(&reason) },
            Refusal::Unsupported(reason) => DecodeError::Unsupported { name: name.into(), reason: one_line(&reason) },
        })?;
        let mut notes: Vec<String> = notes.into_iter().map(|note| format!("{name}: {note}")).collect();
        let negative = image.set_negative_to_zero();
        image.check(name)?;
        if negative > 0 {
            notes.push(format!("{name}: {negative} pixels had negative radiance, which does not exist; set to 0"));
        }
        Ok((image, notes))
    }

    /// A file's name and the layer that is meant: `sky.exr#key-light`.
    pub fn split_layer(reference: &str) -> (&str, Option<&str>) {
        const MARK: &str = ".exr#";
        let found = reference
            .char_indices()
            .find(|(at, _)| reference.get(*at..at + MARK.len()).is_some_and(|part| part.eq_ignore_ascii_case(MARK)));
        found.map_or((reference, None), |(at, _)| {
            let end = at + MARK.len() - 1;
            (&reference[..end], Some(&reference[end + 1..]))
        })
    }

    /// Whether a file of this name is of a format that is read.
    pub fn check_format(name: &str) -> Result<(), DecodeError> {
        let extension = Path::new(name).extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match extension.as_str() {
            "exr" | "hdr" => Ok(()),
            _ => Err(DecodeError::Format { name: name.into(), extension }),
        }
    }

    /// Checks that every pixel is a valid radiance; `name` is used in messages only.
    pub fn check(&self, name: &str) -> Result<(), DecodeError> {
        let (width, height) = (self.width, self.height);
        if self.pixels.is_empty() || width.checked_mul(height) != Some(self.pixels.len()) {
            return Err(DecodeError::NoPixels { name: name.into(), width, height });
        }
        let fits = |value: &f32| (0.0..=crate::scene::MAX_RADIANCE).contains(value);
        let Some(at) = self.pixels.iter().position(|pixel| !pixel.iter().all(fits)) else { return Ok(()) };
        let what = match self.pixels[at] {
            pixel if !pixel.iter().all(|value| value.is_finite()) => "is not a finite number",
            pixel if pixel.iter().any(|value| *value < 0.0) => "is negative",
            _ => "is brighter than 1e36",
        };
        Err(DecodeError::Pixel { name: name.into(), x: at % width, y: at / width, what })
    }

    /// The faces of an OpenEXR cube map, which lie one above the other, in the orientation of WebGPU's cube maps (OpenEXR,
    /// `ImfEnvmap.h`). OpenEXR has directions to the edge of a face in the middle of its last pixels; they are moved outwards by less than
    /// half a pixel.
    pub fn faces_of_column(&self) -> [Self; 6] {
        let n = self.width;
        [0, 1, 2, 3, 4, 5].map(|face| {
            // Seen from inside: WebGPU mirrors what is beside and, of what is above and below, the other axis.
            let is_vertical = face == 2 || face == 3;
            let at = |x: usize, y: usize| if is_vertical { (x, n - 1 - y) } else { (n - 1 - x, y) };
            let pixel = |k: usize| {
                let (x, y) = at(k % n, k / n);
                self.pixels[(face * n + y) * n + x]
            };
            Self { width: n, height: n, pixels: (0..n * n).map(pixel).collect() }
        })
    }

    /// A pixel.
    pub fn pixel(&self, x: usize, y: usize) -> Vec3 {
        Vec3::from(self.pixels[y * self.width + x])
    }

    fn set_negative_to_zero(&mut self) -> usize {
        let negative = self.pixels.iter_mut().filter(|p| p.iter().any(|c| c.is_finite() && *c < 0.0));
        negative.map(|p| *p = p.map(|c| if c.is_finite() { c.max(0.0) } else { c })).count()
    }
}

fn one_line(text: &str) -> String {
    crate::words::escaped(&text.split_whitespace().collect::<Vec<_>>().join(" "))
}

/// The number of pixels, if a file of `length` bytes can hold that many.
fn checked_size(width: usize, height: usize, length: usize, max_pixels_per_byte: usize) -> Result<usize, Refusal> {
    match width.checked_mul(height) {
        Some(pixels) if pixels <= RgbImage::MAX_PIXELS && pixels / max_pixels_per_byte <= length => Ok(pixels),
        Some(pixels) if pixels / max_pixels_per_byte <= length => {
            Err(Refusal::Unsupported(format!("has {width}×{height} pixels, but 2²⁸ is the most; scale it down")))
        }
        _ => Err(Refusal::Damaged(format!("it declares {width}×{height} pixels, but has only {length} bytes"))),
    }
}
