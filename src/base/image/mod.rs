//! Pictures: linear RGB images, tone mapping, EXR and PNG files, error metrics. Independent of scenes.

mod aov;
mod decode;
mod files;
mod metrics;
mod png;
mod sequence;
mod tone;

pub use aov::Aov;
pub(crate) use decode::rec_709_from_xyz;
pub use decode::{DecodeError, RgbImage};
pub use files::AtomicFile;
pub use files::{ImageError, read_exr, read_exr_text, read_mask, write_atomically, write_exr, write_exr_with_text};
pub use metrics::{mrse, rel_l2, speckles};
pub use png::{AnimatedPng, png_bytes, read_png_text, write_png, write_png_with_text};
pub use sequence::{numbered, parse_frames};
pub use tone::{HIGHLIGHT, MIDDLE_GREY};
pub use tone::{ToneMap, display, exposed, metered_ev, srgb8};

use glam::Vec3;

/// A linear RGB picture, stored by rows from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height` pixels.
    pub pixels: Vec<Vec3>,
}

impl Image {
    /// A black picture.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, pixels: vec![Vec3::ZERO; width as usize * height as usize] }
    }

    /// Applies a function to every pixel.
    #[must_use]
    pub fn map(&self, f: impl Fn(Vec3) -> Vec3) -> Self {
        Self { pixels: self.pixels.iter().map(|p| f(*p)).collect(), ..*self }
    }

    /// The mean pixel.
    pub fn mean(&self) -> Vec3 {
        let sum = self.pixels.iter().fold(glam::DVec3::ZERO, |sum, p| sum + p.as_dvec3());
        (sum / self.pixels.len().max(1) as f64).as_vec3()
    }
}
