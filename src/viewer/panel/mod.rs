//! The panel: everything about the scene and its rendering that can be set. Each value can be dragged, typed, reset and undone.

mod difference;
mod fields;
mod inspection;
mod lights;
mod maps;
mod objects;
mod output;
mod settings;

use eframe::egui;

pub(crate) use self::difference::DifferenceState;
use self::fields::browse;
pub(super) use self::fields::named;
pub(crate) use self::inspection::InspectionState;
pub(crate) use self::maps::Thumbnails;

use super::Viewer;
use super::dialogs::Purpose;
use super::document::Document;
use crate::scene::BUILT_IN;

/// Width of sliders, points.
const SLIDER_WIDTH: f32 = 100.0;

/// What the panel itself keeps.
#[derive(Clone, Debug)]
pub struct PanelState {
    pub is_open: bool,
    pub shows_help: bool,
    /// A path to open.
    pub open_file: String,
    /// Where the scene is saved.
    pub scene_file: String,
    /// Where pictures are saved.
    pub picture_file: String,
    /// Where frames are saved.
    pub frames_file: String,
    pub frames_per_second: u16,
    /// Frames that are recorded.
    pub frame_count: u32,
    /// Width and height of pictures and frames that are saved.
    pub output_size: [u32; 2],
}

impl PanelState {
    pub fn new(document: &Document) -> Self {
        let is_file = document.name.to_lowercase().ends_with(".toml");
        let name = std::path::Path::new(&document.name).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let frames_per_second = 24;
        let frame_count = (document.state.scene.duration() * f32::from(frames_per_second)).round().max(1.0) as u32;
        Self {
            is_open: true,
            shows_help: false,
            open_file: String::new(),
            scene_file: if is_file { document.name.clone() } else { format!("{name}.toml") },
            picture_file: format!("{name}.png"),
            frames_file: format!("{name}.apng"),
            frames_per_second,
            frame_count,
            output_size: document.original.options.size,
        }
    }

    /// The scene's name, for names of files.
    pub fn stem(&self) -> String {
        std::path::Path::new(&self.scene_file).file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }
}

impl Viewer {
    /// Returns whether the scene was edited.
    pub(super) fn show_panel(&mut self, ui: &mut egui::Ui) -> bool {
        let mut is_edited = false;
        // Content that is too wide must not widen the panel: the picture would have to be rendered again.
        egui::ScrollArea::both().auto_shrink(false).show(ui, |ui| {
            ui.spacing_mut().slider_width = SLIDER_WIDTH;
            self.scene_section(ui);
            is_edited |= self.comparison(ui);
            ui.separator();
            let section = |ui: &mut egui::Ui, name: &str, is_open: bool, show: &mut dyn FnMut(&mut egui::Ui)| {
                egui::CollapsingHeader::new(name).default_open(is_open).show(ui, |ui| show(ui));
            };
            section(ui, "Display", true, &mut |ui| is_edited |= self.display_section(ui));
            section(ui, "Objects", false, &mut |ui| is_edited |= self.objects_section(ui));
            section(ui, "Save and record", false, &mut |ui| self.output_section(ui));
            section(ui, "Light", true, &mut |ui| is_edited |= self.light_section(ui));
            if !self.document.state.scene.lamps.is_empty() {
                section(ui, "Lamps", true, &mut |ui| is_edited |= self.lamps_section(ui));
            }
            let objects = &self.document.state.scene.objects;
            let has_emitters = objects.iter().any(|object| object.emitter.is_some());
            let has_refractors = objects.iter().any(|object| object.refractor.is_some());
            if has_emitters {
                section(ui, "Emitters", true, &mut |ui| is_edited |= self.emitters_section(ui));
            }
            if has_refractors {
                section(ui, "Refraction", true, &mut |ui| is_edited |= self.refraction_section(ui));
            }
            if self.document.state.scene.medium.is_some() {
                section(ui, "Medium", true, &mut |ui| is_edited |= self.medium_section(ui));
            }
            section(ui, "Caustic", false, &mut |ui| is_edited |= self.caustic_section(ui));
            section(ui, "Under the pointer", false, &mut |ui| self.inspection_section(ui));
            section(ui, "Reference", false, &mut |ui| self.difference_section(ui));
            section(ui, "Frame time", false, &mut |ui| self.frame_time_section(ui));
        });
        is_edited
    }

    fn scene_section(&mut self, ui: &mut egui::Ui) {
        ui.horizontal(|ui| {
            let mut chosen = None;
            let scenes =
                egui::ComboBox::from_label("Scene").selected_text(self.panel.stem()).width(120.0).height(420.0);
            scenes.show_ui(ui, |ui| {
                for built_in in BUILT_IN {
                    let is_open = self.document.name == built_in.name;
                    if ui.selectable_label(is_open, built_in.name).on_hover_text(built_in.about).clicked() {
                        chosen = Some(built_in.name);
                    }
                }
            });
            if let Some(name) = chosen {
                self.loader.open_scene(name.to_owned());
            }
            let history = &self.document.history;
            let (can_undo, can_redo) = (history.can_undo(), history.can_redo());
            if ui.add_enabled(can_undo, egui::Button::new("Undo")).on_hover_text("Ctrl + Z").clicked() {
                self.document.undo();
                self.is_outdated = true;
            }
            if ui.add_enabled(can_redo, egui::Button::new("Redo")).on_hover_text("Ctrl + Y").clicked() {
                self.document.redo();
                self.is_outdated = true;
            }
        });
        ui.horizontal(|ui| {
            let hint = "scene, mesh.obj or map";
            let edit = egui::TextEdit::singleline(&mut self.panel.open_file).hint_text(hint).desired_width(150.0);
            let edit = ui.add(edit);
            named(&edit, egui::Role::TextInput, "File to open");
            let is_entered = edit.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
            if ui.button("Open").clicked() || is_entered {
                self.loader.open(self.panel.open_file.trim().into(), &self.document);
            }
            if browse(ui, "Browse for a file to open") {
                self.dialogs.ask(Purpose::Open, &self.panel.open_file);
            }
        });
    }

    /// The seconds that the last picture took, stage by stage.
    fn frame_time_section(&mut self, ui: &mut egui::Ui) {
        let mut milliseconds = 1000.0 * self.frame_seconds;
        let slider = egui::Slider::new(&mut milliseconds, 8.0..=1000.0).logarithmic(true).suffix(" ms");
        let slider = ui.add(slider.text("Target")).on_hover_text("how long a preview may take while things move");
        if slider.changed() && milliseconds.is_finite() {
            self.frame_seconds = 1e-3 * milliseconds;
            self.is_outdated = true;
        }
        ui.label(format!("on {}", self.backend));
        let Some(picture) = &self.picture else { return };
        let bar = |ui: &mut egui::Ui, name: &str, seconds: f64| {
            let part = (seconds / picture.seconds.max(1e-9)) as f32;
            let text = format!("{name}: {:.1} ms", 1000.0 * seconds);
            ui.add(egui::ProgressBar::new(part).desired_height(16.0).text(text));
        };
        for (stage, seconds) in &picture.stages {
            bar(ui, stage.name(), *seconds);
        }
        ui.label("Passes on the GPU").on_hover_text("of previews, by the GPU's own clock");
        if picture.passes.is_empty() {
            ui.weak("unavailable");
        }
        for pass in &picture.passes {
            bar(ui, pass.name, pass.seconds);
        }
        for warning in &picture.warnings {
            ui.colored_label(egui::Color32::YELLOW, warning);
        }
    }
}
