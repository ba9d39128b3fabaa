//! What the modes of image-space techniques cost, as multiples of the points of as many photons in the same run, and what traversals save, as
//! Table 1 of Wyman and Nichols 2009 has it: `cargo bench --bench photons`, or one of both with `-- modes` or `-- traversals`.
//!
//! A table of its own instead of criterion's: what counts are ratios, of runs that take turns. A frame is what the stage `photons` does when
//! something has changed: photons from the light, and the maps of what the camera sees and of what it does not. On software adapters, which
//! take minutes for them, the largest numbers of photons are left out.

use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

use pinspot::blocking::wait;
use pinspot::image::{Aov, Image, mrse, rel_l2};
use pinspot::scene::{Scene, parse};
use pinspot::{
    Backend, BackendChoice, BackendReport, CubeSize, Engine, Hits, ImageSpaceOptions, Mode, NoProgress,
    PhotonStatistics, Progress, Settings, Stage, Technique, Traversal,
};

const PHOTONS: [u32; 3] = [512, 1024, 2048];
const PHOTONS_AT_MOST: [u32; 3] = [2048, 4096, 8192];
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
    engine_of(backend, scene, (image_space, [512; 2]))
}

fn engine_of(backend: &Backend, scene: Scene, (image_space, size): (ImageSpaceOptions, [u32; 2])) -> Engine {
    let options = pinspot::Options::default()
        .with_technique(Technique::ImageSpace)
        .with_image_space(image_space)
        .with_size(size)
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

/// A glass ball in parallel light, which is focused near the floor.
const BALL: &str = r#"
[environment]
constant = [0, 0, 0]
[[light]]
directional = { direction = [0.2, 1, 0.1], irradiance = [1, 1, 1] }
[camera]
position = [0, 9, 0]
target = [0, 0, 0]
up = [0, 0, -1]
orthographic = { height = 2 }
[[object]]
name = "floor"
shape = { plane = { size = [8, 8] } }
receiver = {}
[[object]]
name = "ball"
shape = { sphere = { radius = 0.4, divisions = 96 } }
translate = [0, 0.62, 0]
refractor = { eta = 1.5, interfaces = 2 }
camera_visible = false
"#;

/// The ways of Table 1: every photon by rays or in images; those that are put together; where casters are; and where the map resolves them, the
/// rest as points or in several resolutions.
const WAYS: [(&str, Hits, Traversal, Mode); 7] = [
    ("dense", Hits::Traced, Traversal::Dense, Mode::Points),
    ("deferred, dense", Hits::Image, Traversal::Dense, Mode::Points),
    ("deferred, a quarter", Hits::QuarterImage, Traversal::Dense, Mode::Points),
    ("hierarchical", Hits::Traced, Traversal::Hierarchical, Mode::Points),
    ("maximal level", Hits::Traced, Traversal::MaximalLevel, Mode::Points),
    ("texel error", Hits::Traced, Traversal::TexelError, Mode::Points),
    ("several resolutions", Hits::Traced, Traversal::TexelError, Mode::MultiResolution),
];

fn ball(backend: &Backend, (hits, traversal, mode): (Hits, Traversal, Mode), photons: u32) -> Engine {
    let scene = parse::<Settings>("ball.toml", BALL, Path::new(".")).expect("a scene").scene;
    let image_space = ImageSpaceOptions { mode, hits, traversal, photons, ..Default::default() };
    engine_of(backend, scene, (image_space, [256; 2]))
}

fn picture(engine: &mut Engine) -> (Image, PhotonStatistics) {
    let backend = engine.backend().clone();
    let mut rendered = wait(backend.device(), engine.render(&NoProgress)).expect("a picture");
    (rendered.layers.remove(0).1, rendered.report.photons.expect("photons"))
}

fn table_of_traversals(backend: &Backend, photons: u32) {
    let truth = picture(&mut ball(backend, (Hits::Traced, Traversal::Dense, Mode::ExactPolygons), 2048)).0;
    let mut engines = WAYS.map(|(_, hits, traversal, mode)| ball(backend, (hits, traversal, mode), photons));
    let pictures = engines.each_mut().map(picture);
    let mut best = [f64::INFINITY; WAYS.len()];
    // Of these pictures, each takes up to a minute.
    for _ in 0..if photons < 8192 { RUNS } else { 1 } {
        for (best, engine) in best.iter_mut().zip(&mut engines) {
            *best = best.min(frame(engine));
        }
    }
    println!("\n{photons}² photons at most, glass ball, {}", backend.report());
    println!("{:20} {:>10} {:>10} {:>8} {:>8} {:>8} {:>8}", "", "followed", "kept", "ms", "× dense", "rel_l2", "mrse");
    for (((name, ..), (image, of)), seconds) in WAYS.iter().zip(&pictures).zip(best) {
        let errors = [rel_l2(image, &truth, None), mrse(image, &truth, None)];
        let (ms, ratio) = (1e3 * seconds, seconds / best[0]);
        println!(
            "{name:20} {:10} {:10} {ms:8.1} {ratio:8.2} {:8.4} {:8.3}",
            of.photons, of.photons_used, errors[0], errors[1]
        );
    }
}

fn main() {
    let asked: Vec<String> = std::env::args().collect();
    let is_asked =
        |table: &str, other: &str| asked.iter().any(|arg| arg == table) || !asked.iter().any(|arg| arg == other);
    let [modes, traversals] = [is_asked("modes", "traversals"), is_asked("traversals", "modes")];
    let backends = [BackendChoice::Cpu, BackendChoice::Gpu(None)];
    for backend in backends.iter().filter_map(|choice| wait(None, Backend::open(choice)).ok()) {
        let is_software = matches!(backend.report(), BackendReport::Gpu { adapter } if adapter.software);
        for photons in PHOTONS.into_iter().filter(|_| modes).take(if is_software { 2 } else { 3 }) {
            table(&backend, photons);
        }
        for photons in PHOTONS_AT_MOST.into_iter().filter(|_| traversals).take(if is_software { 1 } else { 3 }) {
            table_of_traversals(&backend, photons);
        }
    }
}
