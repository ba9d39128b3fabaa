//! The command as its users run it: outputs, exit codes, and one clear line for every bad input.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

const SCENE: &str = r#"
[environment]
constant = [1.0, 1.0, 1.0]
[camera]
position = [0.0, 5.0, 0.0]
target = [0.0, 0.0, 0.0]
up = [0.0, 0.0, -1.0]
orthographic = { height = 3.0 }
[render]
size = [24, 16]
samples = 60
[[object]]
name = "ring"
mesh = "ring.obj"
reflector = { sides = "both" }
[[object]]
name = "table"
shape = { plane = { size = [3.0, 3.0] } }
receiver = { albedo = [0.5, 0.5, 0.5] }
"#;

const MESH: &str = "v -0.5 0.1 0\nv 0.5 0.1 0\nv 0.5 0.8 0\nv -0.5 0.8 0\nf 1 2 3 4\n";

/// A folder with a scene and its mesh.
struct Workplace(TempDir);

impl Workplace {
    fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        place.write("scene.toml", SCENE);
        place.write("ring.obj", MESH);
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, contents: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), contents).unwrap();
    }

    fn run(&self, args: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_pinspot")).args(args).current_dir(self.0.path()).output().unwrap()
    }

    /// Renders the scene with more arguments; the CPU back end, so that messages do not depend on the machine.
    fn render(&self, more: &[&str]) -> Output {
        self.run(&[&["render", "scene.toml", "-o", "out.exr", "--backend", "cpu"], more].concat())
    }

    /// Asserts that a command fails with exit code 1, one line on stderr that has all of `parts`, and no output file.
    fn refuses(&self, args: &[&str], parts: &[&str]) {
        self.refuses_with(1, args, parts);
    }

    /// The same for a wrong command line.
    fn refuses_command_line(&self, args: &[&str], parts: &[&str]) {
        self.refuses_with(2, args, parts);
    }

    fn refuses_with(&self, code: i32, args: &[&str], parts: &[&str]) {
        let output = self.run(args);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{args:?}: {stderr}");
        let start = if code == 1 { "pinspot:" } else { "error:" };
        let lines: Vec<&str> = stderr.lines().filter(|l| l.starts_with(start)).collect();
        assert_eq!(lines.len(), 1, "{stderr}");
        for part in parts {
            assert!(lines[0].contains(part), "{args:?}: '{part}' is not in: {stderr}");
        }
        let left: Vec<_> = std::fs::read_dir(self.0.path()).unwrap().map(|f| f.unwrap().file_name()).collect();
        assert!(
            !left
                .iter()
                .any(|f| f.to_string_lossy().starts_with("out.") || f.to_string_lossy().starts_with(".pinspot")),
            "{left:?}"
        );
    }

    fn refuses_scene(&self, parts: &[&str]) {
        self.refuses(&["render", "scene.toml", "-o", "out.exr", "--backend", "cpu"], parts);
    }

    fn replace(&self, from: &str, to: &str) {
        assert!(SCENE.contains(from));
        self.write("scene.toml", SCENE.replace(from, to));
    }
}

fn exr(path: &Path, width: usize, height: usize, value: f32) {
    exr::prelude::write_rgb_file(path, width, height, |_, _| (value, value, value)).unwrap();
}

#[test]
fn renders_png_and_exr_and_reports() {
    let place = Workplace::new();
    let output = place.run(&[
        "render",
        "scene.toml",
        "-o",
        "out.png",
        "out.exr",
        "--backend",
        "cpu",
        "--aov",
        "caustic,depth",
        "--json",
    ]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["scene"], "scene");
    assert_eq!(report["backend"], "cpu");
    assert_eq!(report["size"], serde_json::json!([24, 16]));
    assert!(report["lookups"].as_f64().unwrap() > 0.0);
    assert!(report["seconds"]["caustic"].as_f64().unwrap() > 0.0);
    let caustic = pinspot::image::read_exr(&place.path("out.exr"), "caustic").unwrap();
    assert_eq!((caustic.width, caustic.height), (24, 16));
    assert!(caustic.mean().x > 0.0);
    let depth = pinspot::image::read_exr(&place.path("out.exr"), "depth").unwrap();
    // The table is five metres down; nothing is behind its edge, where the picture is wider.
    assert!((depth.pixels[8 * 24 + 4].x - 5.0).abs() < 1e-4);
    assert_eq!(depth.pixels[0].x, -1.0);
    assert_eq!(&std::fs::read(place.path("out.png")).unwrap()[..4], b"\x89PNG");
}

#[test]
fn quiet_is_quiet_and_the_summary_names_the_back_end() {
    let place = Workplace::new();
    let quiet = place.render(&["--quiet"]);
    assert!(quiet.status.success() && quiet.stdout.is_empty() && quiet.stderr.is_empty());
    let spoken = place.render(&[]);
    assert!(String::from_utf8(spoken.stderr).unwrap().contains("on the CPU"));
}

#[test]
fn the_gpu_back_end_renders_and_says_so() {
    let place = Workplace::new();
    let output = place.run(&["render", "scene.toml", "-o", "out.exr", "--backend", "gpu", "--json", "--quiet"]);
    assert!(output.status.success(), "run the tests by tests/run: {}", String::from_utf8_lossy(&output.stderr));
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

/// The long options of a command, as its help has them.
fn options_of(place: &Workplace, command: &str) -> BTreeSet<String> {
    let help = String::from_utf8(place.run(&[command, "--help"]).stdout).unwrap();
    let listed = help.lines().map(str::trim_start).filter(|line| line.starts_with('-'));
    let long = listed.filter_map(|line| line.split([' ', ',']).find(|word| word.starts_with("--")));
    long.map(str::to_owned).filter(|option| option != "--help").collect()
}

/// Fails when a command has an option that no case names, so that a new one needs a case.
fn assert_all_named<'a>(place: &Workplace, command: &str, named: impl IntoIterator<Item = &'a str>) {
    let named: BTreeSet<String> = named.into_iter().filter(|word| word.starts_with("--")).map(str::to_owned).collect();
    assert_eq!(named, options_of(place, command), "the options of {command}: exercised here, and in its help");
}

