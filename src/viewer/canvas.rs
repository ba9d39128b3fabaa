//! The picture: its texture, the camera's moves, and what is drawn over it.

use std::time::{Duration, Instant};

use eframe::egui;
use eframe::egui_wgpu::RenderState;
use egui::{Color32, Pos2, Rect, Sense, Stroke, TextureHandle, TextureId, TextureOptions, Vec2 as UiVec2};
use glam::Vec2;
use rayon::prelude::*;

use super::Viewer;
use super::gizmo::{self, Gizmo, Handle};
use super::panel::named;
use super::scene_text::differing_options;
use super::worker::{Picture, Pixels, Quality, Side};
use crate::Mark;
use crate::image::{Image, srgb8};
use pinspot_render::options::{Options, Overlay};

/// A refined picture replaces the one before it over this long.
const FADE: Duration = Duration::from_millis(250);
/// The longest edge of the picture, pixels.
const MAX_EDGE: u32 = 8192;

/// The divider between two settings is taken hold of within this distance, points.
const DIVIDER_REACH: f32 = 8.0;

/// A picture as egui draws it.
#[derive(Clone)]
enum Drawn {
    Uploaded(TextureHandle),
    /// A texture of the worker's on the window's device.
    OnDevice(TextureId),
}

impl Drawn {
    fn id(&self) -> TextureId {
        match self {
            Self::Uploaded(texture) => texture.id(),
            Self::OnDevice(id) => *id,
        }
    }
}

/// What one side shows.
#[derive(Default)]
struct SidePicture {
    shown: Option<Drawn>,
    /// Fades out under the one that is shown.
    last: Option<Drawn>,
    /// The texture into which previews are drawn on the window's device.
    on_device: Option<(wgpu::TextureView, TextureId)>,
    fade_began: Option<Instant>,
    marks: Vec<Mark>,
}

/// What is being dragged.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Held {
    Gizmo(Handle),
    Divider,
}

/// The picture area.
pub struct Canvas {
    current: SidePicture,
    /// Left of the divider, in a comparison.
    kept: SidePicture,
    /// Where the divider is, as a fraction of the width.
    divider: f32,
    held: Option<Held>,
    /// Where it is in the window, points.
    area: Option<Rect>,
    /// Pixels.
    size: [u32; 2],
    /// The user has moved the camera: its animation does not move it any more.
    pub holds_camera: bool,
    /// The window's.
    device: Option<RenderState>,
}

impl Canvas {
    /// A canvas of a window with, or without, a device of its own.
    pub fn new(device: Option<RenderState>) -> Self {
        Self {
            device,
            current: SidePicture::default(),
            kept: SidePicture::default(),
            divider: 0.5,
            held: None,
            area: None,
            size: [0, 0],
            holds_camera: false,
        }
    }
}

impl SidePicture {
    fn is_fading(&self) -> bool {
        self.fade_began.is_some_and(|began| began.elapsed() < FADE)
    }

    fn set(&mut self, context: &egui::Context, device: Option<&RenderState>, picture: &mut Picture) {
        std::mem::swap(&mut self.shown, &mut self.last);
        match (picture.pixels.take(), device) {
            (Some(Pixels::Texture(view)), Some(device)) => self.shown = Some(self.registered(device, view)),
            (Some(Pixels::Image(image)), _) => {
                let pixels = colour_image(&image);
                if let Some(Drawn::Uploaded(texture)) = &mut self.shown {
                    texture.set(pixels, TextureOptions::LINEAR);
                } else {
                    let texture = context.load_texture("picture", pixels, TextureOptions::LINEAR);
                    self.shown = Some(Drawn::Uploaded(texture));
                }
            }
            _ => {}
        }
        self.fade_began = picture.fades.then(Instant::now);
        self.marks.clone_from(&picture.marks);
    }

    /// A texture that egui can draw. Previews are drawn into the same one again and again.
    fn registered(&mut self, device: &RenderState, view: wgpu::TextureView) -> Drawn {
        let mut renderer = device.renderer.write();
        let linear = wgpu::FilterMode::Linear;
        let id = match self.on_device.take() {
            Some((known, id)) => {
                if known != view {
                    renderer.update_egui_texture_from_wgpu_texture(&device.device, &view, linear, id);
                }
                id
            }
            None => renderer.register_native_texture(&device.device, &view, linear),
        };
        self.on_device = Some((view, id));
        Drawn::OnDevice(id)
    }

