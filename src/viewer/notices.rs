//! What the window tells the user: what went wrong, until it is mended or dismissed, and what was done, for a while.

use std::time::{Duration, Instant};

/// How long the window shows that something was done.
const SHOWN: Duration = Duration::from_secs(6);

/// Messages of the window.
#[derive(Clone, Debug, Default)]
pub struct Notices {
    /// What went wrong beside rendering, until it is read.
    failure: Option<String>,
    /// Why the scene cannot be rendered, until it can.
    rendering: Option<String>,
    done: Option<(String, Instant)>,
}

impl Notices {
    /// Something went wrong.
    pub fn fail(&mut self, reason: String) {
        self.failure = Some(reason);
    }

    /// The scene cannot be rendered for this reason or, without one, it can.
    pub fn set_rendering(&mut self, reason: Option<String>) {
        self.rendering = reason;
    }

    /// Something was done.
    pub fn say(&mut self, text: String) {
        self.done = Some((text, Instant::now()));
    }

    /// What went wrong has been read.
    pub fn clear_failure(&mut self) {
        (self.failure, self.rendering) = (None, None);
    }

    pub fn failure(&self) -> Option<&str> {
        self.failure.as_deref().or(self.rendering.as_deref())
    }

    pub fn done(&self) -> Option<&str> {
        self.done.as_ref().filter(|(_, since)| since.elapsed() < SHOWN).map(|(text, _)| text.as_str())
    }
}
