//! The section of the objects: which one is selected, and where it is.

use eframe::egui;
use glam::Vec3;

use super::fields::{named, reset, typed_number, vector};
use crate::scene::Transform;
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