fn first_adapter(place: &Workplace) -> String {
    let adapters = place.run(&["adapters", "--json"]).stdout;
    let adapters: serde_json::Value = serde_json::from_slice(&adapters).unwrap();
    adapters[0]["name"].as_str().expect("run the tests by tests/run").to_owned()
}

#[test]
fn every_option_of_render_changes_what_it_writes() {
    let place = Workplace::new();
    place.replace("constant = [1.0, 1.0, 1.0]", "map = \"forest\"");
    let adapter = first_adapter(&place);
    // Pictures, and what is said: nothing of it but times differs from run to run.
    let written = |more: &[&str]| {
        let mut args = vec!["render", "scene.toml", "-o", "out.png", "out.exr"];
        if !more.contains(&"--backend") && !more.contains(&"--adapter") {
            args.extend(["--backend", "cpu"]);
        }
        args.extend(more);
        let output = place.run(&args);
        assert!(output.status.success(), "{more:?}: {}", String::from_utf8_lossy(&output.stderr));
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
    let photons = |more: &[&str]| written(&[&["--technique", "image-space", "--lights", "6"][..], more].concat());
    let by_photons = photons(&[]);
    assert_ne!(by_photons, *plain);
    for more in
        [&["--mode", "points"][..], &["--hits", "quarter-image"], &["--photons", "64"], &["--caustic-map", "light"]]
    {
        assert_ne!(photons(more), by_photons, "{more:?} changes nothing");
    }
    assert_ne!(written(&["--technique", "image-space", "--lights", "5"]), by_photons);
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
        assert!(place.run(&[&args[..], more, &["--quiet"]].concat()).status.success());
        std::fs::read(place.path("small.exr")).unwrap()
    };
    assert_ne!(small("ring", &["--light-directions", "2"]), small("ring", &["--light-directions", "5"]));
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
        assert!(output.status.success());
        String::from_utf8(output.stderr).unwrap()
    };
    let pinhole = said(&["--mode", "points", "--samples", "50"]);
    assert!(pinhole.contains("--mode changes nothing") && !pinhole.contains("--samples changes"), "{pinhole}");
    let photons = said(&["--technique", "image-space", "--mode", "points", "--samples", "50", "--photons", "64"]);
    assert!(photons.contains("--samples changes nothing") && !photons.contains("--mode changes"), "{photons}");
}

#[test]
fn frames_are_numbered_and_an_interrupted_sequence_goes_on() {
    let place = Workplace::new();
    let moving = "[[animation]]\nobject = \"ring\"\ntranslate = [[0.0, [0, 0, 0]], [1.0, [0.5, 0, 0]]]\n";
    place.write("moving.toml", format!("{SCENE}{moving}"));
    let render = |more: &[&str]| place.run(&[&["render", "moving.toml", "--backend", "cpu"], more].concat());
    let frames = &["--frames", "0..3", "--fps", "2", "-o", "f-##.png", "f-##.exr"];
    let output = render(frames);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let bytes = |name: &str| std::fs::read(place.path(name)).unwrap();
    let first: Vec<Vec<u8>> = (0..3).map(|k| bytes(&format!("f-0{k}.png"))).collect();
    assert!(first[0] != first[1] && first[1] != first[2], "it moves");
    std::fs::remove_file(place.path("f-01.exr")).unwrap();
    let said = String::from_utf8(render(frames).stderr).unwrap();
    assert!(said.contains("1 frames rendered, 2 were there already"), "{said}");
    assert_eq!((0..3).map(|k| bytes(&format!("f-0{k}.png"))).collect::<Vec<_>>(), first);
    let json = render(&[&frames[..], &["--json"]].concat()).stdout;
    let report: serde_json::Value = serde_json::from_slice(&json).unwrap();
    assert_eq!((&report["kept"], &report["rendered"]), (&3.into(), &0.into()));
    let said =
        String::from_utf8(render(&["--frames", "0..3", "--fps", "4", "-o", "f-##.png", "f-##.exr"]).stderr).unwrap();
    assert!(said.contains("2 frames rendered, 1 were there already"), "other moments but the first: {said}");
    assert!(render(&["--frames", "0..2", "-o", "all.apng"]).status.success());
    assert!(bytes("all.apng").windows(4).any(|chunk| chunk == b"fcTL"));
    let still = place.run(&["render", "scene.toml", "--backend", "cpu", "--frames", "0..1", "-o", "still-#.png"]);
    let still = String::from_utf8(still.stderr).unwrap();
    assert!(still.contains("nothing moves in scene 'scene'"), "{still}");
}

#[test]
fn frames_that_cannot_be_are_refused_before_the_work() {
    let place = Workplace::new();
    let code = |args: &[&str]| place.run(&[&["render", "scene.toml"], args].concat()).status.code();
    for frames in ["3", "3..3", "5..2", "x..2", "-1..2"] {
        assert_eq!(code(&["--frames", frames, "-o", "f-#.png"]), Some(2), "{frames}");
    }
    assert_eq!(code(&["--fps", "10", "-o", "f.png"]), Some(2), "--fps without --frames");
    assert_eq!(code(&["--frames", "0..2", "--seconds", "1", "-o", "f-#.png"]), Some(2));
    for (output, expected) in [
        ("f.png", "one file for many frames"),
        ("f-#.apng", "without '#'"),
        ("no/f-#.png", "folder 'no' does not exist"),
        ("f-#.txt", "ends in .png or .exr or .apng"),
    ] {
        let output = place.run(&["render", "scene.toml", "--frames", "0..2", "-o", output]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(1) && said.contains(expected), "{said}");
    }
}

