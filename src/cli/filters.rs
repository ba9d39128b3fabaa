//! `pinspot filters`.

use std::path::PathBuf;

use clap::Args;

use pinspot::blocking::wait;
use pinspot::image::{write_atomically, write_png};
use pinspot::low_level::conformance::{Conformance, Device, FilterResult, PATTERNS, examine, zone_plates};
use pinspot::low_level::gpu::{Gpu, adapters};
use pinspot::{Filter, Progress, Stage};

use super::console::{Console, Failure};
use super::errors::message;

#[derive(Debug, Args)]
pub struct FiltersArgs {
    /// A folder for filters.json and one picture per device: a zone plate, exact and as each filter renders it, in the order that is printed
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Test only the GPU adapter whose name contains this [default: the CPU and all adapters]
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// Print JSON on stdout
    #[arg(long)]
    json: bool,
    /// No progress bar and no table
    #[arg(long)]
    quiet: bool,
}

pub fn run(args: &FiltersArgs, console: &Console) -> Result<(), Failure> {
    if let Some(folder) = &args.output {
        std::fs::create_dir_all(folder).map_err(|e| format!("cannot create the folder '{}': {e}", folder.display()))?;
    }
    let gpus: Vec<Gpu> = match &args.adapter {
        Some(name) => vec![wait(None, Gpu::open(Some(name))).map_err(|e| message(&e.into()))?],
        None => (0..wait(None, adapters()).len()).filter_map(|index| wait(None, Gpu::open_nth(index)).ok()).collect(),
    };
    let cpu = args.adapter.is_none().then_some(Device::Cpu);
    let devices: Vec<Device> = cpu.into_iter().chain(gpus.iter().map(Device::Gpu)).collect();
    let bar = console.watch(args.quiet);
    let (mut all, mut legends) = (Vec::new(), Vec::new());
    for (k, device) in devices.into_iter().enumerate() {
        bar.begin(Stage::Filters, (device.filters().len() * PATTERNS.len()) as u64);
        let result = wait(device.wgpu_device(), examine(device, &|| bar.advance(1))).map_err(|e| message(&e.into()))?;
        if let Some(folder) = &args.output {
            let picture = wait(device.wgpu_device(), zone_plates(device)).map_err(|e| message(&e.into()))?;
            let path = folder.join(format!("{k}-{}.png", file_name(&result.device)));
            write_png(&path, &picture).map_err(|e| e.to_string())?;
            let tiles = device.filters().into_iter().map(|(filter, taps)| filter_name(filter, taps));
            let tiles: Vec<String> = std::iter::once("exact".to_owned()).chain(tiles).collect();
            legends.push(format!("{}, from left to right: {}", path.display(), tiles.join(", ")));
        }
        all.push(result);
    }
    bar.finish();
    if let Some(folder) = &args.output {
        let json = serde_json::to_string_pretty(&all).map_err(|e| e.to_string())?;
        let write = |out: &mut dyn std::io::Write| out.write_all(json.as_bytes()).map_err(|e| e.to_string());
        write_atomically(&folder.join("filters.json"), |out| write(out)).map_err(|e| e.to_string())?;
    }
    match (args.json, args.quiet) {
        (true, _) => console.print_json(&all),
        (false, true) => Ok(()),
        (false, false) => {
            for legend in &legends {
                console.say(legend);
            }
            all.iter().try_for_each(|conformance| console.print(&table(conformance)))
        }
    }
}

fn file_name(device: &str) -> String {
    let words = device.to_lowercase();
    let words: Vec<&str> = words.split(|c: char| !c.is_ascii_alphanumeric()).filter(|w| !w.is_empty()).collect();
    words.join("-")
}

fn table(conformance: &Conformance) -> String {
    let mut lines = vec![
        format!("{}: {} footprints on {} patterns", conformance.device, conformance.footprints, PATTERNS.len()),
        "errors are root mean squares; 1 is the deviation of the pattern, or of the exact means where that is larger"
            .to_owned(),
        format!(
            "{:15} {:>6} {} {:>8} {:>8}  verdict",
            "filter",
            "error",
            PATTERNS.map(|p| format!("{:>12}", p.name())).join(" "),
            "turning",
            "fetches"
        ),
    ];
    lines.extend(conformance.results.iter().map(line));
    lines.push(format!("--filter auto picks {}\n", conformance.auto.name()));
    lines.join("\n")
}

fn filter_name(filter: Filter, taps: u32) -> String {
    match filter {
        Filter::Anisotropic => format!("{} {taps}", filter.name()),
        filter => filter.name().to_owned(),
    }
}

fn line(result: &FilterResult) -> String {
    let name = filter_name(result.filter, result.taps);
    let patterns: Vec<String> = result.by_pattern.iter().map(|(_, error)| format!("{error:>12.3}")).collect();
    format!(
        "{name:15} {:>6.3} {} {:>8.2} {:>8.1}  {}",
        result.rms_error,
        patterns.join(" "),
        result.orientation,
        result.fetches,
        result.verdict
    )
}
