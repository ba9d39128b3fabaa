//! The seconds of each stage, how far it is, and whether a picture is still wanted.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use pinspot_base::progress::{Progress, Stage};

/// Seconds by stage, in the order in which they began.
pub type StageSeconds = Vec<(Stage, f64)>;

/// The current stage, and the part of it that is done, from 0 to 1.
pub type CurrentStage = Mutex<Option<(Stage, f32)>>;

/// Measures stages. Cancelled once a flag is set.
pub struct Stopwatch<'a> {
    is_cancelled: Option<&'a AtomicBool>,
    shared: Option<&'a CurrentStage>,
    state: Mutex<State>,
}

struct State {
    /// Of the current stage.
    began: Instant,
    /// The current stage, its steps, and how many of them are done.
    current: Option<(Stage, u64, u64)>,
    seconds: StageSeconds,
}

impl<'a> Stopwatch<'a> {
    pub fn new(is_cancelled: Option<&'a AtomicBool>) -> Self {
        let state = State { began: Instant::now(), current: None, seconds: Vec::new() };
        Self { is_cancelled, shared: None, state: Mutex::new(state) }
    }

    /// Keeps a record of how far the current stage is.
    pub fn recorded(self, shared: &'a CurrentStage) -> Self {
        Self { shared: Some(shared), ..self }
    }

    pub fn seconds(self) -> StageSeconds {
        self.state.into_inner().unwrap_or_else(PoisonError::into_inner).seconds
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn record(&self, state: &State) {
        let Some(shared) = self.shared else { return };
        let current = state.current.map(|(stage, total, done)| (stage, (done as f32 / total.max(1) as f32).min(1.0)));
        *shared.lock().unwrap_or_else(PoisonError::into_inner) = current;
    }
}

impl Progress for Stopwatch<'_> {
    fn begin(&self, stage: Stage, total: u64) {
        let mut state = self.state();
        (state.began, state.current) = (Instant::now(), Some((stage, total, 0)));
        self.record(&state);
    }

    fn advance(&self, steps: u64) {
        let mut state = self.state();
        if let Some((_, _, done)) = &mut state.current {
            *done += steps;
        }
        self.record(&state);
    }

    fn end(&self, stage: Stage) {
        let mut state = self.state();
        let seconds = state.began.elapsed().as_secs_f64();
        state.current = None;
        self.record(&state);
        match state.seconds.iter_mut().find(|(known, _)| *known == stage) {
            Some((_, sum)) => *sum += seconds,
            None => state.seconds.push((stage, seconds)),
        }
    }

    fn is_cancelled(&self) -> bool {
        self.is_cancelled.is_some_and(|flag| flag.load(Ordering::Relaxed))
    }
}
