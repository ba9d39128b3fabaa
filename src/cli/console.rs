//! Where the command writes, and how it fails.

use std::cell::RefCell;
use std::io::{self, IsTerminal, Write};

use super::progress::Watch;

/// Standard output and standard error of one run of the command.
pub struct Console<'a> {
    out: RefCell<Box<dyn Write + 'a>>,
    err: RefCell<Box<dyn Write + 'a>>,
    /// Whether these are the process's own, which may be a terminal.
    is_of_process: bool,
}

/// Why the command ends before it has done what it was asked for.
#[derive(Debug)]
pub(super) enum Failure {
    /// A wrong command line; or one that asks for help only, which is no failure but ends the command in the same way.
    CommandLine(clap::Error),
    /// An error in one line.
    Message(String),
}

impl From<clap::Error> for Failure {
    fn from(error: clap::Error) -> Self {
        Self::CommandLine(error)
    }
}

impl From<String> for Failure {
    fn from(message: String) -> Self {
        Self::Message(message)
    }
}

impl Failure {
    /// A wrong command line that clap's own rules do not find.
    pub fn command_line(kind: clap::error::ErrorKind, message: &str) -> Self {
        Self::CommandLine(clap::Error::raw(kind, format!("{message}\n")))
    }
}

impl<'a> Console<'a> {
    /// A console that writes to these, which are not terminals: it shows neither progress nor colours.
    pub fn new(out: impl Write + 'a, err: impl Write + 'a) -> Self {
        Self { out: RefCell::new(Box::new(out)), err: RefCell::new(Box::new(err)), is_of_process: false }
    }

    /// The console of this process.
    pub fn of_process() -> Self {
        Self { is_of_process: true, ..Self::new(io::stdout(), io::stderr()) }
    }

    /// A stopwatch, with a progress bar where a person sees it.
    pub(super) fn watch(&self, quiet: bool) -> Watch {
        Watch::new(!quiet && self.is_of_process && io::stderr().is_terminal())
    }

    /// Prints to stdout. A closed pipe is not an error.
    pub(super) fn print(&self, text: &str) -> Result<(), Failure> {
        match writeln!(self.out.borrow_mut(), "{text}") {
            Err(e) if e.kind() != io::ErrorKind::BrokenPipe => {
                Err(format!("cannot write to standard output: {e}").into())
            }
            _ => Ok(()),
        }
    }

    pub(super) fn print_json(&self, value: &impl serde::Serialize) -> Result<(), Failure> {
        self.print(&serde_json::to_string_pretty(value).map_err(|e| e.to_string())?)
    }

    /// Prints a line to stderr. If that fails, there is nowhere left to report it.
    pub(super) fn say(&self, line: &str) {
        let _ = writeln!(self.err.borrow_mut(), "{line}");
    }

    /// Prints a warning to stderr.
    pub(super) fn warn(&self, warning: &str) {
        self.say(&format!("pinspot: warning: {}", printable(warning)));
    }

    /// Reports a failure, and returns the exit code.
    pub(super) fn report(&self, failure: &Failure) -> u8 {
        match failure {
            Failure::CommandLine(error) => {
                // To a terminal clap writes in colours, unless the user wants none.
                let _ = if self.is_of_process {
                    error.print()
                } else {
                    let to = if error.use_stderr() { &self.err } else { &self.out };
                    write!(to.borrow_mut(), "{}", error.render())
                };
                u8::try_from(error.exit_code()).unwrap_or(2)
            }
            Failure::Message(message) => {
                self.say(&format!("pinspot: error: {}", printable(message)));
                1
            }
        }
    }
}

/// One line without control characters, which names in files may contain.
fn printable(text: &str) -> String {
    let escaped = |c: char| match c {
        '\n' => vec![' '],
        c if c.is_control() => c.escape_default().collect(),
        c => vec![c],
    };
    text.chars().flat_map(escaped).collect()
}
