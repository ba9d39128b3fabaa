//! The progress bar on a terminal's stderr.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use pinspot::Progress;

/// A bar, or nothing where stderr is no terminal or the user wants it quiet.
pub struct Bar(Mutex<ProgressBar>);

impl Bar {
    pub fn new(quiet: bool) -> Self {
        let bar = if quiet || !std::io::stderr().is_terminal() {
            ProgressBar::hidden()
        } else {
            ProgressBar::with_draw_target(Some(1), ProgressDrawTarget::stderr())
        };
        let style = ProgressStyle::with_template("{msg:24} [{bar:32}] {percent:>3} %  {elapsed} (left: {eta})");
        bar.set_style(style.expect("the template is valid").progress_chars("=> "));
        bar.enable_steady_tick(Duration::from_millis(200));
        Self(Mutex::new(bar))
    }

    /// Takes the bar off the screen.
    pub fn finish(&self) {
        self.bar().finish_and_clear();
    }

    fn bar(&self) -> ProgressBar {
        self.0.lock().expect("no panic holds the lock").clone()
    }
}

impl Progress for Bar {
    fn begin(&self, stage: &str, total: u64) {
        let bar = self.bar();
        bar.reset();
        bar.set_length(total);
        bar.set_message(stage.to_owned());
    }

    fn advance(&self, steps: u64) {
        self.bar().inc(steps);
    }
}
