//! Image files to linear RGB. Knows no directions.

use std::io::Cursor;
use std::path::Path;

use exr::prelude::{ReadChannels, ReadLayers};
use glam::Vec3;

use super::EnvironmentError;

/// A linear RGB image, row by row from the top left.
#[derive(Clone, Debug)]
pub struct RgbImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` pixels.
    pub pixels: Vec<[f32; 3]>,
}

impl RgbImage {
    /// Reads an .exr or .hdr file. The second part of the result notes what was repaired.
    pub fn load(path: &Path) -> Result<(Self, Option<String>), EnvironmentError> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        if extension != "exr" && extension != "hdr" {
            return Err(EnvironmentError::Format { path: path.into(), extension });
        }
        let bytes =
            std::fs::read(path).map_err(|e| EnvironmentError::Read { path: path.into(), reason: e.to_string() })?;
        Self::decode(path, &extension, &bytes)
    }

    /// Decodes a file's bytes; `path` is used in messages only.
    pub fn decode(path: &Path, extension: &str, bytes: &[u8]) -> Result<(Self, Option<String>), EnvironmentError> {
        let decoded = if extension == "exr" { decode_exr(bytes) } else { decode_hdr(bytes) };
        let mut image = decoded.map_err(|reason| EnvironmentError::Damaged { path: path.into(), reason })?;
        if image.pixels.is_empty() {
            return Err(EnvironmentError::NoPixels { path: path.into(), width: image.width, height: image.height });
        }
        if let Some(i) = image.pixels.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
            return Err(EnvironmentError::NotFinite { path: path.into(), x: i % image.width, y: i / image.width });
        }
        let negative = image.set_negative_to_zero();
        let note = (negative > 0)
            .then(|| format!("{}: {negative} pixels had negative radiance, which is none; set to 0", path.display()));
        Ok((image, note))
    }

    /// A pixel.
    pub fn pixel(&self, x: usize, y: usize) -> Vec3 {
        Vec3::from(self.pixels[y * self.width + x])
    }

    fn set_negative_to_zero(&mut self) -> usize {
        let negative = self.pixels.iter_mut().filter(|p| p.iter().any(|c| *c < 0.0));
        negative.map(|p| *p = p.map(|c| c.max(0.0))).count()
    }
}

fn decode_exr(bytes: &[u8]) -> Result<RgbImage, String> {
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| e.to_string())?;
    let layer = image.layer_data;
    let channel = |name: &str| layer.channel_data.list.iter().find(|c| c.name.eq_case_insensitive(name));
    let grey = channel("Y");
    let [r, g, b] = [channel("R").or(grey), channel("G").or(grey), channel("B").or(grey)]
        .map(|c| c.map(|c| c.sample_data.values_as_f32().collect::<Vec<f32>>()));
    let (Some(r), Some(g), Some(b)) = (r, g, b) else {
        return Err("it has neither channels R, G, B nor Y".into());
    };
    let (width, height) = (layer.size.0, layer.size.1);
    if [&r, &g, &b].iter().any(|c| c.len() != width * height) {
        return Err("a channel is subsampled".into());
    }
    let pixels = r.into_iter().zip(g).zip(b).map(|((r, g), b)| [r, g, b]).collect();
    Ok(RgbImage { width, height, pixels })
}

fn decode_hdr(bytes: &[u8]) -> Result<RgbImage, String> {
    let decoder = image::codecs::hdr::HdrDecoder::new(Cursor::new(bytes)).map_err(|e| e.to_string())?;
    let image = image::DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?.into_rgb32f();
    let (width, height) = (image.width() as usize, image.height() as usize);
    Ok(RgbImage { width, height, pixels: image.pixels().map(|p| p.0).collect() })
}
