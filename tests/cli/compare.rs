//! Comparisons.

use std::collections::BTreeSet;

use crate::workplace::{Workplace, assert_all_named, first_adapter};

#[test]
#[ignore = "full: a comparison for each option"]
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
        assert!(output.succeeded(), "{}", String::from_utf8_lossy(&output.stderr));
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
    assert!(quiet.succeeded() && quiet.stdout.is_empty() && quiet.stderr.is_empty());
    let paper = ["compare", "scene.toml", "-o", "paper", "--figure", "5", "--seeds", "1", "--rel-error", "0.5"];
    let paper = report(&[&paper[..], &["--size", "6x4", "--backend", "cpu", "--json"]].concat());
    assert!(!paper["findings"].as_array().unwrap().is_empty() && paper["rows"][0]["samples"] == 2000);
    let cell = place.path("gpu/cells/neighbourhood-cells-none-auto-10-seed1.exr");
    let written = || std::fs::metadata(&cell).unwrap().modified().unwrap();
    let before = written();
    let again = |more: &[&str]| {
        let output = place.run(&[&quick[..], &["--rel-error", "0.5", "--backend", "cpu", "--quiet"], more].concat());
        assert!(output.succeeded());
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
        assert!(output.succeeded(), "{}", String::from_utf8_lossy(&output.stderr));
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
    assert!(output.succeeded(), "{}", String::from_utf8_lossy(&output.stderr));
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
