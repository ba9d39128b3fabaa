//! The sections of what shines and of what light passes: lamps, emitters, interfaces and the medium.

use eframe::egui;
use glam::Vec3;

use super::fields::{number, switch, vector};
use crate::scene::{Animation, Medium, Refractor};
use crate::viewer::Viewer;

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
            if lamp.is_distant {
                let [mut towards, reset] = [&*lamp, original].map(|lamp| lamp.position.normalize_or(Vec3::Y));
                if vector(ui, &format!("{} direction", lamp.name), &mut towards, reset, 0.01) {
                    lamp.turn_towards(towards);
                    is_edited = true;
                }
            } else {
                is_edited |= vector(ui, &format!("{} m", lamp.name), &mut lamp.position, original.position, 0.01);
            }
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

impl Viewer {
    /// How bright each emitter is, and whether its light comes from where it is.
    pub(super) fn emitters_section(&mut self, ui: &mut egui::Ui) -> bool {
        let mut is_edited = false;
        for (object, original) in
            self.document.state.scene.objects.iter_mut().zip(&self.document.original.scene.objects)
        {
            let (Some(emitter), Some(original)) = (&mut object.emitter, original.emitter) else { continue };
            ui.strong(object.name.clone());
            let full = original.radiance.max_element();
            let mut factor = emitter.radiance.max_element() / full;
            // Black ones stay black.
            if full > 0.0 && number(ui, &format!("{} brightness", object.name), &mut factor, 1.0, (0.01..=100.0, true))
            {
                emitter.radiance = factor * original.radiance;
                is_edited = true;
            }
            is_edited |= switch(ui, &format!("{} is near", object.name), &mut emitter.is_near, original.is_near);
        }
        is_edited
    }

    /// The refractive indices of interfaces; colours keep their distances from each other.
    pub(super) fn refraction_section(&mut self, ui: &mut egui::Ui) -> bool {
        let mut is_edited = false;
        for (object, original) in
            self.document.state.scene.objects.iter_mut().zip(&self.document.original.scene.objects)
        {
            let (Some(refractor), Some(original)) = (&mut object.refractor, &original.refractor) else { continue };
            let mut index = mean_index(refractor);
            if number(ui, &format!("{} index", object.name), &mut index, mean_index(original), (1.01..=2.5, false)) {
                refractor.eta = (original.eta + (index - mean_index(original))).max(glam::DVec3::splat(1e-3));
                is_edited = true;
            }
        }
        is_edited
    }
}

fn mean_index(refractor: &Refractor) -> f64 {
    refractor.eta.element_sum() / 3.0
}
