//! Radiance pictures (.hdr) through the `image` crate, which reads scanlines from the top down, with a strict header, and leaves EXPOSURE,
//! COLORCORR and PRIMARIES to the caller. It gets a header of ours; what the file's says is applied to the result.

use std::io::{Cursor, Read};

use image::codecs::hdr::{HdrDecoder, SIGNATURE};

use super::{Refusal, RgbImage, checked_size, primaries};

/// Run-length encoding stores about 120 pixels per byte at most, except in pictures of a single colour.
const MAX_PIXELS_PER_BYTE: usize = 128;

/// The picture, and notes on it.
pub(super) fn decode(bytes: &[u8]) -> Result<(RgbImage, Vec<String>), Refusal> {
    let damaged = |error: image::ImageError| Refusal::Damaged(error.to_string());
    if has_endless_run(bytes) {
        return Err(Refusal::Damaged("a run length does not end".into()));
    }
    let Header { attributes, scanlines, pixels, is_xyz, primaries, rest } = Header::parse(bytes)?;
    checked_size(pixels.count, scanlines.count, bytes.len(), MAX_PIXELS_PER_BYTE)?;
    let header = [SIGNATURE, attributes.as_bytes()].concat();
    let size = format!("\n-Y {} +X {}\n", scanlines.count, pixels.count);
    let decoder =
        HdrDecoder::new(Cursor::new(header).chain(Cursor::new(size.into_bytes())).chain(rest)).map_err(damaged)?;
    let meta = decoder.metadata();
    let exposure = meta.exposure.unwrap_or(1.0);
    let (r, g, b) = meta.color_correction.unwrap_or((1.0, 1.0, 1.0));
    let divisor = [r, g, b].map(|correction| exposure * correction);
    if !divisor.iter().all(|d| d.is_finite() && *d > 0.0) {
        return Err(Refusal::Damaged("its EXPOSURE or COLORCORR is not a positive number".into()));
    }
    let stored = image::DynamicImage::from_decoder(decoder).map_err(damaged)?.into_rgb32f();
    let radiance = |p: &image::Rgb<f32>| [0, 1, 2].map(|c| p.0[c] / divisor[c]);
    let mut values: Vec<[f32; 3]> = stored.pixels().map(radiance).collect();
    let mut notes = Vec::new();
    if is_xyz {
        primaries::convert_from_xyz(&mut values);
    } else if let Some([r, g, b, white]) = primaries {
        notes.extend(primaries::convert(&mut values, [r, g, b], white).map_err(Refusal::Unsupported)?);
    }
    Ok((upright(values, scanlines, pixels), notes))
}

/// One of a picture's two directions.
#[derive(Clone, Copy, Debug)]
struct Direction {
    /// Up and down, not across.
    is_vertical: bool,
    /// From the left, or from the top.
    is_forward: bool,
    count: usize,
}

/// What a file says of its pixels.
struct Header<'a> {
    /// Lines for the decoder.
    attributes: String,
    /// In which direction scanlines follow each other,
    scanlines: Direction,
    /// and pixels within one.
    pixels: Direction,
    is_xyz: bool,
    /// Chromaticities of red, green, blue and white.
    primaries: Option<[[f32; 2]; 4]>,
    /// What follows the header.
    rest: &'a [u8],
}

impl<'a> Header<'a> {
    fn parse(bytes: &'a [u8]) -> Result<Self, Refusal> {
        let damaged = |what: &str| Refusal::Damaged(what.into());
        let mut rest = bytes;
        let mut line = || {
            let end = rest.iter().position(|byte| *byte == b'\n')?;
            let line = String::from_utf8_lossy(rest[..end].trim_ascii_end()).into_owned();
            rest = &rest[end + 1..];
            Some(line)
        };
        let truncated = || damaged("its header is incomplete");
        let first = line().ok_or_else(truncated)?;
        // Some writers use the pixel encoding's name as the signature.
        if !["#?RADIANCE", "#?RGBE"].iter().any(|signature| first.starts_with(signature)) {
            return Err(damaged("it does not begin with #?RADIANCE"));
        }
        let (mut attributes, mut is_xyz, mut primaries) = (String::from("\nFORMAT=32-bit_rle_rgbe\n"), false, None);
        loop {
            let line = line().ok_or_else(truncated)?;
            let (key, value) = line.split_once('=').unwrap_or((&line, ""));
            match (key.trim(), value.trim()) {
                ("", "") if line.is_empty() => break,
                ("FORMAT", "32-bit_rle_rgbe") => {}
                ("FORMAT", "32-bit_rle_xyze") => is_xyz = true,
                ("FORMAT", _) => return Err(damaged("its FORMAT is neither 32-bit_rle_rgbe nor 32-bit_rle_xyze")),
                ("PRIMARIES", value) => {
                    let numbers: Result<Vec<f32>, _> = value.split_whitespace().map(str::parse).collect();
                    let Ok(&[rx, ry, gx, gy, bx, by, wx, wy]) = numbers.as_deref() else {
                        return Err(damaged("its PRIMARIES are not eight numbers"));
                    };
                    primaries = Some([[rx, ry], [gx, gy], [bx, by], [wx, wy]]);
                }
                ("EXPOSURE" | "COLORCORR", _) => attributes.extend([&line, "\n"]),
                _ => {}
            }
        }
        let size = line().ok_or_else(truncated)?;
        let words: Vec<&str> = size.split_whitespace().collect();
        let [axis_1, count_1, axis_2, count_2] = words[..] else {
            return Err(damaged("its size is not of the form -Y HEIGHT +X WIDTH"));
        };
        let direction = |axis: &str, count: &str| {
            let (is_vertical, is_forward) = match axis {
                "-Y" => (true, true),
                "+Y" => (true, false),
                "+X" => (false, true),
                "-X" => (false, false),
                _ => return None,
            };
            Some(Direction { is_vertical, is_forward, count: count.parse().ok()? })
        };
        match (direction(axis_1, count_1), direction(axis_2, count_2)) {
            (Some(scanlines), Some(pixels)) if scanlines.is_vertical != pixels.is_vertical => {
                Ok(Self { attributes, scanlines, pixels, is_xyz, primaries, rest })
            }
            _ => Err(damaged("its size is not of the form -Y HEIGHT +X WIDTH")),
        }
    }
}

