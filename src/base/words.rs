//! Text that scene files, the command line and messages have in common: values that are a number or a word, and names.

use std::fmt;

use serde::Deserialize;

/// A number or a word; displays in the form in which the command line parses it.
#[derive(Deserialize)]
#[serde(untagged, expecting = "a number or a word")]
pub enum NumberOrWord {
    /// A number.
    Number(f64),
    /// A word.
    Word(String),
}

impl fmt::Display for NumberOrWord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => number.fmt(f),
            Self::Word(word) => word.fmt(f),
        }
    }
}

/// Escapes control characters in a name, which would otherwise reach the terminal.
pub fn escaped(name: &str) -> String {
    let escape = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    name.chars().map(escape).collect()
}
