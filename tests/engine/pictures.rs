//! The README's pictures are what its commands render, pixel by pixel; the largest and the slowest, which are compared at a smaller size,
//! on average.

use std::path::Path;

use pinspot::BackendChoice;
use pinspot::image::{Aov, srgb8};

use crate::support;

/// Levels of 255 that rounding may add to a channel: processors without fused multiplication round differently.
const ROUNDING: u8 = 1;
/// Where an edge or a decision of the tree falls to the other side by rounding, a pixel may differ by more: so many of them
const STRAY_PIXELS: usize = 16;
/// by so much.
const STRAY: u8 = 16;

/// How many times smaller large pictures are compared than they are stored,
const REDUCTION: u32 = 3;
/// and by how many levels they may differ then: on average (the waves of `pool` are finer than its pixels),
const MEAN_OF_SMALL: f64 = 2.2;
/// and in all but 5 % of the channels. Edges are anti-aliased by another filter.
const MOST_OF_SMALL: u8 = 8;

#[test]
fn a_picture_of_the_readme_is_what_its_command_renders() {
    are_what_its_commands_render(|scene| scene == "ring-natural");
}

#[test]
#[ignore = "full: pictures of 256² pixels and more"]
fn the_readmes_pictures_are_what_its_commands_render() {
    are_what_its_commands_render(|scene| scene != "ring-natural");
}

fn are_what_its_commands_render(is_asked_for: fn(&str) -> bool) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = std::fs::read_to_string(root.join("README.md")).unwrap();
    let commands: Vec<&str> = readme.lines().filter_map(|l| l.split_once("`pinspot render ")).map(|(_, c)| c).collect();
    let mut failures = Vec::new();
    let mut count = 0;
    for command in commands.iter().filter_map(|c| c.split_once(" -o examples/pictures/")) {
        let (scene, rest) = command;
        let (command, _) = rest.split_once('`').unwrap();
        let (file, size) = command.split_once(' ').map_or((command, None), |(file, size)| (file, Some(size)));
        // An animation takes minutes; `tests/cli` records smaller ones.
        if std::path::Path::new(file).extension().is_some_and(|extension| extension == "apng") {
            continue;
        }
        assert!(size.is_none_or(|size| size == "--size 256x256"), "another command than this test renders: {rest}");
        let stored = root.join("examples/pictures").join(file);
        count += 1;
        if !is_asked_for(scene) {
            continue;
        }
        let is_slow = ["pool", "underwater"].contains(&scene);
        failures.extend(if size.is_some() && !is_slow {
            compare(scene, [256; 2], &stored)
        } else {
            compare_small(scene, &stored)
        });
    }
    assert_eq!(count, 14, "fourteen pictures with their commands");
    assert!(failures.is_empty(), "{}\nif a change is meant, render the pictures again", failures.join("\n"));
}

#[test]
#[ignore = "full: every pixel of three pictures computed"]
fn interpolated_light_cannot_be_told_from_computed_light() {
    for scene in ["ring-natural", "columns", "cup"] {
        cannot_be_told_from_computed_light(scene);
    }
}

/// A picture that shows the caustic alone, too, computes it in every pixel and as exactly everywhere. Without, it is interpolated and
/// less exact where that cannot be seen; only at edges, which are anti-aliased then, do pixels differ.
fn cannot_be_told_from_computed_light(scene: &str) {
    let [interpolated, computed] =
        [&[Aov::Beauty][..], &[Aov::Beauty, Aov::Caustic]].map(|aovs| render_with(scene, [64; 2], aovs));
    let pairs = interpolated.pixels().zip(computed.pixels());
    let largest = |(a, b): (&image::Rgb<u8>, &image::Rgb<u8>)| (0..3).map(|k| a[k].abs_diff(b[k])).max().unwrap_or(0);
    let mut differences: Vec<u8> = pairs.map(largest).collect();
    differences.sort_unstable();
    let of_all = |part: usize| differences[differences.len() * part / 1000];
    println!("{scene}: {} levels in the middle, {} at 95 %, {} at 99 %", of_all(500), of_all(950), of_all(990));
    assert!(differences.iter().any(|&d| d > 0), "{scene}: nothing is interpolated");
    assert!(of_all(500) == 0 && of_all(950) <= 2, "{scene}");
}

