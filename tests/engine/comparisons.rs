//! Comparisons that are made again.

use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

use pinspot::reference::{Estimator, StoppingCriterion};
use pinspot::report::{Plan, Request, compare};
use pinspot::{Backend, NoProgress, Technique, blocking};

/// Compares photons, which are quick. Returns the seconds that the picture took, by a clock of such ticks, and the references that lie
/// in the folder.
fn seconds_of_picture(folder: &Path, code: &str, force: bool, tick: f64) -> (f64, usize) {
    let (scene, options) = pinspot::load("mirror-sphere").unwrap();
    let request = Request {
        scene,
        options: options.with_size([8, 8]),
        backend: Backend::cpu(),
        plan: Plan { techniques: vec![Technique::ImageSpace], photons: vec![16], seeds: 1, ..Plan::default() },
        estimator: Estimator::Auto,
        mask: None,
        folder: folder.into(),
        code: code.into(),
        force,
        command: "a test".into(),
    };
    let ticks = AtomicU32::new(0);
    let clock = || tick * f64::from(ticks.fetch_add(1, Ordering::Relaxed));
    let criterion = StoppingCriterion::new(0.5);
    let rows = blocking::wait(None, compare(&request, &criterion, &clock, &NoProgress)).unwrap().rows;
    let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
    let references = names.filter(|name| name.to_string_lossy().starts_with("reference-")).count();
    (rows[0].seconds, references)
}

#[test]
fn pictures_of_other_code_are_rendered_again() {
    let folder = tempfile::tempdir().unwrap();
    let compared = |code, force, tick| seconds_of_picture(folder.path(), code, force, tick);
    let (first, references) = compared("this code", false, 1.0);
    assert!(first > 0.0 && references == 1);
    assert_eq!(compared("this code", false, 1000.0), (first, 1), "what is there is used again");
    let (forced, references) = compared("this code", true, 1000.0);
    assert!(forced >= 1000.0 && references == 1, "{forced}: rendered all the same, beside the same reference");
    let (other, references) = compared("other code", false, 1e6);
    assert!(other >= 1e6 && references == 2, "{other}: other code, other pictures, and a reference of its own");
}
