//! Frames of the interactive window without a window: everything moves, light is filtered, both legs are shadowed. Beside the frames per
//! second that Wand and Straßer report for the same sample counts (Figures 6 and 7, unfiltered, without visibility).
//!
//! `cargo bench --bench frames -- errors` measures instead how far the irradiance of caustics in these frames is from the ground truth,
//! beside that of whole pictures of the same samples. This takes some minutes. Names of scenes measure these alone; `previews` leaves
//! whole pictures out, for a profiler.

use std::f32::consts::PI;
use std::sync::Mutex;
use std::time::Instant;

use pinspot::blocking::wait;
use pinspot::glam::Vec3;
use pinspot::image::{Aov, Image, ToneMap, rel_l2};
use pinspot::reference::{self, Quantity, Reference, StoppingCriterion};
use pinspot::scene::{Scene, Visibility};
use pinspot::{Backend, Detail, Engine, EvaluationChoice, Exposure, NoProgress, Options, Progress, Stage};

/// Scene, samples, and the paper's frames per second, where it reports them.
const SCENES: [(&str, u32, Option<f64>); 10] = [
    ("spoon", 60, Some(19.0)),
    ("ring-natural", 103, Some(13.0)),
    ("ring-solid", 154, Some(6.4)),
    ("dynamic", 200, Some(9.6)),
    ("cup", 354, Some(4.9)),
    ("sheet", 200, None),
    ("disco-ball", 200, None),
    ("candle", 200, None),
    ("pool", 200, None),
    ("dance-floor", 200, None),
];
/// Edge of the picture, as in the paper.
const SIZE: u32 = 400;
/// Frames of each measurement, and their rate.
const FRAMES: u32 = 24;
const FRAMES_PER_SECOND: f32 = 24.0;
/// Pixels between those in which light is computed.
const SPACING: u32 = 4;
const SHADOW_DIRECTIONS: u32 = 32;

/// Adds up the seconds of each stage.
#[derive(Default)]
struct Stages(Mutex<StageTimes>);

#[derive(Default)]
struct StageTimes {
    began: Option<Instant>,
    seconds: Vec<(Stage, f64)>,
}

impl Progress for Stages {
    fn begin(&self, _: Stage, _: u64) {
        self.0.lock().unwrap().began = Some(Instant::now());
    }

    fn advance(&self, _: u64) {}

    fn end(&self, stage: Stage) {
        let mut state = self.0.lock().unwrap();
        let seconds = state.began.map_or(0.0, |began| began.elapsed().as_secs_f64());
        match state.seconds.iter_mut().find(|(known, _)| *known == stage) {
            Some((_, sum)) => *sum += seconds,
            None => state.seconds.push((stage, seconds)),
        }
    }
}

/// The scene's own animation, and beside it the light and every mirror.
fn move_everything(scene: &mut Scene, frame: u32) {
    scene.pose(frame as f32 / FRAMES_PER_SECOND);
    scene.environment.rotation_rad += 0.01;
    for object in scene.objects.iter_mut().filter(|object| object.reflector.is_some()) {
        object.placement.translate.x += 0.002;
    }
}

fn detail(size: [u32; 2], samples: u32) -> Detail {
    Detail { size, samples, taps: 16, spacing: SPACING, shadow_directions: SHADOW_DIRECTIONS, reuses_light: false }
}

fn main() -> Result<(), pinspot::Error> {
    if is_asked_for("errors") { errors() } else { speeds() }
}

fn is_asked_for(what: &str) -> bool {
    std::env::args().any(|argument| argument == what)
}

/// The scenes that are named on the command line, or all.
fn scenes() -> impl Iterator<Item = (&'static str, u32, Option<f64>)> {
    let are_named = SCENES.iter().any(|(name, ..)| is_asked_for(name));
    SCENES.into_iter().filter(move |(name, ..)| !are_named || is_asked_for(name))
}

fn speeds() -> Result<(), pinspot::Error> {
    println!(
        "| scene | samples | paper, frames per second | preview | whole picture, flat | ratio | milliseconds by stage |"
    );
    println!("|---|---|---|---|---|---|---|");
    for (name, samples, paper) in scenes() {
        let (scene, options) = pinspot::load(name)?;
        let options = options.with_size([SIZE; 2]).with_samples(samples).with_evaluation(EvaluationChoice::Flat);
        let mut engine = Engine::new(scene, options, Backend::cpu());
        let detail = detail([SIZE; 2], samples);
        wait(None, engine.preview(&detail, &NoProgress))?;
        let stages = Stages::default();
        let began = Instant::now();
        for frame in 1..=FRAMES {
            move_everything(engine.scene_mut(), frame);
            wait(None, engine.preview(&detail, &stages))?;
        }
        let preview = f64::from(FRAMES) / began.elapsed().as_secs_f64();
        let began = Instant::now();
        if !is_asked_for("previews") {
            wait(None, engine.render(&NoProgress))?;
        }
        let whole = 1.0 / began.elapsed().as_secs_f64();
        let stages = stages.0.into_inner().unwrap().seconds;
        let stages: Vec<String> = stages
            .iter()
            .map(|(stage, seconds)| (stage, 1000.0 * seconds / f64::from(FRAMES)))
            .filter(|(_, milliseconds)| *milliseconds > 0.5)
            .map(|(stage, milliseconds)| format!("{stage} {milliseconds:.0}"))
            .collect();
        let paper = paper.map_or_else(String::new, |paper| paper.to_string());
        println!(
            "| {name} | {samples} | {paper} | {preview:.1} | {whole:.2} | {:.1} | {} |",
            preview / whole,
            stages.join(", ")
        );
    }
    Ok(())
}

