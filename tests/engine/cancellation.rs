//! A picture that nobody waits for any more ends early, and leaves nothing incomplete behind.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use pinspot::{
    Backend, CubeSize, Engine, Error, EvaluationChoice, ImageSpaceOptions, NoProgress, Progress, Stage, blocking,
};

use crate::support::{above_floor, gpu_backend, photon_options};

/// Cancels when a stage begins.
struct CancelAt {
    stage: Stage,
    has_begun: AtomicBool,
    /// Stages of the picture that began afterwards.
    later: Mutex<Vec<Stage>>,
}

impl CancelAt {
    fn new(stage: Stage) -> Self {
        Self { stage, has_begun: AtomicBool::new(false), later: Mutex::default() }
    }
}

/// The stages that follow when everything is prepared, as far as they take long.
const OF_PICTURE: [Stage; 7] =
    [Stage::Rays, Stage::Caustic, Stage::Direct, Stage::Scattering, Stage::Paths, Stage::PathEnds, Stage::Shading];

impl Progress for CancelAt {
    fn begin(&self, stage: Stage, _: u64) {
        if stage == self.stage {
            self.has_begun.store(true, Ordering::Relaxed);
        } else if self.is_cancelled() && OF_PICTURE.contains(&stage) {
            self.later.lock().unwrap().push(stage);
        }
    }

    fn advance(&self, _: u64) {}

    fn end(&self, _: Stage) {}

    fn is_cancelled(&self) -> bool {
        self.has_begun.load(Ordering::Relaxed)
    }
}

/// Cancels pictures when each of some stages begins, and renders them again.
fn check(backend: &Backend, (samples, leaves): (u32, Option<u32>), stages: &[Stage]) {
    let engine = || {
        let (scene, options) = pinspot::load("columns").unwrap();
        let options = options.with_size([24, 18]).with_samples(samples).with_leaves(leaves);
        let options = options.with_cube_size(CubeSize::Texels(64));
        let evaluation = if leaves.is_some() { EvaluationChoice::Hierarchical } else { EvaluationChoice::Flat };
        Engine::new(scene, options.with_evaluation(evaluation), backend.clone())
    };
    let whole = blocking::wait(backend.device(), engine().render(&NoProgress)).unwrap();
    for &stage in stages {
        let mut engine = engine();
        let progress = CancelAt::new(stage);
        let cancelled = blocking::wait(backend.device(), engine.render(&progress));
        assert!(matches!(cancelled, Err(Error::Cancelled)), "{stage}: {:?}", cancelled.err());
        // The window waits for the end before it shows what was asked for.
        assert_eq!(*progress.later.lock().unwrap(), [], "{stage}");
        let again = blocking::wait(backend.device(), engine.render(&NoProgress)).unwrap();
        assert!(again.layers == whole.layers, "{stage}: the picture differs after a cancelled one");
    }
}

#[test]
fn a_cancelled_picture_leaves_no_incomplete_stage_behind() {
    let stages =
        [Stage::Geometry, Stage::Tree, Stage::Visibility, Stage::Direct, Stage::Caustic, Stage::Paths, Stage::Shading];
    check(&Backend::cpu(), (60, Some(4)), &stages);
}

#[test]
#[ignore = "full: a new engine on a software adapter for each stage"]
fn nor_does_one_on_a_gpu() {
    let gpu = gpu_backend();
    check(&gpu, (60, Some(4)), &[Stage::Visibility, Stage::Caustic]);
    // More maps than a dispatch traces.
    check(&gpu, (300, None), &[Stage::Visibility]);
}

/// Photons that are sent until their halves agree end, too.
#[test]
fn passes_of_photons_end_when_cancelled() {
    let sun = "spot = { direction = [0.36, 0.8, 0.48], sigma_rad = 0.05, radiance = [1e3, 1e3, 1e3] }";
    let ball = "[[object]]\nshape = { sphere = { radius = 0.3 } }\ntranslate = [0, 0.5, 0]\nreflector = {}\n";
    let options = photon_options(ImageSpaceOptions { photons: 64, ..Default::default() }).with_size([24, 24]);
    let mut engine = Engine::new(above_floor(sun, ball), options, Backend::cpu());
    let progress = CancelAt::new(Stage::Photons);
    assert!(matches!(blocking::wait(None, engine.render(&progress)), Err(Error::Cancelled)));
    let again = blocking::wait(None, engine.render(&NoProgress)).unwrap();
    assert!(again.report.photons.unwrap().passes.unwrap().photon_passes >= 2);
}
