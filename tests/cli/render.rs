//! Pictures: options, what is written, and what is said of it.

use crate::workplace::{MESH, SCENE, Workplace, assert_all_named, exr, first_adapter};

#[test]
fn quiet_is_quiet_and_the_summary_names_the_back_end() {
    let place = Workplace::new();
    let quiet = place.render(&["--quiet"]);
    assert!(quiet.succeeded() && quiet.stdout.is_empty() && quiet.stderr.is_empty());
    let spoken = place.render(&[]);
    assert!(String::from_utf8(spoken.stderr).unwrap().contains("on the CPU"));
}

#[test]
fn the_gpu_back_end_renders_and_says_so() {
    let place = Workplace::new();
    let output = place.run(&["render", "scene.toml", "-o", "out.exr", "--backend", "gpu", "--json", "--quiet"]);
    assert!(output.succeeded(), "run the tests by tests/run: {}", String::from_utf8_lossy(&output.stderr));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["backend"], "gpu");
    assert!(!report["adapter"]["name"].as_str().unwrap().is_empty());
}

#[test]
fn options_lie_over_the_scene() {
    let place = Workplace::new();
    let output = place.render(&[
        "--size",
        "10x6",
        "--samples",
        "30",
        "--strategy",
        "random",
        "--footprint",
        "curvature",
        "--filter",
        "isotropic",
        "--seed",
        "3",
        "--json",
    ]);
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["size"], serde_json::json!([10, 6]));
    assert_eq!((report["samples"].as_u64(), report["seed"].as_u64()), (Some(30), Some(3)));
    assert_eq!(
        (&report["strategy"], &report["filter"], &report["footprint"]),
        (&"random".into(), &"isotropic".into(), &"curvature".into())
    );
}

#[test]
fn every_option_of_render_changes_what_it_writes() {
    let place = Workplace::new();
    // Natural light, which takes little time at this size, and few photons.
    let scene = SCENE.replace("constant = [1.0, 1.0, 1.0]", "map = \"forest\"");
    place.write("scene.toml", scene.replace("samples = 60", "samples = 60\ncube_size = 64\nphotons = 128"));
    let adapter = first_adapter(&place);
    // Pictures, and what is said: nothing of it but times differs from run to run.
    let written = |more: &[&str]| {
        let mut args = vec!["render", "scene.toml", "-o", "out.png", "out.exr"];
        if !more.contains(&"--backend") && !more.contains(&"--adapter") {
            args.extend(["--backend", "cpu"]);
        }
        args.extend(more);
        let output = place.run(&args);
        assert!(output.succeeded(), "{more:?}: {}", String::from_utf8_lossy(&output.stderr));
        let files = ["out.png", "out.exr", "more.png"].map(|name| std::fs::read(place.path(name)).ok());
        let _ = std::fs::remove_file(place.path("more.png"));
        (files, output.stdout.is_empty(), output.stderr.is_empty())
    };
    let plain = written(&[]);
    assert_eq!(written(&[]), plain, "the same bits");
    let changes = [
        &["--output", "more.png"][..],
        &["--size", "20x12"],
        &["--samples", "20"],
        &["--strategy", "random"],
        &["--strategy", "quantised-grid"],
        &["--density", "contribution"],
        &["--seed", "9"],
        &["--footprint", "curvature"],
        &["--filter", "none"],
        &["--filter", "isotropic"],
        &["--evaluation", "flat"],
        &["--leaves", "4"],
        &["--tolerance", "1"],
        &["--taps", "1"],
        &["--attenuation", "off"],
        &["--epsilon", "paper"],
        &["--epsilon", "0.5"],
        &["--cube-size", "16"],
        &["--visibility", "none"],
        &["--env", "city"],
        &["--env-rotation-deg", "90"],
        &["--env-intensity", "2"],
        &["--exposure", "-2"],
        &["--exposure", "auto"],
        &["--background-exposure", "-2"],
        &["--tone-map", "filmic"],
        &["--tone-map", "linear"],
        &["--caustic-gain", "3"],
        &["--overlay", "samples"],
        &["--quality", "draft"],
        &["--quality", "final"],
        &["--seconds", "1e-6"],
        &["--plain-diffuse"],
        &["--pixel-samples", "3"],
        &["--aov", "albedo"],
        &["--backend", "gpu"],
        &["--adapter", &adapter],
        &["--json"],
        &["--quiet"],
    ];
    for more in changes {
        assert_ne!(written(more), plain, "{more:?} changes nothing");
    }
    // It is the default; and there is no medium.
    assert_eq!(written(&["--technique", "pinhole"]), plain);
    let of_photons = options_of_photons_that_change(&written, &plain);
    assert_eq!(written(&["--medium-steps", "4"]), plain);
    let mut scene = std::fs::read_to_string(place.path("scene.toml")).unwrap();
    scene.push_str("[medium]\nsigma_s = 0.2\n");
    std::fs::write(place.path("scene.toml"), scene).unwrap();
    let hazy = written(&[]);
    assert_ne!(hazy, plain);
    assert_ne!(written(&["--medium-steps", "4"]), hazy);
    // Those of animations have a test of their own.
    let others = ["--technique", "--medium-steps", "--frames", "--fps"];
    assert_all_named(&place, "render", changes.concat().into_iter().chain(others).chain(of_photons));
}

