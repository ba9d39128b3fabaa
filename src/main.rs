//! The `pinspot` command.

use std::process::ExitCode;

use pinspot::cli::{Console, run};

fn main() -> ExitCode {
    ExitCode::from(run(std::env::args_os(), &Console::of_process()))
}
