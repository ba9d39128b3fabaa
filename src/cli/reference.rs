//! `pinspot reference`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use pinspot::image::Aov;
use pinspot::reference::{
    EstimateFile, Estimator, Ledger, Options, Quantity, Reference, ReferenceError, Statistics, StoppingCriterion,
    Stored,
};
use pinspot::scene::{Chain, Chains, Loaded, Scene, Visibility, load};
use pinspot::{Error, Settings};

use super::console::{Console, Failure};
use super::errors::message;
use super::options::{EnvironmentOptions, parse_positive, parse_size, parse_switch, word};
use super::output::check_output;
use super::progress::Watch;

#[derive(Debug, Args)]
pub struct ReferenceArgs {
    /// A scene file (.toml), or the name of a built-in scene
    scene: String,
    /// The image to write (.exr): R G B and their standard errors, error.R error.G error.B
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Relative standard error to stop at: √Σse² / √ΣE² over the image
    #[arg(long, value_name = "FRACTION", default_value_t = 0.005, value_parser = parse_positive)]
    rel_error: f64,
    /// Stop after this many seconds, even if the error is larger; run the same command again to continue
    #[arg(long, value_name = "S", value_parser = parse_positive)]
    seconds: Option<f64>,
    /// Picture to compute: caustic, direct, scattered or scattered.direct
    #[arg(long, value_parser = word::<Aov>, value_name = "NAME", default_value = "caustic")]
    aov: Aov,
    /// Occlusion: full (by all objects, before and after the mirror or interface), or none [default: the scene's, else full]
    #[arg(long, value_parser = word::<Visibility>, value_name = "none|full")]
    visibility: Option<Visibility>,
    /// Caustics to add up: R (one reflection), T (one refraction), TT (two refractions, through a closed object), TTTT (through
    /// two of them) [default: all]
    #[arg(long, value_parser = word::<Chain>, value_delimiter = ',', value_name = "CHAINS")]
    chains: Option<Vec<Chain>>,
    /// How a caustic is computed: points (an integral over the mirrors, for each point of a pixel), beams (the light of spots and lamps without
    /// noise, as means over whole pixels, and other light by points), or auto (beams for lights that are too small for points) [default: auto]
    #[arg(long, value_parser = word::<Estimator>, value_name = "NAME")]
    estimator: Option<Estimator>,
    /// Image size in pixels [default: the scene's, else 512x512]
    #[arg(long, value_parser = parse_size, value_name = "WxH")]
    size: Option<[u32; 2]>,
    /// Attenuation by the squared distance, 1/l²: on or off [default: on]
    #[arg(long, value_parser = parse_switch, value_name = "on|off")]
    attenuation: Option<bool>,
    /// Average NxN points per pixel [default: 1]
    #[arg(long, value_name = "N")]
    pixel_samples: Option<u32>,
    /// Independent randomisations, from which the standard error comes, or for beams the directions in extended lights [default: 16]
    #[arg(long, value_name = "N")]
    replicates: Option<u32>,
    /// Random seed [default: 1]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    #[command(flatten)]
    environment: EnvironmentOptions,
    /// Start from scratch, replacing whatever the file contains
    #[arg(long)]
    force: bool,
    /// Print a JSON report on stdout
    #[arg(long)]
    json: bool,
    /// No progress bar and no summary
    #[arg(long)]
    quiet: bool,
}

#[derive(Serialize)]
struct Report<'a> {
    scene: &'a str,
    #[serde(flatten)]
    options: &'a Options,
    rel_error: f64,
    #[serde(flatten)]
    statistics: Statistics,
    /// The account of the flux; null of what none is kept of.
    ledger: Option<&'a Ledger>,
    seconds: f64,
    warnings: Vec<String>,
}

pub fn run(args: &ReferenceArgs, console: &Console) -> Result<(), Failure> {
    check_output(&args.output, &["exr"])?;
    let Loaded { mut scene, render, .. } = load::<Settings>(&args.scene).map_err(|e| message(&e.into()))?;
    args.environment.apply(&mut scene)?;
    let options = options(args, &render)?;
    let name = scene.name.clone();
    let watch = console.watch(args.quiet);
    let solved = solve(args, scene, &options, &watch);
    watch.finish();
    let (stored, mut warnings) = solved.map_err(|e| with_remedy(args, &e))?;
    let rel_error = stored.estimate.rel_error();
    if rel_error > args.rel_error && options.estimator == Estimator::Beams {
        warnings.push(format!(
            "the standard error is {rel_error:.4}, not {}, and more time does not lower it; give more --replicates, or --estimator points",
            args.rel_error
        ));
    } else if rel_error > args.rel_error {
        warnings.push(format!(
            "the time is up at a relative standard error of {rel_error:.4}, not {}; the same command goes on from here",
            args.rel_error
        ));
    }
    for warning in &warnings {
        console.warn(warning);
    }
    if args.json {
        let Stored { estimate, seconds } = stored;
        let (statistics, ledger) = (estimate.statistics, estimate.ledger.as_ref());
        console.print_json(&Report {
            scene: &name,
            options: &options,
            rel_error,
            statistics,
            ledger,
            seconds,
            warnings,
        })?;
    } else if !args.quiet {
        console.say(&summary(args, &stored));
    }
    Ok(())
}

