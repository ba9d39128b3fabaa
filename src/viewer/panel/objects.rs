//! The section of the objects: which one is selected, and where it is. And those of the lamps and of the medium.

use eframe::egui;
use glam::Vec3;

use super::fields::{named, number, reset, typed_number};
use crate::scene::{Animation, Medium, Transform};
use crate::viewer::Viewer;

impl Viewer {
    pub(super) fn objects_section(&mut self, ui: &mut egui::Ui) -> bool {
        for index in 0..self.document.state.scene.objects.len() {
            let name = self.document.state.scene.objects[index].name.clone();
            let is_selected = self.selected == Some(index);
            if ui.selectable_label(is_selected, name).clicked() {
                self.selected = if is_selected { None } else { Some(index) };
            }
        }
        let Some(index) = self.selected else {
            ui.weak("Select an object here or in the picture to move it.");
            return false;
        };
        if self.document.state.is_animated && self.is_animated_object(index) {
            ui.weak("Its animation places this object; switch \u{201c}Animate\u{201d} off to move it.");
            return false;
        }
        let original = self.document.original.scene.objects.get(index).map_or(Transform::default(), |o| o.placement);
        let Some(before) = self.document.state.scene.objects.get(index).map(|object| object.placement) else {
            return false;
        };
        let placement = &mut before.clone();
        ui.separator();
        vector(ui, "Translate m", &mut placement.translate, original.translate, 0.01);
        let mut degrees = Vec3::from(placement.rotate_rad.to_array().map(f32::to_degrees));
        let rotation = Vec3::from(original.rotate_rad.to_array().map(f32::to_degrees));
        if vector(ui, "Rotate \u{b0}", &mut degrees, rotation, 0.5) {
            placement.rotate_rad = degrees.to_array().map(f32::to_radians).into();
        }
        ui.horizontal(|ui| {
            let drag = egui::DragValue::new(&mut placement.scale)
                .speed(0.005)
                .range(0.001..=1000.0)
                .clamp_existing_to_range(false);
            let drag = drag.custom_parser(typed_number);
            let drag = ui.add(drag);
            named(&drag, egui::Role::SpinButton, "Scale");
            ui.label("Scale");
            reset(ui, "Scale", &mut placement.scale, original.scale);
        });
        if *placement == before {
            return false;
        }
        self.document.place(index, *placement);
        true
    }
}

impl Viewer {
    /// Where each lamp is, and how bright.
    pub(super) fn lamps_section(&mut self, ui: &mut egui::Ui) -> bool {
        let state = &mut self.document.state;
        let mut is_edited = false;
        for (index, lamp) in state.scene.lamps.iter_mut().enumerate() {
            let Some(original) = self.document.original.scene.lamps.get(index) else { continue };
            ui.strong(lamp.name.clone());
            let moves = |animation: &Animation| matches!(animation, Animation::Lamp(motion) if motion.lamp == index);
            if state.is_animated && state.scene.animations.iter().any(moves) {
                ui.weak("Its animation sets this lamp; switch \u{201c}Animate\u{201d} off to change it.");
                continue;
            }
            is_edited |= vector(ui, &format!("{} m", lamp.name), &mut lamp.position, original.position, 0.01);
            let full = original.intensity.max_element();
            let mut factor = lamp.intensity.max_element() / full;
            if number(ui, &format!("{} brightness", lamp.name), &mut factor, 1.0, (0.01..=100.0, true)) {
                lamp.intensity = factor * original.intensity;
                for animation in &mut state.scene.animations {
                    if let Animation::Lamp(motion) = animation
                        && motion.lamp == index
                    {
                        motion.full_intensity = lamp.intensity;
                    }
                }
                is_edited = true;
            }
        }
        is_edited
    }
}

impl Viewer {
    /// How dense the medium is, and which way it scatters. Colours stay.
    pub(super) fn medium_section(&mut self, ui: &mut egui::Ui) -> bool {
        let mut is_edited = false;
        let original = self.document.original.scene.medium;
        let Some((medium, original)) = self.document.state.scene.medium.as_mut().zip(original) else { return false };
        let mut coefficient = |ui: &mut egui::Ui, name: &str, value: &mut Vec3, full: Vec3| {
            if full == Vec3::ZERO {
                return;
            }
            let mut largest = value.max_element();
            if number(ui, name, &mut largest, full.max_element(), (1e-3..=100.0, true)) {
                *value = largest / full.max_element() * full;
                is_edited = true;
            }
        };
        coefficient(ui, "Scattering 1/m", &mut medium.sigma_s, original.sigma_s);
        coefficient(ui, "Absorption 1/m", &mut medium.sigma_a, original.sigma_a);
        is_edited |= number(ui, "Forwards g", &mut medium.g, original.g, (-Medium::MAX_G..=Medium::MAX_G, false));
        is_edited
    }
}

/// Three numbers. Returns whether any was changed.
fn vector(ui: &mut egui::Ui, name: &str, value: &mut Vec3, original: Vec3, speed: f64) -> bool {
    let before = *value;
    ui.horizontal(|ui| {
        for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
            let drag =
                ui.add(egui::DragValue::new(&mut value[axis]).speed(speed).max_decimals(3).custom_parser(typed_number));
            named(&drag, egui::Role::SpinButton, &format!("{name} {letter}"));
        }
        ui.label(name);
        reset(ui, name, value, original);
    });
    *value != before
}
