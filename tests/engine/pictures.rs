//! The README's pictures are what its commands render.

use std::path::Path;

use pinspot::BackendChoice;
use pinspot::image::srgb8;

use crate::support::render;

#[test]
fn the_readmes_pictures_are_what_its_commands_render() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = std::fs::read_to_string(root.join("README.md")).unwrap();
    let commands: Vec<&str> = readme.lines().filter_map(|l| l.split_once("`pinspot render ")).map(|(_, c)| c).collect();
    let mut compared = 0;
    for command in commands.iter().filter_map(|c| c.split_once(" -o examples/pictures/")) {
        let (scene, rest) = command;
        let file = rest.split_whitespace().next().unwrap();
        assert!(rest.starts_with(&format!("{file} --size 256x256`")), "another command than this test renders: {rest}");
        compare(scene, &root.join("examples/pictures").join(file));
        compared += 1;
    }
    assert_eq!(compared, 8, "eight pictures with their commands");
}

fn compare(scene: &str, picture: &Path) {
    let stored = image::open(picture).unwrap_or_else(|e| panic!("{}: {e}", picture.display())).into_rgb8();
    let (loaded, mut options) = pinspot::load(scene).unwrap();
    options.size = [stored.width(), stored.height()];
    let display = options.display;
    let rendered = render(loaded, options, &BackendChoice::Cpu).unwrap();
    let shown = rendered.displayed(&display);
    let difference: f64 = shown
        .pixels
        .iter()
        .zip(stored.pixels())
        .flat_map(|(ours, theirs)| srgb8(*ours).into_iter().zip(theirs.0))
        .map(|(a, b)| f64::from(a.abs_diff(b)))
        .sum();
    let mean = difference / (3 * shown.pixels.len()) as f64;
    // Other processors round differently; a changed picture differs by whole levels.
    assert!(mean < 0.5, "{scene}: {mean} levels on average; if the change is meant, render the picture again");
}
