//! The table of flat sums in docs/accuracy.md: unfiltered samples, the paper's recipe and Pinspot's default against the ground
//! truth.
//!
//! ```sh
//! cargo run --release --example accuracy
//! ```
//!
//! prints it as Markdown. `-- SECONDS` limits the time for each reference (default: 3600). Everything is kept in
//! `target/accuracy`, where each scene also gets its report; an interrupted run goes on where it stopped. About an
//! hour on two cores.

use std::path::Path;
use std::time::Instant;

use pinspot::blocking::wait;
use pinspot::image::Aov;
use pinspot::reference::{Estimator, StoppingCriterion};
use pinspot::report::{Comparison, Plan, Request, Row, compare};
use pinspot::scene::Visibility;
use pinspot::{Backend, Error, Filter, FilterChoice, Footprint, NoProgress};

const SCENES: [&str; 5] = ["ring", "ring-natural", "spoon", "mirror-sphere", "cup"];
const SAMPLES: [u32; 3] = [100, 1000, 10_000];
const SIZE: [u32; 2] = [256, 256];
/// Relative standard error of the references, and the seconds after which a worse one must do.
const REL_ERROR: f64 = 0.005;
const DEFAULT_SECONDS: f64 = 3600.0;

fn main() -> Result<(), Error> {
    let seconds = match std::env::args().nth(1).map(|s| s.parse()) {
        None => DEFAULT_SECONDS,
        Some(seconds) => seconds.expect("the argument is a number of seconds"),
    };
    println!("| scene (± reference) | | 100 | 1,000 | 10,000 |\n|---|---|---|---|---|");
    for scene in SCENES {
        let comparison = compare_scene(scene, seconds)?;
        comparison.write(&Path::new("target/accuracy").join(scene))?;
        print_rows(scene, &comparison);
    }
    Ok(())
}

fn compare_scene(name: &str, seconds: f64) -> Result<Comparison, Error> {
    let (scene, mut options) = pinspot::load(name)?;
    options.size = SIZE;
    options.aovs = vec![Aov::Caustic];
    // The paper's integral, for its recipe's sake.
    options.visibility = Visibility::None;
    let plan = Plan {
        footprints: vec![Footprint::Curvature, Footprint::Cells],
        filters: vec![FilterChoice::None, FilterChoice::Anisotropic],
        samples: SAMPLES.to_vec(),
        ..Plan::default()
    };
    let request = Request {
        scene,
        options,
        backend: Backend::cpu(),
        plan,
        estimator: Estimator::Auto,
        mask: None,
        folder: Path::new("target/accuracy").join(name),
        code: pinspot::code_id().into(),
        force: false,
        command: "cargo run --release --example accuracy".into(),
    };
    let started = Instant::now();
    let clock = || started.elapsed().as_secs_f64();
    let seconds_left = || seconds - clock();
    let criterion = StoppingCriterion::new(REL_ERROR).with_seconds_left(&seconds_left);
    wait(None, compare(&request, &criterion, &clock, &NoProgress))
}

fn print_rows(scene: &str, comparison: &Comparison) {
    let se = comparison.reference.rel_error;
    for (k, (label, footprint, filter)) in [
        ("unfiltered", Footprint::Curvature, Filter::None),
        ("the paper's recipe", Footprint::Curvature, Filter::Anisotropic),
        ("**Pinspot**", Footprint::Cells, Filter::Anisotropic),
    ]
    .into_iter()
    .enumerate()
    {
        let cells = SAMPLES.map(|n| {
            let chosen = |r: &&Row| (r.samples, r.footprint, r.filter) == (Some(n), Some(footprint), Some(filter));
            let rows: Vec<&Row> = comparison.rows.iter().filter(chosen).collect();
            let mut errors: Vec<f64> = rows.iter().filter_map(|r| r.rel_l2).collect();
            errors.sort_by(f64::total_cmp);
            let lookups = rows.iter().map(|r| r.lookups).sum::<f64>() / rows.len() as f64;
            format!("{:.3} ({lookups:.0})", errors[errors.len() / 2])
        });
        let name = if k == 0 { format!("`{scene}` (±{se:.3})") } else { String::new() };
        println!("| {name} | {label} | {} |", cells.join(" | "));
    }
}