    fn paint(&self, painter: &egui::Painter, area: Rect) {
        let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
        let part = self.fade_began.map_or(1.0, |began| began.elapsed().as_secs_f32() / FADE.as_secs_f32()).min(1.0);
        if let Some(last) = self.last.as_ref().filter(|_| part < 1.0) {
            painter.image(last.id(), area, whole, Color32::WHITE);
        }
        if let Some(shown) = &self.shown {
            painter.image(shown.id(), area, whole, Color32::WHITE.gamma_multiply(part));
        }
    }

    fn paint_marks(&self, painter: &egui::Painter, area: Rect) {
        let place = |at: Vec2| area.min + UiVec2::new(at.x, at.y) * area.size();
        for mark in &self.marks {
            match *mark {
                Mark::Dot(at) => {
                    painter.circle(place(at), 2.2, Color32::from_rgb(255, 140, 0), Stroke::new(0.8, Color32::BLACK));
                }
                Mark::Line { ends, kind } => {
                    let [r, g, b] = srgb8(kind.colour());
                    painter.line_segment(ends.map(place), Stroke::new(1.4, Color32::from_rgb(r, g, b)));
                }
                Mark::Texel { corners, colour } => {
                    let [r, g, b] = srgb8(colour);
                    let [low, high] = corners.map(place);
                    painter.rect_filled(Rect::from_min_max(low, high), 0.0, Color32::from_rgb(r, g, b));
                }
            }
        }
    }
}

impl Canvas {
    /// Width and height of the picture area, pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Whether a picture is still fading in.
    pub fn is_fading(&self) -> bool {
        self.current.is_fading() || self.kept.is_fading()
    }

    /// Forgets the pictures of settings that are no longer compared.
    pub fn end_comparison(&mut self) {
        let kept = std::mem::take(&mut self.kept);
        if let (Some((_, id)), Some(device)) = (kept.on_device, &self.device) {
            device.renderer.write().free_texture(&id);
        }
    }

    /// Shows a picture. Refined ones fade in.
    pub fn set_picture(&mut self, context: &egui::Context, picture: &mut Picture) {
        let side = if picture.side == Side::Current { &mut self.current } else { &mut self.kept };
        side.set(context, self.device.as_ref(), picture);
    }

    /// Where the divider is, as a fraction of the width.
    #[cfg(test)]
    pub fn divider(&self) -> f32 {
        self.divider
    }

    /// Where the divider is in the window.
    fn divider_x(&self, area: Rect) -> f32 {
        area.left() + self.divider * area.width()
    }
}

impl Viewer {
    /// Shows the picture, moves the camera and the selected object. Returns whether the scene was edited.
    pub(super) fn show_canvas(&mut self, ui: &mut egui::Ui) -> bool {
        let (area, response) = ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
        named(&response, egui::Role::Image, "Picture");
        self.set_size(area, ui.ctx().pixels_per_point());
        if !response.dragged() {
            self.canvas.held = None;
        }
        if self.document.state.kept.is_none() {
            self.canvas.end_comparison();
        }
        let painter = ui.painter_at(area);
        self.paint_sides(&painter, area);
        self.drag_divider(ui, &response, area);
        let is_edited = self.drag_object(ui, &response, area);
        if self.canvas.held.is_none() && self.move_camera(ui, &response, area) {
            self.canvas.holds_camera = true;
            self.is_outdated = true;
        }
        if let Some(at) = response.interact_pointer_pos().filter(|_| response.clicked()) {
            let place = (at - area.min) / area.size();
            self.worker.pick(Vec2::new(place.x, place.y));
        }
        let hovered = response.hover_pos().map(|at| (at - area.min) / area.size());
        self.inspect(ui.ctx(), hovered.map(|place| Vec2::new(place.x, place.y)));
        self.paint_cells(&painter, area);
        self.paint_status(&painter, area);
        self.show_failure(ui.ctx(), area);
        is_edited
    }

    fn set_size(&mut self, area: Rect, pixels_per_point: f32) {
        let pixels = |length: f32| ((length * pixels_per_point).round() as u32).clamp(1, MAX_EDGE);
        let size = [pixels(area.width()), pixels(area.height())];
        self.canvas.area = Some(area);
        if size != self.canvas.size {
            self.canvas.size = size;
            self.is_outdated = true;
        }
    }

