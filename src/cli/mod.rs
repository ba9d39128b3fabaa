//! The command line: parses arguments, calls the library and writes files. Nothing is computed here.

#[cfg(feature = "gpu")]
mod adapters;
#[cfg(feature = "report")]
mod compare;
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

use std::process::ExitCode;

use clap::{Parser, Subcommand};

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

/// Parses the command line and runs it. Exit codes: 0 for success, 1 for an error with one line on stderr, 2 for a
/// wrong command line.
pub fn run() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Render(args) => render::run(&args),
        #[cfg(feature = "view")]
        Command::View(args) => view::run(&args),
        Command::Reference(args) => reference::run(&args),
        #[cfg(feature = "report")]
        Command::Compare(args) => compare::run(&args),
        Command::Samples(args) => samples::run(&args),
        #[cfg(feature = "gpu")]
        Command::Filters(args) => filters::run(&args),
        #[cfg(feature = "gpu")]
        Command::Adapters(args) => adapters::run(&args),
        Command::Scenes(args) => scenes::run(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            to_stderr(&format!("pinspot: error: {}", printable(&message)));
            ExitCode::FAILURE
        }
    }
}

/// Prints to stdout. A closed pipe is not an error.
fn print(text: &str) -> Result<(), String> {
    use std::io::Write;
    match writeln!(std::io::stdout(), "{text}") {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(format!("cannot write to standard output: {e}")),
        _ => Ok(()),
    }
}

fn print_json(value: &impl serde::Serialize) -> Result<(), String> {
    print(&serde_json::to_string_pretty(value).map_err(|e| e.to_string())?)
}

/// Prints a line to stderr. If that fails, there is nowhere left to report it.
fn to_stderr(line: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Prints a warning to stderr.
fn warn(warning: &str) {
    to_stderr(&format!("pinspot: warning: {}", printable(warning)));
}

/// One line without control characters, which names in files may contain.
fn printable(text: &str) -> String {
    let escaped = |c: char| match c {
        '\n' => vec![' '],
        c if c.is_control() => c.escape_default().collect(),
        c => vec![c],
    };
    text.chars().flat_map(escaped).collect()
}
