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
    /// How it summed: `flat` or `hierarchical`.
    pub mode: String,
    /// How samples were placed.
    pub strategy: Strategy,
    /// Where they are denser.
    pub density: Density,
    /// How footprints were found.
    pub footprint: Footprint,
    /// How the environment was looked up.
    pub filter: Filter,
    /// Cells that each sample was split into at most.
    pub leaves: u32,
    /// Samples asked for.
    pub samples: u32,
    /// Samples in use.
    pub samples_used: usize,
    /// Most taps along a footprint.
    pub taps: u32,
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

/// Measures a cell. The FLIP map is the second part of the result.
pub(super) fn measure(cell: &Cell, reference: &Image, mask: Option<&[bool]>, exposure_ev: f32) -> (Row, FlipMap) {
    let map = flip(&cell.image, reference, exposure_ev);
    let options = &cell.options;
    let file_name = cell.file.file_name().unwrap_or_default().to_string_lossy();
    let row = Row {
        technique: options.technique,
        mode: cell.metadata.mode.clone(),
        strategy: options.strategy,
        density: options.density,
        footprint: options.footprint,
        filter: cell.metadata.filter,
        leaves: cell.metadata.leaves,
        samples: options.samples,
        samples_used: cell.metadata.samples_used,
        taps: options.taps,
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