/// Frames whose errors are measured.
const MEASURED_FRAMES: [u32; 2] = [12, 36];
/// Every so manyth pixel is measured, along both axes: the ground truth of all of them takes hours. Odd, and no multiple of the spacing.
const STEP: u32 = 5;
const MEASURED_SIZE: u32 = SIZE / STEP;
/// Relative standard error of the ground truth.
const TRUTH_ERROR: f64 = 0.03;
/// Makes direct light negligible in previews, which show all light together.
const GAIN: f32 = 1000.0;

/// The relative error of the caustic's irradiance, RMS over the pixels that see a receiver, mean over frames.
fn errors() -> Result<(), pinspot::Error> {
    println!("| scene | samples | whole picture, flat | preview | difference |");
    println!("|---|---|---|---|---|");
    for (name, samples, _) in scenes() {
        let mut sums = [0.0; 2];
        for frame in MEASURED_FRAMES {
            let (mut scene, options) = pinspot::load(name)?;
            move_everything(&mut scene, frame);
            // The camera looks through mirrors, whose images of caustics would be measured with their receivers.
            for mirror in scene.objects.iter_mut().filter(|object| object.reflector.is_some()) {
                mirror.camera_visible = false;
            }
            let truth = truth(&scene)?;
            let [whole, preview, mask] = irradiances(scene, options.with_samples(samples))?;
            let mask: Vec<bool> = mask.pixels.iter().map(|p| p.x > 0.0).collect();
            for (sum, found) in sums.iter_mut().zip([whole, preview]) {
                *sum += rel_l2(&found, &truth, Some(&mask)) / MEASURED_FRAMES.len() as f64;
            }
        }
        let [whole, preview] = sums;
        println!("| {name} | {samples} | {whole:.3} | {preview:.3} | {:+.3} |", preview - whole);
    }
    Ok(())
}

fn truth(scene: &Scene) -> Result<Image, pinspot::Error> {
    let options = reference::Options {
        size: [MEASURED_SIZE; 2],
        quantity: Quantity::Caustic,
        visibility: Visibility::Full,
        ..Default::default()
    };
    let goal = StoppingCriterion::new(TRUTH_ERROR);
    Ok(Reference::new(scene.clone(), options)?.solve(&goal, None, &NoProgress, &mut |_| Ok(()))?.irradiance)
}

/// The caustic's irradiance in a whole picture and in a preview, W/m², and 1 where all pixels around see the same receiver: at the
/// measured pixels.
fn irradiances(scene: Scene, options: Options) -> Result<[Image; 3], pinspot::Error> {
    let samples = options.samples;
    let mut display = options.display;
    // Nothing is cut off.
    (display.exposure, display.tone_map) = (Exposure::Stops(-40.0), ToneMap::Linear);
    let aovs = [Aov::Caustic, Aov::Direct, Aov::Albedo, Aov::Normal];
    let options = options
        .with_size([SIZE; 2])
        .with_evaluation(EvaluationChoice::Flat)
        .with_pixel_samples(1)
        .with_aovs(aovs.to_vec())
        .with_display(display);
    let mut engine = Engine::new(scene, options, Backend::cpu());
    let whole = wait(None, engine.render(&NoProgress))?;
    let [caustic, direct, albedo, normal] = aovs.map(|aov| whole.layer(aov).expect("it was asked for"));
    engine.options_mut().caustic_gain = GAIN;
    let shown = wait(None, engine.preview(&detail([SIZE; 2], samples), &NoProgress))?;
    let per_value = PI * (-shown.exposures.exposure_ev).exp2();
    let mut measured = [0; 3].map(|_| Image::new(MEASURED_SIZE, MEASURED_SIZE));
    for k in 0..MEASURED_SIZE * MEASURED_SIZE {
        let pixel = |x: u32, y: u32| {
            ((STEP / 2 + STEP * (k / MEASURED_SIZE) + y - 1) * SIZE + STEP / 2 + STEP * (k % MEASURED_SIZE) + x - 1)
                as usize
        };
        let own = pixel(1, 1);
        // Edges are anti-aliased.
        let is_alike = |other: usize| {
            albedo.pixels[other] == albedo.pixels[own] && normal.pixels[other].dot(normal.pixels[own]) > 0.9
        };
        if albedo.pixels[own].min_element() > 0.0 && (0..9).all(|k| is_alike(pixel(k % 3, k / 3))) {
            let found = (per_value * shown.image.pixels[own] / albedo.pixels[own] - direct.pixels[own]) / GAIN;
            for (image, value) in measured.iter_mut().zip([caustic.pixels[own], found, Vec3::ONE]) {
                image.pixels[k as usize] = value;
            }
        }
    }
    Ok(measured)
}
