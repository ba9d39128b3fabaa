//! A picture that nobody waits for any more ends early, and leaves nothing incomplete behind.

use std::sync::atomic::{AtomicBool, Ordering};

use pinspot::{Backend, Engine, Error, NoProgress, Progress, Stage, blocking};

/// Cancels when a stage begins.
struct CancelAt {
    stage: Stage,
    has_begun: AtomicBool,
}

impl Progress for CancelAt {
    fn begin(&self, stage: Stage, _: u64) {
        if stage == self.stage {
            self.has_begun.store(true, Ordering::Relaxed);
        }
    }

    fn advance(&self, _: u64) {}

    fn end(&self, _: Stage) {}

    fn is_cancelled(&self) -> bool {
        self.has_begun.load(Ordering::Relaxed)
    }
}

#[test]
fn a_cancelled_picture_leaves_no_incomplete_stage_behind() {
    let engine = || {
        let (scene, options) = pinspot::load("columns").unwrap();
        Engine::new(scene, options.with_size([32, 24]).with_samples(60).with_leaves(Some(4)), Backend::cpu())
    };
    let whole = blocking::wait(None, engine().render(&NoProgress)).unwrap();
    let stages = [
        Stage::Geometry,
        Stage::Light,
        Stage::Tree,
        Stage::Visibility,
        Stage::Estimate,
        Stage::Direct,
        Stage::Caustic,
        Stage::Paths,
        Stage::PathEnds,
        Stage::Shading,
    ];
    for stage in stages {
        let mut engine = engine();
        let progress = CancelAt { stage, has_begun: AtomicBool::new(false) };
        let cancelled = blocking::wait(None, engine.render(&progress));
        assert!(matches!(cancelled, Err(Error::Cancelled)), "{stage}: {:?}", cancelled.err());
        let again = blocking::wait(None, engine.render(&NoProgress)).unwrap();
        assert!(again.layers == whole.layers, "{stage}: the picture differs after a cancelled one");
    }
}
