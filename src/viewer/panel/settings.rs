//! Sections of the panel: the light, the display, and how the caustic is computed.

use eframe::egui;

use super::fields::{choice, number, switch};
use crate::image::{Aov, ToneMap};
use crate::scene::Visibility;
use crate::viewer::Viewer;
use pinspot_render::image_space::{Hits, ImageSpaceOptions, Incidence, MapView, Mode, Traversal};
use pinspot_render::options::{EvaluationChoice, Exposure, FilterChoice, Options, Overlay, Quality};
use pinspot_render::pinhole::{Epsilon, Footprint};
use pinspot_render::technique::Technique;
use pinspot_sums::sampling::{Density, MAX_SAMPLES, Strategy};

const STRATEGIES: &[(Strategy, &str)] = &[
    (Strategy::Neighbourhood, "neighbourhood"),
    (Strategy::Random, "random"),
    (Strategy::Grid, "grid"),
    (Strategy::QuantisedGrid, "quantised-grid"),
    (Strategy::Elimination, "elimination"),
];
const DENSITIES: &[(Density, &str)] = &[
    (Density::Uniform, "uniform"),
    (Density::Curvature, "curvature"),
    (Density::Normal, "normal"),
    (Density::Visibility, "visibility"),
    (Density::Contribution, "contribution"),
];
const FILTERS: &[(FilterChoice, &str)] = &[
    (FilterChoice::Auto, "auto"),
    (FilterChoice::None, "none"),
    (FilterChoice::Isotropic, "isotropic"),
    (FilterChoice::Anisotropic, "anisotropic"),
    (FilterChoice::Hardware, "hardware"),
    (FilterChoice::Ewa, "ewa"),
];
const EVALUATIONS: &[(EvaluationChoice, &str)] = &[
    (EvaluationChoice::Auto, "auto"),
    (EvaluationChoice::Flat, "flat"),
    (EvaluationChoice::Hierarchical, "hierarchical"),
];
const PICTURES: &[(Aov, &str)] = &[
    (Aov::Beauty, "beauty"),
    (Aov::Caustic, "caustic"),
    (Aov::CausticR, "reflected caustic"),
    (Aov::CausticT, "refracted caustic"),
    (Aov::CausticTT, "caustic through solids"),
    (Aov::CausticTTTT, "caustic through two solids"),
    (Aov::Direct, "direct"),
    (Aov::Scattered, "scattered caustic"),
    (Aov::ScatteredDirect, "scattered direct light"),
    (Aov::Albedo, "albedo"),
    (Aov::Normal, "normal"),
    (Aov::Position, "position"),
    (Aov::Depth, "depth"),
];
const TONE_MAPS: &[(ToneMap, &str)] =
    &[(ToneMap::Neutral, "neutral"), (ToneMap::Filmic, "filmic"), (ToneMap::Linear, "linear")];
/// What is drawn over the picture.
pub(super) const OVERLAYS: &[(Overlay, &str)] = &[
    (Overlay::None, "none"),
    (Overlay::Samples, "samples"),
    (Overlay::Normals, "normals"),
    (Overlay::Curvature, "curvature"),
    (Overlay::Cells, "cells"),
    (Overlay::Photons, "photons"),
    (Overlay::CausticMap, "caustic map"),
];
/// Numbers of leaves; 0: as many as fit, up to 64.
const LEAVES: &[(u32, &str)] = &[(0, "auto"), (1, "1"), (4, "4"), (16, "16"), (64, "64"), (256, "256"), (1024, "1024")];
/// The term that keeps 1/l² finite; the number is in m².
const EPSILONS: &[(Epsilon, &str)] =
    &[(Epsilon::Auto, "auto"), (Epsilon::Paper, "paper"), (Epsilon::Value(0.001), "a value")];
/// Exposures that are offered, stops.
const STOPS: std::ops::RangeInclusive<f32> = -16.0..=16.0;

impl Viewer {
    pub(super) fn light_section(&mut self, ui: &mut egui::Ui) -> bool {
        let original = self.document.original.scene.environment.clone();
        let environment = &mut self.document.state.scene.environment;
        let mut degrees = environment.rotation_rad.to_degrees();
        let mut is_edited = false;
        let range = (-360.0..=360.0, false);
        if number(ui, "Rotation \u{b0}", &mut degrees, original.rotation_rad.to_degrees(), range) {
            environment.rotation_rad = degrees.to_radians();
            is_edited = true;
        }
        is_edited |= number(ui, "Intensity", &mut environment.intensity, original.intensity, (0.0..=100.0, true));
        self.map_choices(ui);
        is_edited
    }

