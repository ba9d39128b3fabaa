//! The section that compares the picture with the ground truth.

use eframe::egui;
use egui::{Color32, Pos2, Rect, TextureHandle, TextureOptions};

use super::fields::switch;
use crate::viewer::Viewer;
use crate::viewer::canvas::colour_image;
use crate::viewer::difference::{Comparison, Difference};

/// The comparison that is shown over the picture.
#[derive(Default)]
pub(crate) struct DifferenceState {
    is_on: bool,
    /// The comparison at hand, and the number of the radiance that it belongs to.
    comparison: Option<(Comparison, u64)>,
    /// The latest difference, without its pixels, and these.
    found: Option<(Difference, TextureHandle)>,
    failure: Option<String>,
}

impl DifferenceState {
    /// The latest difference.
    #[cfg(test)]
    pub fn found(&self) -> Option<&Difference> {
        self.found.as_ref().map(|(difference, _)| difference)
    }
}

impl Viewer {
    pub(super) fn difference_section(&mut self, ui: &mut egui::Ui) {
        switch(ui, "Difference to the reference", &mut self.difference.is_on, false);
        if !self.difference.is_on {
            ui.weak("Shows how far the caustic is from an unbiased reference, which is computed while things rest.");
            return;
        }
        if let Some(reason) = &self.difference.failure {
            ui.colored_label(Color32::YELLOW, reason);
        }
        let is_current = |difference: &Difference| difference.view == self.sent_radiance();
        match self.difference.found.as_ref().filter(|(difference, _)| is_current(difference)) {
            Some((Difference { rel_l2, uncertainty, seconds, is_final, .. }, _)) => {
                let state = if *is_final { "" } else { ", becoming more exact\u{2026}" };
                ui.label(format!(
                    "relative error {:.1} % (\u{b1} {:.1} % of the reference), {seconds:.0} s{state}",
                    100.0 * rel_l2,
                    100.0 * uncertainty
                ));
                ui.weak("black: equal; white: off by half of the typical irradiance, or more");
            }
            None if self.difference.failure.is_none() => {
                ui.weak("waits for the finished picture\u{2026}");
            }
            None => {}
        }
    }

    /// Starts a comparison of the picture that is finished, ends one of an earlier picture, and takes what was found.
    pub(in crate::viewer) fn compare_with_reference(&mut self, context: &egui::Context) {
        let is_finished = self.is_finished() && self.notices.failure().is_none();
        let sent = self.sent_radiance();
        let state = &mut self.difference;
        if !state.is_on || state.comparison.as_ref().is_some_and(|(_, view)| *view != sent) {
            (state.comparison, state.failure) = (None, None);
        }
        if state.is_on && is_finished && state.comparison.is_none() {
            let scene = self.posed_scene();
            let options = self.document.state.options.clone().with_size(self.canvas.size());
            let waker = context.clone();
            let comparison = Comparison::start(sent, scene, &options, move || waker.request_repaint());
            self.difference.comparison = Some((comparison, sent));
        }
        let state = &mut self.difference;
        match state.comparison.as_ref().and_then(|(comparison, _)| comparison.found()) {
            None => {}
            Some(Err(reason)) => state.failure = Some(reason),
            Some(Ok(mut difference)) => {
                let image = colour_image(&difference.heat);
                difference.heat.pixels = Vec::new();
                let texture = context.load_texture("difference", image, TextureOptions::LINEAR);
                state.found = Some((difference, texture));
            }
        }
    }

    /// Paints the heat map over the picture that it belongs to.
    pub(in crate::viewer) fn paint_difference(&self, painter: &egui::Painter, area: Rect) {
        let state = &self.difference;
        let current =
            state.found.as_ref().filter(|(difference, _)| state.is_on && difference.view == self.sent_radiance());
        if let Some((_, texture)) = current {
            let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            painter.image(texture.id(), area, whole, Color32::WHITE);
        }
    }
}
