//! The interactive window: a user of the engine like any other. It shows a scene, moves it, and edits it.
//!
//! ```text
//! input ─► document (scene, options) ─► worker: preview, then the whole picture ─► canvas
//!             ▲        │
//!   panel ────┘        └─► scene file, pictures, frames
//! ```
//!
//! Nothing here waits: pictures are rendered by the [`worker`], files are read by the [`loader`], and both wake the window when they
//! are done. Errors are shown in the window, which keeps the last picture.

mod camera_input;
mod canvas;
mod clock;
mod dialogs;
mod difference;
mod document;
mod gizmo;
mod history;
mod inspector;
mod jobs;
mod loader;
mod maps;
mod navigation;
mod notices;
mod panel;
mod scene_text;
mod stopwatch;
#[cfg(test)]
mod tests;
mod timeline;
mod window;
mod worker;

pub use self::window::{ViewError, view};

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::{egui, egui_wgpu};
use glam::Vec3;

use self::canvas::Canvas;
use self::clock::Clock;
use self::dialogs::Dialogs;
use self::document::{Document, State};
use self::jobs::JobProgress;
use self::loader::{Loaded, Loader};
use self::maps::Maps;
use self::navigation::point_of_interest;
use self::notices::Notices;
use self::worker::{Message, Picture, Quality, Side, View, Worker};
use crate::BackendChoice;

/// Seconds that a preview may take at first.
const FRAME_SECONDS: f64 = 0.05;
/// How far a picture is, is shown anew this often.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(500);

/// What the window shows, independent of the windowing system.
pub(crate) struct Viewer {
    document: Document,
    worker: Worker,
    loader: Loader,
    dialogs: Dialogs,
    maps: Maps,
    thumbnails: panel::Thumbnails,
    clock: Clock,
    canvas: Canvas,
    notices: Notices,
    /// The point that the camera circles.
    target: Vec3,
    selected: Option<usize>,
    /// In words.
    backend: String,
    /// The last picture, without its pixels.
    picture: Option<Picture>,
    /// The same of the settings that are compared.
    kept_picture: Option<Picture>,
    /// Seconds that a preview may take.
    frame_seconds: f64,
    /// The part of a job that is done.
    job: Option<f32>,
    panel: panel::PanelState,
    inspection: panel::InspectionState,
    difference: panel::DifferenceState,
    /// The view that was sent last.
    last_view: Option<View>,
    /// The view has to be shown anew.
    is_outdated: bool,
    /// A view was sent, and no picture of it has come back.
    is_waiting: bool,
    /// An edit goes on while the pointer is down; it is one step of the history.
    is_editing: bool,
}

impl Viewer {
    /// With `device`, the window's own, previews can stay on it.
    pub fn new(
        document: Document,
        choice: BackendChoice,
        context: egui::Context,
        device: Option<egui_wgpu::RenderState>,
    ) -> Self {
        let repaint = Arc::new(move || context.request_repaint());
        let [wake, wake_for_dialogs, wake_for_maps] = std::array::from_fn(|_| {
            let repaint = repaint.clone();
            move || repaint()
        });
        let gpu = device.as_ref().and_then(|device| window::shared_device(device, &choice));
        let mut viewer = Self {
            worker: Worker::start(choice, gpu, wake),
            dialogs: Dialogs::new(wake_for_dialogs),
            maps: Maps::new(wake_for_maps),
            thumbnails: panel::Thumbnails::default(),
            loader: Loader::new(move || repaint()),
            clock: Clock::default(),
            canvas: Canvas::new(device),
            notices: Notices::default(),
            target: Vec3::ZERO,
            selected: None,
            backend: String::new(),
            picture: None,
            kept_picture: None,
            frame_seconds: FRAME_SECONDS,
            job: None,
            panel: panel::PanelState::new(&document),
            inspection: panel::InspectionState::default(),
            difference: panel::DifferenceState::default(),
            last_view: None,
            is_outdated: true,
            is_waiting: false,
            is_editing: false,
            document,
        };
        viewer.look_at_scene();
        viewer.loader.watch(viewer.document.files());
        viewer
    }

