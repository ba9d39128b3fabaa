//! Writes the five procedural environment maps of Pinspot as OpenEXR files.
//!
//! `cargo run --release --example envmaps -- [OUT_DIR]`

mod canvas;
mod city;
mod clear_sky;
mod forest;
mod noise;
mod overcast;
mod studio;
mod terrain;

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use canvas::{Canvas, Storage};
use glam::Vec3;

const FINE: (usize, usize) = (1024, 512);
/// For the forest, whose leaves compress badly.
const COARSE: (usize, usize) = (768, 384);

/// Samples per side of a texel.
const SAMPLES: usize = 4;

fn main() -> ExitCode {
    let out_dir = std::env::args_os().nth(1).map_or_else(|| PathBuf::from("envmaps"), PathBuf::from);
    match write_all(&out_dir) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn write_all(out_dir: &Path) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(out_dir).map_err(|e| format!("{}: {e}", out_dir.display()))?;

    let clear = clear_sky::ClearSky::new();
    let canvas = Canvas::render(FINE, clear_sky::samples, |d| clear.radiance(d));
    write(out_dir, "clear-sky", &canvas, stored(7, true))?;

    write_evenly(out_dir, "overcast", FINE, stored(7, false), overcast::radiance)?;

    let forest = forest::Forest::new();
    write_evenly(out_dir, "forest", COARSE, stored(6, false), |d| forest.radiance(d))?;

    let studio = studio::Studio::new();
    write_evenly(out_dir, "studio", FINE, stored(9, false), |d| studio.radiance(d))?;

    let city = city::City::new();
    write_evenly(out_dir, "city", FINE, stored(6, false), |d| city.radiance(d))
}

fn stored(mantissa_bits: u32, wide: bool) -> Storage {
    Storage { mantissa_bits, wide }
}

/// Renders with the same number of samples everywhere, and writes.
fn write_evenly(
    out_dir: &Path,
    name: &str,
    size: (usize, usize),
    storage: Storage,
    radiance: impl Fn(Vec3) -> Vec3 + Sync,
) -> Result<(), Box<dyn Error>> {
    let canvas = Canvas::render(size, |_| SAMPLES, radiance);
    write(out_dir, name, &canvas, storage)
}

/// Writes under a temporary name first, so that no half-written map can stay.
fn write(out_dir: &Path, name: &str, canvas: &Canvas, storage: Storage) -> Result<(), Box<dyn Error>> {
    let path = out_dir.join(format!("{name}.exr"));
    let partial = out_dir.join(format!("{name}.exr.partial"));
    let explained = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let bytes = canvas.encode(storage).map_err(|e| explained(&e))?;
    fs::write(&partial, &bytes).map_err(|e| explained(&e))?;
    fs::rename(&partial, &path).map_err(|e| explained(&e))?;
    println!("{}: {} x {}, {} bytes, peak {}", path.display(), canvas.width, canvas.height, bytes.len(), canvas.peak());
    Ok(())
}
