//! The thread itself: it carries out orders and, if there are none, refines the picture.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use super::orders::{Orders, Shared};
use super::refinement::{Refinement, RefinementStep};
use super::{Message, Picture, Pixels, Quality, Side, View};
use crate::blocking::wait_sharing as wait;
use crate::image::Aov;
use crate::scene::Scene;
use crate::viewer::jobs::run_job;
use crate::viewer::stopwatch::Stopwatch;
use crate::{Backend, BackendChoice, Budget, Detail, Engine, Error, Mark, NoProgress, Rendered};
use pinspot_render::gpu::{Gpu, GpuError};
use pinspot_render::options::{Options, Overlay};

/// Nothing has to change for this long before the picture is refined.
const REST: Duration = Duration::from_millis(250);
/// Longer side of the coarse picture that replaces the preview where another AOV than beauty is shown, pixels.
const COARSE_SIZE: u32 = 160;

/// What there is of each side.
struct Sides<T> {
    current: Option<T>,
    kept: Option<T>,
}

impl<T> Default for Sides<T> {
    fn default() -> Self {
        Self { current: None, kept: None }
    }
}

impl<T> Sides<T> {
    fn of(&mut self, side: Side) -> &mut Option<T> {
        match side {
            Side::Current => &mut self.current,
            Side::Kept => &mut self.kept,
        }
    }
}

/// The engines of both sides. They are kept from view to view, with everything that they have prepared.
type Engines = Sides<Engine>;

impl Engines {
    /// The engine of a side, for its options.
    fn set(&mut self, side: Side, scene: &Scene, options: &Options, backend: &Backend) -> &mut Engine {
        let new = || Engine::new(scene.clone(), options.clone(), backend.clone());
        let engine = self.of(side).get_or_insert_with(new);
        engine.scene_mut().clone_from(scene);
        engine.options_mut().clone_from(options);
        engine
    }
}

/// A picture that is shown, with what displays it again.
struct Shown {
    rendered: Rendered,
    /// Without pixels.
    picture: Picture,
}

/// The thread's state that lasts from back end to back end.
pub struct RenderLoop {
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
    /// Where that is not a preview.
    shown: Sides<Shown>,
    /// Things have to rest before the next step of the refinement.
    has_to_rest: bool,
}

impl RenderLoop {
    /// A loop that sends messages, and wakes the window for each.
    pub fn new(
        shared: Arc<Shared>,
        (sender, wake): (Sender<Message>, Box<dyn Fn() + Send + Sync>),
        choice: BackendChoice,
        window: Option<Gpu>,
    ) -> Self {
        Self { shared, sender, wake, choice, window, is_of_window: false, budget: Budget::new(0.05) }
    }