    /// One frame of the window.
    pub fn ui(&mut self, ui: &mut egui::Ui) {
        self.take_messages(ui.ctx());
        self.take_dropped_files(ui.ctx());
        self.take_chosen_file();
        self.take_thumbnails(ui.ctx());
        self.shortcuts(ui.ctx());
        if self.clock.advance(Instant::now(), self.document.state.scene.duration()) {
            self.is_outdated = true;
        }
        let before = self.document.state.clone();
        let mut is_edited = false;
        egui::Panel::bottom("timeline").show(ui, |ui| is_edited |= self.timeline(ui));
        if self.panel.is_open {
            let panel = egui::Panel::right("panel").default_size(345.0).size_range(240.0..=480.0);
            panel.show(ui, |ui| is_edited |= self.show_panel(ui));
        }
        let frame = egui::Frame::NONE.fill(egui::Color32::BLACK);
        egui::CentralPanel::default().frame(frame).show(ui, |ui| is_edited |= self.show_canvas(ui));
        self.help(ui.ctx());
        self.note_edit(ui.ctx(), is_edited, &before);
        self.send_view();
        self.compare_with_reference(ui.ctx());
        if self.notices.done().is_some() {
            ui.ctx().request_repaint_after(Duration::from_secs(1));
        }
        // It shows how far the picture is.
        if !self.is_finished() && !self.clock.is_playing {
            ui.ctx().request_repaint_after(PROGRESS_INTERVAL);
        }
        // While the animation plays, pictures wake the window.
        if self.canvas.is_fading() {
            ui.ctx().request_repaint();
        }
    }

    /// Whether the whole picture of what was last set is shown, or an error tells why it cannot be, and everything beside it.
    fn is_finished(&self) -> bool {
        let is_whole = |picture: &Picture| {
            picture.view == self.sent() && matches!(picture.quality, Quality::Refined(step, steps) if step == steps)
        };
        let has_thumbnails = self.thumbnails.count() == self.maps.choices().len();
        let is_settled = !self.is_outdated && !self.is_waiting && !self.canvas.is_fading() && has_thumbnails;
        let is_kept_whole = self.document.state.kept.is_none() || self.kept_picture.as_ref().is_some_and(is_whole);
        let is_whole = self.picture.as_ref().is_some_and(is_whole) && is_kept_whole;
        is_settled && (is_whole || self.notices.failure().is_some())
    }

    /// A step of the history for each edit, or for all of a drag.
    fn note_edit(&mut self, context: &egui::Context, is_edited: bool, before: &State) {
        if is_edited {
            if !self.is_editing {
                self.document.history.note(before);
            }
            self.is_editing = true;
            self.is_outdated = true;
        }
        self.is_editing &= context.input(|input| input.pointer.any_down());
    }

    /// Sends what is to be shown. While the animation plays, it waits for the last picture, so that time goes on with the pictures.
    fn send_view(&mut self) {
        let is_ready = !(self.clock.is_playing && self.is_waiting);
        if !self.is_outdated || !is_ready || self.canvas.size() == [0, 0] {
            return;
        }
        let number = self.sent() + 1;
        let mut view = View {
            number,
            radiance: number,
            scene: self.posed_scene(),
            options: self.document.state.options.clone().with_size(self.canvas.size()),
            kept: self.document.state.kept.clone().map(|kept| kept.with_size(self.canvas.size())),
            is_playing: self.clock.is_playing,
            frame_seconds: self.frame_seconds,
        };
        if let Some(last) = self.last_view.as_ref().filter(|last| view.shares_radiance_with(last)) {
            view.radiance = last.radiance;
        }
        self.last_view = Some(view.clone());
        self.worker.show(view);
        (self.is_outdated, self.is_waiting) = (false, true);
    }

    /// The number of the view that was sent last; 0 before the first.
    fn sent(&self) -> u64 {
        self.last_view.as_ref().map_or(0, |view| view.number)
    }

