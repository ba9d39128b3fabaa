//! `pinspot view`.

use std::path::PathBuf;

use clap::Args;

use pinspot::ViewError;

use super::console::Failure;

#[derive(Debug, Args)]
pub struct ViewArgs {
    /// A scene file (.toml), or the name of a built-in scene (see `pinspot scenes`) [default: ring-natural]
    scene: Option<String>,
    /// Save a picture of the window (.png) once the scene's picture is finished, and close it
    #[arg(long, value_name = "FILE")]
    screenshot: Option<PathBuf>,
    /// Back end: auto (a hardware GPU if there is one, else the CPU), gpu or cpu [default: auto]
    #[arg(long, value_parser = ["auto", "gpu", "cpu"], value_name = "NAME", hide_possible_values = true)]
    backend: Option<String>,
    /// Use the GPU adapter whose name contains this
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
}

pub fn run(args: &ViewArgs) -> Result<(), Failure> {
    let choice = super::options::backend_choice(args.backend.as_deref(), args.adapter.as_deref())?;
    if let Some(path) = &args.screenshot {
        super::output::check_output(path, &["png"])?;
    }
    pinspot::view(args.scene.as_deref(), choice, args.screenshot.clone()).map_err(|error| with_remedy(&error).into())
}

fn with_remedy(error: &ViewError) -> String {
    match error {
        ViewError::Window(_) => format!(
            "{error}; `pinspot view` needs a display (X11 or Wayland) and a Vulkan, Metal or Direct3D driver (on Debian: \
             apt-get install libvulkan1 mesa-vulkan-drivers); `pinspot render` needs neither"
        ),
        _ => error.to_string(),
    }
}