    /// Carries out orders until they say that it is over.
    pub fn run(mut self) {
        let mut state = RenderState {
            backend: self.open(),
            engines: Engines::default(),
            refinement: Refinement::default(),
            view: None,
            shown: Sides::default(),
            has_to_rest: true,
        };
        loop {
            let rest = if state.has_to_rest { REST } else { Duration::ZERO };
            let orders = self.shared.next(state.refinement.next().map(|_| rest));
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
        let Orders { view, pick, job, .. } = orders;
        if view.is_none() && pick.is_none() && job.is_none() {
            state.has_to_rest = false;
            return self.refine(state);
        }
        state.has_to_rest = true;
        if let (Some(place), Some(engine)) = (pick, &mut state.engines.current) {
            self.send(Message::Picked(engine.object_at(place)));
        }
        if let Some(job) = job {
            run_job(job, &state.backend, &self.shared.is_aborted, &|progress| self.send(Message::Job(progress)));
        }
        let Some(view) = view else { return Ok(()) };
        let is_shown = self.show_again(&view, state);
        let view = state.view.insert(view);
        if is_shown? {
            state.refinement.show(view);
            return Ok(());
        }
        // Before a preview or a draft of fewer samples hides that the whole picture cannot be rendered.
        for options in [Some(&view.options), view.kept.as_ref()].into_iter().flatten() {
            options.check()?;
        }
        state.refinement = Refinement::new(view);
        state.shown = Sides::default();
        self.previews(&mut state.engines, view, &state.backend)
    }

    /// Displays the pictures that are shown in another way, if a view differs in nothing else. Returns whether that was possible.
    fn show_again(&self, view: &View, state: &mut RenderState) -> Result<bool, Error> {
        let RenderState { backend, engines, refinement, view: last, shown, .. } = state;
        let Some(last) = last.as_ref().filter(|last| last.radiance == view.radiance) else { return Ok(false) };
        let sides = [
            (Side::Current, Some((&view.options, &last.options))),
            (Side::Kept, view.kept.as_ref().zip(last.kept.as_ref())),
        ];
        let mut pictures = Vec::new();
        for (side, options) in sides {
            let Some((options, before)) = options else { continue };
            let again = shown.of(side).as_ref().and_then(|shown| shown.rendered.displayed_again(&options.display));
            let (Some(shown), Some((image, exposures))) = (shown.of(side).as_mut(), again) else { return Ok(false) };
            let marks_change = options.overlay != before.overlay;
            // Those of another overlay come from the samples, which an engine that is refining may not have.
            let Some(engine) = engines.of(side).as_mut().filter(|_| !marks_change || refinement.next().is_none())
            else {
                return Ok(false);
            };
            if marks_change {
                engine.options_mut().overlay = options.overlay;
                shown.picture.marks = marks_of(engine, backend)?;
            }
            let picture = &mut shown.picture;
            (picture.view, picture.exposures, picture.fades) = (view.number, Some(exposures), false);
            pictures.push(Picture { pixels: Some(Pixels::Image(image)), ..picture.clone() });
        }
        for picture in pictures {
            self.send(Message::Picture(Box::new(picture)));
        }
        Ok(true)
    }

    /// Reports why the view cannot be shown. After a defect, and with a new device after the loss of one, everything is prepared again.
    fn recover(&mut self, failure: Failure, state: &mut RenderState) {
        // A device that is lost in the middle of a frame makes wgpu panic.
        let failure = match (failure, state.backend.check()) {
            (Failure::Panic(_), Err(lost)) => Failure::Error(lost.into()),
            (failure, _) => failure,
        };
        (state.refinement, state.shown) = (Refinement::default(), Sides::default());
        let number = state.view.as_ref().map_or(0, |view| view.number);
        self.send(Message::Failed(number, failure.to_string()));
        match failure {
            Failure::Error(error) if !is_lost(&error) => {}
            Failure::Panic(_) => state.engines = Engines::default(),
            Failure::Error(error) => {
                let has_room = !matches!(error, Error::Gpu(GpuError::OutOfMemory { .. }));
                let backend = if has_room { self.open() } else { self.use_cpu() };
                (state.engines, state.backend) = (Engines::default(), backend);
                let mut orders = self.shared.orders();
                orders.view = orders.view.take().or_else(|| state.view.clone());
            }
        }
    }

    /// Leaves a GPU that has too little memory.
    fn use_cpu(&mut self) -> Backend {
        self.is_of_window = false;
        let backend = Backend::cpu();
        self.send(Message::Backend(backend.report().to_string()));
        backend
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
        let watch = Stopwatch::new(None).recorded(&self.shared.current_stage);
        let began = Instant::now();
        let backend = engine.backend().clone();
        let detail = self.budget.detail(engine.options().size);
        if engine.options().aovs != [Aov::Beauty] {
            let whole = engine.options().clone();
            let coarse = whole.coarse_to_fine().swap_remove(0).with_size(whole.size_within(COARSE_SIZE));
            *engine.options_mut() = coarse;
            let quality = Quality::Preview(Detail { size: engine.options().size, ..detail });
            // Each view is answered: whatever is ordered meanwhile comes afterwards.
            let picture = self.render(engine, (view, side, quality), None);
            *engine.options_mut() = whole;
            self.send(Message::Picture(Box::new(picture?.0)));
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
            fades: false,
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

    fn refine(&self, state: &mut RenderState) -> Result<(), Error> {
        let RenderState { engines, refinement, shown, .. } = state;
        let Some(RefinementStep { view, side, options, quality }) = refinement.next() else { return Ok(()) };
        if let Some(engine) = engines.of(*side) {
            engine.options_mut().clone_from(options);
            let (mut picture, rendered) =
                self.render(engine, (*view, *side, *quality), Some(&self.shared.is_outdated))?;
            let pixels = picture.pixels.take();
            *shown.of(*side) = Some(Shown { rendered, picture: picture.clone() });
            self.send(Message::Picture(Box::new(Picture { pixels, ..picture })));
        }
        refinement.advance();
        Ok(())
    }

    /// Renders a whole picture, unless a flag says that it became obsolete.
    fn render(
        &self,
        engine: &mut Engine,
        (view, side, quality): (u64, Side, Quality),
        is_obsolete: Option<&AtomicBool>,
    ) -> Result<(Picture, Rendered), Error> {
        let watch = Stopwatch::new(is_obsolete).recorded(&self.shared.current_stage);
        let began = Instant::now();
        let backend = engine.backend().clone();
        // Marks are drawn by the window.
        let overlay = std::mem::replace(&mut engine.options_mut().overlay, Overlay::None);
        let rendered = wait(backend.device(), engine.render(&watch));
        engine.options_mut().overlay = overlay;
        let rendered = rendered?;
        let marks = marks_of(engine, &backend)?;
        let picture = Picture {
            view,
            side,
            pixels: Some(Pixels::Image(rendered.displayed(&engine.options().display))),
            quality,
            fades: matches!(quality, Quality::Refined(..)),
            exposures: rendered.report.exposures,
            samples: rendered.report.samples,
            evaluation: rendered.report.evaluation,
            marks,
            seconds: began.elapsed().as_secs_f64(),
            stages: watch.seconds(),
            passes: Vec::new(),
            warnings: rendered.report.warnings.clone(),
        };
        Ok((picture, rendered))
    }

    fn send(&self, message: Message) {
        // Without a window nobody listens.
        let _ = self.sender.send(message);
        (self.wake)();
    }
}

/// The overlay's marks, as fractions of the picture's width and height.
fn marks_of(engine: &mut Engine, backend: &Backend) -> Result<Vec<Mark>, Error> {
    let marks = wait(backend.device(), engine.marks(&NoProgress))?;
    let size = glam::UVec2::from_array(engine.options().size).as_vec2();
    Ok(marks.iter().map(|mark| mark.scaled(size.recip())).collect())
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
    matches!(error, Error::Gpu(GpuError::Lost { .. } | GpuError::Refused { .. } | GpuError::OutOfMemory { .. }))
}
