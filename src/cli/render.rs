//! `pinspot render`.

use std::ops::Range;
use std::path::{Path, PathBuf};

use clap::Args;

use pinspot::blocking::wait;
use pinspot::image::{Aov, parse_frames, write_exr, write_png};
use pinspot::scene::Scene;
use pinspot::{
    Backend, BackendChoice, DisplaySettings, Engine, Error, Evaluation, Exposure, FilterChoice, Options, Overlay,
    Rendered, Report, Sequence, SequenceReport, Stage,
};
use serde::Serialize;

use super::console::{Console, Failure};
use super::errors::message;
use super::options::{CommonOptions, parse_positive};
use super::output::{check_extension, check_output, check_writable, extension};
use super::progress::{Seconds, Watch};

/// How many times as long a finer picture is expected to take as the one before it.
const STEP_GROWTH: f64 = 4.0;
/// Frames per second of an animation.
const FRAMES_PER_SECOND: u16 = 24;

#[derive(Debug, Args)]
pub struct RenderArgs {
    /// A scene file (.toml), the name of a built-in scene (see `pinspot scenes`), or a model (.obj), which is put on a table
    scene: String,
    /// Files to write: .png (tone-mapped), .exr (linear); with --frames, numbered ones such as frame-####.png, or one .apng [default: the scene's name, .png]
    #[arg(short, long, required = false, num_args = 1.., value_name = "FILE")]
    output: Vec<PathBuf>,
    /// Render the frames A to B-1 of the scene's animation; frames that are complete in their files are not rendered again
    #[arg(long, value_parser = parse_frames, value_name = "A..B", conflicts_with = "seconds")]
    frames: Option<Range<u32>>,
    /// Frames per second of the animation [default: 24]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1000), value_name = "N", requires = "frames")]
    fps: Option<u16>,
    #[command(flatten)]
    options: CommonOptions,
    /// Render for about this many seconds: a coarse picture first, then finer ones in its place for as long as there is time
    #[arg(long, value_parser = parse_positive, value_name = "S", conflicts_with_all = ["quality", "leaves", "tolerance", "pixel_samples"])]
    seconds: Option<f64>,
    /// Print a JSON report on stdout
    #[arg(long)]
    json: bool,
    /// No progress bar and no summary
    #[arg(long)]
    quiet: bool,
}

/// What `--json` prints.
#[derive(Serialize)]
struct JsonReport<'a, R> {
    #[serde(flatten)]
    report: &'a R,
    seconds: &'a Seconds,
}

pub fn run(mut args: RenderArgs, console: &Console) -> Result<(), Failure> {
    if args.output.is_empty() {
        args.output.push(default_output(&args));
    }
    let args = &args;
    // Anything that is sure to fail is reported before the long work.
    let sequence = args.frames.clone().map(|frames| sequence(args, frames)).transpose()?;
    if sequence.is_none() {
        args.output.iter().try_for_each(|path| check_output(path, &["png", "exr"]))?;
    }
    let choice = args.options.scene.backend()?;
    let (scene, options) = args.options.load(&args.scene, console)?;
    check_uses(args, &options)?;
    let watch = console.watch(args.quiet);
    if let Some(sequence) = sequence {
        return render_sequence(args, &sequence, (scene, options), &choice, &watch, console);
    }
    let display = options.display;
    let rendered = render(args, scene, options, &choice, &watch);
    watch.finish();
    let rendered = rendered?;
    rendered.report.warnings.iter().for_each(|warning| console.warn(warning));
    let seconds = watch.seconds();
    if args.json {
        console.print_json(&JsonReport { report: &rendered.report, seconds: &seconds })?;
    } else if !args.quiet {
        console.say(&summary(&rendered.report, display.exposure == Exposure::Auto, &seconds, &args.output));
    }
    Ok(())
}

/// Where a picture of the scene goes, or its frames: a file in the current folder.
fn default_output(args: &RenderArgs) -> PathBuf {
    let name = Path::new(&args.scene).file_stem().unwrap_or_default().to_string_lossy();
    PathBuf::from(if args.frames.is_some() { format!("{name}-####.png") } else { format!("{name}.png") })
}