/// What is wrong with a picture, if anything is.
fn compare(scene: &str, size: [u32; 2], stored: &Path) -> Option<String> {
    let expected = image::open(stored).unwrap_or_else(|e| panic!("{}: {e}", stored.display())).into_rgb8();
    assert_eq!([expected.width(), expected.height()], size, "{}", stored.display());
    let actual = render(scene, size);
    let pairs = actual.pixels().zip(expected.pixels());
    let largest = |(a, e): (&image::Rgb<u8>, &image::Rgb<u8>)| {
        a.0.into_iter().zip(e.0).map(|(a, e)| a.abs_diff(e)).max().unwrap_or(0)
    };
    let differences: Vec<u8> = pairs.map(largest).collect();
    let strays = differences.iter().filter(|d| **d > ROUNDING).count();
    let most = differences.iter().max().copied().unwrap_or(0);
    println!("{scene}: {strays} pixels differ by more than {ROUNDING}, the most by {most}");
    if strays <= STRAY_PIXELS && most <= STRAY {
        return None;
    }
    let folder = save(scene, &actual, &expected);
    Some(format!(
        "{scene}: {strays} pixels differ by more than {ROUNDING} level, the most by {most}; see {scene}-actual.png, \
         {scene}-expected.png and {scene}-difference.png in {folder}"
    ))
}

/// The same for a large picture, which takes a minute: a smaller one shows the same on average, and nearly everywhere.
fn compare_small(scene: &str, stored: &Path) -> Option<String> {
    let expected = image::open(stored).unwrap_or_else(|e| panic!("{}: {e}", stored.display())).into_rgb8();
    let size = [expected.width(), expected.height()].map(|edge| edge / REDUCTION);
    let expected = image::imageops::resize(&expected, size[0], size[1], image::imageops::FilterType::Triangle);
    let actual = render(scene, size);
    let pairs = actual.as_raw().iter().zip(expected.as_raw());
    let mut differences: Vec<u8> = pairs.map(|(a, e)| a.abs_diff(*e)).collect();
    differences.sort_unstable();
    let mean = differences.iter().map(|d| f64::from(*d)).sum::<f64>() / differences.len() as f64;
    let most = differences[differences.len() * 95 / 100];
    println!("{scene}: {mean:.2} levels on average at a {REDUCTION}rd of the size, {most} at 95 %");
    if mean <= MEAN_OF_SMALL && most <= MOST_OF_SMALL {
        return None;
    }
    let folder = save(scene, &actual, &expected);
    Some(format!("{scene}: {mean:.2} levels differ on average, {most} at 95 %; see {scene}-difference.png in {folder}"))
}

fn render(scene: &str, size: [u32; 2]) -> image::RgbImage {
    render_with(scene, size, &[Aov::Beauty])
}

fn render_with(scene: &str, size: [u32; 2], aovs: &[Aov]) -> image::RgbImage {
    let (scene, options) = pinspot::load(scene).unwrap();
    let display = options.display;
    let mut options = options.with_size(size);
    options.aovs = aovs.to_vec();
    let rendered = support::render(scene, options, &BackendChoice::Cpu).unwrap();
    let bytes = rendered.displayed(&display).pixels.iter().flat_map(|p| srgb8(*p)).collect();
    image::RgbImage::from_raw(size[0], size[1], bytes).unwrap()
}

/// Keeps both pictures, and their difference about middle grey, eightfold.
fn save(scene: &str, actual: &image::RgbImage, expected: &image::RgbImage) -> String {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pictures");
    std::fs::create_dir_all(&folder).unwrap();
    let mut difference = actual.clone();
    for (pixel, expected) in difference.pixels_mut().zip(expected.pixels()) {
        for (channel, expected) in pixel.0.iter_mut().zip(expected.0) {
            *channel = (128 + 8 * (i32::from(*channel) - i32::from(expected))).clamp(0, 255) as u8;
        }
    }
    for (name, picture) in [("actual", actual), ("expected", expected), ("difference", &difference)] {
        picture.save(folder.join(format!("{scene}-{name}.png"))).unwrap();
    }
    folder.display().to_string()
}
