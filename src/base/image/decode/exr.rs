//! OpenEXR images through the `exr` crate. Its readers allocate the size that a header declares, so that sizes are
//! checked first.

use std::io::Cursor;

use exr::meta::BlockDescription;
use exr::meta::MetaData;
use exr::meta::header::Header;
use exr::prelude::{AnyChannels, FlatSamples, IntegerBounds, ReadChannels, ReadLayers};

use super::{Refusal, RgbImage, checked_size};

/// The best ratio of all supported compressions: deflate encodes runs at one bit per 129 bytes.
const MAX_PIXELS_PER_BYTE: usize = 1032;

pub(super) fn decode(bytes: &[u8]) -> Result<RgbImage, Refusal> {
    let damaged = |error: exr::error::Error| Refusal::Damaged(error.to_string());
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(damaged)?;
    for header in &meta.headers {
        check_header(header, bytes.len())?;
    }
    let read = || {
        exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_buffered(Cursor::new(bytes))
    };
    // The reader asserts what only a well-formed file keeps.
    let image = std::panic::catch_unwind(read)
        .map_err(|_| Refusal::Damaged("its blocks contradict its header".into()))?
        .map_err(damaged)?;
    let layer = image.layer_data;
    let pixels = rgb_pixels(&layer.channel_data)?;
    let (width, height) = (layer.size.0, layer.size.1);
    if pixels.len() != width * height {
        return Err(Refusal::Unsupported("has subsampled channels; convert it to plain R, G and B".into()));
    }
    let data_window = IntegerBounds::new(layer.attributes.layer_position, layer.size);
    Ok(placed(RgbImage { width, height, pixels }, data_window, image.attributes.display_window))
}

fn check_header(header: &Header, length: usize) -> Result<(), Refusal> {
    for window in [header.data_window(), header.shared_attributes.display_window] {
        checked_size(window.size.0, window.size.1, length, MAX_PIXELS_PER_BYTE)?;
    }
    if let BlockDescription::Tiles(tiles) = header.blocks {
        checked_size(tiles.tile_size.0, tiles.tile_size.1, usize::MAX, 1)?;
    }
    if header.chunk_count > length / size_of::<u64>() {
        return Err(Refusal::Damaged(format!("it declares {} blocks in {length} bytes", header.chunk_count)));
    }
    let has = |name: &str| header.channels.list.iter().any(|c| c.name.eq_case_insensitive(name));
    if has("RY") || has("BY") {
        let reason = "has luminance and chroma (channels Y, RY and BY); convert it to R, G and B";
        return Err(Refusal::Unsupported(reason.into()));
    }
    Ok(())
}

/// The channels R, G and B, or Y in place of all three.
fn rgb_pixels(channels: &AnyChannels<FlatSamples>) -> Result<Vec<[f32; 3]>, Refusal> {
    let channel = |name: &str| channels.list.iter().find(|c| c.name.eq_case_insensitive(name));
    let grey = channel("Y");
    let rgb = ["R", "G", "B"].map(|name| channel(name).or(grey).map(|c| c.sample_data.values_as_f32()));
    let [Some(r), Some(g), Some(b)] = rgb else {
        return Err(Refusal::Unsupported("has neither the channels R, G and B nor Y; export it with them".into()));
    };
    Ok(r.zip(g).zip(b).map(|((r, g), b)| [r, g, b]).collect())
}

/// Crops or pads the data to the display window; pixels without data are black.
fn placed(image: RgbImage, data: IntegerBounds, display: IntegerBounds) -> RgbImage {
    if data == display {
        return image;
    }
    let (width, height) = (display.size.0, display.size.1);
    // Column and row of a pixel of the display window in the data.
    let start = |axis: fn(IntegerBounds) -> i32| i64::from(axis(display)) - i64::from(axis(data));
    let (dx, dy) = (start(|window| window.position.0), start(|window| window.position.1));
    let shown = |at: i64, size: usize| usize::try_from(at).ok().filter(|at| *at < size);
    let mut pixels = Vec::with_capacity(width * height);
    for y in 0..height as i64 {
        for x in 0..width as i64 {
            let place = shown(x + dx, image.width).zip(shown(y + dy, image.height));
            pixels.push(place.map_or([0.0; 3], |(x, y)| image.pixels[y * image.width + x]));
        }
    }
    RgbImage { width, height, pixels }
}

#[cfg(test)]
mod tests {
    use exr::prelude::{AnyChannel, Encoding, Image, Layer, LayerAttributes, Vec2, WritableImage};

    use super::*;

    fn file(channels: &[&str], size: (usize, usize), at: (i32, i32), display: IntegerBounds) -> Vec<u8> {
        let samples = || FlatSamples::F32((0..size.0 * size.1).map(|k| k as f32).collect());
        let list: Vec<_> = channels.iter().map(|name| AnyChannel::new(*name, samples())).collect();
        let attributes = LayerAttributes { layer_position: Vec2(at.0, at.1), ..Default::default() };
        let channels = AnyChannels::sort(list.into());
        let mut image = Image::from_layer(Layer::new(size, attributes, Encoding::FAST_LOSSLESS, channels));
        image.attributes.display_window = display;
        let mut bytes = Cursor::new(Vec::new());
        image.write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    fn window(at: (i32, i32), size: (usize, usize)) -> IntegerBounds {
        IntegerBounds::new(at, size)
    }

    #[test]
    fn the_display_window_is_the_picture() {
        let bytes = file(&["R", "G", "B"], (2, 2), (1, -1), window((0, 0), (4, 2)));
        let (image, _) = RgbImage::decode("sky.exr", &bytes).unwrap();
        assert_eq!((image.width, image.height), (4, 2));
        let red: Vec<f32> = image.pixels.iter().map(|p| p[0]).collect();
        // The data's second row is the picture's first.
        assert_eq!(red, [0.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn grey_is_read_and_luminance_with_chroma_refused() {
        let whole = window((0, 0), (2, 1));
        let (image, _) = RgbImage::decode("sky.exr", &file(&["Y"], (2, 1), (0, 0), whole)).unwrap();
        assert_eq!(image.pixels, [[0.0; 3], [1.0; 3]]);
        let refused =
            |channels| RgbImage::decode("sky.exr", &file(channels, (2, 1), (0, 0), whole)).unwrap_err().to_string();
        let message = refused(&["BY", "RY", "Y"]);
        assert!(message.contains("sky.exr") && message.contains("convert it to R, G and B"), "{message}");
        assert!(refused(&["Z"]).contains("neither the channels"));
    }

    #[test]
    fn sizes_beyond_the_files_length_are_refused_before_anything_is_allocated() {
        let bytes = file(&["R", "G", "B"], (2, 2), (0, 0), window((0, 0), (2, 2)));
        let at = bytes.windows(10).position(|w| w == b"dataWindow").unwrap();
        // Behind the name and its end are the type `box2i`, its end, and the length; then x and y, twice.
        let max = at + 11 + 6 + 4 + 8;
        for k in [2, 6] {
            let mut hostile = bytes.clone();
            hostile[max + k] = 0x10;
            let message = RgbImage::decode("sky.exr", &hostile).unwrap_err().to_string();
            assert!(message.contains("damaged") && message.contains("bytes"), "{message}");
        }
    }
}