/// The frames that are asked for, whose first files can be written.
fn sequence(args: &RenderArgs, frames: Range<u32>) -> Result<Sequence, String> {
    args.output.iter().try_for_each(|path| check_extension(path, &["png", "exr", "apng"]))?;
    let first = frames.start;
    let sequence = Sequence::new(frames, args.fps.unwrap_or(FRAMES_PER_SECOND), args.output.clone());
    let sequence = sequence.map_err(|e| e.to_string())?;
    sequence.files(first).iter().try_for_each(|path| check_writable(path))?;
    sequence.animated_file().map_or(Ok(()), check_writable)?;
    Ok(sequence)
}

fn render_sequence(
    args: &RenderArgs,
    sequence: &Sequence,
    (scene, options): (Scene, Options),
    choice: &BackendChoice,
    watch: &Watch,
    console: &Console,
) -> Result<(), Failure> {
    let backend = open(choice, watch).map_err(|e| message(&e))?;
    let code = pinspot::code_id();
    let rendered = wait(backend.device(), sequence.render(scene, options, &backend, code, watch, &mut |_| ()));
    watch.finish();
    let report = rendered.map_err(|e| message(&e))?;
    report.warnings.iter().for_each(|warning| console.warn(warning));
    let seconds = watch.seconds();
    if args.json {
        console.print_json(&JsonReport { report: &report, seconds: &seconds })?;
    } else if !args.quiet {
        let files: Vec<String> = args.output.iter().map(|p| p.display().to_string()).collect();
        let SequenceReport { rendered, kept, .. } = report;
        let kept = if kept > 0 { format!(", {kept} were there already") } else { String::new() };
        console.say(&format!(
            "{}: {rendered} frames rendered{kept}, on {}: {:.1} s",
            files.join(", "),
            backend.report(),
            seconds.total
        ));
    }
    Ok(())
}

/// Renders and writes the picture or, where the time is limited, the same from coarse to fine for as long as there is time.
fn render(
    args: &RenderArgs,
    scene: Scene,
    options: Options,
    choice: &BackendChoice,
    watch: &Watch,
) -> Result<Rendered, String> {
    let backend = open(choice, watch).map_err(|e| message(&e))?;
    let display = options.display;
    let own = options.clone();
    let finer = if args.seconds.is_some() { options.coarse_to_fine() } else { vec![options] };
    let mut steps = finer.into_iter();
    let first = steps.next().unwrap_or_default();
    let mut engine = Engine::new(scene, first, backend.clone());
    loop {
        let began = watch.elapsed();
        let mut rendered = wait(backend.device(), engine.render(watch)).map_err(|e| message(&e))?;
        for path in &args.output {
            write(path, &rendered, &display)?;
        }
        let took = watch.elapsed() - began;
        let ends = watch.elapsed() + STEP_GROWTH * took;
        let has_time = args.seconds.is_some_and(|seconds| ends < seconds);
        let Some(finer) = steps.next().filter(|_| has_time) else {
            rendered.report.warnings.extend(coarser_than(&own, engine.options(), ends));
            return Ok(rendered);
        };
        *engine.options_mut() = finer;
    }
}

/// What to say of a picture that is coarser than its scene asks for; a finer one would have ended after so many seconds.
fn coarser_than(own: &Options, rendered: &Options, ends: f64) -> Option<String> {
    let Options { samples, tolerance, .. } = rendered;
    let photons = rendered.image_space.photons;
    let what = if photons < own.image_space.photons {
        format!("{photons}² photons")
    } else if *samples < own.samples || *tolerance > own.tolerance {
        format!("{samples} samples, tolerance {tolerance}")
    } else {
        return None;
    };
    Some(format!(
        "this picture is coarser than its scene asks for ({what}): the next finer one would have ended after about {ends:.1} s; give more \
         --seconds, or leave them out"
    ))
}

