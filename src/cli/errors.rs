//! What the library reports, with the command's own options and remedies added.

use pinspot::scene::MeshError;
use pinspot::{Error, OptionError};

/// One line for a user of the command.
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

/// An option that cannot be used, and what to give instead.
pub fn option_message(error: &OptionError) -> String {
    let OptionError::Conflict { remedies, .. } = error else { return error.to_string() };
    let flags: Vec<String> = remedies.iter().map(|(key, value)| flag(key, value)).collect();
    if flags.is_empty() { error.to_string() } else { format!("{error}; give {}", flags.join(" or ")) }
}

/// An option of a scene file as the command line has it.
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

#[cfg(feature = "gpu")]
fn remedy(error: &Error) -> Option<&'static str> {
    use pinspot::low_level::gpu::GpuError;
    let Error::Gpu(error) = error else { return scene_remedy(error) };
    match error {
        GpuError::NoAdapter => Some(
            "give --backend cpu, or install a Vulkan driver (on Debian: apt-get install libvulkan1 mesa-vulkan-drivers)",
        ),
        GpuError::NoDevice { .. } => Some("give another --adapter, or --backend cpu"),
        GpuError::Lost { .. } => Some("run again, with fewer --samples or with --backend cpu"),
        GpuError::Refused { .. } => Some("give --backend cpu, and report this"),
        GpuError::MapsTooLarge { .. } => Some("give fewer --samples, --visibility none or --backend cpu"),
        GpuError::LoopCutShort { .. } => Some("give --backend cpu, a larger --tolerance, or --evaluation flat"),
        GpuError::TreeTooLarge { .. } => Some("give fewer --samples or --leaves, or --backend cpu"),
        GpuError::TooManySamples { .. } => Some("give fewer --samples or --backend cpu"),
        _ => None,
    }
}

#[cfg(not(feature = "gpu"))]
fn remedy(error: &Error) -> Option<&'static str> {
    scene_remedy(error)
}

fn scene_remedy(error: &Error) -> Option<&'static str> {
    match error {
        Error::Mesh(MeshError::Empty { .. }) => Some("export it with faces"),
        _ => None,
    }
}
