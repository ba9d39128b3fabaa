//! The `pinspot` command: parse, call the library, write.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
