//! Input that moves the camera: pointer, wheel, touchpad and keys.

use eframe::egui;
use egui::{Key, PointerButton, Rect};
use glam::{Vec2, Vec3};

use super::Viewer;
use super::navigation::{dolly, orbit, pan};
use crate::scene::Camera;

/// The distance changes by a factor of e for so many points of scrolling.
const POINTS_PER_E: f32 = 400.0;
/// A step of the arrow keys, as a fraction of the window's height.
const KEY_STEP: f32 = 0.04;
/// A step of the keys + and −: the factor on the distance.
const KEY_FACTOR: f32 = 1.1;
const ARROW_KEYS: [(Key, Vec2); 4] = [
    (Key::ArrowLeft, Vec2::new(KEY_STEP, 0.0)),
    (Key::ArrowRight, Vec2::new(-KEY_STEP, 0.0)),
    (Key::ArrowUp, Vec2::new(0.0, KEY_STEP)),
    (Key::ArrowDown, Vec2::new(0.0, -KEY_STEP)),
];

/// A camera, and the point that it circles.
struct CameraMove {
    camera: Camera,
    target: Vec3,
}

impl CameraMove {
    fn drag(&mut self, drag: Vec2, is_pan: bool) {
        if is_pan { pan(&mut self.camera, &mut self.target, drag) } else { orbit(&mut self.camera, self.target, drag) }
    }

    /// Orbits by dragging; pans by the other buttons or with Shift.
    fn by_pointer(&mut self, ui: &egui::Ui, response: &egui::Response, height: f32) {
        let drag = response.drag_delta() / height;
        let is_pan = ui.input(|input| input.modifiers.shift) || !response.dragged_by(PointerButton::Primary);
        if response.dragged() && drag != egui::Vec2::ZERO {
            self.drag(Vec2::new(drag.x, drag.y), is_pan);
        }
    }

    /// Comes nearer or goes away by scrolling or pinching.
    fn by_wheel(&mut self, ui: &egui::Ui) {
        let (scroll, zoom) = ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
        let factor = (-scroll / POINTS_PER_E).exp() / zoom;
        if factor != 1.0 {
            dolly(&mut self.camera, self.target, factor);
        }
    }

    fn by_keys(&mut self, ui: &egui::Ui) {
        let is_pressed = |key| ui.input(|input| input.key_pressed(key));
        let is_pan = ui.input(|input| input.modifiers.shift);
        for (_, step) in ARROW_KEYS.into_iter().filter(|(key, _)| is_pressed(*key)) {
            self.drag(step, is_pan);
        }
        if is_pressed(Key::Plus) || is_pressed(Key::Equals) {
            dolly(&mut self.camera, self.target, 1.0 / KEY_FACTOR);
        }
        if is_pressed(Key::Minus) {
            dolly(&mut self.camera, self.target, KEY_FACTOR);
        }
    }
}

impl Viewer {
    /// Moves the camera. Returns whether it moved.
    pub(super) fn move_camera(&mut self, ui: &egui::Ui, response: &egui::Response, area: Rect) -> bool {
        let camera = self.posed_scene().camera;
        let mut moved = CameraMove { camera, target: self.target };
        moved.by_pointer(ui, response, area.height().max(1.0));
        if response.hovered() {
            moved.by_wheel(ui);
        }
        // Arrow keys belong to a control that has the focus.
        let has_focus = |id: egui::Id| id == response.id;
        if ui.memory(|memory| memory.focused().is_none_or(has_focus)) {
            moved.by_keys(ui);
        }
        if moved.camera == camera {
            return false;
        }
        self.document.state.scene.camera = moved.camera;
        self.target = moved.target;
        true
    }
}
