//! tmp
use exr::prelude::*;
#[test]
fn make() {
    let dir = std::path::Path::new("tests/fuzz/corpus/exr");
    let img = |w: usize, h: usize, names: &[&str], enc: Encoding, half: bool| {
        let vals = |c: usize| -> FlatSamples {
            let v: Vec<f32> = (0..w * h).map(|k| (k * 7 % 13) as f32 * 0.25 + c as f32).collect();
            if half {
                FlatSamples::F16(v.iter().map(|x| half::f16::from_f32(*x)).collect())
            } else {
                FlatSamples::F32(v)
            }
        };
        let list: Vec<_> = names.iter().enumerate().map(|(c, n)| AnyChannel::new(*n, vals(c))).collect();
        let channels = AnyChannels::sort(list.into());
        Image::from_layer(Layer::new((w, h), LayerAttributes::default(), enc, channels))
    };
    let tiles = |c| Encoding { compression: c, blocks: Blocks::Tiles(Vec2(4, 4)), line_order: LineOrder::Increasing };
    let lines = |c| Encoding { compression: c, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let rgb = ["R", "G", "B"];
    let mut save = |name: &str, i: Image<Layer<AnyChannels<FlatSamples>>>| {
        i.write().non_parallel().to_file(dir.join(name)).unwrap()
    };
    save("raw.exr", img(4, 2, &rgb, lines(Compression::Uncompressed), false));
    save("zip.exr", img(8, 4, &rgb, lines(Compression::ZIP16), true));
    save("rle.exr", img(8, 4, &["Y"], lines(Compression::RLE), true));
    save("piz.exr", img(8, 8, &rgb, lines(Compression::PIZ), true));
    save("pxr24.exr", img(8, 4, &rgb, lines(Compression::PXR24), false));
    save("b44.exr", img(8, 4, &rgb, lines(Compression::B44), true));
    save("tiles.exr", img(8, 8, &rgb, tiles(Compression::ZIP1), false));
    let mut windowed = img(4, 2, &rgb, lines(Compression::ZIP1), false);
    windowed.layer_data.attributes.layer_position = Vec2(1, 1);
    windowed.attributes.display_window = IntegerBounds::new((0, 0), (6, 3));
    save("windowed.exr", windowed);
}
