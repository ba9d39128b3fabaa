//! `pinspot samples`.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use pinspot::Progress;
use pinspot::image::write_atomically;
#[cfg(feature = "report")]
use pinspot::image::write_png;
use pinspot::low_level::differential::{differentials, write_ply};
use pinspot::low_level::sampling::{
    Options, Parameterization, PointSet, Quality, Spectrum, Surface, quality, strategy_statistics,
};
#[cfg(feature = "report")]
use pinspot::report::spectrum_picture;
use pinspot::scene::load;
use pinspot::{Density, Settings, Stage, Strategy, place_samples};

use super::console::{Console, Failure};
use super::errors::{message, option_message};
use super::options::SamplingOptions;
use super::output::check_output;

#[derive(Debug, Args)]
pub struct SamplesArgs {
    /// A scene file (.toml), or the name of a built-in scene
    scene: String,
    /// The point cloud to write (.ply)
    #[arg(short, long, value_name = "FILE.ply")]
    output: PathBuf,
    #[command(flatten)]
    options: SamplingOptions,
    /// Number of point sets, with consecutive seeds, over which the spectrum is averaged (for reflectors that unroll
    /// into a rectangle)
    #[arg(long, value_name = "K", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=1000))]
    sets: u32,
    /// Write a picture of the power spectrum (.png), with frequency 0 in the middle; the level of white noise is 25 %
    /// grey
    #[cfg(feature = "report")]
    #[arg(long, value_name = "FILE.png")]
    spectrum: Option<PathBuf>,
    /// Print the figures as JSON on stdout
    #[arg(long)]
    json: bool,
    /// Print no figures
    #[arg(long)]
    quiet: bool,
}

impl SamplesArgs {
    #[cfg(feature = "report")]
    fn spectrum(&self) -> Option<&Path> {
        self.spectrum.as_deref()
    }

    /// Without the feature `report` there are no such pictures.
    #[cfg(not(feature = "report"))]
    #[expect(clippy::unused_self, reason = "as with the feature `report`")]
    fn spectrum(&self) -> Option<&Path> {
        None
    }
}

#[derive(Serialize)]
struct Figures {
    requested: u32,
    strategy: Strategy,
    density: Density,
    seed: u64,
    /// Samples in the file; those with an empty cell are left out.
    written: usize,
    #[serde(flatten)]
    quality: Quality,
    /// Number of sets over which the spectrum is averaged; `null` without a spectrum.
    sets: Option<u32>,
    /// `null` where the reflectors do not unroll into a rectangle.
    spectrum: Option<Spectrum>,
}

pub fn run(args: &SamplesArgs, console: &Console) -> Result<(), Failure> {
    check_output(&args.output, &["ply"])?;
    if let Some(path) = args.spectrum() {
        check_output(path, &["png"])?;
    }
    let loaded = load::<Settings>(&args.scene).map_err(|e| message(&e.into()))?;
    let over = Settings {
        samples: args.options.samples,
        strategy: args.options.strategy,
        density: args.options.density,
        seed: args.options.seed,
        ..Default::default()
    };
    let render = loaded.render.overridden_by(over).options().map_err(|e| option_message(&e))?;
    loaded.scene.notes.iter().for_each(|note| console.warn(note));
    let surface = Surface::of_scene(&loaded.scene);
    let parameterization = Parameterization::of(&surface);
    if args.spectrum().is_some() && parameterization.is_none() {
        let message =
            "--spectrum needs reflectors that unroll into a rectangle: one flat rectangle or one whole cylinder";
        return Err(format!("{}: {message}", loaded.scene.name).into());
    }
    let bar = console.watch(args.quiet);
    bar.begin(Stage::Points, 3);
    let options = Options { samples: render.samples, strategy: render.strategy, seed: render.seed };
    let set = place_samples(&loaded.scene, &render).map_err(|e| message(&e))?;
    bar.advance(1);
    let samples = differentials(&set);
    bar.advance(1);
    let spectrum = match &parameterization {
        Some(d) => strategy_statistics(&surface, Some(d), &options, args.sets).map_err(|e| e.to_string())?.spectrum,
        None => None,
    };
    bar.end(Stage::Points);
    bar.finish();
    write_atomically(&args.output, |out| write_ply(&samples, out).map_err(|e| e.to_string()))
        .map_err(|e| e.to_string())?;
    #[cfg(feature = "report")]
    if let (Some(path), Some(spectrum)) = (&args.spectrum, &spectrum) {
        write_png(path, &spectrum_picture(spectrum)).map_err(|e| e.to_string())?;
    }
    let figures = figures(args, &options, render.density, &set, &surface, samples.len(), spectrum);
    match (args.json, args.quiet) {
        (true, _) => console.print_json(&figures),
        (false, true) => Ok(()),
        (false, false) => console.print(&describe(&figures)),
    }
}

fn figures(
    args: &SamplesArgs,
    options: &Options,
    density: Density,
    set: &PointSet,
    surface: &Surface,
    written: usize,
    spectrum: Option<Spectrum>,
) -> Figures {
    Figures {
        requested: options.samples,
        strategy: options.strategy,
        density,
        seed: options.seed,
        written,
        quality: quality(set, surface.area()),
        sets: spectrum.as_ref().map(|_| args.sets),
        spectrum,
    }
}

fn describe(figures: &Figures) -> String {
    let q = &figures.quality;
    let bias = q.orientation_bias.map_or_else(
        || "not told: the surface has one orientation".to_owned(),
        |bias| format!("{bias:.3} times as many points where the surface is diagonal to the axes"),
    );
    let spectrum = figures.spectrum.as_ref().map_or_else(
        || "spectrum            none: the reflectors do not unroll into a rectangle".to_owned(),
        |s| {
            format!(
                "low frequencies     {:.3} of white noise's power\n\
                 anisotropy          {:.1} dB (mean of {} sets; {:.1} dB if isotropic)",
                s.low_power,
                s.anisotropy_db,
                figures.sets.unwrap_or(1),
                -10.0 * f64::from(figures.sets.unwrap_or(1)).log10(),
            )
        },
    );
    format!(
        "samples             {} ({} asked for), {} written\n\
         area                {:.4} m²\n\
         relative radius     {:.3} (smallest distance over that of the densest packing)\n\
         nearest neighbour   {:.3} of that distance on average, spread {:.3}\n\
         coverage radius     {:.3} of that distance (largest gap)\n\
         displacement        {:.3} of that distance off the surface\n\
         orientation         {bias}\n\
         {spectrum}",
        q.count,
        figures.requested,
        figures.written,
        q.area,
        q.relative_radius,
        q.nearest_mean,
        q.nearest_spread,
        q.coverage_radius,
        q.displacement,
    )
}