    /// The picture or, in a comparison, those of both settings on either side of the divider.
    fn paint_sides(&self, painter: &egui::Painter, area: Rect) {
        let has_overlay = |options: &Options| options.overlay != Overlay::None;
        self.canvas.current.paint(painter, area);
        self.paint_difference(painter, area);
        if has_overlay(&self.document.state.options) {
            self.canvas.current.paint_marks(painter, area);
        }
        let Some(kept) = &self.document.state.kept else { return };
        let x = self.canvas.divider_x(area);
        let left = painter.with_clip_rect(area.with_max_x(x));
        left.rect_filled(area, 0.0, Color32::BLACK);
        self.canvas.kept.paint(&left, area);
        if has_overlay(kept) {
            self.canvas.kept.paint_marks(&left, area);
        }
        painter.vline(x, area.y_range(), Stroke::new(3.0, Color32::BLACK));
        painter.vline(x, area.y_range(), Stroke::new(1.0, Color32::WHITE));
        let [own, others] = differing_options(kept, &self.document.state.options);
        let top = area.left_top() + UiVec2::new(10.0, 30.0);
        label(&left, top, &format!("kept: {own}"), Color32::WHITE, 0.5 * area.width());
        label(painter, Pos2::new(x + 10.0, top.y), &format!("current: {others}"), Color32::WHITE, 0.5 * area.width());
    }

    fn drag_divider(&mut self, ui: &egui::Ui, response: &egui::Response, area: Rect) {
        if self.document.state.kept.is_none() {
            return;
        }
        let is_near = |at: Pos2| (at.x - self.canvas.divider_x(area)).abs() < DIVIDER_REACH;
        if response.hover_pos().is_some_and(is_near) {
            ui.ctx().set_cursor_icon(egui::CursorIcon::ResizeHorizontal);
        }
        if response.drag_started() && ui.input(|input| input.pointer.press_origin()).is_some_and(is_near) {
            self.canvas.held = Some(Held::Divider);
        }
        if self.canvas.held == Some(Held::Divider) {
            match response.interact_pointer_pos().filter(|_| response.dragged()) {
                Some(at) => self.canvas.divider = ((at.x - area.left()) / area.width()).clamp(0.0, 1.0),
                None => self.canvas.held = None,
            }
        }
    }

    /// Moves and turns the selected object by its arrows and rings.
    fn drag_object(&mut self, ui: &egui::Ui, response: &egui::Response, area: Rect) -> bool {
        let Some(index) = self.selected.filter(|_| !self.clock.is_playing) else { return false };
        let Some(object) = self.document.state.scene.objects.get(index) else { return false };
        let gizmo = self.gizmo_of_selected();
        if response.drag_started_by(egui::PointerButton::Primary) {
            let at = ui.input(|input| input.pointer.press_origin());
            let handle = at.filter(|_| self.canvas.held.is_none()).and_then(|at| gizmo.at(at));
            self.canvas.held = self.canvas.held.or(handle.map(Held::Gizmo));
        }
        let held = if let Some(Held::Gizmo(handle)) = self.canvas.held { Some(handle) } else { None };
        gizmo::paint(&ui.painter_at(area), &gizmo, &object.name, held);
        let Some(handle) = held else { return false };
        if !response.dragged() {
            self.canvas.held = None;
            return false;
        }
        let is_animated = self.document.state.is_animated && self.is_animated_object(index);
        if is_animated {
            self.notices
                .say("its animation places this object; switch \u{201c}Animate\u{201d} off to move it".to_owned());
            return false;
        }
        let before = self.document.state.scene.objects[index].placement;
        let mut placement = before;
        match handle {
            Handle::Arrow(axis) => placement.translate += gizmo::step(&gizmo.arrows, axis, response.drag_delta()),
            Handle::Ring(axis) => {
                let ring = gizmo.ring(axis).zip(response.interact_pointer_pos());
                let angle = ring.map_or(0.0, |(ring, at)| ring.turn(at, response.drag_delta()));
                if angle != 0.0 {
                    placement = placement.turned(axis.direction(), angle);
                }
            }
        }
        self.document.place(index, placement);
        placement != before
    }

