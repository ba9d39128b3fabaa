//! The command line: parses arguments, calls the library and writes files. Nothing is computed here.

#[cfg(feature = "gpu")]
mod adapters;
#[cfg(feature = "report")]
mod compare;
mod console;
#[cfg(all(test, feature = "report", feature = "view"))]
mod documents;
mod errors;
#[cfg(feature = "gpu")]
mod filters;
mod options;
mod output;
mod progress;
mod reference;
mod render;
mod samples;
mod scenes;
#[cfg(feature = "view")]
mod view;

use std::ffi::OsString;

use clap::{Parser, Subcommand};

pub use console::Console;
use console::Failure;

/// Renders caustics from natural light: each sample of a mirror projects the environment onto the surfaces it faces
#[derive(Debug, Parser)]
#[command(version, max_term_width = 110)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Render a scene to .png (tone-mapped) or .exr (linear)
    Render(render::RenderArgs),
    /// Open a window in which the scene moves and can be edited
    #[cfg(feature = "view")]
    View(view::ViewArgs),
    /// Compute the ground truth with its standard error (.exr); run the same command again to continue
    Reference(reference::ReferenceArgs),
    /// Compare strategies, footprints, filters and sample counts with the ground truth, as an HTML report
    #[cfg(feature = "report")]
    Compare(compare::CompareArgs),
    /// Write the samples as a point cloud (.ply) and print how evenly they are distributed
    Samples(samples::SamplesArgs),
    /// Measure the error of each cube-map filter on this machine against the exact integral
    #[cfg(feature = "gpu")]
    Filters(filters::FiltersArgs),
    /// List the GPU adapters and their capabilities
    #[cfg(feature = "gpu")]
    Adapters(adapters::AdaptersArgs),
    /// List the built-in scenes and environment maps
    Scenes(scenes::ScenesArgs),
}

/// Parses a command line, the first of whose words is the name of the program, runs it, and returns the exit code: 0 for success, 1 for
/// an error with one line on stderr, 2 for a wrong command line.
pub fn run(command_line: impl IntoIterator<Item = OsString>, console: &Console) -> u8 {
    let words: Vec<OsString> = command_line.into_iter().collect();
    let parsed = Cli::try_parse_from(&words).map_err(Failure::from);
    match parsed.and_then(|cli| execute(cli.command, &words, console)) {
        Ok(()) => 0,
        Err(failure) => console.report(&failure),
    }
}

#[cfg_attr(not(feature = "report"), expect(unused_variables, reason = "reports hold the command line"))]
fn execute(command: Command, words: &[OsString], console: &Console) -> Result<(), Failure> {
    match command {
        Command::Render(args) => render::run(args, console),
        #[cfg(feature = "view")]
        Command::View(args) => view::run(&args),
        Command::Reference(args) => reference::run(&args, console),
        #[cfg(feature = "report")]
        Command::Compare(args) => compare::run(&args, words, console),
        Command::Samples(args) => samples::run(&args, console),
        #[cfg(feature = "gpu")]
        Command::Filters(args) => filters::run(&args, console),
        #[cfg(feature = "gpu")]
        Command::Adapters(args) => adapters::run(&args, console),
        Command::Scenes(args) => scenes::run(&args, console),
    }
}
