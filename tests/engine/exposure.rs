//! Metered exposure.

use pinspot::image::srgb8;
use pinspot::scene::Light;
use pinspot::{BackendChoice, DisplaySettings, Exposure};

use crate::support;

#[test]
fn night_and_day_are_exposed_for() {
    are_exposed_for(&["city", "clear-sky"]);
}

#[test]
#[ignore = "full: the other maps"]
fn other_built_in_lights_are_exposed_for() {
    are_exposed_for(&["studio", "forest"]);
}

/// Under each map, which differ by several stops, the mirror's surroundings are neither dark nor washed out.
fn are_exposed_for(maps: &[&str]) {
    for &map in maps {
        let (mut scene, options) = pinspot::load("ring").unwrap();
        scene.environment.light = Light::BuiltInMap(map.into());
        let display = DisplaySettings { exposure: Exposure::Auto, ..Default::default() };
        let options = options.with_size([64, 64]).with_samples(100).with_display(display);
        let rendered = support::render(scene, options, &BackendChoice::Cpu).unwrap();
        let used = rendered.report.exposures.unwrap();
        assert_eq!(used.exposure_ev, used.background_exposure_ev);
        let mut levels: Vec<u8> = rendered.displayed(&display).pixels.iter().map(|p| srgb8(*p)[1]).collect();
        levels.sort_unstable();
        let [middle, bright] = [levels.len() / 2, levels.len() * 9 / 10].map(|k| levels[k]);
        println!("{map}: {:+.1} stops, median {middle}, ninth decile {bright}", used.exposure_ev);
        assert!((60..190).contains(&middle) && bright < 253, "{map}: {middle}, {bright}");
    }
}

/// Metered and fixed at what was metered: the same picture.
#[test]
fn the_report_states_the_exposure_in_use() {
    let render = |exposure| {
        let (scene, options) = pinspot::load("mirror-sphere").unwrap();
        let display = DisplaySettings { exposure, background_exposure_ev: Some(0.5), ..Default::default() };
        let options = options.with_size([40, 30]).with_samples(100).with_display(display);
        let rendered = support::render(scene, options, &BackendChoice::Cpu).unwrap();
        (rendered.displayed(&display), rendered.report.exposures.unwrap())
    };
    let (metered, used) = render(Exposure::Auto);
    assert_eq!(used.background_exposure_ev, 0.5);
    assert_eq!(render(Exposure::Stops(used.exposure_ev)), (metered, used));
}
