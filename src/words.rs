//! Values of scene files that are a number or a word; the command line parses the same text.

use std::fmt;

use serde::Deserialize;

/// A number or a word; it displays as what it is parsed from on the command line.
#[derive(Deserialize)]
#[serde(untagged, expecting = "a number or a word")]
pub(crate) enum NumberOrWord {
    Number(f64),
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