/// The options of image-space techniques, each of which changes a picture of theirs.
fn options_of_photons_that_change<T: PartialEq + std::fmt::Debug>(
    written: &impl Fn(&[&str]) -> T,
    plain: &T,
) -> Vec<&'static str> {
    let with_few = |lights: &'static str, more: &[&str]| {
        let args = ["--technique", "image-space", "--tolerance", "0.5", "--lights", lights];
        let photons: &[&str] = if more.contains(&"--photons") { &[] } else { &["--photons", "64"] };
        written(&[&args[..], photons, more].concat())
    };
    let photons = |more: &[&str]| with_few("6", more);
    let by_photons = photons(&[]);
    assert_ne!(by_photons, *plain);
    for more in
        [&["--mode", "points"][..], &["--hits", "quarter-image"], &["--photons", "512"], &["--caustic-map", "light"]]
    {
        assert_ne!(photons(more), by_photons, "{more:?} changes nothing");
    }
    assert_ne!(with_few("5", &[]), by_photons);
    assert_ne!(photons(&["--temporal-frames", "2"]), by_photons);
    for (with, more) in [
        (["--caustic-map", "light"], &["--caustic-map-size", "64"][..]),
        (["--mode", "splats"], &["--splat-diameter", "9"]),
        (["--mode", "polygons"], &["--paper"]),
    ] {
        assert_ne!(photons(&[&with, more].concat()), photons(&with), "{more:?} changes nothing");
    }
    // Directions are those of a light with an extent, and glossy floors show where light comes from.
    let place = Workplace::new();
    let small = |scene: &str, more: &[&str]| {
        let args =
            ["render", scene, "-o", "small.exr", "--size", "24x24", "--technique", "image-space", "--photons", "64"];
        assert!(place.run(&[&args[..], more, &["--quiet"]].concat()).succeeded());
        std::fs::read(place.path("small.exr")).unwrap()
    };
    let polygons = |directions: &str| small("ring", &["--mode", "exact-polygons", "--light-directions", directions]);
    assert_ne!(polygons("2"), polygons("5"));
    assert_ne!(small("varnish", &["--incidence", "light"]), small("varnish", &["--incidence", "photon"]));
    vec![
        "--mode",
        "--hits",
        "--traversal",
        "--photons",
        "--caustic-map",
        "--lights",
        "--caustic-map-size",
        "--splat-diameter",
        "--light-directions",
        "--temporal-frames",
        "--incidence",
        "--paper",
    ]
}

#[test]
fn options_of_the_other_technique_are_named() {
    let place = Workplace::new();
    let said = |more: &[&str]| {
        let output = place.run(&[&["render", "ring", "-o", "small.png", "--size", "16x16"], more].concat());
        assert!(output.succeeded());
        String::from_utf8(output.stderr).unwrap()
    };
    let pinhole = said(&["--mode", "points", "--samples", "50"]);
    assert!(pinhole.contains("--mode changes nothing") && !pinhole.contains("--samples changes"), "{pinhole}");
    let photons = said(&["--technique", "image-space", "--mode", "points", "--samples", "50", "--photons", "64"]);
    assert!(photons.contains("--samples changes nothing") && !photons.contains("--mode changes"), "{photons}");
}