fn options(args: &ReferenceArgs, render: &Settings) -> Result<Options, String> {
    let defaults = Options::default();
    let quantity = match args.aov {
        Aov::Caustic => Quantity::Caustic,
        Aov::Direct => Quantity::Direct,
        Aov::Scattered => Quantity::Scattered,
        Aov::ScatteredDirect => Quantity::ScatteredDirect,
        other => {
            return Err(format!(
                "aov is {}, but the reference computes caustic, direct, scattered or scattered.direct; give one of them",
                other.name()
            ));
        }
    };
    Ok(Options {
        size: args.size.or(render.size).unwrap_or(defaults.size),
        pixel_samples: args.pixel_samples.or(render.pixel_samples).unwrap_or(defaults.pixel_samples),
        quantity,
        chains: args.chains.as_ref().map_or(Chains::ALL, |chains| chains.iter().copied().collect()),
        estimator: args.estimator.unwrap_or_default(),
        visibility: args.visibility.or(render.visibility).unwrap_or_default(),
        attenuation: args.attenuation.or(render.attenuation).unwrap_or(true),
        replicates: args.replicates.unwrap_or(defaults.replicates),
        seed: args.seed.or(render.seed).unwrap_or(defaults.seed),
        ..defaults
    })
}

/// The estimate, with notes on what was repaired while loading.
fn solve(args: &ReferenceArgs, scene: Scene, options: &Options, watch: &Watch) -> Result<(Stored, Vec<String>), Error> {
    let clock = || watch.elapsed();
    let seconds_left = || args.seconds.map_or(f64::INFINITY, |most| most - clock());
    let criterion = StoppingCriterion::new(args.rel_error).with_seconds_left(&seconds_left);
    let reference = Reference::new(scene, options.clone())?;
    let file = EstimateFile { path: &args.output, code: pinspot::code_id() };
    let known = if args.force { None } else { reference.read(&file)? };
    let stored = reference.solve_in_file(&file, known, &criterion, &clock, watch)?;
    stored.estimate.check()?;
    Ok((stored, reference.notes))
}

fn with_remedy(args: &ReferenceArgs, error: &Error) -> String {
    match error {
        Error::Reference(ReferenceError::Foreign { .. } | ReferenceError::OtherCode { .. }) => {
            format!("{error}; give -o another name, or --force to replace it")
        }
        Error::Reference(ReferenceError::Unbalanced { .. }) => format!("{error}; {}", remedy(args)),
        Error::Reference(ReferenceError::Incomplete { .. }) => {
            format!("{error}; the file keeps them, and the same command goes on from there: give it more --seconds")
        }
        _ => message(error),
    }
}

/// What may help where light is missing.
fn remedy(args: &ReferenceArgs) -> &'static str {
    match args.estimator {
        Some(Estimator::Points) => "points may not find small lights: give --estimator beams or auto",
        _ => "give more --pixel-samples or --replicates, and --force to begin again",
    }
}

fn summary(args: &ReferenceArgs, Stored { estimate, seconds }: &Stored) -> String {
    let Statistics { passes, points_per_pixel, .. } = estimate.statistics;
    let work = match points_per_pixel {
        0.0 => "by beams".into(),
        _ => format!("{points_per_pixel:.0} points a pixel in {passes} passes"),
    };
    let ledger = estimate.ledger.as_ref().map(balance).unwrap_or_default();
    let (file, rel_error) = (args.output.display(), estimate.rel_error());
    format!("{file}: relative standard error {rel_error:.4}, {work}, {seconds:.1} s in all{ledger}")
}

fn balance(ledger: &Ledger) -> String {
    let Ledger { cast_w, arriving_w, counted, counted_error, estimated, .. } = *ledger;
    if !ledger.is_known() {
        return format!(
            "\nflux: {} counted rays arrive in the picture, too few or too uneven to account for it",
            ledger.rays
        );
    }
    let part = |value: f64, of: f64| if of > 0.0 { format!("{:.2} %", 100.0 * value / of) } else { "none".into() };
    format!(
        "\nflux: {cast_w:.4} W fall on mirrors and glass, {arriving_w:.4} W arrive in the picture (counted forwards, ± {}), which holds {} of them",
        part(counted_error, counted),
        part(estimated, counted)
    )
}
