//! `pinspot reference`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use pinspot::image::Aov;
use pinspot::reference::{Account, Estimate, Goal, Options, Quantity, Reference};
use pinspot::render::Settings;
use pinspot::scene::{Loaded, Visibility, load};

use super::options::{override_light, parse_size, parse_switch, word};
use super::progress::Bar;
use super::render::check_output;

#[derive(Debug, Args)]
pub struct ReferenceArgs {
    /// A scene file (.toml), or the name of a built-in scene
    scene: String,
    /// The image to write (.exr): R G B and their standard errors, error.R error.G error.B
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Stop when √Σse² / √ΣE² over the image is this small
    #[arg(long, value_name = "FRACTION", default_value_t = 0.005)]
    rel_error: f64,
    /// Stop after this many seconds, whatever is reached; the same command again goes on
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// What to compute: caustic or direct
    #[arg(long, value_parser = word::<Aov>, value_name = "NAME", default_value = "caustic")]
    aov: Aov,
    /// Occlusion: none, or full (of both legs) [default: the scene's, else full]
    #[arg(long, value_parser = word::<Visibility>, value_name = "none|full")]
    visibility: Option<Visibility>,
    /// Image size in pixels [default: the scene's, else 512x512]
    #[arg(long, value_parser = parse_size, value_name = "WxH")]
    size: Option<[u32; 2]>,
    /// on, or off to drop the 1/l² [default: on]
    #[arg(long, value_parser = parse_switch, value_name = "on|off")]
    attenuation: Option<bool>,
    /// Average NxN points per pixel [default: 1]
    #[arg(long, value_name = "N")]
    pixel_samples: Option<u32>,
    /// Random seed [default: 1]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Environment map instead of the scene's light: a file (.exr, .hdr) or a built-in map's name
    #[arg(long, value_name = "FILE")]
    env: Option<String>,
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
    account: Account,
    warnings: Vec<String>,
}

pub fn run(args: &ReferenceArgs) -> Result<(), String> {
    check_output(&args.output, &["exr"])?;
    let Loaded { mut scene, render, .. } = load::<Settings>(&args.scene).map_err(|e| e.to_string())?;
    override_light(&mut scene, args.env.as_deref())?;
    let options = options(args, &render)?;
    let name = scene.name.clone();
    let goal = Goal { rel_error: args.rel_error, seconds: args.seconds, points: None };
    let bar = Bar::new(args.quiet);
    let solved = solve(args, Reference::new(scene, options.clone()), &goal, &bar);
    bar.finish();
    let (estimate, mut warnings) = solved.map_err(|e| e.to_string())?;
    if estimate.rel_error() > goal.rel_error {
        warnings.push(format!(
            "the time is up at a relative standard error of {:.4}, not {}; the same command goes on from here",
            estimate.rel_error(),
            goal.rel_error
        ));
    }
    for warning in &warnings {
        eprintln!("pinspot: warning: {warning}");
    }
    if args.json {
        let rel_error = estimate.rel_error();
        super::print_json(&Report { scene: &name, options: &options, rel_error, account: estimate.account, warnings })?;
    } else if !args.quiet {
        eprintln!("{}", summary(args, &estimate));
    }
    Ok(())
}

fn options(args: &ReferenceArgs, render: &Settings) -> Result<Options, String> {
    let defaults = Options::default();
    let quantity = match args.aov {
        Aov::Caustic => Quantity::Caustic,
        Aov::Direct => Quantity::Direct,
        other => {
            return Err(format!(
                "aov is {}, but the reference computes caustic or direct; give one of them",
                other.name()
            ));
        }
    };
    Ok(Options {
        size: args.size.or(render.size).unwrap_or(defaults.size),
        pixel_samples: args.pixel_samples.or(render.pixel_samples).unwrap_or(defaults.pixel_samples),
        quantity,
        visibility: args.visibility.or(render.visibility).unwrap_or_default(),
        attenuation: args.attenuation.or(render.attenuation).unwrap_or(true),
        seed: args.seed.or(render.seed).unwrap_or(defaults.seed),
        ..defaults
    })
}

fn solve(
    args: &ReferenceArgs,
    reference: Result<Reference, pinspot::Error>,
    goal: &Goal,
    bar: &Bar,
) -> Result<(Estimate, Vec<String>), pinspot::Error> {
    let reference = reference?;
    let known = reference.read(&args.output)?;
    let estimate = reference.solve(goal, known, bar, &mut |estimate| reference.write(&args.output, estimate))?;
    Ok((estimate, reference.notes))
}

fn summary(args: &ReferenceArgs, estimate: &Estimate) -> String {
    let Account { passes, points_per_pixel, seconds, .. } = estimate.account;
    format!(
        "{}: relative standard error {:.4}, {points_per_pixel:.0} points a pixel in {passes} passes, {seconds:.1} s in all",
        args.output.display(),
        estimate.rel_error()
    )
}
