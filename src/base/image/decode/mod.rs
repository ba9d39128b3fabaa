//! Environment images: decodes .exr and .hdr files in memory to linear RGB. Independent of directions.

mod exr;
mod hdr;

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
    /// result notes what was repaired.
    pub fn decode(name: &str, bytes: &[u8]) -> Result<(Self, Option<String>), DecodeError> {
        Self::check_format(name)?;
        let extension = Path::new(name).extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let decoded = match extension.as_str() {
            "exr" => exr::decode(bytes),
            _ => hdr::decode(bytes),
        };
        let mut image = decoded.map_err(|refusal| match refusal {
            Refusal::Damaged(reason) => DecodeError::Damaged { name: name.into(), reason: one_line(&reason) },
            Refusal::Unsupported(reason) => DecodeError::Unsupported { name: name.into(), reason },
        })?;
        let negative = image.set_negative_to_zero();
        image.check(name)?;
        let note = (negative > 0)
            .then(|| format!("{name}: {negative} pixels had negative radiance, which does not exist; set to 0"));
        Ok((image, note))
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
