//! OpenEXR images through the `exr` crate. Its readers allocate the size that a header declares, so that sizes are
//! checked first.

use std::io::Cursor;

use exr::error::{Error, Result as ExrResult};
use exr::meta::BlockDescription;
use exr::meta::MetaData;
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use exr::prelude::{IntegerBounds, ReadChannels, ReadLayers};

use super::exr_layers::{self, LayerChannels};
use super::{Refusal, RgbImage, checked_size, primaries};

/// The best ratio of all supported compressions: deflate encodes runs at one bit per 129 bytes.
const MAX_PIXELS_PER_BYTE: usize = 1032;
/// The largest number of half floats.
const LARGEST_HALF: f32 = 65504.0;

/// The RGB of a layer, of the only or the main one if none is named, and notes on it.
pub(super) fn decode(bytes: &[u8], layer: Option<&str>) -> Result<(RgbImage, Vec<String>), Refusal> {
    let damaged = |error: Error| Refusal::Damaged(error.to_string());
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(damaged)?;
    for header in &meta.headers {
        check_header(header, bytes.len())?;
    }
    let chosen = exr_layers::choose(&meta.headers, layer).map_err(Refusal::Unsupported)?;
    let header = &meta.headers[chosen.part];
    let read = || {
        let channels = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels();
        OfPart { channels, header }.first_valid_layer().all_attributes().from_buffered(Cursor::new(bytes))
    };
    // The reader asserts what only a well-formed file keeps.
    let image = std::panic::catch_unwind(read)
        .map_err(|_| Refusal::Damaged("its blocks contradict its header".into()))?
        .map_err(damaged)?;
    let data = image.layer_data;
    let (width, height) = (data.size.0, data.size.1);
    let [r, g, b] = chosen.channels.map(|index| data.channel_data.list[index].sample_data.values_as_f32());
    let mut pixels: Vec<[f32; 3]> = r.zip(g).zip(b).map(|((r, g), b)| [r, g, b]).collect();
    if pixels.len() != width * height {
        return Err(Refusal::Unsupported("has subsampled channels; convert it to plain R, G and B".into()));
    }
    let mut notes: Vec<String> = clipped(header, &chosen, &pixels).into_iter().collect();
    if let Some(chromaticities) = &header.shared_attributes.chromaticities {
        let [red, green, blue, white] =
            [chromaticities.red, chromaticities.green, chromaticities.blue, chromaticities.white]
                .map(|place| [place.0, place.1]);
        notes.extend(primaries::convert(&mut pixels, [red, green, blue], white).map_err(Refusal::Unsupported)?);
    }
    if let Some(luminance) = header.own_attributes.white_luminance {
        notes.push(format!(
            "its white is {luminance} cd/m² (whiteLuminance), which is left aside; scale it by intensity"
        ));
    }
    let data_window = IntegerBounds::new(data.attributes.layer_position, data.size);
    Ok((placed(RgbImage { width, height, pixels }, data_window, image.attributes.display_window), notes))
}

/// Reads one part of a file, whatever the others are.
struct OfPart<'h, C> {
    channels: C,
    header: &'h Header,
}

impl<'s, C: ReadChannels<'s>> ReadChannels<'s> for OfPart<'_, C> {
    type Reader = C::Reader;

    fn create_channels_reader(&'s self, header: &Header) -> ExrResult<Self::Reader> {
        // Names of parts are unique.
        let own = &header.own_attributes.layer_name;
        if *own == self.header.own_attributes.layer_name && header.channels == self.header.channels {
            self.channels.create_channels_reader(header)
        } else {
            Err(Error::Invalid("another part".into()))
        }
    }
}

