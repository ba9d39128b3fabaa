//! `pinspot samples`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use pinspot::differential::{differentials, write_ply};
use pinspot::image::write_atomically;
use pinspot::render::Settings;
use pinspot::sampling::{Options, Quality, Surface, quality, sample};
use pinspot::scene::load;

use super::options::SamplingOptions;

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
    #[serde(flatten)]
    quality: Quality,
}

pub fn run(args: &SamplesArgs) -> Result<(), String> {
    if args.output.extension().is_none_or(|e| e != "ply") {
        return Err(format!("cannot write '{}': give a file that ends in .ply", args.output.display()));
    }
    let loaded = load::<Settings>(&args.scene).map_err(|e| e.to_string())?;
    let over = Settings {
        samples: args.options.samples,
        strategy: args.options.strategy,
        seed: args.options.seed,
        ..Default::default()
    };
    let render = loaded.render.overridden_by(over).options().map_err(|e| e.to_string())?;
    let surface = Surface::of_scene(&loaded.scene);
    let options = Options { samples: render.samples, strategy: render.strategy, seed: render.seed };
    let set = sample(&surface, &options).map_err(|e| e.to_string())?;
    let samples = differentials(&set);
    write_atomically(&args.output, |out| write_ply(&samples, out).map_err(|e| e.to_string()))
        .map_err(|e| e.to_string())?;
    let figures = Figures {
        requested: options.samples,
        strategy: options.strategy,
        seed: options.seed,
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
        "samples             {count} ({} asked for)\n\
         area                {area:.4} m²\n\
         relative radius     {relative_radius:.3} (smallest distance over that of the densest packing)\n\
         nearest neighbour   {nearest_mean:.3} of that distance on average, spread {nearest_spread:.3}",
        figures.requested
    )
}
