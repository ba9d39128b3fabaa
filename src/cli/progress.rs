//! The progress bar on a terminal's stderr, and the time that each stage takes. This is the only clock of a render.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use pinspot::{Progress, Stage};
use serde::ser::{Serialize, SerializeMap, Serializer};

/// A stopwatch, and a progress bar if it is shown.
pub struct Watch {
    started: Instant,
    state: Mutex<State>,
}

struct State {
    bar: ProgressBar,
    stage_began: Instant,
    seconds: Seconds,
}

/// Seconds per stage, in the order in which the stages first began, and in total.
#[derive(Clone, Debug, Default)]
pub struct Seconds {
    stages: Vec<(Stage, f64)>,
    pub total: f64,
}

impl Seconds {
    /// The sum over these stages.
    pub fn of(&self, stages: &[Stage]) -> f64 {
        self.stages.iter().filter(|(stage, _)| stages.contains(stage)).fold(0.0, |sum, (_, seconds)| sum + seconds)
    }
}

impl Serialize for Seconds {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.stages.len() + 1))?;
        for (stage, seconds) in &self.stages {
            map.serialize_entry(stage.name(), seconds)?;
        }
        map.serialize_entry("total", &self.total)?;
        map.end()
    }
}

impl Watch {
    pub fn new(is_shown: bool) -> Self {
        let bar = if is_shown {
            ProgressBar::with_draw_target(Some(1), ProgressDrawTarget::stderr())
        } else {
            ProgressBar::hidden()
        };
        let style = ProgressStyle::with_template("{msg:24} [{bar:32}] {percent:>3} %  {elapsed} (left: {eta})");
        bar.set_style(style.expect("the template is valid").progress_chars("=> "));
        bar.enable_steady_tick(Duration::from_millis(200));
        let now = Instant::now();
        Self { started: now, state: Mutex::new(State { bar, stage_began: now, seconds: Seconds::default() }) }
    }

    /// Removes the bar from the screen.
    pub fn finish(&self) {
        self.state().bar.finish_and_clear();
    }

    /// Seconds per stage so far.
    pub fn seconds(&self) -> Seconds {
        Seconds { total: self.elapsed(), ..self.state().seconds.clone() }
    }

    /// Seconds since the start.
    pub fn elapsed(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().expect("no panic holds the lock")
    }
}

impl Progress for Watch {
    fn begin(&self, stage: Stage, total: u64) {
        let mut state = self.state();
        state.stage_began = Instant::now();
        state.bar.reset();
        state.bar.set_length(total);
        state.bar.set_message(stage.activity());
    }

    fn advance(&self, steps: u64) {
        let bar = self.state().bar.clone();
        bar.inc(steps);
    }

    fn end(&self, stage: Stage) {
        let mut state = self.state();
        let seconds = state.stage_began.elapsed().as_secs_f64();
        match state.seconds.stages.iter_mut().find(|(known, _)| *known == stage) {
            Some((_, sum)) => *sum += seconds,
            None => state.seconds.stages.push((stage, seconds)),
        }
    }
}
