//! The thread that renders for the window: a preview at once for everything that changes, then, once things rest, the whole picture
//! from coarse to fine. It knows the engine, but nothing of the window, which it only wakes.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use glam::Vec2;

use super::jobs::{Job, JobProgress, run_job};
use super::stopwatch::{StageSeconds, Stopwatch};
use crate::blocking::wait_sharing as wait;
use crate::image::{Aov, Image};
use crate::scene::Scene;
use crate::{Backend, BackendChoice, Budget, Detail, Engine, Error, Mark, PassTime};
use pinspot_render::gpu::Gpu;
use pinspot_render::options::{Evaluation, Exposures, Options, Overlay};

/// Nothing has to change for this long before the picture is refined.
const REST: Duration = Duration::from_millis(250);
/// Longer side of the coarse picture that replaces the preview where another AOV than beauty is shown, pixels.
const COARSE_SIZE: u32 = 160;

/// What the window shows.
#[derive(Clone, Debug)]
pub struct View {
    /// Pictures carry the number of their view.
    pub number: u64,
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

/// What is to be done. Newer views replace older ones.
#[derive(Debug, Default)]
struct Orders {
    view: Option<View>,
    /// A place in the picture, as fractions of its width and height.
    pick: Option<Vec2>,
    job: Option<Job>,
    is_over: bool,
}

#[derive(Debug, Default)]
struct Shared {
    orders: Mutex<Orders>,
    arrived: Condvar,
    /// Something was ordered that makes the picture being refined obsolete.
    is_outdated: AtomicBool,
    /// The job at hand is to end.
    is_aborted: AtomicBool,
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
            let (wake, budget) = (Box::new(wake), Budget::new(0.05));
            Loop { shared: of_thread, sender, wake, choice, window, is_of_window: false, budget }.run();
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

    /// The next message, if there is one.
    pub fn message(&self) -> Option<Message> {
        self.messages.try_recv().ok()
    }