    /// The arrows and rings of the selected object.
    pub(super) fn gizmo_of_selected(&self) -> Gizmo {
        let posed = self.posed_scene();
        let object = self.selected.and_then(|index| posed.objects.get(index));
        let middle = object.map(|object| object.placement.translate);
        let placed = middle.zip(self.canvas.area);
        placed.map_or_else(Gizmo::default, |(middle, area)| Gizmo::new(&posed.camera, middle, area))
    }

    /// Whether an animation places an object.
    pub(super) fn is_animated_object(&self, index: usize) -> bool {
        self.document.state.scene.animations.iter().any(|animation| match animation {
            crate::scene::Animation::Objects(motion) => motion.objects.contains(&index),
            _ => false,
        })
    }

    /// What is shown, in the lower left corner, and what was done, above it.
    fn paint_status(&self, painter: &egui::Painter, area: Rect) {
        let text = self.status();
        let at = area.left_bottom() + UiVec2::new(10.0, -10.0);
        label(painter, at, &text, Color32::from_white_alpha(210), area.width() - 20.0);
        if let Some(done) = self.notices.done() {
            label(painter, at - UiVec2::new(0.0, 24.0), done, Color32::from_rgb(160, 220, 160), area.width() - 20.0);
        }
    }

    /// What went wrong, over the picture, until it is mended or read.
    fn show_failure(&mut self, context: &egui::Context, area: Rect) {
        let Some(reason) = self.notices.failure().map(str::to_owned) else { return };
        let at = area.left_bottom() + UiVec2::new(6.0, -64.0);
        let message = egui::Area::new(egui::Id::unique("failure")).fixed_pos(at).pivot(egui::Align2::LEFT_BOTTOM);
        message.show(context, |ui| {
            egui::Frame::popup(ui.style()).show(ui, |ui| {
                ui.set_max_width((area.width() - 40.0).max(60.0));
                ui.horizontal_wrapped(|ui| {
                    if ui.button("OK").clicked() {
                        self.notices.clear_failure();
                    }
                    ui.colored_label(Color32::from_rgb(255, 150, 120), reason);
                });
            });
        });
    }

    /// What is shown, in words.
    pub(super) fn status(&self) -> String {
        let stage = self.worker.stage().map_or_else(String::new, |(stage, part)| match part {
            0.0 => format!(" ({stage})"),
            _ => format!(" ({stage} {:.0} %)", 100.0 * part),
        });
        let Some(picture) = &self.picture else { return format!("preparing the scene\u{2026}{stage}") };
        let samples = match picture.evaluation {
            None => String::new(),
            Some(evaluation) if evaluation.leaves() > 1 => {
                format!(", {} samples \u{d7} {} leaves", picture.samples, evaluation.leaves())
            }
            Some(_) => format!(", {} samples", picture.samples),
        };
        let milliseconds = 1000.0 * picture.seconds;
        match picture.quality {
            Quality::Preview(detail) => {
                let refining = if self.clock.is_playing { String::new() } else { format!(", refining\u{2026}{stage}") };
                format!(
                    "preview {}\u{d7}{}{samples}, light every {} pixels: {milliseconds:.0} ms{refining}",
                    detail.size[0], detail.size[1], detail.spacing
                )
            }
            Quality::Refined(step, steps) if step < steps => {
                format!("draft{samples}: {:.1} s, refining\u{2026}{stage}", picture.seconds)
            }
            Quality::Refined(..) => format!("finished{samples}: {:.1} s", picture.seconds),
        }
    }
}

/// A display-linear picture as textures hold it.
pub fn colour_image(image: &Image) -> egui::ColorImage {
    let pixels = image.pixels.par_iter().map(|pixel| {
        let [r, g, b] = srgb8(*pixel);
        Color32::from_rgb(r, g, b)
    });
    egui::ColorImage::new([image.width as usize, image.height as usize], pixels.collect())
}

/// Text on a dark ground.
fn label(painter: &egui::Painter, at: Pos2, text: &str, colour: Color32, width: f32) {
    let font = egui::FontId::proportional(13.0);
    let galley = painter.layout(text.to_owned(), font, colour, width.max(40.0));
    let rect = Rect::from_min_size(at - UiVec2::new(0.0, galley.size().y), galley.size());
    painter.rect_filled(rect.expand(4.0), 4.0, Color32::from_black_alpha(150));
    painter.galley(rect.min, galley, colour);
}
