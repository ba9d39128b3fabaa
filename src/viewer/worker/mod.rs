//! The thread that renders for the window: a preview at once for everything that changes, then, once things rest, the whole picture
//! from coarse to fine. It knows the engine, but nothing of the window, which it only wakes.
//!
//! ```text
//! window ─► orders ─► render loop ─► messages ─► window
//!                       ├─ preview, for each view
//!                       ├─ refinement, step by step, while nothing is ordered
//!                       └─ the last picture again, where only its display changes
//! ```

mod orders;
mod refinement;
mod render_loop;

use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, PoisonError};
use std::thread::JoinHandle;

use glam::Vec2;

use self::orders::{Orders, Shared};
use self::render_loop::RenderLoop;
use super::jobs::{Job, JobProgress};
use super::stopwatch::StageSeconds;
use crate::image::Image;
use crate::scene::Scene;
use crate::{BackendChoice, Detail, Mark, PassTime, Stage};
use pinspot_render::gpu::Gpu;
use pinspot_render::options::{DisplaySettings, Evaluation, Exposures, Options, Overlay};

/// What the window shows.
#[derive(Clone, Debug)]
pub struct View {
    /// Pictures carry the number of their view.
    pub number: u64,
    /// The number of the first view of the same radiance: those that share it differ in the display alone.
    pub radiance: u64,
    /// Posed.
    pub scene: Scene,
    /// Of the whole picture.
    pub options: Options,
    /// Other options, whose picture is shown beside it.
    pub kept: Option<Options>,
    /// The animation plays: nothing is refined.
    pub is_playing: bool,
    /// Seconds that a preview may take.
    pub frame_seconds: f64,
}

impl View {
    /// Whether both show the same radiance, at rest.
    pub fn shares_radiance_with(&self, other: &Self) -> bool {
        let displayed = |options: &Options| {
            let mut options = options.clone().with_overlay(Overlay::None);
            options.display = DisplaySettings::default();
            options
        };
        !(self.is_playing || other.is_playing)
            && self.scene == other.scene
            && displayed(&self.options) == displayed(&other.options)
            && self.kept.as_ref().map(displayed) == other.kept.as_ref().map(displayed)
    }
}

/// Which options a picture was rendered with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The view's own.
    Current,
    /// Those that it is compared with.
    Kept,
}

/// How far a picture is refined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quality {
    Preview(Detail),
    /// This step of so many.
    Refined(usize, usize),
}

/// A picture for the window.
#[derive(Clone, Debug)]
pub struct Picture {
    /// The number of the view that it shows.
    pub view: u64,
    pub side: Side,
    /// Until they are shown.
    pub pixels: Option<Pixels>,
    pub quality: Quality,
    /// It replaces the last one gradually, so that nothing jumps.
    pub fades: bool,
    pub exposures: Option<Exposures>,
    pub samples: usize,
    pub evaluation: Option<Evaluation>,
    /// The overlay's, as fractions of the picture's width and height.
    pub marks: Vec<Mark>,
    pub seconds: f64,
    pub stages: StageSeconds,
    /// Of a preview on a GPU with timestamps.
    pub passes: Vec<PassTime>,
    pub warnings: Vec<String>,
}

/// The pixels of a picture.
#[derive(Clone, Debug)]
pub enum Pixels {
    /// Display-linear.
    Image(Image),
    /// On the window's own device, encoded as sRGB.
    Texture(wgpu::TextureView),
}

/// What the worker tells the window.
#[derive(Clone, Debug)]
pub enum Message {
    /// The back end, in words.
    Backend(String),
    Picture(Box<Picture>),
    /// The view of this number could not be rendered; the last picture stays.
    Failed(u64, String),
    /// The back end that was asked for is not there; another one renders.
    Warning(String),
    /// The object at the place that was clicked, if there is one.
    Picked(Option<usize>),
    Job(JobProgress),
}

/// The thread, from the window's side.
#[derive(Debug)]
pub struct Worker {
    shared: Arc<Shared>,
    messages: Receiver<Message>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Starts the thread. `wake` is called whenever there are messages. The window's device, if
    /// there is one that suits the choice of a back end, renders, too.
    pub fn start(choice: BackendChoice, window: Option<Gpu>, wake: impl Fn() + Send + Sync + 'static) -> Self {
        let shared = Arc::new(Shared::default());
        let (sender, messages) = channel();
        let of_thread = shared.clone();
        let thread = std::thread::spawn(move || {
            RenderLoop::new(of_thread, (sender, Box::new(wake)), choice, window).run();
        });
        Self { shared, messages, thread: Some(thread) }
    }

    /// Shows a view instead of the last one.
    pub fn show(&self, view: View) {
        self.order(|orders| orders.view = Some(view));
    }

    /// Asks which object is seen at a place, as fractions of the picture's width and height.
    pub fn pick(&self, place: Vec2) {
        self.order(|orders| orders.pick = Some(place));
    }

    /// Begins a job; views wait until it is done.
    pub fn begin(&self, job: Job) {
        self.shared.is_aborted.store(false, Ordering::Relaxed);
        self.order(|orders| orders.job = Some(job));
    }

    /// Ends the job at hand.
    pub fn abort(&self) {
        self.shared.is_aborted.store(true, Ordering::Relaxed);
    }

    /// The current stage of the picture, and the part of it that is done, from 0 to 1.
    pub fn stage(&self) -> Option<(Stage, f32)> {
        *self.shared.current_stage.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The next message, if there is one.
    pub fn message(&self) -> Option<Message> {
        self.messages.try_recv().ok()
    }

    fn order(&self, change: impl FnOnce(&mut Orders)) {
        self.shared.order(change);
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.abort();
        self.order(|orders| orders.is_over = true);
        if let Some(thread) = self.thread.take() {
            // It has already told what went wrong.
            let _ = thread.join();
        }
    }
}