    pub(super) fn display_section(&mut self, ui: &mut egui::Ui) -> bool {
        let (options, original) = (&mut self.document.state.options, &self.document.original.options);
        let mut is_edited = quality(ui, options, original);
        let mut picture = options.aovs.first().copied().unwrap_or(Aov::Beauty);
        let has_medium = self.document.state.scene.medium.is_some();
        let is_possible = |aov: Aov| has_medium || !matches!(aov, Aov::Scattered | Aov::ScatteredDirect);
        let pictures: Vec<_> = PICTURES.iter().copied().filter(|(aov, _)| is_possible(*aov)).collect();
        if choice(ui, "Picture", &mut picture, Aov::Beauty, &pictures) {
            options.aovs = vec![picture];
            is_edited = true;
        }
        is_edited |= exposure(ui, options, original, self.picture.as_ref().and_then(|picture| picture.exposures));
        let (tone_map, reset) = (&mut options.display.tone_map, original.display.tone_map);
        is_edited |= choice(ui, "Tone map", tone_map, reset, TONE_MAPS);
        // Each technique has its own.
        let has_photons = options.technique == Technique::ImageSpace;
        let is_known = |(overlay, _): &&(Overlay, &str)| match overlay {
            Overlay::None => true,
            Overlay::Photons | Overlay::CausticMap => has_photons,
            _ => !has_photons,
        };
        let known: Vec<_> = OVERLAYS.iter().filter(is_known).copied().collect();
        if !known.iter().any(|(overlay, _)| *overlay == options.overlay) {
            options.overlay = Overlay::None;
        }
        is_edited |= choice(ui, "Overlay", &mut options.overlay, original.overlay, &known);
        is_edited |= switch(ui, "Shapes only", &mut options.plain_diffuse, original.plain_diffuse);
        is_edited
    }

    /// Keeps the current settings for a comparison, or ends it.
    pub(super) fn comparison(&mut self, ui: &mut egui::Ui) -> bool {
        let state = &mut self.document.state;
        let mut is_edited = false;
        ui.horizontal(|ui| match &mut state.kept {
            None => {
                let hint = "shows the picture of these settings left of a divider, while you change them at the right";
                if ui.button("Compare").on_hover_text(hint).clicked() {
                    state.kept = Some(state.options.clone());
                    is_edited = true;
                }
            }
            Some(kept) => {
                if ui.button("Swap sides").clicked() {
                    std::mem::swap(kept, &mut state.options);
                    is_edited = true;
                }
                if ui.button("End comparison").clicked() {
                    state.kept = None;
                    is_edited = true;
                }
            }
        });
        is_edited
    }

    pub(super) fn caustic_section(&mut self, ui: &mut egui::Ui) -> bool {
        let has_medium = self.document.state.scene.medium.is_some();
        let (options, original) = (&mut self.document.state.options, &self.document.original.options);
        let techniques = Technique::ALL.map(|technique| (technique, technique.name()));
        let mut is_edited = choice(ui, "Technique", &mut options.technique, original.technique, &techniques);
        is_edited |= if options.technique == Technique::ImageSpace {
            photon_fields(ui, &mut options.image_space, &original.image_space)
        } else {
            sample_fields(ui, options, original, has_medium)
        };
        is_edited |= number(ui, "Gain", &mut options.caustic_gain, original.caustic_gain, (0.0..=100.0, true));
        is_edited |= number(ui, "Seed", &mut options.seed, original.seed, (0..=9_999, false));
        is_edited
    }
}

/// Qualities by name.
const QUALITIES: &[(Quality, &str)] =
    &[(Quality::Draft, "draft"), (Quality::Normal, "normal"), (Quality::Final, "final")];

