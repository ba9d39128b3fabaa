//! A turntable: 36 frames of a turning mirror under a turning light, seen by a camera that circles them, all from one engine.
//!
//! ```sh
//! cargo run --release --example turntable -- ring-natural target/turntable
//! ```
//!
//! writes `frame00.png` to `frame35.png` and prints the seconds that each stage took for each frame: what did not change is not
//! made again.

use std::f32::consts::TAU;
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::Instant;

use glam::{Quat, Vec3};
use pinspot::blocking::wait;
use pinspot::image::write_png;
use pinspot::scene::Scene;
use pinspot::{Backend, BackendChoice, Engine, Error, Progress, Stage};

const FRAMES: u32 = 36;
const SIZE: [u32; 2] = [256, 256];

fn main() -> Result<(), Error> {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().unwrap_or_else(|| "ring-natural".to_owned());
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "target/turntable".to_owned()));
    std::fs::create_dir_all(&folder).expect("the folder can be made");

    let (scene, options) = pinspot::load(&scene)?;
    let start = scene.clone();
    let backend = wait(None, Backend::open(&BackendChoice::Auto))?;
    let mut engine = Engine::new(scene, options.with_size(SIZE), backend.clone());
    print_header();
    for frame in 0..FRAMES {
        let turn = TAU * frame as f32 / FRAMES as f32;
        pose(engine.scene_mut(), &start, turn);
        let clock = StageClock::default();
        let rendered = wait(backend.device(), engine.render(&clock))?;
        write_png(&folder.join(format!("frame{frame:02}.png")), &rendered.displayed(&engine.options().display))?;
        clock.print(frame);
    }
    Ok(())
}

/// The mirrors turn by a whole turn, the light by half of one, and the camera circles them by a tenth.
fn pose(scene: &mut Scene, start: &Scene, turn: f32) {
    for (object, first) in scene.objects.iter_mut().zip(&start.objects) {
        if first.reflector.is_some() {
            object.placement.rotate_rad.y = first.placement.rotate_rad.y + turn;
        }
    }
    scene.environment.rotation_rad = start.environment.rotation_rad + 0.5 * turn;
    let around = Quat::from_rotation_y(0.1 * turn);
    let rotated = |v: Vec3| around * v;
    scene.camera.position = rotated(start.camera.position);
    scene.camera.forward = rotated(start.camera.forward);
    scene.camera.right = rotated(start.camera.right);
    scene.camera.up = rotated(start.camera.up);
}

/// Seconds per stage of one frame.
#[derive(Default)]
struct StageClock(Mutex<StageTimes>);

#[derive(Default)]
struct StageTimes {
    began: Option<Instant>,
    seconds: Vec<(Stage, f64)>,
}

impl Progress for StageClock {
    fn begin(&self, _: Stage, _: u64) {
        self.0.lock().expect("no panic holds the lock").began = Some(Instant::now());
    }

    fn advance(&self, _: u64) {}

    fn end(&self, stage: Stage) {
        let mut times = self.0.lock().expect("no panic holds the lock");
        let elapsed = times.began.take().map_or(0.0, |began| began.elapsed().as_secs_f64());
        times.seconds.push((stage, elapsed));
    }
}

impl StageClock {
    fn print(&self, frame: u32) {
        let seconds = &self.0.lock().expect("no panic holds the lock").seconds;
        let of = |stage: Stage| seconds.iter().filter(|(s, _)| *s == stage).map(|(_, t)| t).sum::<f64>();
        // A stage that was not made again shows as nothing.
        let cell = |stage: Stage| {
            if seconds.iter().any(|(s, _)| *s == stage) {
                format!("{:>15.3}", of(stage))
            } else {
                format!("{:>15}", "-")
            }
        };
        let cells: Vec<String> = Stage::ENGINE.into_iter().map(cell).collect();
        println!("{frame:>5}{}{:>15.3}", cells.concat(), seconds.iter().map(|(_, t)| t).sum::<f64>());
    }
}

fn print_header() {
    let names: Vec<String> = Stage::ENGINE.iter().map(|stage| format!("{:>15}", stage.name())).collect();
    println!("frame{}{:>15}", names.concat(), "all");
}