    fn order(&self, change: impl FnOnce(&mut Orders)) {
        let mut orders = self.shared.orders();
        change(&mut orders);
        // With the lock held, so that the thread cannot take the order before.
        self.shared.is_outdated.store(true, Ordering::Relaxed);
        drop(orders);
        self.shared.arrived.notify_one();
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

impl Shared {
    fn orders(&self) -> MutexGuard<'_, Orders> {
        self.orders.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for orders, up to some time if there is something else to do. Takes them.
    fn next(&self, at_most: Option<Duration>) -> Orders {
        let is_idle = |orders: &mut Orders| {
            orders.view.is_none() && orders.pick.is_none() && orders.job.is_none() && !orders.is_over
        };
        let orders = self.orders();
        let mut orders = match at_most {
            None => self.arrived.wait_while(orders, is_idle).unwrap_or_else(PoisonError::into_inner),
            Some(time) => {
                self.arrived.wait_timeout_while(orders, time, is_idle).unwrap_or_else(PoisonError::into_inner).0
            }
        };
        self.is_outdated.store(false, Ordering::Relaxed);
        Orders { is_over: orders.is_over, ..std::mem::take(&mut *orders) }
    }
}

/// What is left to refine.
#[derive(Debug, Default)]
struct Refinement {
    steps: Vec<RefinementStep>,
    done: usize,
}

#[derive(Debug)]
struct RefinementStep {
    view: u64,
    side: Side,
    options: Options,
    quality: Quality,
}

/// The engines of both sides. They are kept from view to view, with everything that they have prepared.
#[derive(Debug, Default)]
struct Engines {
    current: Option<Engine>,
    kept: Option<Engine>,
}

impl Engines {
    fn of(&mut self, side: Side) -> &mut Option<Engine> {
        match side {
            Side::Current => &mut self.current,
            Side::Kept => &mut self.kept,
        }
    }

    /// The engine of a side, for its options.
    fn set(&mut self, side: Side, scene: &Scene, options: &Options, backend: &Backend) -> &mut Engine {
        let new = || Engine::new(scene.clone(), options.clone(), backend.clone());
        let engine = self.of(side).get_or_insert_with(new);
        engine.scene_mut().clone_from(scene);
        engine.options_mut().clone_from(options);
        engine
    }
}

struct Loop {
    shared: Arc<Shared>,
    sender: Sender<Message>,
    wake: Box<dyn Fn() + Send + Sync>,
    choice: BackendChoice,
    /// The window's device, until it is taken.
    window: Option<Gpu>,
    /// The back end is the window's device.
    is_of_window: bool,
    budget: Budget,
}

/// What the thread has open.
struct RenderState {
    backend: Backend,
    engines: Engines,
    refinement: Refinement,
    /// The view that is shown, or could not be.
    view: Option<View>,
}

impl Loop {
    fn run(mut self) {
        let backend = self.open();
        let mut state =
            RenderState { backend, engines: Engines::default(), refinement: Refinement::default(), view: None };
        loop {
            let Refinement { steps, done } = &state.refinement;
            let rest = if *done == 0 { REST } else { Duration::ZERO };
            let orders = self.shared.next((*done < steps.len()).then_some(rest));
            if orders.is_over {
                return;
            }
            match caught(|| self.carry_out(orders, &mut state)) {
                Ok(()) | Err(Failure::Error(Error::Cancelled)) => {}
                Err(failure) => self.recover(failure, &mut state),
            }
        }
    }

    /// Does what is ordered or, if that is nothing, refines the picture by a step.
    fn carry_out(&mut self, orders: Orders, state: &mut RenderState) -> Result<(), Error> {
        let RenderState { backend, engines, refinement, view: shown } = state;
        let Orders { view, pick, job, .. } = orders;
        if view.is_none() && pick.is_none() && job.is_none() {
            return self.refine(engines, refinement);
        }
        if let (Some(place), Some(engine)) = (pick, &mut engines.current) {
            self.send(Message::Picked(engine.object_at(place)));
        }
        if let Some(job) = job {
            run_job(job, backend, &self.shared.is_aborted, &|progress| self.send(Message::Job(progress)));
        }
        let Some(view) = view else { return Ok(()) };
        let view = shown.insert(view);
        // Before a preview or a draft of fewer samples hides that the whole picture cannot be rendered.
        for options in [Some(&view.options), view.kept.as_ref()].into_iter().flatten() {
            options.check()?;
        }
        *refinement = refinement_of(view);
        self.previews(engines, view, backend)
    }

    /// Reports why the view cannot be shown. After a defect, and with a new device after the loss of one, everything is prepared again.
    fn recover(&mut self, failure: Failure, state: &mut RenderState) {
        // A device that is lost in the middle of a frame makes wgpu panic.
        let failure = match (failure, state.backend.check()) {
            (Failure::Panic(_), Err(lost)) => Failure::Error(lost.into()),
            (failure, _) => failure,
        };
        state.refinement = Refinement::default();
        let number = state.view.as_ref().map_or(0, |view| view.number);
        self.send(Message::Failed(number, failure.to_string()));
        match failure {
            Failure::Error(error) if !is_lost(&error) => {}
            Failure::Panic(_) => state.engines = Engines::default(),
            Failure::Error(_) => {
                (state.engines, state.backend) = (Engines::default(), self.open());
                let mut orders = self.shared.orders();
                orders.view = orders.view.take().or_else(|| state.view.clone());
            }
        }
    }

    fn open(&mut self) -> Backend {
        let of_window = self.window.take().map(Backend::gpu);
        self.is_of_window = of_window.is_some();
        let backend = of_window.unwrap_or_else(|| self.open_another());
        self.send(Message::Backend(backend.report().to_string()));
        backend
    }

    /// A back end of its own.
    fn open_another(&self) -> Backend {
        match wait(None, Backend::open(&self.choice)) {
            Ok(backend) => backend,
            Err(error) => {
                self.send(Message::Warning(format!("{error}; the CPU renders instead")));
                Backend::cpu()
            }
        }
    }

    /// Renders a preview of each side.
    fn previews(&mut self, engines: &mut Engines, view: &View, backend: &Backend) -> Result<(), Error> {
        let sides = if view.kept.is_some() { 2.0 } else { 1.0 };
        self.budget.set_target(view.frame_seconds / sides);
        let current = engines.set(Side::Current, &view.scene, &view.options, backend);
        self.preview(current, (view.number, Side::Current))?;
        let Some(kept) = &view.kept else {
            engines.kept = None;
            return Ok(());
        };
        self.preview(engines.set(Side::Kept, &view.scene, kept, backend), (view.number, Side::Kept))
    }

    /// Renders a preview, or a coarse picture where another one than beauty is shown.
    fn preview(&mut self, engine: &mut Engine, (view, side): (u64, Side)) -> Result<(), Error> {
        let watch = Stopwatch::new(None);
        let began = Instant::now();
        let backend = engine.backend().clone();
        let detail = self.budget.detail(engine.options().size);
        if engine.options().aovs != [Aov::Beauty] {
            let whole = engine.options().clone();
            let coarse = whole.coarse_to_fine().swap_remove(0).with_size(whole.size_within(COARSE_SIZE));
            *engine.options_mut() = coarse;
            let quality = Quality::Preview(Detail { size: engine.options().size, ..detail });
            // Each view is answered: whatever is ordered meanwhile comes afterwards.
            let picture = render(engine, (view, side, quality), None);
            *engine.options_mut() = whole;
            self.send(Message::Picture(Box::new(picture?)));
            return Ok(());
        }
        let on_device =
            if self.is_of_window { wait(backend.device(), engine.preview_on_device(&detail, &watch))? } else { None };
        let preview = match on_device {
            Some(preview) => preview.map(Pixels::Texture),
            None => wait(backend.device(), engine.preview(&detail, &watch))?.map(Pixels::Image),
        };
        let seconds = began.elapsed().as_secs_f64();
        self.budget.took(seconds);
        let size = glam::UVec2::from_array(engine.options().size).as_vec2();
        self.send(Message::Picture(Box::new(Picture {
            view,
            side,
            pixels: Some(preview.image),
            quality: Quality::Preview(detail),
            exposures: Some(preview.exposures),
            samples: preview.samples,
            evaluation: preview.evaluation,
            marks: preview.marks.iter().map(|mark| mark.scaled(size.recip())).collect(),
            seconds,
            stages: watch.seconds(),
            passes: preview.passes,
            warnings: Vec::new(),
        })));
        Ok(())
    }

    fn refine(&self, engines: &mut Engines, refinement: &mut Refinement) -> Result<(), Error> {
        let Some(step) = refinement.steps.get(refinement.done) else { return Ok(()) };
        let RefinementStep { view, side, options, quality } = step;
        if let Some(engine) = engines.of(*side) {
            engine.options_mut().clone_from(options);
            let picture = render(engine, (*view, *side, *quality), Some(&self.shared.is_outdated))?;
            self.send(Message::Picture(Box::new(picture)));
        }
        refinement.done += 1;
        Ok(())
    }

    fn send(&self, message: Message) {
        // Without a window nobody listens.
        let _ = self.sender.send(message);
        (self.wake)();
    }
}

/// Renders a whole picture, unless a flag says that it became obsolete.
fn render(
    engine: &mut Engine,
    (view, side, quality): (u64, Side, Quality),
    is_obsolete: Option<&AtomicBool>,
) -> Result<Picture, Error> {
    let watch = Stopwatch::new(is_obsolete);
    let began = Instant::now();
    let backend = engine.backend().clone();
    // Marks are drawn by the window.
    let overlay = std::mem::replace(&mut engine.options_mut().overlay, Overlay::None);
    let rendered = wait(backend.device(), engine.render(&watch));
    engine.options_mut().overlay = overlay;
    let rendered = rendered?;
    let marks = wait(backend.device(), engine.marks(&watch))?;
    let size = glam::UVec2::from_array(engine.options().size).as_vec2();
    Ok(Picture {
        view,
        side,
        pixels: Some(Pixels::Image(rendered.displayed(&engine.options().display))),
        quality,
        exposures: rendered.report.exposures,
        samples: rendered.report.samples,
        evaluation: rendered.report.evaluation,
        marks: marks.iter().map(|mark| mark.scaled(size.recip())).collect(),
        seconds: began.elapsed().as_secs_f64(),
        stages: watch.seconds(),
        passes: Vec::new(),
        warnings: rendered.report.warnings,
    })
}

/// From a draft to the view's own settings, on both sides in turn; nothing while it moves.
fn refinement_of(view: &View) -> Refinement {
    if view.is_playing {
        return Refinement::default();
    }
    let sides = [(Side::Current, Some(&view.options)), (Side::Kept, view.kept.as_ref())];
    let steps_of = |(side, options): (Side, Option<&Options>)| {
        let Some(options) = options else { return Vec::new() };
        let draft = options.coarse_to_fine().into_iter().nth(1).filter(|draft| draft.samples < options.samples);
        let draft = draft.map(|draft| draft.with_pixel_samples(1));
        let all: Vec<Options> = draft.into_iter().chain([options.clone()]).collect();
        let count = all.len();
        let step = |(index, options)| RefinementStep {
            view: view.number,
            side,
            options,
            quality: Quality::Refined(index + 1, count),
        };
        all.into_iter().enumerate().map(step).collect()
    };
    let mut steps: Vec<RefinementStep> = sides.into_iter().flat_map(steps_of).collect();
    // Drafts of both sides come first; the order is stable.
    steps.sort_by_key(|step| matches!(step.quality, Quality::Refined(index, count) if index == count));
    Refinement { steps, done: 0 }
}

/// Why an order was not carried out.
#[derive(Debug)]
enum Failure {
    Error(Error),
    /// A defect of the program, in its own words.
    Panic(String),
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Error(error) => error.fmt(f),
            Self::Panic(words) => write!(f, "a defect of Pinspot ended the picture, please report it: {words}"),
        }
    }
}

/// Carries out an order. A defect must not end the thread, and with it the window's pictures; the engines are made again after it.
fn caught(order: impl FnOnce() -> Result<(), Error>) -> Result<(), Failure> {
    match catch_unwind(AssertUnwindSafe(order)) {
        Ok(result) => result.map_err(Failure::Error),
        Err(payload) => {
            let words = payload.downcast_ref::<&str>().map(|words| (*words).to_owned());
            let words = words.or_else(|| payload.downcast_ref::<String>().cloned());
            Err(Failure::Panic(words.unwrap_or_default()))
        }
    }
}

/// A device that has refused something stays unusable, too.
fn is_lost(error: &Error) -> bool {
    matches!(
        error,
        Error::Gpu(pinspot_render::gpu::GpuError::Lost { .. } | pinspot_render::gpu::GpuError::Refused { .. })
    )
}