    /// The number of the first view that shows the same radiance as the one that was sent last.
    fn sent_radiance(&self) -> u64 {
        self.last_view.as_ref().map_or(0, |view| view.radiance)
    }

    /// The scene at the time of the clock. The camera follows its animation only while that plays or is scrubbed.
    fn posed_scene(&self) -> crate::scene::Scene {
        let mut scene = self.document.state.scene.clone();
        if self.document.state.is_animated {
            let camera = scene.camera;
            scene.pose(self.clock.seconds);
            if self.canvas.holds_camera {
                scene.camera = camera;
            }
        }
        scene
    }

    fn take_messages(&mut self, context: &egui::Context) {
        while let Some(message) = self.worker.message() {
            match message {
                Message::Backend(backend) => self.backend = backend,
                Message::Picture(mut picture) => {
                    self.is_waiting &= picture.view != self.sent();
                    self.canvas.set_picture(context, &mut picture);
                    self.notices.set_rendering(None);
                    match picture.side {
                        Side::Current => self.picture = Some(*picture),
                        Side::Kept => self.kept_picture = Some(*picture),
                    }
                }
                Message::Failed(view, reason) => {
                    self.is_waiting &= view != self.sent();
                    self.notices.set_rendering(Some(reason));
                }
                Message::Warning(reason) => self.notices.fail(reason),
                Message::Picked(object) => self.selected = object,
                Message::Job(JobProgress::Running(part)) => self.job = Some(part),
                Message::Job(JobProgress::Done(written)) => {
                    self.job = None;
                    self.notices.say(written);
                }
                Message::Job(JobProgress::Stopped) => {
                    self.job = None;
                    self.notices.say("stopped; frames that are complete stay".to_owned());
                }
                Message::Job(JobProgress::Failed(reason)) => {
                    self.job = None;
                    self.notices.fail(reason);
                }
            }
        }
        while let Some(loaded) = self.loader.loaded() {
            self.take_loaded(loaded);
        }
    }

    fn take_loaded(&mut self, loaded: Loaded) {
        match loaded {
            Loaded::Scene(Ok(document)) => {
                self.notices.say(format!("opened {}", document.name));
                (self.clock, self.selected) = (Clock::default(), None);
                self.canvas.holds_camera = false;
                self.panel = panel::PanelState { is_open: self.panel.is_open, ..panel::PanelState::new(&document) };
                self.set_document(*document);
                self.forget_inspection();
                self.look_at_scene();
            }
            // Of a scene that has been closed meanwhile.
            Loaded::Mesh(Ok(document)) | Loaded::Changed(Ok(document)) if document.name != self.document.name => {}
            Loaded::Mesh(Ok(document)) => {
                self.selected = Some(document.state.scene.objects.len().saturating_sub(1));
                let with_edits = self.document.edits_with_mesh(*document);
                self.set_document(with_edits);
            }
            Loaded::Touched => self.loader.reload(&self.document),
            Loaded::Changed(Ok(document)) => {
                self.notices.say(format!("{} has changed on disk and was read again", document.name));
                let with_edits = self.document.edits_on(*document);
                self.set_document(with_edits);
            }
            Loaded::Written(path) => self.notices.say(format!("screenshot: {}", path.display())),
            Loaded::Map(Ok((light, reference))) => {
                self.maps.add(&reference, &light);
                self.document.set_map(light, reference);
                self.is_outdated = true;
            }
            Loaded::Scene(Err(reason))
            | Loaded::Mesh(Err(reason))
            | Loaded::Changed(Err(reason))
            | Loaded::Map(Err(reason)) => {
                self.notices.fail(reason);
            }
        }
    }

    fn set_document(&mut self, document: Document) {
        self.loader.watch(document.files());
        self.clock.is_playing &= document.state.scene.duration() > 0.0;
        self.selected = self.selected.filter(|&index| index < document.state.scene.objects.len());
        self.document = document;
        self.is_outdated = true;
    }

