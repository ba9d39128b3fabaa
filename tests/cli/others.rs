//! Samples, filters, adapters, scenes, and the options of the window.

use crate::workplace::{Workplace, adapters, assert_all_named, first_adapter};

#[test]
fn view_says_what_its_options_are() {
    let place = Workplace::new();
    assert_all_named(&place, "view", ["--screenshot", "--backend", "--adapter"]);
    let output = place.run(&["view", "scene.toml", "--backend", "cpu", "--adapter", "x"]);
    assert_eq!(output.code, 2);
}

#[test]
fn every_option_of_samples_changes_what_it_writes() {
    let place = Workplace::new();
    let written = |more: &[&str]| {
        let output = place.run(&[&["samples", "ring", "-o", "out.ply"][..], more].concat());
        assert!(output.succeeded(), "{more:?}: {}", String::from_utf8_lossy(&output.stderr));
        let files = ["out.ply", "more.ply", "out.png"].map(|name| std::fs::read(place.path(name)).ok());
        let _ = ["more.ply", "out.png"].map(|name| std::fs::remove_file(place.path(name)));
        (files, output.stdout)
    };
    let plain = written(&[]);
    let changes = [
        &["--samples", "200"][..],
        &["--strategy", "grid"],
        &["--density", "curvature"],
        &["--seed", "9"],
        &["--sets", "2"],
        &["--spectrum", "out.png"],
        &["--json"],
        &["--quiet"],
    ];
    for more in changes {
        assert_ne!(written(more), plain, "{more:?} changes nothing");
    }
    assert!(place.run(&["samples", "ring", "--output", "more.ply", "--quiet"]).succeeded());
    assert!(place.path("more.ply").exists());
    assert_all_named(&place, "samples", changes.concat().into_iter().chain(["--output"]));
}

#[test]
fn samples_writes_a_point_cloud_and_prints_figures() {
    let place = Workplace::new();
    let output = place.run(&["samples", "ring", "-o", "out.ply", "--samples", "200"]);
    assert!(output.succeeded());
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("200 asked for") && text.contains("relative radius"), "{text}");
    let ply = std::fs::read(place.path("out.ply")).unwrap();
    assert!(ply.starts_with(b"ply\nformat binary_little_endian 1.0\n"));
    let json = place.run(&["samples", "ring", "-o", "out.ply", "--samples", "200", "--json"]);
    let figures: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert!(figures["relative_radius"].as_f64().unwrap() > 0.5);
}

#[test]
fn samples_tell_their_spectrum_where_there_is_one() {
    let place = Workplace::new();
    let args =
        ["samples", "ring", "-o", "ring.ply", "--samples", "500", "--sets", "4", "--spectrum", "ring.png", "--json"];
    let output = place.run(&args);
    assert!(output.succeeded(), "{}", String::from_utf8_lossy(&output.stderr));
    let figures: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(figures["spectrum"]["low_power"].as_f64().unwrap() < 0.3, "blue noise: {figures}");
    assert!(figures["coverage_radius"].as_f64().unwrap() < 1.0 && figures["orientation_bias"].as_f64().is_some());
    assert!(place.path("ring.png").exists());
}

#[test]
fn every_option_of_filters_adapters_and_scenes_does_something() {
    let place = Workplace::new();
    let adapter = first_adapter(&place);
    let output = place.run(&["filters", "--adapter", &adapter, "--output", "tried", "--json"]);
    assert!(output.succeeded(), "{}", String::from_utf8_lossy(&output.stderr));
    let tried: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(tried.as_array().unwrap().len(), 1, "the adapter alone");
    assert!(tried[0]["device"].as_str().unwrap().contains(&adapter));
    let files: Vec<_> = std::fs::read_dir(place.path("tried")).unwrap().map(|f| f.unwrap().file_name()).collect();
    assert_eq!(files.len(), 2, "{files:?}");
    place.refuses(&["filters", "--adapter", "voodoo", "--quiet"], &["voodoo"]);
    assert_all_named(&place, "filters", ["--adapter", "--output", "--json", "--quiet"]);

    let text = String::from_utf8(place.run(&["adapters"]).stdout).unwrap();
    assert!(text.contains(&adapter) && adapters(&place).is_array(), "{text}");
    assert_all_named(&place, "adapters", ["--json"]);

    let shown = String::from_utf8(place.run(&["scenes", "--show", "ring"]).stdout).unwrap();
    assert!(shown.contains("[environment]"), "{shown}");
    assert_all_named(&place, "scenes", ["--show"]);
}

#[test]
fn lists_scenes_and_adapters() {
    let place = Workplace::new();
    let scenes = String::from_utf8(place.run(&["scenes"]).stdout).unwrap();
    for name in ["ring-natural", "spoon-above", "cup-point-light", "disco-ball", "clear-sky", "city"] {
        assert!(scenes.contains(name), "{name}");
    }
    let list = adapters(&place);
    assert!(!list.as_array().unwrap().is_empty(), "run the tests by tests/run");
    assert!(list[0]["max_texture"].as_u64().unwrap() >= 2048);
}
