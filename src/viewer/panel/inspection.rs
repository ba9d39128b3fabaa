//! The section that takes apart what lies under the pointer: footprints on the environment, or what a sample of a mirror sees.

use eframe::egui;
use egui::{Color32, ColorImage, Pos2, Rect, Sense, Stroke, TextureHandle, TextureOptions};

use super::fields::{named, switch};
use crate::viewer::Viewer;
use crate::viewer::canvas::colour_image;
use crate::viewer::inspector::{Answer, Inspector, Question};
use crate::{Inspection, MapFootprint, ReceiverInspection, TakenCell};
use pinspot_render::options::Exposure;
use pinspot_render::pinhole::SampleView;

/// Radius of the dot of a footprint that brings everything, points.
const DOT: f32 = 14.0;

/// What is shown of the place under the pointer.
#[derive(Default)]
pub(crate) struct InspectionState {
    /// The pointer is followed.
    is_on: bool,
    /// The cells of the sum are drawn, too.
    with_cells: bool,
    /// Answers about earlier views belong to another scene.
    first_view: u64,
    inspector: Option<Inspector>,
    /// The last place that was asked about, and its view.
    asked: Option<(glam::Vec2, u64, bool)>,
    /// The answer has not come yet.
    is_waiting: bool,
    map: Option<TextureHandle>,
    view: Option<TextureHandle>,
    found: Option<Inspection>,
    /// Cells that the sum takes for the receiver under the pointer, and the view that they belong to; `None` if it is flat.
    cells: Option<(Vec<TakenCell>, u64)>,
    failure: Option<String>,
}

impl InspectionState {
    /// The cells that are drawn.
    #[cfg(test)]
    pub fn cells(&self) -> &[TakenCell] {
        self.cells.as_ref().map_or(&[], |(cells, _)| cells)
    }

    /// What was found under the pointer.
    #[cfg(test)]
    pub fn found(&self) -> Option<&Inspection> {
        self.found.as_ref()
    }
}

impl Viewer {
    pub(super) fn inspection_section(&mut self, ui: &mut egui::Ui) {
        switch(ui, "Follow the pointer", &mut self.inspection.is_on, false);
        if !self.inspection.is_on {
            ui.weak(
                "Shows where the light under the pointer comes from, and what samples of mirrors and interfaces see.",
            );
            return;
        }
        switch(ui, "Cells of the sum", &mut self.inspection.with_cells, false);
        if let Some(reason) = &self.inspection.failure {
            ui.colored_label(Color32::YELLOW, reason);
        }
        if let Some(map) = &self.inspection.map {
            let width = ui.available_width();
            let (area, response) = ui.allocate_exact_size(egui::Vec2::new(width, 0.5 * width), Sense::hover());
            named(&response, egui::Role::Image, "Environment");
            let painter = ui.painter_at(area);
            painter.image(map.id(), area, Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0)), Color32::WHITE);
            let receiver = self.inspection.found.as_ref().and_then(|found| found.receiver.as_ref());
            for footprint in receiver.iter().flat_map(|receiver| &receiver.footprints) {
                paint_footprint(&painter, area, footprint);
            }
        }
        let Some(found) = &self.inspection.found else {
            let is_waiting = self.inspection.is_waiting;
            ui.weak(if is_waiting { "Looking\u{2026}" } else { "Point at something in the picture." });
            return;
        };
        let object = self.document.state.scene.objects.get(found.object);
        ui.label(object.map_or("", |object| object.name.as_str()));
        if let Some(receiver) = &found.receiver {
            ui.label(in_words(receiver));
            if self.inspection.with_cells {
                ui.label(cells_in_words(self.inspection.cells.as_ref()));
            }
        }
        if let Some(view) = self.inspection.view.as_ref().filter(|_| found.view.is_some()) {
            ui.label("What the nearest sample sees, horizon at the edge; bright: the environment");
            let width = 0.5 * ui.available_width();
            let image = egui::Image::new((view.id(), egui::Vec2::splat(width)));
            named(&ui.add(image), egui::Role::Image, "Visibility map");
        }
    }

    /// Asks about the place under the pointer, as fractions of the picture's width and height, or the last one if the view has changed.
    pub(in crate::viewer) fn inspect(&mut self, context: &egui::Context, place: Option<glam::Vec2>) {
        self.take_answer(context);
        let place = place.or(self.inspection.asked.map(|(place, ..)| place));
        let moves = self.clock.is_playing || self.is_outdated || context.input(|input| input.pointer.any_down());
        let Some(place) = place.filter(|_| self.inspection.is_on && !moves && self.sent() > 0) else { return };
        let with_cells = self.inspection.with_cells;
        if self.inspection.asked == Some((place, self.sent(), with_cells)) {
            return;
        }
        (self.inspection.asked, self.inspection.is_waiting) = (Some((place, self.sent(), with_cells)), true);
        let mut options = self.document.state.options.clone().with_size(self.canvas.size());
        if let Some(used) = self.picture.as_ref().and_then(|picture| picture.exposures) {
            options.display.exposure = Exposure::Stops(used.exposure_ev);
            options.display.background_exposure_ev = Some(used.background_exposure_ev);
        }
        let question = Question { scene: self.posed_scene(), options, place, view: self.sent(), with_cells };
        let waker = context.clone();
        let start = || Inspector::start(move || waker.request_repaint());
        if !self.inspection.inspector.get_or_insert_with(start).ask(question) {
            self.inspection.inspector = None;
            self.inspection.failure = Some("a defect of Pinspot ended the inspection; please report it".to_owned());
        }
    }

    /// Draws the cells of the sum over the picture: the more one brings, the brighter, those on the far sides of mirrors, too.
    pub(in crate::viewer) fn paint_cells(&self, painter: &egui::Painter, area: Rect) {
        let state = &self.inspection;
        let is_current = |cells: &&(Vec<TakenCell>, u64)| state.is_on && state.with_cells && cells.1 == self.sent();
        let Some((cells, _)) = state.cells.as_ref().filter(is_current) else { return };
        let camera = self.posed_scene().camera;
        let size = glam::Vec2::new(area.width(), area.height());
        let most = cells.iter().map(|cell| cell.irradiance.element_sum()).fold(f32::MIN_POSITIVE, f32::max);
        // Below the outlines.
        let (place, mut fills) = (painter.add(egui::Shape::Noop), egui::Mesh::default());
        for cell in cells {
            let [u, v] = cell.sides.map(|side| 0.5 * side);
            let corners = [-u - v, u - v, u + v, v - u].map(|corner| camera.project(cell.centroid + corner, size));
            if corners.iter().any(|(_, depth)| *depth <= 0.0) {
                continue;
            }
            let points = corners.map(|(at, _)| area.min + egui::Vec2::new(at.x, at.y));
            let part = (cell.irradiance.element_sum() / most).sqrt();
            let colour = Color32::from_rgb(255, 200, 40);
            let first = fills.vertices.len() as u32;
            for point in points {
                fills.colored_vertex(point, colour.gamma_multiply(0.6 * part));
            }
            fills.add_triangle(first, first + 1, first + 2);
            fills.add_triangle(first, first + 2, first + 3);
            paint_outline(painter, &points, Stroke::new(1.0, colour.gamma_multiply(0.7)));
        }
        painter.set(place, fills);
    }

    /// Forgets what was found in another scene.
    pub(in crate::viewer) fn forget_inspection(&mut self) {
        let InspectionState { is_on, with_cells, .. } = self.inspection;
        self.inspection =
            InspectionState { is_on, with_cells, first_view: self.sent() + 1, ..InspectionState::default() };
    }

    fn take_answer(&mut self, context: &egui::Context) {
        let state = &mut self.inspection;
        let answer = state.inspector.as_ref().and_then(Inspector::answer);
        let Some(Answer { map, found, cells, view: of_view }) = answer.filter(|answer| answer.view >= state.first_view)
        else {
            return;
        };
        state.is_waiting = false;
        if let Some(map) = map {
            state.map = Some(context.load_texture("environment", colour_image(&map), TextureOptions::LINEAR));
        }
        state.cells = cells.map(|cells| (cells, of_view));
        (state.found, state.failure) = match found {
            Ok(found) => (found, None),
            Err(reason) => (None, Some(reason)),
        };
        let view = state.found.as_ref().and_then(|found| found.view.as_ref());
        state.view =
            view.map(|view| context.load_texture("visibility map", image_of_view(view), TextureOptions::NEAREST));
    }
}

