//! `pinspot samples`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use pinspot::Progress;
use pinspot::differential::{differentials, write_ply};
use pinspot::image::write_atomically;
use pinspot::render::Settings;
use pinspot::sampling::{Options, Quality, Surface, quality, sample};
use pinspot::scene::load;

use super::options::SamplingOptions;
use super::progress::Bar;
use super::render::check_output;

#[derive(Debug, Args)]
pub struct SamplesArgs {
    /// A scene file (.toml), or the name of a built-in scene
    scene: String,
    /// The point cloud to write (.ply)
    #[arg(short, long, value_name = "FILE.ply")]
    output: PathBuf,
    #[command(flatten)]
    options: SamplingOptions,
    /// Print the figures as JSON on stdout
    #[arg(long)]
    json: bool,
    /// Print no figures
    #[arg(long)]
    quiet: bool,
}

#[derive(Serialize)]
struct Figures {
    requested: u32,
    strategy: pinspot::sampling::Strategy,
    seed: u64,
    /// Samples in the file; one that no part of the surface is nearest to is left out.
    written: usize,
    #[serde(flatten)]
    quality: Quality,
}

pub fn run(args: &SamplesArgs) -> Result<(), String> {
    check_output(&args.output, &["ply"])?;
    let loaded = load::<Settings>(&args.scene).map_err(|e| e.to_string())?;
    let over = Settings {
        samples: args.options.samples,
        strategy: args.options.strategy,
        seed: args.options.seed,
        ..Default::default()
    };
    let render = loaded.render.overridden_by(over).options().map_err(|e| e.to_string())?;
    for note in &loaded.scene.notes {
        eprintln!("pinspot: warning: {note}");
    }
    let bar = Bar::new(args.quiet);
    bar.begin("sampling the reflectors", 2);
    let surface = Surface::of_scene(&loaded.scene);
    let options = Options { samples: render.samples, strategy: render.strategy, seed: render.seed };
    let set = sample(&surface, &options).map_err(|e| e.to_string())?;
    bar.advance(1);
    let samples = differentials(&set);
    bar.finish();
    write_atomically(&args.output, |out| write_ply(&samples, out).map_err(|e| e.to_string()))
        .map_err(|e| e.to_string())?;
    let figures = Figures {
        requested: options.samples,
        strategy: options.strategy,
        seed: options.seed,
        written: samples.len(),
        quality: quality(&set.points, surface.area()),
    };
    match (args.json, args.quiet) {
        (true, _) => super::print_json(&figures),
        (false, true) => Ok(()),
        (false, false) => super::print(&describe(&figures)),
    }
}

fn describe(figures: &Figures) -> String {
    let Quality { count, area, relative_radius, nearest_mean, nearest_spread } = figures.quality;
    format!(
        "samples             {count} ({} asked for), {} written\n\
         area                {area:.4} m²\n\
         relative radius     {relative_radius:.3} (smallest distance over that of the densest packing)\n\
         nearest neighbour   {nearest_mean:.3} of that distance on average, spread {nearest_spread:.3}",
        figures.requested, figures.written
    )
}