/// The picture by rows from the top left.
fn upright(values: Vec<[f32; 3]>, scanlines: Direction, pixels: Direction) -> RgbImage {
    let (vertical, across) = if scanlines.is_vertical { (scanlines, pixels) } else { (pixels, scanlines) };
    let (width, height) = (across.count, vertical.count);
    if scanlines.is_vertical && vertical.is_forward && across.is_forward {
        return RgbImage { width, height, pixels: values };
    }
    let along = |direction: Direction, at: usize| if direction.is_forward { at } else { direction.count - 1 - at };
    let place = |k: usize| {
        let (x, y) = (along(across, k % width), along(vertical, k / width));
        let (line, pixel) = if scanlines.is_vertical { (y, x) } else { (x, y) };
        values[line * pixels.count + pixel]
    };
    RgbImage { width, height, pixels: (0..width * height).map(place).collect() }
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

    /// Six pixels in each of the eight orientations; lines of the header may end as Windows' do.
    #[test]
    fn every_orientation_is_upright() {
        let expected: Vec<u8> = vec![10, 20, 30, 40, 50, 60];
        for axes in ["-Y +X", "-Y -X", "+Y +X", "+Y -X", "+X -Y", "+X +Y", "-X -Y", "-X +Y"] {
            let (first, second) = axes.split_once(' ').unwrap();
            let count = |axis: &str| if axis.ends_with('Y') { 2 } else { 3 };
            let at = |axis: &str, k: usize| if matches!(axis, "-Y" | "+X") { k } else { count(axis) - 1 - k };
            let mut pixels = Vec::new();
            for i in 0..count(first) {
                for j in 0..count(second) {
                    let (one, other) = (at(first, i), at(second, j));
                    let (x, y) = if first.ends_with('X') { (one, other) } else { (other, one) };
                    pixels.push([expected[3 * y + x], 0, 0, 136]);
                }
            }
            let size = format!("{first} {} {second} {}", count(first), count(second));
            let file = picture("#?RADIANCE\r\nFORMAT=32-bit_rle_rgbe\r", &size, &pixels);
            let (image, notes) = RgbImage::decode("sky.hdr", &file).unwrap();
            let red: Vec<u8> = image.pixels.iter().map(|p| p[0] as u8).collect();
            assert_eq!(([image.width, image.height], &red, notes.len()), ([3, 2], &expected, 0), "{axes}");
        }
    }

    #[test]
    fn cie_xyz_and_other_primaries_become_rec_709() {
        // The white of D65, with Y = 128/256.
        let xyze = [[122, 128, 139, 128]; 2];
        let (image, _) =
            RgbImage::decode("sky.hdr", &picture("#?RADIANCE\nFORMAT=32-bit_rle_xyze", "-Y 1 +X 2", &xyze)).unwrap();
        assert!(image.pixels[0].iter().all(|value| (value - 0.5).abs() < 0.01), "{:?}", image.pixels);
        let rgbe = [[128, 128, 128, 129]; 2];
        let primaries = |numbers: &str| {
            let header = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nPRIMARIES={numbers}");
            RgbImage::decode("sky.hdr", &picture(&header, "-Y 1 +X 2", &rgbe)).map_err(|error| error.to_string())
        };
        let (image, notes) = primaries("0.713 0.293 0.165 0.83 0.128 0.044 0.32168 0.33767").unwrap();
        assert!(image.pixels[0].iter().all(|value| (value - 1.0).abs() < 1e-3) && notes[0].contains("converted"));
        assert!(primaries("1 2 3").unwrap_err().contains("PRIMARIES"));
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
        for size in ["+Y 1 -Y 2", "-Y 1 +X", "-Y 1 +Z 2", "-Y -1 +X 2"] {
            assert!(refused(&picture(header, size, &pixels)).contains("size"), "{size}");
        }
        let runs = [[[128, 128, 128, 129]].as_slice(), &[[1, 1, 1, 0]; 9]].concat();
        assert!(refused(&picture(header, "-Y 1 +X 40", &runs)).contains("run length"));
        assert!(refused(b"P6 1 1 255 abc").contains("damaged"));
    }
}
