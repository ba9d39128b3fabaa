//! `pinspot adapters`.

use clap::Args;

use pinspot::blocking::wait;
use pinspot::low_level::gpu::{Adapter, Gpu, adapters};
use pinspot::low_level::pinhole::gpu::check_hardware_filter;

use super::console::{Console, Failure};

#[derive(Debug, Args)]
pub struct AdaptersArgs {
    /// Print JSON on stdout
    #[arg(long)]
    json: bool,
}

#[derive(serde::Serialize)]
struct Entry {
    #[serde(flatten)]
    adapter: Adapter,
    /// Root mean square error of the hardware filter, relative to the pattern's standard deviation; `null` if it could
    /// not be tested.
    hardware_filter_error: Option<f32>,
    hardware_filter_right: Option<bool>,
}

pub fn run(args: &AdaptersArgs, console: &Console) -> Result<(), Failure> {
    let entries: Vec<Entry> = wait(None, adapters()).into_iter().enumerate().map(examine).collect();
    if args.json {
        return console.print_json(&entries);
    }
    if entries.is_empty() {
        return console.print(
            "no GPU adapter found: Pinspot renders on the CPU back end\n\
             (a software one on Debian: apt-get install libvulkan1 mesa-vulkan-drivers)",
        );
    }
    entries.iter().try_for_each(|entry| console.print(&describe(entry)))
}

fn examine((index, adapter): (usize, Adapter)) -> Entry {
    let verdict =
        wait(None, Gpu::open_nth(index)).and_then(|gpu| wait(Some(&gpu.device), check_hardware_filter(&gpu))).ok();
    Entry {
        adapter,
        hardware_filter_error: verdict.map(|v| v.rms_error),
        hardware_filter_right: verdict.map(|v| v.is_right()),
    }
}

fn describe(entry: &Entry) -> String {
    let a = &entry.adapter;
    let yes = |b: bool| if b { "yes" } else { "no" };
    let hardware = match (entry.hardware_filter_right, entry.hardware_filter_error) {
        (Some(true), _) => "right".to_owned(),
        (Some(false), Some(error)) => {
            format!("wrong on cube maps with explicit gradients (error {error:.2} of a pattern's deviation)")
        }
        _ => "unavailable: the device could not be opened".to_owned(),
    };
    format!(
        "{} ({}{})\n  driver                      {}\n  filters 32-bit textures     {}\n  blends 32-bit targets       {}\n  \
         ray queries                 {}\n  largest texture             {} texels\n  largest storage buffer      {} MiB\n  anisotropic hardware filter {hardware}",
        a.name,
        a.backend,
        if a.software { ", software" } else { "" },
        a.driver,
        yes(a.float32_filterable),
        yes(a.float32_blendable),
        yes(a.ray_queries),
        a.max_texture,
        a.max_storage_bytes >> 20,
    )
}
