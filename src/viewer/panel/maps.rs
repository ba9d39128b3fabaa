//! The environment maps, by their thumbnails.

use eframe::egui;
use egui::{TextureHandle, TextureOptions, Vec2};

use super::fields::named;
use crate::viewer::Viewer;
use crate::viewer::canvas::colour_image;
use crate::viewer::dialogs::Purpose;

/// Of a thumbnail, points: three in a row.
const SIZE: Vec2 = Vec2::new(80.0, 40.0);
/// Between thumbnails, points.
const GAP: f32 = 4.0;

/// Thumbnails of the maps, in their order, as far as they are finished.
#[derive(Default)]
pub(crate) struct Thumbnails(Vec<TextureHandle>);

impl Thumbnails {
    /// How many are finished.
    pub fn count(&self) -> usize {
        self.0.len()
    }
}

impl Viewer {
    pub(super) fn map_choices(&mut self, ui: &mut egui::Ui) {
        // Buttons have a margin around their images.
        let margin = 2.0 * ui.spacing().button_padding;
        let mut chosen = None;
        ui.horizontal_wrapped(|ui| {
            ui.spacing_mut().item_spacing = Vec2::splat(GAP);
            for (index, choice) in self.maps.choices().iter().enumerate() {
                let is_chosen = self.document.state.scene.environment.light == choice.light;
                let button = match self.thumbnails.0.get(index) {
                    Some(thumbnail) => egui::Button::image((thumbnail.id(), SIZE)),
                    None => egui::Button::new(choice.name()).min_size(SIZE + margin),
                };
                let button = ui.add(button.selected(is_chosen));
                named(&button, egui::Role::Button, &format!("Map {}", choice.name()));
                if button.on_hover_text(format!("{}: {}", choice.name(), choice.about)).clicked() && !is_chosen {
                    chosen = Some((choice.light.clone(), choice.reference.clone()));
                }
            }
        });
        ui.horizontal(|ui| {
            if ui.button("Open map\u{2026}").on_hover_text(".exr or .hdr; or drop the file here").clicked() {
                self.dialogs.ask(Purpose::OpenMap, "");
            }
            if self.document.state.map.is_some() && ui.button("Reset map").clicked() {
                self.document.reset_map();
                self.is_outdated = true;
            }
        });
        if let Some((light, reference)) = chosen {
            self.document.set_map(light, reference);
            self.is_outdated = true;
        }
    }

    /// Takes the thumbnails that have been finished.
    pub(in crate::viewer) fn take_thumbnails(&mut self, context: &egui::Context) {
        // The first picture comes first.
        if self.picture.is_some() {
            self.maps.ask_for_thumbnails();
        }
        while let Some(image) = self.maps.thumbnail() {
            let name = format!("map {}", self.thumbnails.0.len());
            self.thumbnails.0.push(context.load_texture(name, colour_image(&image), TextureOptions::LINEAR));
        }
    }
}
