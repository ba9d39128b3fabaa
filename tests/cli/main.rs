//! The command as its users run it: outputs, exit codes, and one clear line for every bad input.
//!
//! It runs in the test's process. What only a process has (exit codes, pipes, signals, terminals, an environment) is tested in `processes`.

mod compare;
mod frames;
mod others;
mod processes;
mod reference;
mod refusals;
mod render;
mod workplace;
