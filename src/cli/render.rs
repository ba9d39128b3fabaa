//! `pinspot render`.

use std::path::{Path, PathBuf};

use clap::Args;

use pinspot::image::{Aov, write_exr, write_png};
use pinspot::render::{Evaluation, Options, Overlay, Rendered, Renderer, Report};

use super::options::CommonOptions;
use super::output::{check_output, extension};
use super::progress::Bar;

#[derive(Debug, Args)]
pub struct RenderArgs {
    /// A scene file (.toml), or the name of a built-in scene (see `pinspot scenes`)
    scene: String,
    /// Files to write: .png (tone-mapped), .exr (linear)
    #[arg(short, long, required = true, num_args = 1.., value_name = "FILE")]
    output: Vec<PathBuf>,
    #[command(flatten)]
    options: CommonOptions,
    /// Print a JSON report on stdout
    #[arg(long)]
    json: bool,
    /// No progress bar and no summary
    #[arg(long)]
    quiet: bool,
}

pub fn run(args: &RenderArgs) -> Result<(), String> {
    // What can be known to fail is checked before the long work.
    args.output.iter().try_for_each(|path| check_output(path, &["png", "exr"]))?;
    let backend = args.options.scene.backend();
    let (scene, options) = args.options.load(&args.scene)?;
    check_uses(args, &options)?;
    let bar = Bar::new(args.quiet);
    let look = options.look;
    let rendered = Renderer::new(scene, options, &backend, &bar).and_then(|r| r.render(&bar));
    bar.finish();
    let rendered = rendered.map_err(|e| e.to_string())?;
    for warning in &rendered.report.warnings {
        eprintln!("pinspot: warning: {warning}");
    }
    for path in &args.output {
        write(path, &rendered, &look)?;
    }
    if args.json {
        super::print_json(&rendered.report)?;
    } else if !args.quiet {
        eprintln!("{}", summary(&rendered.report, &args.output));
    }
    Ok(())
}

/// Refuses what would be asked for in vain.
fn check_uses(args: &RenderArgs, options: &Options) -> Result<(), String> {
    let beauty = options.aovs.contains(&Aov::Beauty);
    let png = args.output.iter().any(|path| extension(path) == "png");
    if options.overlay != Overlay::None && !(beauty && png) {
        return Err("--overlay is drawn into a .png of the beauty; give one with -o, and no other --aov".into());
    }
    for (option, given) in
        [("--plain-diffuse", args.options.plain_diffuse), ("--caustic-gain", args.options.caustic_gain.is_some())]
    {
        if given && !beauty {
            return Err(format!(
                "{option} changes the beauty only, which --aov does not name; add beauty or drop {option}"
            ));
        }
    }
    if options.aovs.len() > 1 && !args.output.iter().any(|path| extension(path) == "exr") {
        return Err("a .png holds one picture, but --aov names several; give an .exr with -o for all of them".into());
    }
    Ok(())
}

fn write(path: &Path, rendered: &Rendered, look: &pinspot::render::Look) -> Result<(), String> {
    let written = if extension(path) == "png" {
        write_png(path, &rendered.shown(look))
    } else {
        let layers: Vec<_> = rendered.layers.iter().map(|(aov, image)| (aov.name(), image)).collect();
        write_exr(path, &layers)
    };
    written.map_err(|e| e.to_string())
}

/// How many, and how they were summed.
fn samples(report: &Report) -> String {
    match report.evaluation {
        Evaluation::Flat { leaves: 1 } => format!("{} samples", report.samples),
        Evaluation::Flat { leaves } => format!("{} samples of {leaves} leaves, one by one", report.samples),
        Evaluation::Hierarchical { leaves, .. } => format!("{} samples of {leaves} leaves", report.samples),
    }
}

fn summary(report: &Report, outputs: &[PathBuf]) -> String {
    let on = &report.backend;
    let files: Vec<String> = outputs.iter().map(|p| p.display().to_string()).collect();
    let seconds = &report.seconds;
    let preparing = seconds.environment
        + seconds.sampling
        + seconds.differentials
        + seconds.tree
        + seconds.visibility
        + seconds.backend;
    format!(
        "{}: {}x{} pixels, {}, on {on}: {:.1} s (preparing {preparing:.1} s, gather {:.1} s, {:.0} look-ups a pixel)",
        files.join(", "),
        report.size[0],
        report.size[1],
        samples(report),
        preparing + seconds.render,
        seconds.gather,
        report.lookups,
    )
}
