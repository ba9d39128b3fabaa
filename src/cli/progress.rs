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
    stage: Option<RunningStage>,
    stage_began: Instant,
    seconds: Seconds,
}

/// A stage that has begun, and how much of it is done.
#[derive(Clone, Copy)]
struct RunningStage {
    stage: Stage,
    steps: u64,
    total: u64,
}

/// The bar of a picture ends here, whatever the numbers of steps of its stages.
const WHOLE: u64 = 1000;

/// What stages of a picture take of its time, roughly. They only say how far the bar moves in each.
fn weight(stage: Stage) -> u64 {
    match stage {
        Stage::Caustic => 30,
        Stage::PathEnds => 25,
        Stage::Photons | Stage::Scattering => 15,
        Stage::Paths => 8,
        Stage::Direct | Stage::Visibility => 5,
        _ => 1,
    }
}

impl RunningStage {
    /// The part of a picture that is done, as if all of its stages were needed; `None` for what is no stage of a picture.
    fn part_of_picture(&self) -> Option<f64> {
        let place = Stage::ENGINE.iter().position(|stage| *stage == self.stage)?;
        let before: u64 = Stage::ENGINE[..place].iter().map(|stage| weight(*stage)).sum();
        let all: u64 = Stage::ENGINE.iter().map(|stage| weight(*stage)).sum();
        let done = self.steps.min(self.total) as f64 / self.total.max(1) as f64;
        Some((before as f64 + done * weight(self.stage) as f64) / all as f64)
    }
}

impl State {
    /// Moves the bar of a picture; never back, as stages that were left out are passed by.
    fn show_part_of_picture(&self) {
        if let Some(part) = self.stage.and_then(|stage| stage.part_of_picture()) {
            self.bar.set_position(((part * WHOLE as f64) as u64).max(self.bar.position()));
        }
    }
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
        bar.enable_steady_tick(Duration::from_millis(200));
        let now = Instant::now();
        let state = State { bar, stage: None, stage_began: now, seconds: Seconds::default() };
        Self { started: now, state: Mutex::new(state) }
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
        let ends_picture = |before: Stage| before == Stage::Display || !Stage::ENGINE.contains(&before);
        let is_next_picture = state.stage.is_none_or(|before| ends_picture(before.stage));
        let is_of_picture = Stage::ENGINE.contains(&stage);
        if !is_of_picture || is_next_picture {
            state.bar.reset();
            state.bar.set_length(if is_of_picture { WHOLE } else { total });
            state.bar.set_style(style(!is_of_picture));
        }
        state.stage = Some(RunningStage { stage, steps: 0, total });
        state.bar.set_message(stage.activity());
        state.show_part_of_picture();
    }

    fn advance(&self, steps: u64) {
        let mut state = self.state();
        match &mut state.stage {
            Some(running) if Stage::ENGINE.contains(&running.stage) => {
                running.steps += steps;
                state.show_part_of_picture();
            }
            _ => state.bar.inc(steps),
        }
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

/// How a bar looks. The time that is left follows from the part that is done only where all of it is of one kind.
fn style(has_time_left: bool) -> ProgressStyle {
    let template = if has_time_left {
        "{msg:24} [{bar:32}] {percent:>3} %  {elapsed} (left: {eta})"
    } else {
        "{msg:24} [{bar:32}] {percent:>3} %  {elapsed}"
    };
    ProgressStyle::with_template(template).expect("the template is valid").progress_chars("=> ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_of_a_picture_never_goes_back_and_starts_anew_for_the_next() {
        let watch = Watch::new(false);
        let mut last = 0;
        let mut advance = |stage: Stage| {
            watch.begin(stage, 4);
            for _ in 0..4 {
                watch.advance(1);
                let position = watch.state().bar.position();
                assert!(position >= last, "{stage:?}: {position} after {last}");
                last = position;
            }
            watch.end(stage);
        };
        // Points are placed after the environment has been prepared, or before.
        [Stage::Geometry, Stage::Points, Stage::Light, Stage::Caustic, Stage::PathEnds, Stage::Display]
            .into_iter()
            .for_each(&mut advance);
        assert_eq!(last, WHOLE);
        watch.begin(Stage::Rays, 4);
        assert!(watch.state().bar.position() < WHOLE / 2);
    }

    #[test]
    fn other_work_is_counted_by_its_own_steps() {
        let watch = Watch::new(false);
        watch.begin(Stage::Device, 1);
        watch.advance(1);
        watch.begin(Stage::Geometry, 1);
        let bar = watch.state().bar.clone();
        assert_eq!((bar.position(), bar.length()), (0, Some(WHOLE)));
        watch.begin(Stage::Reference, 50);
        watch.advance(20);
        assert_eq!((bar.position(), bar.length()), (20, Some(50)));
    }
}