    /// Resets the point that the camera circles.
    fn look_at_scene(&mut self) {
        let scene = &self.document.state.scene;
        // Of mirrors, which are what a scene is about; receivers may be as large as a room.
        let mirrors = scene.objects.iter().filter(|object| object.specular().is_some());
        let middles: Vec<Vec3> = mirrors.map(|object| object.placement.translate).collect();
        let middle = middles.iter().sum::<Vec3>() / middles.len().max(1) as f32;
        self.target = point_of_interest(&scene.camera, middle);
    }

    fn take_dropped_files(&mut self, context: &egui::Context) {
        for file in context.input(|input| input.raw.dropped_files.clone()) {
            self.loader.open(file.path().to_owned(), &self.document);
        }
    }

    fn shortcuts(&mut self, context: &egui::Context) {
        use egui::{Key, Modifiers};
        if context.text_edit_focused() {
            return;
        }
        let pressed = |modifiers, key| context.input_mut(|input| input.consume_key(modifiers, key));
        if pressed(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z) || pressed(Modifiers::COMMAND, Key::Y) {
            self.document.redo();
            self.is_outdated = true;
        }
        if pressed(Modifiers::COMMAND, Key::Z) {
            self.document.undo();
            self.is_outdated = true;
        }
        if pressed(Modifiers::COMMAND, Key::S) {
            self.save_scene();
        }
        if pressed(Modifiers::NONE, Key::F1) {
            self.panel.shows_help ^= true;
        }
        if pressed(Modifiers::NONE, Key::F11) {
            let is_full = context.input(|input| input.viewport().fullscreen.unwrap_or(false));
            context.send_viewport_cmd(egui::ViewportCommand::Fullscreen(!is_full));
        }
        // The space bar also presses the focused button.
        let has_focus = context.memory(|memory| memory.focused().is_some());
        if !has_focus && pressed(Modifiers::NONE, Key::Space) {
            self.toggle_playing();
        }
        if pressed(Modifiers::NONE, Key::H) {
            self.panel.is_open ^= true;
        }
        if pressed(Modifiers::NONE, Key::R) {
            self.reset_camera();
        }
        if pressed(Modifiers::NONE, Key::P) {
            self.save_screenshot(context);
        }
    }

    fn toggle_playing(&mut self) {
        if self.document.state.scene.animations.is_empty() {
            self.notices.say("nothing moves in this scene: it has no [[animation]]".to_owned());
            return;
        }
        self.document.state.is_animated = true;
        self.clock.is_playing ^= true;
        self.canvas.holds_camera = false;
        self.is_outdated = true;
    }

    fn reset_camera(&mut self) {
        self.document.state.scene.camera = self.document.original.scene.camera;
        self.canvas.holds_camera = false;
        self.look_at_scene();
        self.is_outdated = true;
    }

    fn save_scene(&mut self) {
        let path = PathBuf::from(self.panel.scene_file.trim());
        match self.document.save(&path) {
            Ok(()) => {
                self.loader.watch(self.document.files());
                self.notices.say(format!("saved {}", path.display()));
            }
            Err(error) => self.notices.fail(error.to_string()),
        }
    }

    /// Saves what the window shows, as PNG.
    fn save_screenshot(&mut self, context: &egui::Context) {
        let path = free_name(&self.panel.stem(), "png");
        let sender = self.loader.sender();
        context.send_viewport_cmd(egui::ViewportCommand::Screenshot(egui::ScreenshotCallback::new(move |image| {
            sender.save_screenshot(path, &image);
        })));
    }
}

/// A name in the current folder that is not taken: `ring.png`, `ring-2.png`, …
fn free_name(stem: &str, extension: &str) -> PathBuf {
    let name = |number: u32| match number {
        1 => format!("{stem}.{extension}"),
        _ => format!("{stem}-{number}.{extension}"),
    };
    (1..10_000).map(name).map(PathBuf::from).find(|path| !path.exists()).unwrap_or_default()
}