#[test]
fn a_picture_that_time_left_coarse_says_so() {
    let place = Workplace::new();
    let said = |seconds| {
        let output = place.run(&["render", "scene.toml", "-o", "out.png", "--backend", "cpu", "--seconds", seconds]);
        assert!(output.succeeded());
        String::from_utf8(output.stderr).unwrap()
    };
    let coarse = said("1e-6");
    assert!(coarse.contains("coarser than its scene asks for") && coarse.contains("more --seconds"), "{coarse}");
    assert!(!said("600").contains("coarser"));
}

#[test]
fn the_hierarchy_is_asked_for_reported_and_bounded() {
    let place = Workplace::new();
    let base = ["render", "mirror-sphere", "-o", "a.png", "--size", "16x16", "--backend", "cpu"];
    let run = |more: &[&str]| place.run(&[&base[..], more].concat());
    let report = |more: &[&str]| {
        let output = run(&[more, &["--json", "--quiet"]].concat());
        assert!(output.succeeded(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    let by_default = report(&[]);
    assert_eq!((&by_default["mode"], &by_default["leaves"]), (&"hierarchical".into(), &256.into()));
    let flat = report(&["--evaluation", "flat", "--leaves", "5"]);
    assert_eq!((&flat["mode"], &flat["leaves"]), (&"flat".into(), &4.into()));
    assert!(flat["seconds"]["tree"].as_f64().unwrap() > 0.0);
    for (code, more, remedy) in [
        (2, &["--leaves", "0"][..], "from 1 to"),
        (2, &["--leaves", "4096", "--samples", "100000"], "fewer --samples or fewer --leaves"),
        (2, &["--tolerance", "0"], "from 0.00001 to 1"),
        (2, &["--tolerance", "NaN"], "from 0.00001 to 1"),
        (1, &["--evaluation", "hierarchical", "--filter", "none"], "--filter anisotropic"),
        (1, &["--evaluation", "hierarchical", "--epsilon", "paper"], "--evaluation flat"),
        (2, &["--leaves", "4", "--footprint", "curvature"], "--footprint cells"),
    ] {
        let output = run(more);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.code, code, "{more:?}: {message}");
        assert!(message.contains(remedy), "{more:?}: {message}");
    }
}

#[test]
fn a_printed_built_in_scene_renders_as_a_file() {
    let place = Workplace::new();
    let toml = place.run(&["scenes", "--show", "mirror-sphere"]).stdout;
    place.write("mine.toml", toml);
    let output =
        place.run(&["render", "mine.toml", "-o", "out.png", "--size", "16x16", "--samples", "30", "--backend", "cpu"]);
    assert!(output.succeeded());
}

#[test]
fn degenerate_triangles_are_dropped_with_a_warning() {
    let place = Workplace::new();
    place.write("ring.obj", format!("{MESH}f 1 1 2\n"));
    let output = place.render(&["--quiet"]);
    assert!(output.succeeded());
    assert!(String::from_utf8(output.stderr).unwrap().contains("dropped 1 degenerate"));
}

#[test]
fn negative_radiance_is_set_to_zero_with_a_warning() {
    let place = Workplace::new();
    exr(&place.path("light.exr"), 32, 16, -1.0);
    let output = place.render(&["--env", "light.exr", "--quiet"]);
    assert!(output.succeeded());
    assert!(String::from_utf8(output.stderr).unwrap().contains("512 pixels had negative radiance"));
}

/// What a newcomer types: a model, a side instead of two, thousands by their letter.
#[test]
fn models_and_short_numbers_are_understood() {
    let place = Workplace::new();
    let output = place.run(&[
        "render",
        "ring.obj",
        "-o",
        "ring.exr",
        "--size",
        "12",
        "--samples",
        "0.06k",
        "--backend",
        "cpu",
        "--quiet",
        "--aov",
        "caustic",
    ]);
    assert!(output.succeeded(), "{}", String::from_utf8_lossy(&output.stderr));
    let image = pinspot::image::read_exr(&place.path("ring.exr"), "").unwrap();
    assert!((image.width, image.height) == (12, 12) && image.mean().min_element() > 0.0, "{:?}", image.mean());
    place.refuses(&["render", "ball.glb", "-o", "out.png"], &["ball.glb", "the format '.glb' is not read yet"]);
}