/// How much time the finished picture is worth: the scene's own settings, or coarser or finer ones.
fn quality(ui: &mut egui::Ui, options: &mut Options, original: &Options) -> bool {
    let at = |quality: Quality| {
        let Options { samples, leaves, tolerance, pixel_samples, image_space, .. } = original.at_quality(quality);
        let mut there = options.clone().with_samples(samples).with_leaves(leaves).with_tolerance(tolerance);
        there = there.with_pixel_samples(pixel_samples);
        there.image_space.photons = image_space.photons;
        there
    };
    let current = QUALITIES.iter().map(|(quality, _)| *quality).find(|quality| at(*quality) == *options);
    let mut chosen = current;
    let mut choices: Vec<(Option<Quality>, &str)> = QUALITIES.iter().map(|(q, name)| (Some(*q), *name)).collect();
    if current.is_none() {
        choices.push((None, "custom"));
    }
    if choice(ui, "Quality", &mut chosen, Some(Quality::Normal), &choices)
        && let Some(chosen) = chosen
    {
        *options = at(chosen);
        return true;
    }
    false
}

/// What there is to choose of samples.
fn sample_fields(ui: &mut egui::Ui, options: &mut Options, original: &Options, has_medium: bool) -> bool {
    let mut is_edited = number(ui, "Samples", &mut options.samples, original.samples, (1..=MAX_SAMPLES, true));
    is_edited |= choice(ui, "Strategy", &mut options.strategy, original.strategy, STRATEGIES);
    is_edited |= choice(ui, "Density", &mut options.density, original.density, DENSITIES);
    is_edited |= choice(ui, "Evaluation", &mut options.evaluation, original.evaluation, EVALUATIONS);
    let mut leaves = options.leaves.unwrap_or(0);
    // Footprints by curvature have no cells that could be split.
    let has_leaves = options.footprint == Footprint::Cells;
    let leaves_field = |ui: &mut egui::Ui| choice(ui, "Leaves", &mut leaves, original.leaves.unwrap_or(0), LEAVES);
    if ui.add_enabled_ui(has_leaves, leaves_field).inner {
        options.leaves = (leaves > 0).then_some(leaves);
        is_edited = true;
    }
    is_edited |= number(ui, "Tolerance", &mut options.tolerance, original.tolerance, (1e-3..=1.0, true));
    is_edited |= choice(ui, "Filter", &mut options.filter, original.filter, FILTERS);
    is_edited |= number(ui, "Taps", &mut options.taps, original.taps, (1..=pinspot_render::pinhole::MAX_TAPS, true));
    if has_medium {
        let (steps, most) = (&mut options.medium_steps, pinspot_render::options::MAX_MEDIUM_STEPS);
        is_edited |= number(ui, "Medium steps", steps, original.medium_steps, (1..=most, true));
    }
    let footprints = [(Footprint::Cells, "cells"), (Footprint::Curvature, "curvature")];
    if choice(ui, "Footprint", &mut options.footprint, original.footprint, &footprints) {
        options.leaves = options.leaves.filter(|_| options.footprint == Footprint::Cells);
        is_edited = true;
    }
    let visibilities = [(Visibility::Full, "full"), (Visibility::None, "none")];
    is_edited |= choice(ui, "Visibility", &mut options.visibility, original.visibility, &visibilities);
    is_edited |= switch(ui, "Attenuation 1/l\u{b2}", &mut options.attenuation, original.attenuation);
    is_edited |= epsilon(ui, options, original);
    is_edited
}

