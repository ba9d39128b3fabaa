//! The `pinspot` command.

#[cfg(all(feature = "gpu", unix, not(target_vendor = "apple")))]
mod wayland;

use std::process::ExitCode;

use pinspot::cli::{Console, run};

fn main() -> ExitCode {
    #[cfg(all(feature = "gpu", unix, not(target_vendor = "apple")))]
    wayland::settle();
    ExitCode::from(run(std::env::args_os(), &Console::of_process()))
}
