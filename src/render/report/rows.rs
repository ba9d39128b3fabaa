//! The table: what was rendered and how far it is from the reference.

use serde::Serialize;

use super::cells::Cell;
use super::flip::{FlipMap, flip};
use crate::image::{Image, mrse, rel_l2};
use crate::pinhole::{Filter, Footprint};
use crate::sampling::{Density, Strategy};
use crate::scene::Visibility;
use crate::technique::Technique;

/// One combination and its errors.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The technique.
    pub technique: Technique,
    /// How it summed: `flat` or `hierarchical`; or how photons became irradiance.
    pub mode: String,
    /// How samples were placed. Like all of samples, missing of techniques that have none.
    pub strategy: Option<Strategy>,
    /// Where they are denser.
    pub density: Option<Density>,
    /// How footprints were found.
    pub footprint: Option<Footprint>,
    /// How the environment was looked up.
    pub filter: Option<Filter>,
    /// Cells that each sample was split into at most.
    pub leaves: Option<u32>,
    /// Samples asked for.
    pub samples: Option<u32>,
    /// Samples in use.
    pub samples_used: Option<usize>,
    /// Most taps along a footprint.
    pub taps: Option<u32>,
    /// Photons that were sent. Like all of photons, missing of techniques that send none.
    pub photons: Option<u64>,
    /// Photons that met a receiver by way of a mirror or an interface.
    pub photons_used: Option<u64>,
    /// Lights that sent them.
    pub lights: Option<usize>,
    /// The part of the flux cast that the map does not have: hidden receivers, outside of the map, and so on.
    pub flux_lost: Option<f64>,
    /// The part of it that is unaccounted for, or that is there twice (negative).
    pub flux_error: Option<f64>,
    /// Occlusion.
    pub visibility: Visibility,
    /// Seed.
    pub seed: u64,
    /// ‖E − R‖₂ / ‖R‖₂, over the mask if there is one; not defined where the reference is black.
    pub rel_l2: Option<f64>,
    /// Mean of (E − R)² / (R + 0.01)².
    pub mrse: f64,
    /// Mean LDR FLIP at 67 pixels per degree, after the tone map.
    pub flip: f64,
    /// Placing the samples, their differentials or their tree, what they see, and the gather.
    pub seconds: f64,
    /// Mean trilinear reads of the environment per pixel.
    pub lookups: f64,
    /// The picture, relative to the report.
    pub file: String,
}

impl Row {
    /// A few words that tell it from others.
    pub(super) fn label(&self) -> String {
        let mode = if self.mode == "flat" { None } else { Some(self.mode.as_str()) };
        let technique = self.photons.map(|_| self.technique.name());
        let (strategy, footprint) = (self.strategy.map(Strategy::name), self.footprint.map(Footprint::name));
        let words = [technique, strategy, footprint, self.filter.map(Filter::name), mode];
        let numbers = [self.samples.map(u64::from), self.photons].into_iter().flatten().map(|n| n.to_string());
        let lights = self.lights.filter(|lights| *lights > 1).map(|lights| format!("{lights} lights"));
        words.into_iter().flatten().map(str::to_owned).chain(numbers).chain(lights).collect::<Vec<_>>().join(" ")
    }
}

/// Measures a cell. The FLIP map is the second part of the result.
pub(super) fn measure(cell: &Cell, reference: &Image, mask: Option<&[bool]>, exposure_ev: f32) -> (Row, FlipMap) {
    let map = flip(&cell.image, reference, exposure_ev);
    let options = &cell.options;
    let photons = cell.metadata.photons.as_ref();
    let has_samples = photons.is_none();
    let file_name = cell.file.file_name().unwrap_or_default().to_string_lossy();
    let row = Row {
        technique: options.technique,
        mode: cell.metadata.mode.clone(),
        strategy: has_samples.then_some(options.strategy),
        density: has_samples.then_some(options.density),
        footprint: has_samples.then_some(options.footprint),
        filter: cell.metadata.filter,
        leaves: cell.metadata.leaves,
        samples: has_samples.then_some(options.samples),
        samples_used: has_samples.then_some(cell.metadata.samples_used),
        taps: has_samples.then_some(options.taps),
        photons: photons.map(|p| p.photons),
        photons_used: photons.map(|p| p.photons_used),
        lights: photons.map(|p| p.lights),
        flux_lost: photons.map(|p| if p.flux.cast > 0.0 { p.flux.lost() / p.flux.cast } else { 0.0 }),
        flux_error: photons.map(|p| p.flux.error()),
        visibility: options.visibility,
        seed: options.seed,
        rel_l2: Some(rel_l2(&cell.image, reference, mask)).filter(|error| error.is_finite()),
        mrse: mrse(&cell.image, reference, mask),
        flip: map.mean(mask),
        seconds: cell.metadata.seconds,
        lookups: cell.metadata.lookups,
        file: format!("cells/{file_name}"),
    };
    (row, map)
}
