//! The bar below the picture: play, pause, scrub and speed; and the help.

use eframe::egui;

use super::Viewer;
use super::panel::named;

/// Speeds that are offered.
const SPEEDS: [f32; 6] = [0.1, 0.25, 0.5, 1.0, 2.0, 4.0];

impl Viewer {
    /// Returns whether the scene was edited.
    pub(super) fn timeline(&mut self, ui: &mut egui::Ui) -> bool {
        let mut is_edited = false;
        ui.horizontal(|ui| {
            let duration = self.document.state.scene.duration();
            let has_motion = duration > 0.0;
            let text = if self.clock.is_playing { "Pause" } else { "Play" };
            let play = ui.add_enabled(has_motion, egui::Button::new(text));
            if play.on_hover_text("Space").on_disabled_hover_text("nothing moves in this scene").clicked() {
                self.toggle_playing();
            }
            let mut seconds = self.clock.seconds.min(duration);
            let slider = egui::Slider::new(&mut seconds, 0.0..=duration.max(0.01)).suffix(" s").fixed_decimals(2);
            ui.spacing_mut().slider_width = (ui.available_width() - 430.0).max(40.0);
            let scrub = ui.add_enabled(has_motion, slider);
            scrub.widget_info(|| egui::WidgetInfo::slider(has_motion, f64::from(seconds), "Time"));
            if scrub.changed() && seconds.is_finite() {
                self.clock.seconds = seconds.clamp(0.0, duration);
                self.document.state.is_animated = true;
                self.canvas.holds_camera = false;
                self.is_outdated = true;
            }
            let speed =
                egui::ComboBox::from_id_salt("Speed").selected_text(format!("\u{d7} {}", self.clock.speed)).width(60.0);
            let speed = speed.show_ui(ui, |ui| {
                for speed in SPEEDS {
                    ui.selectable_value(&mut self.clock.speed, speed, format!("\u{d7} {speed}"));
                }
            });
            named(&speed.response, egui::Role::ComboBox, "Speed");
            let animate =
                ui.add_enabled_ui(has_motion, |ui| ui.checkbox(&mut self.document.state.is_animated, "Animate"));
            if animate.inner.changed() {
                self.clock.is_playing &= self.document.state.is_animated;
                is_edited = true;
            }
            ui.separator();
            if ui.button("Help").on_hover_text("F1").clicked() {
                self.panel.shows_help ^= true;
            }
            let text = if self.panel.is_open { "Hide panel" } else { "Show panel" };
            if ui.button(text).on_hover_text("H").clicked() {
                self.panel.is_open ^= true;
            }
        });
        is_edited
    }

    /// The keys, in a window of their own.
    pub(super) fn help(&mut self, context: &egui::Context) {
        let window = egui::Window::new("Help").open(&mut self.panel.shows_help).resizable(false).collapsible(false);
        window.show(context, |ui| {
            egui::Grid::new("keys").num_columns(2).striped(true).show(ui, |ui| {
                for (keys, action) in KEYS {
                    ui.strong(*keys);
                    ui.label(*action);
                    ui.end_row();
                }
            });
        });
    }
}

/// What keys and gestures do.
const KEYS: &[(&str, &str)] = &[
    ("Drag", "orbit"),
    ("Shift + drag, right or middle button", "pan"),
    ("Scroll, pinch, + and \u{2212}", "nearer, farther"),
    ("Arrow keys (with Shift)", "orbit (pan)"),
    ("Click", "select an object; drag its arrows to move it, its rings to turn it"),
    ("Space", "play, pause"),
    ("R", "the scene's own camera"),
    ("H", "hide or show the panel"),
    ("P", "screenshot (PNG) into the current folder"),
    ("F11", "full screen"),
    ("Ctrl + Z, Ctrl + Y", "undo, redo"),
    ("Ctrl + S", "save the scene"),
    ("Drop a file", ".toml opens a scene, .obj adds a mesh, .exr and .hdr light it"),
];
