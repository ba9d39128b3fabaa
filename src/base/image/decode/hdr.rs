//! Radiance pictures (.hdr) through the `image` crate, which leaves EXPOSURE and COLORCORR to the caller.

use std::io::{Cursor, Read};

use image::codecs::hdr::{HdrDecoder, SIGNATURE};

use super::{Refusal, RgbImage, checked_size};

/// Run-length encoding stores about 120 pixels per byte at most, except in pictures of a single colour.
const MAX_PIXELS_PER_BYTE: usize = 128;

pub(super) fn decode(bytes: &[u8]) -> Result<RgbImage, Refusal> {
    let damaged = |error: image::ImageError| Refusal::Damaged(error.to_string());
    if has_endless_run(bytes) {
        return Err(Refusal::Damaged("a run length does not end".into()));
    }
    // Some writers use the pixel encoding's name as the signature, which the crate rejects.
    let rest = bytes.strip_prefix(b"#?RGBE").or_else(|| bytes.strip_prefix(SIGNATURE)).unwrap_or_default();
    let decoder = HdrDecoder::new(Cursor::new(SIGNATURE).chain(rest)).map_err(damaged)?;
    let meta = decoder.metadata();
    checked_size(meta.width as usize, meta.height as usize, bytes.len(), MAX_PIXELS_PER_BYTE)?;
    let exposure = meta.exposure.unwrap_or(1.0);
    let (r, g, b) = meta.color_correction.unwrap_or((1.0, 1.0, 1.0));
    let divisor = [r, g, b].map(|correction| exposure * correction);
    if !divisor.iter().all(|d| d.is_finite() && *d > 0.0) {
        return Err(Refusal::Damaged("its EXPOSURE or COLORCORR is not a positive number".into()));
    }
    let image = image::DynamicImage::from_decoder(decoder).map_err(damaged)?.into_rgb32f();
    let (width, height) = (image.width() as usize, image.height() as usize);
    let radiance = |p: &image::Rgb<f32>| [0, 1, 2].map(|c| p.0[c] / divisor[c]);
    Ok(RgbImage { width, height, pixels: image.pixels().map(radiance).collect() })
}

/// Whether there are eight consecutive run-length markers: the crate multiplies the length by 256 for each, which
/// overflows 64 bits.
fn has_endless_run(bytes: &[u8]) -> bool {
    bytes.windows(32).any(|window| window.as_chunks::<4>().0.iter().all(|marker| marker[..3] == [1, 1, 1]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(header: &str, size: &str, pixels: &[[u8; 4]]) -> Vec<u8> {
        [format!("{header}\n\n{size}\n").as_bytes(), pixels.as_flattened()].concat()
    }

    fn refused(bytes: &[u8]) -> String {
        RgbImage::decode("sky.hdr", bytes).unwrap_err().to_string()
    }

    #[test]
    fn exposure_and_colour_correction_are_undone() {
        // The mantissa 128 and the exponent 129 are 1.
        let pixels = [[128, 128, 128, 129]; 2];
        for signature in ["#?RADIANCE", "#?RGBE"] {
            let header = format!("{signature}\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\nEXPOSURE= 0.25\nCOLORCORR=1 2 4");
            let (image, _) = RgbImage::decode("sky.hdr", &picture(&header, "-Y 1 +X 2", &pixels)).unwrap();
            assert_eq!(image.pixels, [[2.0, 1.0, 0.5]; 2]);
        }
        let header = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=0";
        assert!(refused(&picture(header, "-Y 1 +X 2", &pixels)).contains("EXPOSURE"));
    }

    #[test]
    fn sizes_beyond_the_files_length_are_refused_before_anything_is_allocated() {
        let message = refused(&picture("#?RADIANCE\nFORMAT=32-bit_rle_rgbe", "-Y 100000 +X 200000", &[]));
        assert!(message.contains("sky.hdr") && message.contains("200000×100000 pixels"), "{message}");
    }

    #[test]
    fn pictures_that_the_decoder_would_misread_are_refused() {
        let pixels = [[128, 128, 128, 129]; 2];
        let header = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe";
        assert!(refused(&picture(header, "+Y 1 +X 2", &pixels)).contains("Orientation"));
        let runs = [[[128, 128, 128, 129]].as_slice(), &[[1, 1, 1, 0]; 9]].concat();
        assert!(refused(&picture(header, "-Y 1 +X 40", &runs)).contains("run length"));
        assert!(refused(b"P6 1 1 255 abc").contains("damaged"));
    }
}
