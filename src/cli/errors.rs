//! Messages for the library's errors, with the command's options and remedies added.

use pinspot::low_level::environment::EnvironmentError;
#[cfg(feature = "gpu")]
use pinspot::low_level::gpu::GpuError;
use pinspot::low_level::sampling::SamplingError;
#[cfg(feature = "report")]
use pinspot::report::ReportError;
use pinspot::scene::SceneError;
use pinspot::{Error, OptionError};

/// An error in one line, with a remedy.
pub fn message(error: &Error) -> String {
    let text = match error {
        Error::Option(error) => return option_message(error),
        error => error.to_string(),
    };
    match remedy(error) {
        Some(remedy) => format!("{text}; {remedy}"),
        None => text,
    }
}

/// An invalid option, with alternatives.
pub fn option_message(error: &OptionError) -> String {
    let OptionError::Conflict { remedies, .. } = error else { return error.to_string() };
    let flags: Vec<String> = remedies.iter().map(|(key, value)| flag(key, value)).collect();
    if flags.is_empty() { error.to_string() } else { format!("{error}; give {}", flags.join(" or ")) }
}

/// The command-line flag for an option of a scene file.
fn flag(key: &str, value: &str) -> String {
    let name = match key {
        "exposure_ev" => "exposure".to_owned(),
        "background_exposure_ev" => "background-exposure".to_owned(),
        key => key.replace('_', "-"),
    };
    match value {
        "fewer" => format!("fewer --{name}"),
        value => format!("--{name} {value}"),
    }
}

fn remedy(error: &Error) -> Option<&'static str> {
    match error {
        #[cfg(feature = "gpu")]
        Error::Gpu(error) => gpu_remedy(error),
        Error::Sampling(SamplingError::Even { .. }) => {
            Some("give --strategy neighbourhood or random, or --density uniform")
        }
        Error::Environment(EnvironmentError::TooFine { .. }) => Some("give a smaller --cube-size"),
        Error::Scene(SceneError::Read { .. }) => Some("`pinspot scenes` lists them"),
        #[cfg(feature = "report")]
        Error::Report(ReportError::MaskSize { .. }) => Some("or give another --size"),
        _ => None,
    }
}

#[cfg(feature = "gpu")]
fn gpu_remedy(error: &GpuError) -> Option<&'static str> {
    Some(match error {
        GpuError::NoAdapter => {
            "give --backend cpu, or install a Vulkan driver (on Debian: apt-get install libvulkan1 mesa-vulkan-drivers)"
        }
        GpuError::NoDevice { .. } => "give another --adapter, or --backend cpu",
        GpuError::Lost { .. } => "run again, with fewer --samples or with --backend cpu",
        GpuError::OutOfMemory { .. } => "give --backend cpu, or a smaller --size or --cube-size",
        GpuError::Refused { .. } => "give --backend cpu, and report this",
        GpuError::TextureTooLarge { .. } => "give a smaller --size or --cube-size, or --backend cpu",
        GpuError::TooManyTriangles { .. } => "give --visibility none or --backend cpu",
        GpuError::MapsTooLarge { .. } => "give fewer --samples, --visibility none or --backend cpu",
        GpuError::LoopCutShort { .. } => {
            "give --backend cpu, a larger --tolerance, fewer --leaves, or --evaluation flat"
        }
        GpuError::TreeTooLarge { .. } => "give fewer --samples or --leaves, or --backend cpu",
        GpuError::TooManySamples { .. } => "give fewer --samples or --backend cpu",
        _ => return None,
    })
}
