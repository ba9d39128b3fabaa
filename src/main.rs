//! The `pinspot` command: parse, call the library, write.

mod cli;
#[cfg(all(feature = "gpu", unix, not(target_vendor = "apple")))]
mod wayland;

use std::process::ExitCode;

fn main() -> ExitCode {
    #[cfg(all(feature = "gpu", unix, not(target_vendor = "apple")))]
    wayland::settle();
    cli::run()
}
