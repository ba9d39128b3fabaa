//! What the modes of image-space techniques cost, as multiples of the points of as many photons in the same run: `cargo bench --bench photons`.
//!
//! A table of its own instead of criterion's: what counts are ratios, of runs that take turns. A frame is what the stage `photons` does when
//! something has changed: photons from the light, and the maps of what the camera sees and of what it does not.

use std::sync::Mutex;
use std::time::Instant;

use pinspot::blocking::wait;
use pinspot::image::Aov;
use pinspot::{
    Backend, BackendChoice, CubeSize, Engine, Hits, ImageSpaceOptions, Mode, Progress, Settings, Stage, Technique,
};

const PHOTONS: [u32; 3] = [512, 1024, 2048];
/// Runs of each mode, which take turns; the fastest counts.
const RUNS: usize = 3;

/// Seconds of the last frame's photons.
#[derive(Default)]
struct Stopwatch(Mutex<(Option<Instant>, f64)>);

impl Progress for Stopwatch {
    fn begin(&self, stage: Stage, _: u64) {
        if stage == Stage::Photons {
            self.0.lock().expect("no panic").0 = Some(Instant::now());
        }
    }

    fn advance(&self, _: u64) {}

    fn end(&self, stage: Stage) {
        let mut state = self.0.lock().expect("no panic");
        if let Some(begun) = state.0.take_if(|_| stage == Stage::Photons) {
            state.1 = begun.elapsed().as_secs_f64();
        }
    }
}

fn engine(backend: &Backend, mode: Mode, hits: Hits, photons: u32) -> Engine {
    let scene = pinspot::scene::load::<Settings>("ring").expect("built-in").scene;
    let image_space = ImageSpaceOptions { mode, hits, photons, light_directions: 1, ..Default::default() };
    let options = pinspot::Options::default()
        .with_technique(Technique::ImageSpace)
        .with_image_space(image_space)
        .with_size([512; 2])
        .with_cube_size(CubeSize::Texels(16))
        .with_aovs(vec![Aov::Caustic]);
    Engine::new(scene, options, backend.clone())
}

/// Seconds of a frame.
fn frame(engine: &mut Engine) -> f64 {
    engine.options_mut().seed += 1;
    let (stopwatch, backend) = (Stopwatch::default(), engine.backend().clone());
    wait(backend.device(), engine.render(&stopwatch)).expect("a picture");
    stopwatch.0.into_inner().expect("no panic").1
}

fn table(backend: &Backend, photons: u32) {
    let plain = Mode::ALL.map(|mode| (mode, Hits::Traced));
    let in_images = [Hits::Image, Hits::QuarterImage].map(|hits| (Mode::Points, hits));
    let kinds: Vec<(Mode, Hits)> = plain.into_iter().chain(in_images).collect();
    let mut engines: Vec<Engine> = kinds.iter().map(|(mode, hits)| engine(backend, *mode, *hits, photons)).collect();
    // Pipelines are compiled and pages touched in the first frame.
    for engine in &mut engines {
        frame(engine);
    }
    let mut best = vec![f64::INFINITY; engines.len()];
    for _ in 0..RUNS {
        for (best, engine) in best.iter_mut().zip(&mut engines) {
            *best = best.min(frame(engine));
        }
    }
    println!("\n{photons}² photons, {}", backend.report());
    println!("{:18} {:14} {:>10} {:>10}", "mode", "hits", "ms", "× points");
    for ((mode, hits), seconds) in kinds.iter().zip(&best) {
        println!("{:18} {:14} {:10.1} {:10.2}", mode.name(), hits.name(), 1e3 * seconds, seconds / best[0]);
    }
}

fn main() {
    let backends = [BackendChoice::Cpu, BackendChoice::Gpu(None)];
    for backend in backends.iter().filter_map(|choice| wait(None, Backend::open(choice)).ok()) {
        for photons in PHOTONS {
            table(&backend, photons);
        }
    }
}
