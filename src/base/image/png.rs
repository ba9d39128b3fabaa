//! PNG files, still and animated, 8-bit sRGB. Knows pixels, not scenes.

use std::io::{BufRead, Seek, Write};
use std::path::Path;

use ::png::{BitDepth, ColorType, Encoder, SrgbRenderingIntent};

use super::files::{ImageError, write_atomically};
use super::{Image, srgb8};

/// Writes display-linear colours as 8-bit sRGB.
pub fn write_png(path: &Path, image: &Image) -> Result<(), ImageError> {
    write_png_with_text(path, image, &[])
}

/// Like [`write_png`], with named texts in the file. Names are Latin-1, of 1 to 79 characters.
pub fn write_png_with_text(path: &Path, image: &Image, texts: &[(&str, String)]) -> Result<(), ImageError> {
    write_atomically(path, |out| encode(out, image, texts))
}

/// Encodes display-linear colours as an 8-bit sRGB PNG.
pub fn png_bytes(image: &Image) -> Result<Vec<u8>, String> {
    let mut file = Vec::new();
    encode(&mut file, image, &[])?;
    Ok(file)
}

fn encode(out: impl Write, image: &Image, texts: &[(&str, String)]) -> Result<(), String> {
    let mut encoder = encoder(out, [image.width, image.height]);
    for (name, text) in texts {
        encoder.add_text_chunk((*name).to_owned(), text.clone()).map_err(|e| e.to_string())?;
    }
    let mut writer = encoder.write_header().map_err(|e| e.to_string())?;
    writer.write_image_data(&bytes(image)).map_err(|e| e.to_string())?;
    writer.finish().map_err(|e| e.to_string())
}

fn encoder<'a, W: Write>(out: W, [width, height]: [u32; 2]) -> Encoder<'a, W> {
    let mut encoder = Encoder::new(out, width, height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
    encoder
}

fn bytes(image: &Image) -> Vec<u8> {
    image.pixels.iter().flat_map(|pixel| srgb8(*pixel)).collect()
}

/// A named text of a PNG file; `None` if there is none of that name.
pub fn read_png_text(path: &Path, name: &str) -> Result<Option<String>, ImageError> {
    let fail = |reason: String| ImageError::Read { path: path.into(), reason };
    let file = std::fs::File::open(path).map_err(|e| fail(e.to_string()))?;
    text_of(std::io::BufReader::new(file), name).map_err(|e| fail(e.to_string()))
}

/// Fails on a file that is not complete, too.
fn text_of(file: impl BufRead + Seek, name: &str) -> Result<Option<String>, ::png::DecodingError> {
    let mut reader = ::png::Decoder::new(file).read_info()?;
    reader.finish()?;
    let texts = &reader.info().uncompressed_latin1_text;
    Ok(texts.iter().find(|chunk| chunk.keyword == name).map(|chunk| chunk.text.clone()))
}

/// An animated PNG (APNG) that is written frame by frame and repeats for ever. Programs that do not know the format show the first
/// frame.
pub struct AnimatedPng<W: Write> {
    writer: ::png::Writer<W>,
    /// Frames that are still to come.
    missing: u32,
}

impl<W: Write> AnimatedPng<W> {
    /// Begins a file of so many frames, at least one, of this width and height, shown at so many per second.
    ///
    /// ```
    /// use pinspot::image::{AnimatedPng, Image};
    ///
    /// let mut file = Vec::new();
    /// let mut animation = AnimatedPng::new(&mut file, [8, 8], 2, 24)?;
    /// animation.add(&Image::new(8, 8))?;
    /// animation.add(&Image::new(8, 8))?;
    /// animation.finish()?;
    /// assert!(file.windows(4).any(|name| name == b"acTL"));
    /// # Ok::<(), String>(())
    /// ```
    ///
    /// # Errors
    /// No frames, no pixels, or a failure to write.
    pub fn new(out: W, size: [u32; 2], frames: u32, frames_per_second: u16) -> Result<Self, String> {
        let mut encoder = encoder(out, size);
        encoder.set_animated(frames, 0).map_err(|e| e.to_string())?;
        encoder.set_frame_delay(1, frames_per_second).map_err(|e| e.to_string())?;
        Ok(Self { writer: encoder.write_header().map_err(|e| e.to_string())?, missing: frames })
    }

    /// Adds the next frame, of display-linear colours.
    ///
    /// # Errors
    /// More frames than were announced, another size, or a failure to write.
    pub fn add(&mut self, frame: &Image) -> Result<(), String> {
        self.writer.write_image_data(&bytes(frame)).map_err(|e| e.to_string())?;
        self.missing = self.missing.saturating_sub(1);
        Ok(())
    }

    /// Ends the file.
    ///
    /// # Errors
    /// Fewer frames than were announced, or a failure to write.
    pub fn finish(self) -> Result<(), String> {
        if self.missing > 0 {
            return Err(format!("{} frames are missing", self.missing));
        }
        self.writer.finish().map_err(|e| e.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn texts_come_back_and_truncated_files_are_found_out() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("text.png");
        let image = Image::new(33, 17).map(|_| Vec3::splat(0.5));
        write_png_with_text(&path, &image, &[("of", "a frame".to_owned())]).unwrap();
        assert_eq!(read_png_text(&path, "of").unwrap().as_deref(), Some("a frame"));
        assert_eq!(read_png_text(&path, "off").unwrap(), None);
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
        assert!(read_png_text(&path, "of").is_err());
    }

    #[test]
    fn an_animation_has_as_many_frames_as_announced() {
        let mut file = Vec::new();
        let mut animation = AnimatedPng::new(&mut file, [4, 4], 2, 10).unwrap();
        animation.add(&Image::new(4, 4)).unwrap();
        assert!(animation.finish().is_err());
        assert!(AnimatedPng::new(Vec::new(), [4, 4], 0, 10).is_err());
        assert!(AnimatedPng::new(Vec::new(), [0, 4], 1, 10).is_err());
    }
}