/// Opens a back end.
pub(super) fn open(choice: &BackendChoice, watch: &Watch) -> Result<Backend, Error> {
    use pinspot::Progress;
    watch.begin(Stage::Device, 1);
    let backend = wait(None, Backend::open(choice));
    watch.end(Stage::Device);
    backend
}

/// Rejects options that would have no effect.
fn check_uses(args: &RenderArgs, options: &Options) -> Result<(), String> {
    let beauty = options.aovs.contains(&Aov::Beauty);
    let png = args.output.iter().any(|path| matches!(extension(path).as_str(), "png" | "apng"));
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
    for (option, given) in [
        ("--exposure", args.options.scene.exposure.is_some()),
        ("--tone-map", args.options.tone_map.is_some()),
        ("--background-exposure", args.options.background_exposure.is_some()),
    ] {
        if given && !png {
            return Err(format!(
                "{option} changes what is displayed, which an .exr does not hold; give a .png or drop it"
            ));
        }
    }
    if options.aovs.len() > 1 && !args.output.iter().any(|path| extension(path) == "exr") {
        return Err("a .png holds one picture, but --aov names several; give an .exr with -o for all of them".into());
    }
    check_sampling_uses(args, options)
}

/// Rejects options of the technique that would have no effect.
fn check_sampling_uses(args: &RenderArgs, options: &Options) -> Result<(), String> {
    let is_flat = options.evaluation == pinspot::EvaluationChoice::Flat;
    if args.options.tolerance.is_some() && is_flat {
        return Err("--tolerance is that of a hierarchy, but --evaluation is flat; drop one of them".into());
    }
    if args.options.scene.taps.is_some() && options.filter == FilterChoice::None {
        return Err("--taps are those of a filter, but --filter is none; drop one of them".into());
    }
    Ok(())
}

fn write(path: &Path, rendered: &Rendered, display: &DisplaySettings) -> Result<(), String> {
    let written = if extension(path) == "png" {
        write_png(path, &rendered.displayed(display))
    } else {
        let layers: Vec<_> = rendered.layers.iter().map(|(aov, image)| (aov.name(), image)).collect();
        write_exr(path, &layers)
    };
    written.map_err(|e| e.to_string())
}

/// The number of samples, and how they were summed; or of photons, and what they became.
fn samples(report: &Report) -> String {
    if let Some(photons) = &report.photons {
        let lights = if photons.lights == 1 { "1 light".to_owned() } else { format!("{} lights", photons.lights) };
        return format!(
            "{} of {} photons from {lights} as {}",
            photons.photons_used,
            photons.photons,
            photons.mode.name()
        );
    }
    match report.evaluation {
        None => "no samples".to_owned(),
        Some(Evaluation::Flat { leaves: 1 }) => format!("{} samples", report.samples),
        Some(Evaluation::Flat { leaves }) => format!("{} samples of {leaves} leaves, one by one", report.samples),
        Some(Evaluation::Hierarchical { leaves, .. }) => format!("{} samples of {leaves} leaves", report.samples),
    }
}

/// The exposure that was metered.
fn exposure(report: &Report) -> String {
    report.exposures.map_or_else(String::new, |used| format!(", exposed at {:+.1} stops", used.exposure_ev))
}

fn summary(report: &Report, is_metered: bool, seconds: &Seconds, outputs: &[PathBuf]) -> String {
    use Stage::{Caustic, Direct, Display, Estimate, PathEnds, Paths, Rays, Shading};
    let picture = seconds.of(&[Rays, Caustic, Direct, Paths, PathEnds, Shading, Display, Estimate]);
    let files: Vec<String> = outputs.iter().map(|p| p.display().to_string()).collect();
    format!(
        "{}: {}x{} pixels, {}{}, on {}: {:.1} s (preparing {:.1} s, caustic {:.1} s, {:.0} look-ups a pixel)",
        files.join(", "),
        report.size[0],
        report.size[1],
        samples(report),
        if is_metered { exposure(report) } else { String::new() },
        report.backend,
        seconds.total,
        (seconds.total - picture).max(0.0),
        seconds.of(&[Caustic, PathEnds, Estimate]),
        report.lookups,
    )
}