/// A note if the brightest pixels are the largest number of half floats.
fn clipped(header: &Header, chosen: &LayerChannels, pixels: &[[f32; 3]]) -> Option<String> {
    let is_half = chosen.channels.iter().any(|index| header.channels.list[*index].sample_type == SampleType::F16);
    let is_clipped = |pixel: &&[f32; 3]| pixel.contains(&LARGEST_HALF);
    let count = pixels.iter().filter(is_clipped).count();
    let exceeds = || pixels.as_flattened().iter().any(|value| *value > LARGEST_HALF);
    (count > 0 && (is_half || !exceeds())).then(|| {
        format!(
            "{count} of its pixels are {LARGEST_HALF}, the largest number of half floats: the sun, or what else is brighter, was \
             clipped, and its light is missing; use a map of 32-bit floats, or add the sun as a directional [[light]]"
        )
    })
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
    Ok(())
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
    use exr::prelude::{
        AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, Text, Vec2, WritableImage, f16,
    };

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

    /// A file of two pixels; each part has a name and channels, all samples of which are given numbers.
    fn parts(parts: &[(&str, &[(&str, f32)])]) -> Vec<u8> {
        let mut layers = Vec::new();
        for (name, channels) in parts {
            let channel = |(name, value): &(&str, f32)| AnyChannel::new(*name, FlatSamples::F32(vec![*value; 2]));
            let channels = AnyChannels::sort(channels.iter().map(channel).collect());
            let layer_name = (!name.is_empty()).then(|| Text::from(*name));
            let attributes = LayerAttributes { layer_name, ..Default::default() };
            layers.push(Layer::new((2, 1), attributes, Encoding::FAST_LOSSLESS, channels));
        }
        let attributes = exr::meta::header::ImageAttributes::new(window((0, 0), (2, 1)));
        let image = Image::from_layers(attributes, layers);
        let mut bytes = Cursor::new(Vec::new());
        image.write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    fn layer(bytes: &[u8], name: Option<&str>) -> Result<[f32; 3], String> {
        let decoded = RgbImage::decode_layer("sky.exr", name, bytes).map_err(|error| error.to_string());
        decoded.map(|(image, _)| image.pixels[1])
    }

    /// As Nuke, Arnold, V-Ray and Blender name the channels of their pictures, and as parts are named.
    #[test]
    fn the_only_layer_is_found_and_others_have_names() {
        for [r, g, b] in [
            ["rgba.R", "rgba.G", "rgba.B"],
            ["RGBA.R", "RGBA.G", "RGBA.B"],
            [".R", ".G", ".B"],
            ["ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B"],
            ["light.red", "light.green", "light.blue"],
        ] {
            let file = parts(&[("", &[(r, 1.0), (g, 2.0), (b, 3.0), ("ViewLayer.Depth.Z", 9.0), ("N.Y", 8.0)])]);
            assert_eq!(layer(&file, None), Ok([1.0, 2.0, 3.0]), "{r}");
        }
        let depth_first = parts(&[("depth", &[("Z", 5.0)]), ("beauty", &[("R", 1.0), ("G", 2.0), ("B", 3.0)])]);
        assert_eq!(layer(&depth_first, None), Ok([1.0, 2.0, 3.0]));
        let passes = [("L.Combined.R", 1.0), ("L.Combined.G", 2.0), ("L.Combined.B", 3.0), ("L.Env.R", 4.0)];
        let passes = [&passes[..], &[("L.Env.G", 5.0), ("L.Env.B", 6.0)]].concat();
        let several = parts(&[("", &passes)]);
        for name in ["L.Env", "l.env", "Env"] {
            assert_eq!(layer(&several, Some(name)), Ok([4.0, 5.0, 6.0]), "{name}");
        }
        let message = layer(&several, None).unwrap_err();
        assert!(
            message.contains("sky.exr") && message.contains("L.Combined, L.Env; name one, as in FILE.exr#L.Combined")
        );
        let message = layer(&several, Some("sun")).unwrap_err();
        assert!(message.contains("no layer 'sun'; it has L.Combined, L.Env"), "{message}");
        let bare = parts(&[("", &[("R", 1.0), ("G", 2.0), ("B", 3.0), ("a.R", 4.0), ("a.G", 5.0), ("a.B", 6.0)])]);
        assert_eq!((layer(&bare, None), layer(&bare, Some("a"))), (Ok([1.0, 2.0, 3.0]), Ok([4.0, 5.0, 6.0])));
        let parted = parts(&[
            ("left", &[("R", 1.0), ("G", 1.0), ("B", 1.0)]),
            ("right", &[("right.R", 2.0), ("right.G", 2.0), ("right.B", 2.0)]),
        ]);
        assert_eq!(layer(&parted, Some("right")), Ok([2.0; 3]));
        assert!(layer(&depth_first, Some("depth")).is_err());
        assert_eq!(RgbImage::split_layer("a/sky.EXR#x.y"), ("a/sky.EXR", Some("x.y")));
        assert_eq!(RgbImage::split_layer("a#b/sky#1.exr"), ("a#b/sky#1.exr", None));
    }

    #[test]
    fn a_clipped_sun_is_noted() {
        let of = |values: [f32; 2]| {
            let samples = |name: &str| {
                AnyChannel::new(name, FlatSamples::F16(values.iter().map(|value| f16::from_f32(*value)).collect()))
            };
            let channels = AnyChannels::sort(["R", "G", "B"].map(samples).into_iter().collect());
            let image =
                Image::from_layer(Layer::new((2, 1), LayerAttributes::default(), Encoding::FAST_LOSSLESS, channels));
            let mut bytes = Cursor::new(Vec::new());
            image.write().to_buffered(&mut bytes).unwrap();
            RgbImage::decode("sky.exr", &bytes.into_inner()).unwrap().1
        };
        let notes = of([65504.0, 1.0]);
        assert!(notes.len() == 1 && notes[0].contains("sky.exr: 1 of its pixels") && notes[0].contains("clipped"));
        assert!(of([60000.0, 1.0]).is_empty());
    }

    #[test]
    fn colours_of_other_primaries_are_converted() {
        let mut image = Image::from_layer(Layer::new(
            (2, 1),
            LayerAttributes::default(),
            Encoding::FAST_LOSSLESS,
            AnyChannels::sort(
                ["R", "G", "B"].map(|n| AnyChannel::new(n, FlatSamples::F32(vec![1.0; 2]))).into_iter().collect(),
            ),
        ));
        let ap1 = |x, y| Vec2(x, y);
        image.attributes.chromaticities = Some(exr::meta::attribute::Chromaticities {
            red: ap1(0.713, 0.293),
            green: ap1(0.165, 0.830),
            blue: ap1(0.128, 0.044),
            white: ap1(0.32168, 0.33767),
        });
        image.layer_data.attributes.white_luminance = Some(100.0);
        let mut bytes = Cursor::new(Vec::new());
        image.write().to_buffered(&mut bytes).unwrap();
        let (image, notes) = RgbImage::decode("sky.exr", &bytes.into_inner()).unwrap();
        assert!(image.pixels[0].iter().all(|value| (value - 1.0).abs() < 1e-4), "{:?}", image.pixels[0]);
        assert!(notes.len() == 2 && notes[0].contains("Rec.709") && notes[1].contains("whiteLuminance"), "{notes:?}");
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