fn image_of_view(view: &SampleView) -> ColorImage {
    let colour = |sees: &bool| if *sees { Color32::from_rgb(150, 205, 255) } else { Color32::from_gray(40) };
    ColorImage::new([view.resolution as usize; 2], view.sees_environment.iter().map(colour).collect())
}

/// Its outline, and a dot whose area is its part of the irradiance.
fn paint_footprint(painter: &egui::Painter, area: Rect, footprint: &MapFootprint) {
    let points: Vec<Pos2> =
        footprint.outline.iter().map(|at| area.min + egui::Vec2::new(at.x, at.y) * area.size()).collect();
    let middle = points.iter().fold(egui::Vec2::ZERO, |sum, point| sum + point.to_vec2()) / points.len() as f32;
    // Across the map's left and right edges, too.
    for turn in [-1.0, 0.0, 1.0] {
        let shift = egui::Vec2::new(turn * area.width(), 0.0);
        let moved: Vec<Pos2> = points.iter().map(|point| *point + shift).collect();
        paint_outline(painter, &moved, Stroke::new(1.0, Color32::from_rgb(255, 150, 30)));
        let radius = DOT * footprint.part.sqrt();
        painter.circle_filled((middle + shift).to_pos2(), radius, Color32::from_rgba_unmultiplied(255, 90, 0, 150));
    }
}

/// Side by side: where sides meet at an acute angle, the joint of a closed line would be a long spike.
fn paint_outline(painter: &egui::Painter, corners: &[Pos2], stroke: Stroke) {
    for (k, corner) in corners.iter().enumerate() {
        painter.line_segment([*corner, corners[(k + 1) % corners.len()]], stroke);
    }
}

fn cells_in_words(cells: Option<&(Vec<TakenCell>, u64)>) -> String {
    match cells {
        Some((cells, _)) => format!("{} cells are taken as one sample each", cells.len()),
        None => "the sum is flat: every sample is taken".to_owned(),
    }
}

fn in_words(receiver: &ReceiverInspection) -> String {
    let [r, g, b] = receiver.irradiance.to_array();
    let ReceiverInspection { samples, main_samples, .. } = receiver;
    if *samples == 0 {
        return "no mirror or interface throws light here".to_owned();
    }
    format!(
        "irradiance {r:.3}, {g:.3}, {b:.3} W/m\u{b2} from {samples} samples; {main_samples} of them bring nine tenths"
    )
}
