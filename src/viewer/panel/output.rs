//! The section of files: the scene, pictures, frames, and the command that renders the same.

use std::path::PathBuf;

use eframe::egui;

use super::fields::{browse, named};
use super::settings::OVERLAYS;
use crate::viewer::Viewer;
use crate::viewer::dialogs::{Chosen, Purpose};
use crate::viewer::jobs::Job;
use crate::{Options, Sequence};
use pinspot_render::options::Overlay;

impl Viewer {
    pub(super) fn output_section(&mut self, ui: &mut egui::Ui) {
        ui.horizontal(|ui| {
            file(ui, "Scene file", &mut self.panel.scene_file);
            if ui.button("Save scene").on_hover_text("Ctrl + S").clicked() {
                self.save_scene();
            }
            if browse(ui, "Browse for the scene's file") {
                self.dialogs.ask(Purpose::SaveScene, &self.panel.scene_file);
            }
        });
        ui.horizontal(|ui| {
            for (axis, name) in ["Width", "Height"].into_iter().enumerate() {
                let drag = egui::DragValue::new(&mut self.panel.output_size[axis]).range(1..=16384);
                let drag = ui.add(drag);
                named(&drag, egui::Role::SpinButton, name);
            }
            ui.label("pixels");
            if ui.small_button("as in the window").clicked() {
                self.panel.output_size = self.canvas.size();
            }
        });
        let is_idle = self.job.is_none();
        ui.add_enabled_ui(is_idle, |ui| {
            ui.horizontal(|ui| {
                file(ui, "Picture file", &mut self.panel.picture_file);
                if ui.button("Save picture").on_hover_text(".png, or .exr for radiance").clicked() {
                    self.save_picture();
                }
                if browse(ui, "Browse for the picture's file") {
                    self.dialogs.ask(Purpose::SavePicture, &self.panel.picture_file);
                }
            });
            ui.horizontal(|ui| {
                file(ui, "Frames file", &mut self.panel.frames_file);
                let record = ui.button("Record");
                if record.on_hover_text("one .apng, or numbered files such as frame-####.exr").clicked() {
                    self.record();
                }
                if browse(ui, "Browse for the frames' file") {
                    self.dialogs.ask(Purpose::Record, &self.panel.frames_file);
                }
            });
            ui.horizontal(|ui| {
                let frames = ui.add(egui::DragValue::new(&mut self.panel.frame_count).range(1..=99_999));
                named(&frames, egui::Role::SpinButton, "Frames");
                ui.label("frames at");
                let rate = ui.add(egui::DragValue::new(&mut self.panel.frames_per_second).range(1..=240));
                named(&rate, egui::Role::SpinButton, "Frames per second");
                ui.label("per second");
            });
        });
        if let Some(part) = self.job {
            ui.horizontal(|ui| {
                if ui.button("Stop").clicked() {
                    self.worker.abort();
                }
                ui.add(egui::ProgressBar::new(part).show_percentage());
            });
        }
        ui.horizontal(|ui| {
            if ui.button("Screenshot").on_hover_text("P: the window as it is, as PNG").clicked() {
                self.save_screenshot(ui.ctx());
            }
            if ui
                .button("Copy command")
                .on_hover_text("the command line that renders the saved scene, without its animation")
                .clicked()
            {
                self.copy_command(ui.ctx());
            }
        });
    }

    /// Takes the file that was chosen in a dialog.
    pub(in crate::viewer) fn take_chosen_file(&mut self) {
        match self.dialogs.chosen() {
            None => {}
            Some(Chosen::NoDialog) => self.notices.fail(
                "this desktop has no file dialog (xdg-desktop-portal or zenity): type the name, or drop the file here"
                    .to_owned(),
            ),
            Some(Chosen::File(purpose, path)) => {
                let name = path.display().to_string();
                match purpose {
                    Purpose::Open | Purpose::OpenMap => self.loader.open(path, &self.document),
                    Purpose::SaveScene => {
                        self.panel.scene_file = name;
                        self.save_scene();
                    }
                    Purpose::SavePicture => {
                        self.panel.picture_file = name;
                        self.save_picture();
                    }
                    Purpose::Record => {
                        self.panel.frames_file = name;
                        self.record();
                    }
                }
            }
        }
    }

    fn output_options(&self) -> Options {
        let options = self.document.state.options.clone().with_size(self.panel.output_size);
        options.with_overlay(Overlay::None)
    }

    fn save_picture(&mut self) {
        let path = PathBuf::from(self.panel.picture_file.trim());
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        if !matches!(ending.as_str(), "png" | "exr") {
            self.notices.fail(format!("cannot save '{}': give a name that ends in .png or .exr", path.display()));
            return;
        }
        let (scene, options) = (Box::new(self.posed_scene()), Box::new(self.output_options()));
        self.begin(Job::Picture { scene, options, path });
    }

    fn record(&mut self) {
        let outputs = vec![PathBuf::from(self.panel.frames_file.trim())];
        match Sequence::new(0..self.panel.frame_count, self.panel.frames_per_second, outputs) {
            Err(error) => self.notices.fail(error.to_string()),
            Ok(sequence) => {
                let (scene, options) = (Box::new(self.document.state.scene.clone()), Box::new(self.output_options()));
                self.begin(Job::Frames { scene, options, sequence });
            }
        }
    }

    fn begin(&mut self, job: Job) {
        self.clock.is_playing = false;
        self.job = Some(0.0);
        self.worker.begin(job);
    }

    /// The command renders the file, which therefore has to hold all edits.
    fn copy_command(&mut self, context: &egui::Context) {
        if self.document.is_edited() {
            self.notices.fail("the command renders the scene's file: save the scene first".to_owned());
            return;
        }
        let [width, height] = self.panel.output_size;
        let options = &self.document.state.options;
        let overlay = OVERLAYS.iter().find(|(overlay, _)| *overlay == options.overlay && *overlay != Overlay::None);
        let overlay = overlay.map_or_else(String::new, |(_, name)| format!(" --overlay {name}"));
        let command = format!(
            "pinspot render {} -o {} --size {width}x{height}{}{}",
            quoted(&self.document.name),
            quoted(self.panel.picture_file.trim()),
            if options.plain_diffuse { " --plain-diffuse" } else { "" },
            overlay,
        );
        self.notices.say(format!("copied: {command}"));
        context.copy_text(command);
    }
}

/// A name as a shell takes it.
fn quoted(name: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./".contains(c);
    if name.chars().all(is_plain) { name.to_owned() } else { format!("'{}'", name.replace('\'', r"'\''")) }
}

fn file(ui: &mut egui::Ui, name: &str, path: &mut String) {
    let edit = ui.add(egui::TextEdit::singleline(path).desired_width(150.0));
    named(&edit, egui::Role::TextInput, name);
}

#[cfg(test)]
mod tests {
    use super::quoted;

    #[test]
    fn names_reach_the_shell_unchanged() {
        assert_eq!(quoted("scenes/ring-1.toml"), "scenes/ring-1.toml");
        assert_eq!(quoted("my ring.toml"), "'my ring.toml'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
    }
}