/// What there is to choose of photons.
fn photon_fields(ui: &mut egui::Ui, options: &mut ImageSpaceOptions, original: &ImageSpaceOptions) -> bool {
    let modes = Mode::ALL.map(|mode| (mode, mode.name()));
    let mut is_edited = choice(ui, "Mode", &mut options.mode, original.mode, &modes);
    let hits = Hits::ALL.map(|hits| (hits, hits.name()));
    is_edited |= choice(ui, "Hits", &mut options.hits, original.hits, &hits);
    let traversals: Vec<_> =
        Traversal::ALL.into_iter().filter(|traversal| options.mode.works_with(*traversal)).collect();
    let traversals: Vec<_> = traversals.into_iter().map(|traversal| (traversal, traversal.name())).collect();
    let field = |ui: &mut egui::Ui| choice(ui, "Traversal", &mut options.traversal, original.traversal, &traversals);
    is_edited |= ui.add_enabled_ui(traversals.len() > 1, field).inner;
    if !options.mode.works_with(options.traversal) {
        options.traversal = Traversal::Dense;
    }
    is_edited |= number(ui, "Photons \u{b2}", &mut options.photons, original.photons, (16..=2048, true));
    let maps = [MapView::Eye, MapView::Light].map(|map| (map, map.name()));
    is_edited |= choice(ui, "Caustic map", &mut options.caustic_map, original.caustic_map, &maps);
    let (size, reset) = (&mut options.caustic_map_size, original.caustic_map_size);
    is_edited |= number(ui, "Map texels \u{b2}", size, reset, (16..=4096, true));
    is_edited |= number(ui, "Lights", &mut options.lights, original.lights, (1..=256, true));
    let (directions, reset) = (&mut options.light_directions, original.light_directions);
    is_edited |= number(ui, "Light directions", directions, reset, (1..=256, true));
    if options.mode == Mode::Splats {
        let (diameter, reset) = (&mut options.splat_diameter, original.splat_diameter);
        is_edited |= number(ui, "Splat diameter", diameter, reset, (1.0..=64.0, true));
    }
    let incidences = Incidence::ALL.map(|incidence| (incidence, incidence.name()));
    let has_viewer = options.caustic_map == MapView::Eye;
    is_edited |= choice(ui, "Incidence", &mut options.incidence, original.incidence, &incidences);
    if !has_viewer && options.incidence == Incidence::Photon {
        options.incidence = Incidence::Mean;
    }
    let (frames, reset) = (&mut options.temporal_frames, original.temporal_frames);
    is_edited |= number(ui, "Averaged frames", frames, reset, (1..=ImageSpaceOptions::MAX_TEMPORAL_FRAMES, false));
    let is_papers_mode = matches!(options.mode, Mode::Polygons | Mode::Gather);
    let field = |ui: &mut egui::Ui| switch(ui, "By the paper", &mut options.paper, original.paper);
    is_edited |= ui.add_enabled_ui(is_papers_mode, field).inner;
    options.paper &= is_papers_mode;
    is_edited
}

/// Exposures of surfaces and of the background. `used` are those of the last picture.
fn exposure(
    ui: &mut egui::Ui,
    options: &mut Options,
    original: &Options,
    used: Option<pinspot_render::options::Exposures>,
) -> bool {
    let mut is_edited = false;
    let display = &mut options.display;
    let metered = used.map_or(0.0, |used| used.exposure_ev);
    let mut is_automatic = display.exposure == Exposure::Auto;
    if switch(ui, "Automatic exposure", &mut is_automatic, original.display.exposure == Exposure::Auto) {
        display.exposure = if is_automatic { Exposure::Auto } else { Exposure::Stops(metered) };
        is_edited = true;
    }
    if let Exposure::Stops(stops) = &mut display.exposure {
        let reset = if let Exposure::Stops(stops) = original.display.exposure { stops } else { metered };
        is_edited |= number(ui, "Exposure", stops, reset, (STOPS, false));
    }
    let mut is_own = display.background_exposure_ev.is_some();
    let was_own = original.display.background_exposure_ev.is_some();
    if switch(ui, "Background by itself", &mut is_own, was_own) {
        display.background_exposure_ev = is_own.then_some(metered);
        is_edited = true;
    }
    if let Some(stops) = &mut display.background_exposure_ev {
        let reset = original.display.background_exposure_ev.unwrap_or(metered);
        is_edited |= number(ui, "Background exposure", stops, reset, (STOPS, false));
    }
    is_edited
}

fn epsilon(ui: &mut egui::Ui, options: &mut Options, original: &Options) -> bool {
    let kind = |epsilon| match epsilon {
        Epsilon::Value(_) => EPSILONS[2].0,
        other => other,
    };
    let mut chosen = kind(options.epsilon);
    let mut is_edited = false;
    if choice(ui, "Epsilon", &mut chosen, kind(original.epsilon), EPSILONS) {
        options.epsilon = chosen;
        is_edited = true;
    }
    if let Epsilon::Value(value) = &mut options.epsilon {
        let reset = if let Epsilon::Value(value) = original.epsilon { value } else { 0.001 };
        is_edited |= number(ui, "Epsilon m\u{b2}", value, reset, (0.0..=1.0, true));
    }
    is_edited
}
