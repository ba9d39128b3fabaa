//! The seconds of each stage, and whether a picture is still wanted.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use pinspot_base::progress::{Progress, Stage};

/// Seconds by stage, in the order in which they began.
pub type StageSeconds = Vec<(Stage, f64)>;

/// Measures stages. Cancelled once a flag is set.
pub struct Stopwatch<'a> {
    is_cancelled: Option<&'a AtomicBool>,
    state: Mutex<(Instant, StageSeconds)>,
}

impl<'a> Stopwatch<'a> {
    pub fn new(is_cancelled: Option<&'a AtomicBool>) -> Self {
        Self { is_cancelled, state: Mutex::new((Instant::now(), Vec::new())) }
    }

    pub fn seconds(self) -> StageSeconds {
        self.state.into_inner().unwrap_or_else(PoisonError::into_inner).1
    }
}

impl Progress for Stopwatch<'_> {
    fn begin(&self, _: Stage, _: u64) {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).0 = Instant::now();
    }

    fn advance(&self, _: u64) {}

    fn end(&self, stage: Stage) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let seconds = state.0.elapsed().as_secs_f64();
        match state.1.iter_mut().find(|(known, _)| *known == stage) {
            Some((_, sum)) => *sum += seconds,
            None => state.1.push((stage, seconds)),
        }
    }

    fn is_cancelled(&self) -> bool {
        self.is_cancelled.is_some_and(|flag| flag.load(Ordering::Relaxed))
    }
}
