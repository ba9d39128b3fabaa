//! `pinspot compare`.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::Args;

use pinspot::blocking::wait;
use pinspot::reference::{Estimator, StoppingCriterion};
use pinspot::report::{Comparison, Figure, Plan, ReportError, Request, compare};
use pinspot::{
    Density, Error, EvaluationChoice, Filter, FilterChoice, Footprint, Mode, Options, Quality, Settings, Strategy,
    Technique,
};

use super::console::{Console, Failure};
use super::errors::message;
use super::options::{SceneOptions, parse_count, parse_positive, word};
use super::output::check_writable;
use super::render::open;

#[derive(Debug, Args)]
pub struct CompareArgs {
    /// A scene file (.toml), or the name of a built-in scene
    scene: String,
    /// The folder for report.html, report.json, report.csv and the pictures; finished results in it are reused, if this very code made them
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Techniques, separated by commas: pinhole, image-space [default: the scene's, else pinhole]
    #[arg(long, value_parser = word::<Technique>, value_delimiter = ',', value_name = "NAMES")]
    techniques: Vec<Technique>,
    /// Modes of image-space techniques, separated by commas [default: the scene's, else auto]
    #[arg(long, value_parser = word::<Mode>, value_delimiter = ',', value_name = "NAMES")]
    modes: Vec<Mode>,
    /// Photons along each edge of a light's view, separated by commas [default: the scene's, else 512]
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    photons: Vec<u32>,
    /// Directional lights that an environment map is divided into, separated by commas [default: the scene's, else 24]
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    lights: Vec<u32>,
    /// Strategies, separated by commas [default: the scene's, else neighbourhood]
    #[arg(long, value_parser = word::<Strategy>, value_delimiter = ',', value_name = "NAMES")]
    strategies: Vec<Strategy>,
    /// Densities of samples, separated by commas [default: the scene's, else uniform]
    #[arg(long, value_parser = word::<Density>, value_delimiter = ',', value_name = "NAMES")]
    densities: Vec<Density>,
    /// Footprints, separated by commas [default: the scene's, else cells]
    #[arg(long, value_parser = word::<Footprint>, value_delimiter = ',', value_name = "NAMES")]
    footprints: Vec<Footprint>,
    /// Filters, separated by commas [default: none,auto]
    #[arg(long, value_parser = word::<FilterChoice>, value_delimiter = ',', value_name = "NAMES")]
    filters: Vec<FilterChoice>,
    /// How samples are summed, separated by commas: flat, hierarchical (with the anisotropic filter), auto (hierarchical where that is
    /// possible, as pictures are) [default: auto]
    #[arg(long, value_parser = word::<EvaluationChoice>, value_delimiter = ',', value_name = "NAMES")]
    evaluations: Vec<EvaluationChoice>,
    /// Sample counts, separated by commas [default: 100,1000,10000]
    #[arg(long, value_parser = parse_count, value_delimiter = ',', value_name = "LIST")]
    samples: Vec<u32>,
    /// Number of consecutive seeds
    #[arg(long, value_name = "K", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    seeds: u32,
    /// The first seed [default: 1]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Reproduce a figure of Wand and Straßer (2003): 4 (sample counts, with and without filter) or 5 (strategies)
    #[arg(long, value_name = "4|5", value_parser = figure, conflicts_with_all = ["techniques", "strategies", "densities", "footprints", "filters", "evaluations", "samples"])]
    figure: Option<Figure>,
    /// Measure errors only where this picture (.png, .exr) is not black
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// How the reference is computed: points (for each point of a pixel), beams (the light of spots and lamps as means over whole pixels; give
    /// --pixel-samples, too), or auto (beams for lights that are too small for points) [default: auto]
    #[arg(long, value_parser = word::<Estimator>, value_name = "NAME")]
    estimator: Option<Estimator>,
    /// Relative standard error that the reference must reach: √Σse² / √ΣE²
    #[arg(long, value_name = "FRACTION", default_value_t = 0.005, value_parser = parse_positive)]
    rel_error: f64,
    /// Render all combinations again, those whose finished results lie in the folder, too; the reference goes on from its file
    #[arg(long)]
    force: bool,
    /// Time limit of the reference in seconds; the report states the error that it reached [default: no limit]
    #[arg(long, value_name = "S", value_parser = parse_positive)]
    seconds: Option<f64>,
    #[command(flatten)]
    options: SceneOptions,
    /// Also print report.json on stdout
    #[arg(long)]
    json: bool,
    /// No progress bar and no summary
    #[arg(long)]
    quiet: bool,
}

fn figure(text: &str) -> Result<Figure, String> {
    match text {
        "4" => Ok(Figure::Samples),
        "5" => Ok(Figure::Strategies),
        _ => Err("give 4 or 5".into()),
    }
}

pub fn run(args: &CompareArgs, words: &[OsString], console: &Console) -> Result<(), Failure> {
    if args.output.is_dir() {
        let reports = ["report.html", "report.json", "report.csv"];
        reports.iter().try_for_each(|name| check_writable(&args.output.join(name)))?;
    }
    let over = Settings { seed: args.seed, ..args.options.settings() };
    let (scene, mut options) = args.options.load(&args.scene, Quality::default(), over)?;
    let plan = plan(args, &mut options);
    let watch = console.watch(args.quiet);
    let request = Request {
        scene,
        options,
        backend: open(&args.options.backend()?, &watch).map_err(|e| message(&e))?,
        plan,
        estimator: args.estimator.unwrap_or_default(),
        mask: args.mask.clone(),
        folder: args.output.clone(),
        code: pinspot::code_id().into(),
        force: args.force,
        command: in_one_line(words),
    };
    let clock = || watch.elapsed();
    let seconds_left = || args.seconds.map_or(f64::INFINITY, |most| most - clock());
    let criterion = StoppingCriterion::new(args.rel_error).with_seconds_left(&seconds_left);
    let compared = wait(request.backend.device(), compare(&request, &criterion, &clock, &watch));
    watch.finish();
    let comparison = compared.map_err(|error| match error {
        // A list of options that exclude each other is a wrong command line.
        Error::Report(ReportError::NoCombination { .. }) => {
            Failure::command_line(clap::error::ErrorKind::ArgumentConflict, &message(&error))
        }
        error => message(&error).into(),
    })?;
    comparison.write(&args.output).map_err(|e| message(&e))?;
    comparison.warnings.iter().for_each(|warning| console.warn(warning));
    if comparison.reference.rel_error > args.rel_error && request.estimator != Estimator::Beams {
        console.warn(&format!(
            "the reference's time was up at a relative standard error of {:.4}; the same command goes on from here",
            comparison.reference.rel_error
        ));
    }
    if args.json {
        console.print_json(&comparison)
    } else if args.quiet {
        Ok(())
    } else {
        console.print(&summary(args, &comparison))
    }
}

/// The command line as given; bytes that are not Unicode become �.
fn in_one_line(words: &[OsString]) -> String {
    words.iter().map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
}

fn plan(args: &CompareArgs, options: &mut Options) -> Plan {
    if let Some(figure) = args.figure {
        return Plan::of_figure(figure, options, args.seeds);
    }
    fn or<T: Clone>(given: &[T], default: &[T]) -> Vec<T> {
        if given.is_empty() { default.to_vec() } else { given.to_vec() }
    }
    let filters = or(&args.filters, &[FilterChoice::None, FilterChoice::Auto]);
    let image_space = options.image_space;
    Plan {
        techniques: or(&args.techniques, &[options.technique]),
        modes: or(&args.modes, &[image_space.mode]),
        photons: or(&args.photons, &[image_space.photons]),
        lights: or(&args.lights, &[image_space.lights]),
        strategies: or(&args.strategies, &[options.strategy]),
        densities: or(&args.densities, &[options.density]),
        footprints: or(&args.footprints, &[options.footprint]),
        filters,
        evaluations: or(&args.evaluations, &[EvaluationChoice::Auto]),
        samples: or(&args.samples, &[100, 1000, 10_000]),
        seeds: args.seeds,
        figure: None,
    }
}

/// The mean errors over the seeds, and where the report is.
fn summary(args: &CompareArgs, comparison: &Comparison) -> String {
    let mut lines = vec![format!(
        "{:12} {:15} {:12} {:10} {:12} {:16} {:>8} {:>8} {:>8} {:>8} {:>7} {:>9}",
        "technique",
        "strategy",
        "density",
        "footprint",
        "filter",
        "mode",
        "samples",
        "seconds",
        "rel_l2",
        "mrse",
        "flip",
        "lookups"
    )];
    for rows in comparison.rows.chunks(args.seeds as usize) {
        let mean = |f: fn(&pinspot::report::Row) -> f64| rows.iter().map(f).sum::<f64>() / rows.len() as f64;
        let row = &rows[0];
        // A relative error is undefined where the reference is black.
        let defined: Vec<f64> = rows.iter().filter_map(|r| r.rel_l2).collect();
        let rel_l2 = if defined.len() == rows.len() {
            format!("{:.4}", defined.iter().sum::<f64>() / defined.len() as f64)
        } else {
            "-".to_owned()
        };
        let or_dash = |word: Option<&'static str>| word.unwrap_or("-");
        let amount = row.samples.map(u64::from).or(row.photons_used).unwrap_or(0);
        lines.push(format!(
            "{:12} {:15} {:12} {:10} {:12} {:16} {amount:>8} {:>8.2} {rel_l2:>8} {:>8.3} {:>7.4} {:>9.0}",
            row.technique.name(),
            or_dash(row.strategy.map(Strategy::name)),
            or_dash(row.density.map(Density::name)),
            or_dash(row.footprint.map(Footprint::name)),
            or_dash(row.filter.map(Filter::name)),
            row.mode,
            mean(|r| r.seconds),
            mean(|r| r.mrse),
            mean(|r| r.flip),
            mean(|r| r.lookups)
        ));
    }
    for technique in &comparison.unavailable {
        lines.push(format!("{:12} n/a: {}", technique.technique.name(), technique.reason));
    }
    for finding in &comparison.findings {
        lines.push(format!(
            "{}: {} ({})",
            if finding.holds { "holds" } else { "does not hold" },
            finding.text,
            finding.figures
        ));
    }
    lines.push(format!("report: {}", args.output.join("report.html").display()));
    lines.join("\n")
}
