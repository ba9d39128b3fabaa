//! Frames of the interactive window without a window: everything moves, light is filtered, both legs are shadowed. Beside the frames per
//! second that Wand and Straßer report for the same sample counts (Figures 6 and 7, unfiltered, without visibility).

use std::sync::Mutex;
use std::time::Instant;

use pinspot::blocking::wait;
use pinspot::scene::Scene;
use pinspot::{Backend, Detail, Engine, EvaluationChoice, NoProgress, Progress, Stage};

/// Scene, samples, and the paper's frames per second.
const SCENES: [(&str, u32, f64); 5] = [
    ("spoon", 60, 19.0),
    ("ring-natural", 103, 13.0),
    ("ring-solid", 154, 6.4),
    ("dynamic", 200, 9.6),
    ("cup", 354, 4.9),
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

fn main() -> Result<(), pinspot::Error> {
    println!(
        "| scene | samples | paper, frames per second | preview | whole picture, flat | ratio | milliseconds by stage |"
    );
    println!("|---|---|---|---|---|---|---|");
    for (name, samples, paper) in SCENES {
        let (scene, options) = pinspot::load(name)?;
        let options = options.with_size([SIZE; 2]).with_samples(samples).with_evaluation(EvaluationChoice::Flat);
        let mut engine = Engine::new(scene, options, Backend::cpu());
        let detail =
            Detail { size: [SIZE; 2], samples, taps: 16, spacing: SPACING, shadow_directions: SHADOW_DIRECTIONS };
        wait(None, engine.preview(&detail, &NoProgress))?;
        let stages = Stages::default();
        let began = Instant::now();
        for frame in 1..=FRAMES {
            move_everything(engine.scene_mut(), frame);
            wait(None, engine.preview(&detail, &stages))?;
        }
        let preview = f64::from(FRAMES) / began.elapsed().as_secs_f64();
        let began = Instant::now();
        wait(None, engine.render(&NoProgress))?;
        let whole = 1.0 / began.elapsed().as_secs_f64();
        let stages = stages.0.into_inner().unwrap().seconds;
        let stages: Vec<String> = stages
            .iter()
            .map(|(stage, seconds)| (stage, 1000.0 * seconds / f64::from(FRAMES)))
            .filter(|(_, milliseconds)| *milliseconds > 0.5)
            .map(|(stage, milliseconds)| format!("{stage} {milliseconds:.0}"))
            .collect();
        println!(
            "| {name} | {samples} | {paper} | {preview:.1} | {whole:.2} | {:.1} | {} |",
            preview / whole,
            stages.join(", ")
        );
    }
    Ok(())
}
