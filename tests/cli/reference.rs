//! References: their errors, their time, and files that they go on from.

use crate::workplace::{Workplace, assert_all_named, exr};

#[test]
fn every_option_of_reference_changes_what_it_writes() {
    let place = Workplace::new();
    place.replace("constant = [1.0, 1.0, 1.0]", "map = \"studio\"");
    let written = |more: &[&str]| {
        let rel_error = if more.contains(&"--rel-error") { &[][..] } else { &["--rel-error", "0.1"] };
        let output = place.run(&[&["reference", "scene.toml", "-o", "a.exr"][..], rel_error, more].concat());
        let image = pinspot::image::read_exr(&place.path("a.exr"), "").ok();
        let _ = std::fs::remove_file(place.path("a.exr"));
        (output.code, image, output.stdout.is_empty(), output.stderr.is_empty())
    };
    let plain = written(&[]);
    assert_eq!(plain.0, 0);
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
    assert!(place.run(&["reference", "scene.toml", "--output", "b.exr", "--rel-error", "0.5"]).succeeded());
    // Nothing hides anything in that scene.
    let of_cup = |visibility: &str| {
        let args =
            ["reference", "cup", "-o", "cup.exr", "--size", "12x12", "--rel-error", "0.2", "--visibility", visibility];
        assert!(place.run(&[&args[..], &["--force", "--quiet"]].concat()).succeeded());
        pinspot::image::read_exr(&place.path("cup.exr"), "").unwrap().mean()
    };
    assert!(of_cup("none").x > 1.1 * of_cup("full").x);
    // Nothing refracts in that scene.
    let of_pool = |chains: &str| {
        let args = ["reference", "pool", "-o", "pool.exr", "--size", "12x12", "--rel-error", "0.5", "--chains", chains];
        assert!(place.run(&[&args[..], &["--force", "--quiet"]].concat()).succeeded());
        pinspot::image::read_exr(&place.path("pool.exr"), "").unwrap().mean()
    };
    assert_ne!(of_pool("R"), of_pool("R,T"));
    let reflecting = Workplace::new();
    reflecting.refuses(&["reference", "scene.toml", "-o", "a.exr", "--chains", "T"], &["chains is T", "refractor"]);
    let of_ring = |estimator: &str| {
        let args =
            ["reference", "ring", "-o", "ring.exr", "--size", "12x12", "--rel-error", "0.2", "--estimator", estimator];
        assert!(place.run(&[&args[..], &["--force", "--quiet"]].concat()).succeeded());
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
        assert!(output.succeeded(), "{}", String::from_utf8_lossy(&output.stderr));
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
        (output.code, String::from_utf8(output.stderr).unwrap())
    };
    let (code, message) = run("4", "16x16");
    assert_eq!(code, 0, "{message}");
    assert!(message.contains("time is up"), "{message}");
    assert!(pinspot::image::read_exr(&place.path("cup.exr"), "error").unwrap().mean().is_finite());
    let (code, message) = run("1", "2000x2000");
    assert_eq!(code, 1, "{message}");
    assert!(message.contains("% of the pixels") && message.contains("--seconds"), "{message}");
}

#[test]
fn a_reference_replaces_nothing_that_it_cannot_go_on_from() {
    let place = Workplace::new();
    let reference = |more: &[&str]| {
        let base = ["reference", "scene.toml", "-o", "truth.exr", "--rel-error", "0.3", "--quiet"];
        let output = place.run(&[&base[..], more].concat());
        (output.code, String::from_utf8(output.stderr).unwrap())
    };
    let refused = |more: &[&str], parts: &[&str]| {
        let before = std::fs::read(place.path("truth.exr")).unwrap();
        let (code, message) = reference(more);
        assert_eq!(code, 1, "{message}");
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
        assert_eq!(std::fs::read(place.path("truth.exr")).unwrap(), before);
    };
    assert_eq!(reference(&[]).0, 0);
    refused(&["--seed", "2"], &["truth.exr", "no earlier state of this reference", "--force"]);
    place.replace("constant = [1.0, 1.0, 1.0]", "constant = [2.0, 1.0, 1.0]");
    refused(&[], &["truth.exr", "its scene, light", "--force"]);
    assert_eq!(reference(&["--force"]).0, 0);
    assert_eq!(reference(&[]).0, 0, "now it is this scene's");
    exr(&place.path("truth.exr"), 24, 16, 1.0);
    refused(&[], &["truth.exr", "--force"]);
    place.write("truth.exr", "not an image");
    refused(&[], &["truth.exr", "damaged", "delete it"]);
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
