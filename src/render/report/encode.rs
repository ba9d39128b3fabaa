//! Pictures and numbers as text for a page that must hold everything it shows.

use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use glam::Vec3;

use crate::image::{Image, png_bytes};
use crate::sampling::Spectrum;

/// Compressed with zlib, as base64.
pub(super) fn packed(bytes: &[u8]) -> String {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    let compressed = encoder.write_all(bytes).and_then(|()| encoder.finish()).expect("memory can be written to");
    STANDARD.encode(compressed)
}

/// A picture as RGB9E5, byte by byte in four planes (which compress better than pixels), packed.
pub(super) fn rgb9e5(image: &Image) -> String {
    let words: Vec<u32> = image.pixels.iter().map(|p| rgb9e5_pixel(*p)).collect();
    let planes: Vec<u8> = (0..4).flat_map(|k| words.iter().map(move |w| (w >> (8 * k)) as u8)).collect();
    packed(&planes)
}

/// WebGPU's shared-exponent format: three mantissas of 9 bits and an exponent of 5.
fn rgb9e5_pixel(colour: Vec3) -> u32 {
    // The largest value of the format.
    let colour = colour.clamp(Vec3::ZERO, Vec3::splat(65408.0));
    let largest = colour.max_element();
    if largest < 2f32.powi(-25) {
        return 0;
    }
    let mut exponent = (largest.log2().floor() as i32).max(-16) + 16;
    let scale = |exponent: i32| 2f32.powi(exponent - 24);
    if (largest / scale(exponent)).round() >= 512.0 {
        exponent += 1;
    }
    let [r, g, b] = (colour / scale(exponent)).to_array().map(|c| c.round() as u32);
    r | g << 9 | b << 18 | (exponent as u32) << 27
}

/// Display-linear colours as a PNG, as base64.
pub(super) fn png(image: &Image) -> String {
    STANDARD.encode(png_bytes(image).expect("a picture in memory becomes a PNG"))
}

/// A spectrum as a square picture, display-linear: frequency 0 in the middle, up to 2.5 √(N/A); white is four times the
/// power of white noise.
pub fn spectrum_picture(spectrum: &Spectrum) -> Image {
    const EDGE: u32 = 241;
    let mut image = Image::new(EDGE, EDGE);
    let across = 2 * spectrum.half[0] + 1;
    for (k, pixel) in image.pixels.iter_mut().enumerate() {
        let cell = |k: usize, half: usize| ((k as f64 + 0.5) / f64::from(EDGE) * (2 * half + 1) as f64) as usize;
        let (i, j) = (cell(k % EDGE as usize, spectrum.half[0]), cell(k / EDGE as usize, spectrum.half[1]));
        // As in the literature, grey values go with power; the sRGB curve that follows is undone here.
        *pixel = Vec3::splat((0.25 * spectrum.power[j * across + i]).min(1.0).powf(2.2) as f32);
    }
    image
}

/// A point set on the unit square as a picture.
pub(super) fn points_picture(points: &[[f64; 2]]) -> Image {
    const EDGE: u32 = 241;
    let mut image = Image::new(EDGE, EDGE).map(|_| Vec3::ONE);
    for [x, y] in points {
        let (cx, cy) = (x * f64::from(EDGE), y * f64::from(EDGE));
        for j in (cy - 2.0).max(0.0) as u32..((cy + 2.0) as u32).min(EDGE) {
            for i in (cx - 2.0).max(0.0) as u32..((cx + 2.0) as u32).min(EDGE) {
                let off = (f64::from(i) + 0.5 - cx).hypot(f64::from(j) + 0.5 - cy);
                image.pixels[(j * EDGE + i) as usize] *= (off - 0.9).clamp(0.0, 1.0) as f32;
            }
        }
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rgb9e5_keeps_colours_within_its_precision() {
        let decode = |word: u32| {
            let scale = 2f32.powi((word >> 27) as i32 - 24);
            Vec3::new((word & 511) as f32, (word >> 9 & 511) as f32, (word >> 18 & 511) as f32) * scale
        };
        for colour in [
            Vec3::new(1.0, 0.5, 0.25),
            Vec3::splat(1023.9),
            Vec3::new(3e4, 1.0, 0.0),
            Vec3::splat(65408.0),
            Vec3::splat(3e-5),
            Vec3::ZERO,
        ] {
            let back = decode(rgb9e5_pixel(colour));
            assert!(back.abs_diff_eq(colour, colour.max_element() / 500.0), "{colour} became {back}");
        }
    }
}