#[test]
fn view_says_what_its_options_are() {
    let place = Workplace::new();
    assert_all_named(&place, "view", ["--screenshot", "--backend", "--adapter"]);
    let output = place.run(&["view", "scene.toml", "--backend", "cpu", "--adapter", "x"]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn every_option_of_samples_changes_what_it_writes() {
    let place = Workplace::new();
    let written = |more: &[&str]| {
        let output = place.run(&[&["samples", "ring", "-o", "out.ply"][..], more].concat());
        assert!(output.status.success(), "{more:?}: {}", String::from_utf8_lossy(&output.stderr));
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
    assert!(place.run(&["samples", "ring", "--output", "more.ply", "--quiet"]).status.success());
    assert!(place.path("more.ply").exists());
    assert_all_named(&place, "samples", changes.concat().into_iter().chain(["--output"]));
}

#[test]
fn every_option_of_reference_changes_what_it_writes() {
    let place = Workplace::new();
    place.replace("constant = [1.0, 1.0, 1.0]", "map = \"studio\"");
    let written = |more: &[&str]| {
        let rel_error = if more.contains(&"--rel-error") { &[][..] } else { &["--rel-error", "0.1"] };
        let output = place.run(&[&["reference", "scene.toml", "-o", "a.exr"][..], rel_error, more].concat());
        let image = pinspot::image::read_exr(&place.path("a.exr"), "").ok();
        let _ = std::fs::remove_file(place.path("a.exr"));
        (output.status.code(), image, output.stdout.is_empty(), output.stderr.is_empty())
    };
    let plain = written(&[]);
    assert_eq!(plain.0, Some(0));
    let changes = [
        &["--output", "b.exr"][..],
        &["--rel-error", "0.001"],
        &["--seconds", "1e-9"],
        &["--aov", "direct"],
        &["--size", "20x12"],
        &["--attenuation", "off"],
        &["--pixel-samples", "2"],
        &["--seed", "9"],
        &["--replicates", "20"],
        &["--env", "city"],
        &["--env-rotation-deg", "90"],
        &["--env-intensity", "2"],
        &["--json"],
        &["--quiet"],
    ];
    for more in changes {
        let more = if more[0] == "--output" { &["--quiet", "--size", "2x2"][..] } else { more };
        assert_ne!(written(more), plain, "{more:?} changes nothing");
    }
    assert!(place.run(&["reference", "scene.toml", "--output", "b.exr", "--rel-error", "0.5"]).status.success());
    // Nothing hides anything in that scene.
    let of_cup = |visibility: &str| {
        let args =
            ["reference", "cup", "-o", "cup.exr", "--size", "12x12", "--rel-error", "0.2", "--visibility", visibility];
        assert!(place.run(&[&args[..], &["--force", "--quiet"]].concat()).status.success());
        pinspot::image::read_exr(&place.path("cup.exr"), "").unwrap().mean()
    };
    assert!(of_cup("none").x > 1.1 * of_cup("full").x);
    // Nothing refracts in that scene.
    let of_pool = |chains: &str| {
        let args = ["reference", "pool", "-o", "pool.exr", "--size", "12x12", "--rel-error", "0.5", "--chains", chains];
        assert!(place.run(&[&args[..], &["--force", "--quiet"]].concat()).status.success());
        pinspot::image::read_exr(&place.path("pool.exr"), "").unwrap().mean()
    };
    assert_ne!(of_pool("R"), of_pool("R,T"));
    let reflecting = Workplace::new();
    reflecting.refuses(&["reference", "scene.toml", "-o", "a.exr", "--chains", "T"], &["chains is T", "refractor"]);
    let of_ring = |estimator: &str| {
        let args =
            ["reference", "ring", "-o", "ring.exr", "--size", "12x12", "--rel-error", "0.2", "--estimator", estimator];
        assert!(place.run(&[&args[..], &["--force", "--quiet"]].concat()).status.success());
        pinspot::image::read_exr(&place.path("ring.exr"), "").unwrap()
    };
    assert_ne!(of_ring("points"), of_ring("beams"));
    reflecting.refuses(&["reference", "scene.toml", "-o", "a.exr", "--estimator", "beams"], &["estimator", "spot"]);
    // That --force replaces a file is a test of its own.
    assert_all_named(
        &place,
        "reference",
        changes.concat().into_iter().chain(["--force", "--visibility", "--chains", "--estimator"]),
    );
}

#[test]
fn every_option_of_compare_arrives() {
    let place = Workplace::new();
    let mut mask = image::GrayImage::new(8, 6);
    mask.put_pixel(4, 3, image::Luma([255]));
    mask.save(place.path("mask.png")).unwrap();
    let args = [
        "compare",
        "scene.toml",
        "--output",
        "report",
        "--strategies",
        "random",
        "--densities",
        "contribution",
        "--footprints",
        "cells,curvature",
        "--filters",
        "anisotropic",
        "--evaluations",
        "flat",
        "--samples",
        "20,30",
        "--seeds",
        "2",
        "--seed",
        "5",
        "--mask",
        "mask.png",
        "--rel-error",
        "0.3",
        "--seconds",
        "600",
        "--size",
        "8x6",
        "--taps",
        "4",
        "--medium-steps",
        "4",
        "--attenuation",
        "off",
        "--epsilon",
        "0.5",
        "--cube-size",
        "16",
        "--visibility",
        "none",
        "--pixel-samples",
        "2",
        "--exposure",
        "1",
        "--env",
        "studio",
        "--env-rotation-deg",
        "90",
        "--env-intensity",
        "2",
        "--backend",
        "cpu",
        "--json",
    ];
    let report = |args: &[&str]| {
        let output = place.run(args);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    let all = report(&args);
    let rows = all["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 2 * 2 * 2, "footprints, samples, seeds");
    assert!(rows.iter().all(|r| r["strategy"] == "random" && r["density"] == "contribution" && r["taps"] == 4));
    assert!(rows.iter().all(|r| r["visibility"] == "none"
        && r["technique"] == "pinhole"
        && r["mode"] == "flat"
        && r["filter"] == "anisotropic"));
    let values = |key: &str| rows.iter().map(|r| r[key].to_string()).collect::<BTreeSet<_>>();
    assert_eq!(values("seed"), ["5", "6"].map(str::to_owned).into());
    assert_eq!(values("samples"), ["20", "30"].map(str::to_owned).into());
    assert_eq!(values("footprint"), ["\"cells\"", "\"curvature\""].map(str::to_owned).into());
    assert!(all["reference"]["rel_error"].as_f64().unwrap() <= 0.3 && all["reference"]["visibility"] == "none");
    // What the rows do not name changes their errors.
    let errors = |report: &serde_json::Value| {
        let row = &report["rows"][0];
        [&row["rel_l2"], &row["mrse"], &row["flip"]].map(ToString::to_string)
    };
    let without = |args: &[&'static str], option: &str| {
        let at = args.iter().position(|a| *a == option).unwrap();
        [&args[..at], &args[at + 2..]].concat()
    };
    // One sample count and one seed will do.
    let value_of = |args: &[&'static str], option: &str, value: &'static str| {
        let mut args = args.to_vec();
        let at = args.iter().position(|a| *a == option).unwrap();
        args[at + 1] = value;
        args
    };
    let few = value_of(&value_of(&args, "--samples", "20"), "--seeds", "1");
    let one = errors(&report(&few));
    for option in [
        "--mask",
        "--attenuation",
        "--cube-size",
        "--pixel-samples",
        "--exposure",
        "--env",
        "--env-rotation-deg",
        "--env-intensity",
    ] {
        assert_ne!(errors(&report(&without(&few, option))), one, "{option} changes nothing");
    }
    // ε is part of the attenuation.
    let attenuated = without(&few, "--attenuation");
    assert_ne!(errors(&report(&without(&attenuated, "--epsilon"))), errors(&report(&attenuated)));
    let quick =
        ["compare", "scene.toml", "-o", "gpu", "--samples", "10", "--seeds", "1", "--filters", "none", "--size", "8x6"];
    let adapter = first_adapter(&place);
    let on_gpu = report(&[&quick[..], &["--rel-error", "0.5", "--adapter", &adapter, "--json"]].concat());
    assert!(on_gpu["adapter"].as_str().unwrap().contains(&adapter));
    let quiet = place.run(&[&quick[..], &["--rel-error", "0.5", "--backend", "cpu", "--quiet"]].concat());
    assert!(quiet.status.success() && quiet.stdout.is_empty() && quiet.stderr.is_empty());
    let paper = ["compare", "scene.toml", "-o", "paper", "--figure", "5", "--seeds", "1", "--rel-error", "0.5"];
    let paper = report(&[&paper[..], &["--size", "6x4", "--backend", "cpu", "--json"]].concat());
    assert!(!paper["findings"].as_array().unwrap().is_empty() && paper["rows"][0]["samples"] == 2000);
    let cell = place.path("gpu/cells/neighbourhood-cells-none-10-seed1.exr");
    let written = || std::fs::metadata(&cell).unwrap().modified().unwrap();
    let before = written();
    let again = |more: &[&str]| {
        let output = place.run(&[&quick[..], &["--rel-error", "0.5", "--backend", "cpu", "--quiet"], more].concat());
        assert!(output.status.success());
        written()
    };
    assert_eq!(again(&[]), before, "what is finished is used again");
    assert_ne!(again(&["--force"]), before);
    let others = [
        "--adapter",
        "--quiet",
        "--figure",
        "--techniques",
        "--modes",
        "--photons",
        "--lights",
        "--estimator",
        "--force",
    ];
    assert_all_named(&place, "compare", args.into_iter().chain(others));
}

/// Techniques are compared with each other, and those that do not know what is in a scene are named with the reason.
#[test]
fn techniques_are_compared() {
    let place = Workplace::new();
    place.replace("constant = [1.0, 1.0, 1.0]", "map = \"studio\"");
    let compare = |more: &[&str]| {
        let args =
            ["--seeds", "1", "--filters", "anisotropic", "--samples", "20", "--rel-error", "0.5", "--size", "8x6"];
        let output = place.run(&[&["compare"], more, &args, &["--backend", "cpu", "--json"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    let photons = ["--modes", "points,splats", "--photons", "32,64", "--lights", "2,3"];
    let both = compare(&[&["scene.toml", "-o", "both", "--techniques", "pinhole,image-space"], &photons[..]].concat());
    let rows = both["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 1 + 2 * 2 * 2);
    assert!(rows[0]["technique"] == "pinhole" && rows[0]["photons"].is_null() && rows[0]["samples"] == 20);
    for row in &rows[1..] {
        assert!(row["technique"] == "image-space" && row["strategy"].is_null() && row["rel_l2"].is_f64());
        let lights = row["lights"].as_u64().unwrap();
        assert!([2, 3].contains(&lights) && [32 * 32, 64 * 64].contains(&(row["photons"].as_u64().unwrap() / lights)));
        assert!(row["flux_error"].as_f64().unwrap().abs() < 1e-3);
    }
    assert!(std::fs::read_to_string(place.path("both/report.csv")).unwrap().contains("flux_error"));
    let beams = ["ring", "-o", "ring", "--techniques", "image-space", "--photons", "64", "--pixel-samples", "2"];
    let beams = compare(&[&beams[..], &["--estimator", "beams"]].concat());
    assert!(beams["rows"][0]["rel_l2"].as_f64().unwrap() < 0.5);
    let cup = compare(&["gloss", "-o", "gloss", "--techniques", "pinhole,image-space"]);
    let absent = &cup["unavailable"][0];
    assert!(absent["technique"] == "image-space" && absent["reason"].as_str().unwrap().contains("rough mirrors"));
    place.refuses(
        &["compare", "haze", "-o", "haze", "--techniques", "image-space"],
        &["nothing can be compared", "media"],
    );
}

#[test]
fn every_option_of_filters_adapters_and_scenes_does_something() {
    let place = Workplace::new();
    let adapter = first_adapter(&place);
    let output = place.run(&["filters", "--adapter", &adapter, "--output", "tried", "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let tried: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(tried.as_array().unwrap().len(), 1, "the adapter alone");
    assert!(tried[0]["device"].as_str().unwrap().contains(&adapter));
    let files: Vec<_> = std::fs::read_dir(place.path("tried")).unwrap().map(|f| f.unwrap().file_name()).collect();
    assert_eq!(files.len(), 2, "{files:?}");
    place.refuses(&["filters", "--adapter", "voodoo", "--quiet"], &["voodoo"]);
    assert_all_named(&place, "filters", ["--adapter", "--output", "--json", "--quiet"]);

    let [text, json] = [&["adapters"][..], &["adapters", "--json"]].map(|args| place.run(args).stdout);
    assert!(String::from_utf8(text).unwrap().contains(&adapter) && json.starts_with(b"["));
    assert_all_named(&place, "adapters", ["--json"]);

    let shown = String::from_utf8(place.run(&["scenes", "--show", "ring"]).stdout).unwrap();
    assert!(shown.contains("[environment]"), "{shown}");
    assert_all_named(&place, "scenes", ["--show"]);
}

#[test]
fn samples_writes_a_point_cloud_and_prints_figures() {
    let place = Workplace::new();
    let output = place.run(&["samples", "ring", "-o", "out.ply", "--samples", "200"]);
    assert!(output.status.success());
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("200 asked for") && text.contains("relative radius"), "{text}");
    let ply = std::fs::read(place.path("out.ply")).unwrap();
    assert!(ply.starts_with(b"ply\nformat binary_little_endian 1.0\n"));
    let json = place.run(&["samples", "ring", "-o", "out.ply", "--samples", "200", "--json"]);
    let figures: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert!(figures["relative_radius"].as_f64().unwrap() > 0.5);
}

#[test]
fn lists_scenes_and_adapters() {
    let place = Workplace::new();
    let scenes = String::from_utf8(place.run(&["scenes"]).stdout).unwrap();
    for name in ["ring-natural", "spoon-above", "cup-point-light", "disco-ball", "clear-sky", "city"] {
        assert!(scenes.contains(name), "{name}");
    }
    let adapters = place.run(&["adapters", "--json"]);
    let list: serde_json::Value = serde_json::from_slice(&adapters.stdout).unwrap();
    assert!(!list.as_array().unwrap().is_empty(), "run the tests by tests/run");
    assert!(list[0]["max_texture"].as_u64().unwrap() >= 2048);
}

/// Mesa's layer for the choice of a device asks for a Wayland compositor, even where there cannot be one.
#[cfg(unix)]
#[test]
fn without_a_session_nothing_is_said_of_it() {
    let place = Workplace::new();
    let output = Command::new(env!("CARGO_BIN_EXE_pinspot"))
        .arg("adapters")
        .env_remove("XDG_RUNTIME_DIR")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET")
        .current_dir(place.0.path())
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && !said.contains("XDG_RUNTIME_DIR"), "{said}");
}

#[test]
fn a_printed_built_in_scene_renders_as_a_file() {
    let place = Workplace::new();
    let toml = place.run(&["scenes", "--show", "mirror-sphere"]).stdout;
    place.write("mine.toml", toml);
    let output =
        place.run(&["render", "mine.toml", "-o", "out.png", "--size", "16x16", "--samples", "30", "--backend", "cpu"]);
    assert!(output.status.success());
}

#[test]
fn missing_scenes_are_named_with_the_nearest_built_in_one() {
    let place = Workplace::new();
    place.refuses(&["render", "ring-naturel", "-o", "out.png"], &["'ring-naturel'", "did you mean 'ring-natural'"]);
    place.refuses(&["render", "no/such.toml", "-o", "out.png"], &["no/such.toml", "pinspot scenes"]);
}

#[test]
fn scene_files_with_mistakes_are_refused_with_line_and_key() {
    let place = Workplace::new();
    place.replace("samples = 60", "sampels = 60");
    place.refuses_scene(&["scene.toml:11:", "'sampels'", "'samples'"]);
    place.replace("target = [0.0, 0.0, 0.0]", "target = [0.0, 0.0");
    place.refuses_scene(&["scene.toml:"]);
    place.replace("samples = 60", "samples = 0");
    place.refuses_scene(&["scene", "samples is 0", "from 1 to"]);
    place.replace("size = [24, 16]", "size = [0, 16]");
    place.refuses_scene(&["size is 0×16", "1×1"]);
    place.replace("samples = 60", "taps = 0");
    place.refuses_scene(&["taps is 0", "from 1 to 64"]);
    place.replace("samples = 60", "visibility = \"half\"");
    place.refuses_scene(&["half", "none", "full"]);
    place.replace("samples = 60", "epsilon = -1.0");
    place.refuses_scene(&["epsilon is -1"]);
    place.replace("reflector = { sides = \"both\" }", "");
    place.refuses_scene(&["neither reflector nor refractor"]);
}

#[test]
fn unusable_meshes_are_named_with_the_reason() {
    let place = Workplace::new();
    for (mesh, reason) in [
        ("", "is empty"),
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "1 degenerate"),
        ("v 0 0 0\nv NaN 0 0\nv 0 1 0\nf 2 1 3\n", "ring.obj:2:"),
        ("v 0 0 0\nv 1 0 0\nf 1 2 3\n", "names vertex 3"),
        ("\u{0}\u{1}binary", "ring.obj"),
    ] {
        place.write("ring.obj", mesh);
        place.refuses_scene(&["ring.obj", reason]);
    }
    std::fs::remove_file(place.path("ring.obj")).unwrap();
    place.refuses_scene(&["ring.obj", "check the path"]);
    place.replace("ring.obj", "ring.gltf");
    place.refuses_scene(&["ring.gltf", "export it as Wavefront OBJ"]);
}

#[test]
fn degenerate_triangles_are_dropped_with_a_warning() {
    let place = Workplace::new();
    place.write("ring.obj", format!("{MESH}f 1 1 2\n"));
    let output = place.render(&["--quiet"]);
    assert!(output.status.success());
    assert!(String::from_utf8(output.stderr).unwrap().contains("dropped 1 degenerate"));
}

#[test]
fn unusable_environment_maps_are_named_with_the_reason() {
    let place = Workplace::new();
    place.replace("constant = [1.0, 1.0, 1.0]", "map = \"light.exr\"");
    place.refuses_scene(&["light.exr", "check the path"]);
    place.write("light.exr", "not an image");
    place.refuses_scene(&["light.exr", "damaged"]);
    exr(&place.path("light.exr"), 32, 16, 1.0);
    let whole = std::fs::read(place.path("light.exr")).unwrap();
    place.write("light.exr", &whole[..whole.len() / 2]);
    place.refuses_scene(&["light.exr", "damaged"]);
    exr(&place.path("light.exr"), 32, 16, f32::NAN);
    place.refuses_scene(&["light.exr", "pixel (0, 0)", "not a finite number"]);
    exr(&place.path("light.exr"), 30, 11, 1.0);
    place.refuses_scene(&["light.exr", "30×11", "2:1"]);
    place.write("light.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 0 +X 0\n");
    place.replace("constant = [1.0, 1.0, 1.0]", "map = \"light.hdr\"");
    place.refuses_scene(&["light.hdr"]);
    place.replace("constant = [1.0, 1.0, 1.0]", "map = \"light.jpg\"");
    place.refuses_scene(&["light.jpg", "convert it to .exr or .hdr"]);
    place.replace("constant = [1.0, 1.0, 1.0]", "map = \"forrest\"");
    place.refuses_scene(&["'forrest'", "forest"]);
    place.replace(
        "constant = [1.0, 1.0, 1.0]",
        "spot = { direction = [0.0, 1.0, 0.0], sigma_rad = 0.0002, radiance = [1.0, 1.0, 1.0] }",
    );
    place.refuses_scene(&["4096", "wider spot"]);
}

#[test]
fn negative_radiance_is_set_to_zero_with_a_warning() {
    let place = Workplace::new();
    exr(&place.path("light.exr"), 32, 16, -1.0);
    let output = place.render(&["--env", "light.exr", "--quiet"]);
    assert!(output.status.success());
    assert!(String::from_utf8(output.stderr).unwrap().contains("512 pixels had negative radiance"));
}

#[test]
fn outputs_that_cannot_be_written_are_refused_before_the_work() {
    let place = Workplace::new();
    place.refuses(&["render", "scene.toml", "-o", "out.jpg"], &["out.jpg", ".png or .exr"]);
    place.refuses(&["render", "scene.toml", "-o", "no/folder/a.png"], &["no/folder", "create it first"]);
    place.refuses(&["samples", "ring", "-o", "out.txt"], &["out.txt", ".ply"]);
    std::fs::create_dir(place.path("folder.png")).unwrap();
    place.refuses(&["render", "scene.toml", "-o", "folder.png", "--backend", "cpu"], &["folder.png", "it is a folder"]);
}

#[test]
fn back_ends_that_are_not_there_are_refused() {
    let place = Workplace::new();
    place.refuses(&["render", "scene.toml", "-o", "out.exr", "--adapter", "voodoo"], &["voodoo", "found:"]);
    place.refuses(
        &["render", "scene.toml", "-o", "out.exr", "--filter", "hardware", "--backend", "cpu"],
        &["hardware needs a GPU"],
    );
    place.refuses_command_line(
        &["render", "scene.toml", "-o", "out.exr", "--size", "40000x2"],
        &["size is 40000×2", "16384"],
    );
}

#[test]
fn nothing_is_asked_for_in_vain() {
    let place = Workplace::new();
    let refuses = |more: &[&str], part: &str| place.refuses(&[&["render", "scene.toml"], more].concat(), &[part]);
    refuses(&["-o", "out.exr", "--overlay", "samples"], "--overlay is drawn");
    refuses(&["-o", "out.png", "--aov", "caustic", "--overlay", "samples"], "--overlay is drawn");
    refuses(&["-o", "out.exr", "--aov", "caustic", "--plain-diffuse"], "--plain-diffuse changes the beauty only");
    refuses(&["-o", "out.exr", "--aov", "caustic", "--caustic-gain", "2"], "--caustic-gain changes the beauty only");
    refuses(&["-o", "out.png", "--aov", "caustic,depth"], "give an .exr");
    place.refuses_command_line(
        &["render", "scene.toml", "-o", "out.exr", "--aov", "caustic,caustic"],
        &["aov is caustic twice", "each once"],
    );
    refuses(&["-o", "out.exr", "--exposure", "1"], "--exposure changes what is displayed");
    refuses(&["-o", "out.exr", "--evaluation", "flat", "--tolerance", "0.1"], "--tolerance is that of a hierarchy");
    refuses(&["-o", "out.exr", "--filter", "none", "--taps", "2"], "--taps are those of a filter");
    place.replace("constant = [1.0, 1.0, 1.0]", "constant = [1.0, 1.0, 1.0]\nlayout = \"latlong\"");
    place.refuses_scene(&["scene.toml:4:", "environment.layout"]);
    place.replace(
        "shape = { plane = { size = [3.0, 3.0] } }",
        "shape = { plane = { size = [3.0, 3.0] } }\ncrease_angle_deg = 3.0",
    );
    place.refuses_scene(&["object 'table'.crease_angle_deg", "exact normals"]);
    place.replace("samples = 60", "epsilon = true");
    place.refuses_scene(&["scene.toml:11:", "a number or a word"]);
}

#[test]
fn wrong_command_lines_exit_with_two() {
    let place = Workplace::new();
    for args in [
        &["render"][..],
        &["rendr", "ring"],
        &["render", "ring", "-o", "a.png", "--leaves", "many"],
        &["render", "ring", "-o", "a.png", "--evaluation", "deep"],
        &["render", "ring", "-o", "a.png", "--filter", "bicubic"],
        &["render", "ring", "-o", "a.png", "--strategy", "hexagonal"],
        &["render", "ring", "-o", "a.png", "--visibility", "half"],
        &["reference", "ring", "-o", "a.exr", "--samples", "10"],
        &["compare", "ring", "-o", "a", "--figure", "6"],
        &["compare", "ring", "-o", "a", "--figure", "4", "--samples", "10"],
        &["render", "ring", "-o", "a.png", "--size", "512"],
        &["render", "ring", "-o", "a.png", "--cube-size", "100"],
        &["render", "scene.toml", "-o", "a.png", "--adapter", "voodoo", "--backend", "cpu"],
        &["view", "--frames", "1..2"],
        &["reference", "ring", "-o", "a.exr", "--rel-error", "0"],
        &["reference", "ring", "-o", "a.exr", "--seconds=-1"],
        &["reference", "ring", "-o", "a.exr", "--seconds", "NaN"],
        &["compare", "ring", "-o", "a", "--seconds", "0"],
    ] {
        let output = place.run(args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(!output.stderr.is_empty());
    }
}

#[test]
fn a_reference_has_irradiance_and_its_error_and_can_go_on() {
    let place = Workplace::new();
    let run = |goal: &str| {
        let output = place.run(&[
            "reference",
            "scene.toml",
            "-o",
            "truth.exr",
            "--rel-error",
            goal,
            "--visibility",
            "full",
            "--json",
        ]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    let rough = run("0.1");
    let first = rough["rel_error"].as_f64().unwrap();
    // However good the first pass was.
    let goal = first.min(0.01) / 3.0;
    let better = run(&goal.to_string());
    assert!(first <= 0.1 && better["rel_error"].as_f64().unwrap() <= goal);
    assert!(better["passes"].as_u64() > rough["passes"].as_u64(), "the second run goes on");
    let path = place.path("truth.exr");
    let irradiance = pinspot::image::read_exr(&path, "").unwrap();
    let error = pinspot::image::read_exr(&path, "error").unwrap();
    assert_eq!([irradiance.width, irradiance.height, error.width, error.height], [24, 16, 24, 16]);
    assert!(irradiance.mean().x > 0.0 && error.mean().x > 0.0 && error.mean().x < 0.01 * irradiance.mean().x);
}

/// The time comes first: a whole file, a warning, success; or, where not even the first pass is over, a failure that says so and
/// a file to go on from. The work ends when its time does.
#[test]
fn a_reference_keeps_to_its_time() {
    let place = Workplace::new();
    let run = |seconds: &str, size: &str| {
        let started = std::time::Instant::now();
        let output = place.run(&[
            "reference",
            "cup",
            "-o",
            "cup.exr",
            "--size",
            size,
            "--rel-error",
            "1e-6",
            "--seconds",
            seconds,
            "--force",
        ]);
        // Loading, and the pixels that have been begun.
        assert!(started.elapsed().as_secs_f64() < seconds.parse::<f64>().unwrap() + 20.0);
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let (code, message) = run("4", "16x16");
    assert_eq!(code, Some(0), "{message}");
    assert!(message.contains("time is up"), "{message}");
    assert!(pinspot::image::read_exr(&place.path("cup.exr"), "error").unwrap().mean().is_finite());
    let (code, message) = run("1", "2000x2000");
    assert_eq!(code, Some(1), "{message}");
    assert!(message.contains("% of the pixels") && message.contains("--seconds"), "{message}");
}

#[test]
fn a_reference_replaces_nothing_that_it_cannot_go_on_from() {
    let place = Workplace::new();
    let reference = |more: &[&str]| {
        let base = ["reference", "scene.toml", "-o", "truth.exr", "--rel-error", "0.3", "--quiet"];
        let output = place.run(&[&base[..], more].concat());
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let refused = |more: &[&str], parts: &[&str]| {
        let before = std::fs::read(place.path("truth.exr")).unwrap();
        let (code, message) = reference(more);
        assert_eq!(code, Some(1), "{message}");
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
        assert_eq!(std::fs::read(place.path("truth.exr")).unwrap(), before);
    };
    assert_eq!(reference(&[]).0, Some(0));
    refused(&["--seed", "2"], &["truth.exr", "no earlier state of this reference", "--force"]);
    place.replace("constant = [1.0, 1.0, 1.0]", "constant = [2.0, 1.0, 1.0]");
    refused(&[], &["truth.exr", "its scene, light", "--force"]);
    assert_eq!(reference(&["--force"]).0, Some(0));
    assert_eq!(reference(&[]).0, Some(0), "now it is this scene's");
    exr(&place.path("truth.exr"), 24, 16, 1.0);
    refused(&[], &["truth.exr", "--force"]);
    place.write("truth.exr", "not an image");
    refused(&[], &["truth.exr", "damaged", "delete it"]);
}

/// Refused at once: each of these would otherwise compute a reference that is never good enough, or samples by the million.
#[test]
fn what_cannot_be_is_refused_before_the_work() {
    let place = Workplace::new();
    place.write("a.exr", "old");
    place.write("a.png", "old");
    place.write("a.ply", "old");
    for name in ["a.exr", "a.png", "a.ply"] {
        let mut permissions = std::fs::metadata(place.path(name)).unwrap().permissions();
        permissions.set_readonly(true);
        std::fs::set_permissions(place.path(name), permissions).unwrap();
    }
    std::fs::create_dir(place.path("f.exr")).unwrap();
    let endless = ["--rel-error", "1e-9", "--quiet"];
    let many = ["--samples", "1000000", "--quiet"];
    let reference = |output| [&["reference", "scene.toml", "-o", output][..], &endless].concat();
    place.refuses(&reference("a.exr"), &["a.exr", "read-only"]);
    place.refuses(&reference("f.exr"), &["f.exr", "it is a folder"]);
    place.refuses(&[&["render", "scene.toml", "-o", "b.exr", "a.png"][..], &many].concat(), &["a.png", "read-only"]);
    place.refuses(&[&["samples", "ring", "-o", "a.ply"][..], &many].concat(), &["a.ply", "read-only"]);
    assert_eq!(std::fs::read(place.path("a.exr")).unwrap(), b"old");
    std::fs::create_dir_all(place.path("report/report.html")).unwrap();
    let compare = |more: &[&str], part| {
        place.refuses(&[&["compare", "scene.toml", "-o", "report"][..], more, &endless].concat(), &[part]);
    };
    compare(&[], "report.html");
    std::fs::remove_dir_all(place.path("report")).unwrap();
    compare(&["--evaluations", "hierarchical", "--filters", "none"], "evaluation hierarchical");
    compare(&["--evaluations", "flat,hierarchical", "--footprints", "curvature"], "evaluation hierarchical");
    compare(&["--filters", "none,hardware", "--backend", "cpu"], "no hardware filter");
}

#[cfg(unix)]
#[test]
fn links_are_followed_and_names_need_no_unicode() {
    use std::os::unix::ffi::OsStrExt;
    let place = Workplace::new();
    std::fs::create_dir(place.path("real")).unwrap();
    std::os::unix::fs::symlink("real/picture.exr", place.path("out.exr")).unwrap();
    assert!(place.render(&["--quiet"]).status.success());
    assert!(place.path("out.exr").is_symlink() && place.path("real/picture.exr").is_file());
    let name = std::ffi::OsStr::from_bytes(b"re\xffport");
    let output = Command::new(env!("CARGO_BIN_EXE_pinspot"))
        .args(["compare", "scene.toml", "--samples", "10", "--seeds", "1", "--filters", "none", "--rel-error", "0.5"])
        .args(["--backend", "cpu", "-o"])
        .arg(name)
        .current_dir(place.0.path())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let folder = place.0.path().join(name);
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("report.json")).unwrap()).unwrap();
    let command = report["made_with"].as_array().unwrap().iter().find(|entry| entry[0] == "Command").unwrap();
    assert!(command[1].as_str().unwrap().ends_with("-o re\u{fffd}port"), "{command}");
}

/// Of a black reference no error is a part: that is said, and no NaN is written.
#[test]
fn errors_of_a_black_scene_are_not_defined() {
    let place = Workplace::new();
    place.replace("constant = [1.0, 1.0, 1.0]", "constant = [0.0, 0.0, 0.0]");
    let output = place.run(&[
        "compare",
        "scene.toml",
        "-o",
        "report",
        "--samples",
        "10",
        "--seeds",
        "1",
        "--filters",
        "none",
        "--backend",
        "cpu",
    ]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = |name: &str| std::fs::read_to_string(place.path("report").join(name)).unwrap();
    let report: serde_json::Value = serde_json::from_str(&text("report.json")).unwrap();
    assert!(report["rows"][0]["rel_l2"].is_null() && report["rows"][0]["mrse"] == 0.0, "{report}");
    let csv = text("report.csv");
    let cells: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    let column = cells[0].iter().position(|name| *name == "rel_l2").unwrap();
    assert_eq!(cells[1][column], "", "missing, as CSV has it");
    assert!(text("report.html").contains("\"rel_l2\":null"));
    for text in [text("report.json"), csv, String::from_utf8(output.stdout).unwrap()] {
        assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
    }
}

#[test]
fn the_reference_refuses_what_it_cannot_do() {
    let place = Workplace::new();
    let base = ["reference", "scene.toml", "-o", "out.exr"];
    for (more, parts) in [
        (["--aov", "beauty"], ["aov is beauty", "caustic, direct, scattered"]),
        (["--size", "0x4"], ["size", "1×1"]),
        (["--env", "nowhere.exr"], ["nowhere.exr", "check the path"]),
    ] {
        place.refuses(&[&base[..], &more[..]].concat(), &parts);
    }
    place.refuses(&["reference", "scene.toml", "-o", "out.png"], &["out.png", ".exr"]);
    place.refuses(&["compare", "scene.toml", "-o", "scene.toml"], &["scene.toml", "folder"]);
    place.refuses(&["compare", "scene.toml", "-o", "out", "--mask", "ring.obj"], &["ring.obj", ".png"]);
    place.refuses(&["samples", "spoon", "-o", "out.ply", "--spectrum", "out.png"], &["unroll", "cylinder"]);
}

#[test]
fn samples_tell_their_spectrum_where_there_is_one() {
    let place = Workplace::new();
    let args =
        ["samples", "ring", "-o", "ring.ply", "--samples", "500", "--sets", "4", "--spectrum", "ring.png", "--json"];
    let output = place.run(&args);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let figures: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(figures["spectrum"]["low_power"].as_f64().unwrap() < 0.3, "blue noise: {figures}");
    assert!(figures["coverage_radius"].as_f64().unwrap() < 1.0 && figures["orientation_bias"].as_f64().is_some());
    assert!(place.path("ring.png").exists());
}

#[test]
fn the_hierarchy_is_asked_for_reported_and_bounded() {
    let place = Workplace::new();
    let base = ["render", "mirror-sphere", "-o", "a.png", "--size", "16x16", "--backend", "cpu"];
    let run = |more: &[&str]| place.run(&[&base[..], more].concat());
    let report = |more: &[&str]| {
        let output = run(&[more, &["--json", "--quiet"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    let by_default = report(&[]);
    assert_eq!((&by_default["mode"], &by_default["leaves"]), (&"hierarchical".into(), &64.into()));
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
        assert_eq!(output.status.code(), Some(code), "{more:?}: {message}");
        assert!(message.contains(remedy), "{more:?}: {message}");
    }
}
