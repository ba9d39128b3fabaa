//! What was rendered, and with what.

use serde::Serialize;

use super::{Engine, Prepared};
use crate::backend::BackendReport;
use crate::options::{Evaluation, Options};
use crate::pinhole::{Filter, Footprint};
use crate::sampling::{Density, Strategy};
use crate::scene::Visibility;
use crate::technique::Technique;

/// The object that `--json` prints.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The scene's name.
    pub scene: String,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// How irradiance by way of the mirrors was computed.
    pub technique: Technique,
    /// Samples asked for.
    pub samples_requested: u32,
    /// Samples in use; 0 where no caustics were asked for.
    pub samples: usize,
    /// How they were placed.
    pub strategy: Strategy,
    /// Where they are denser.
    pub density: Density,
    /// How their footprints were found.
    pub footprint: Footprint,
    /// How the environment was looked up; `None` where no caustics were asked for.
    pub filter: Option<Filter>,
    /// Most taps along a footprint.
    pub taps: u32,
    /// How they were summed: the `mode`, `flat` or `hierarchical`, with `leaves` and `tolerance`.
    #[serde(flatten)]
    pub evaluation: Option<Evaluation>,
    /// Which occlusion counts.
    pub visibility: Visibility,
    /// Cube-map face size, texels.
    pub cube_size: u32,
    /// Seed.
    pub seed: u64,
    /// Mean fetches of the environment per pixel, whatever they were for.
    pub lookups: f64,
    /// Back end and adapter.
    #[serde(flatten)]
    pub backend: BackendReport,
    /// What was repaired or is to be mistrusted, a sentence each.
    pub warnings: Vec<String>,
}

impl Report {
    pub(super) fn new(engine: &Engine, prepared: &Prepared, lookups: f64) -> Self {
        let Engine { scene, options, backend, .. } = engine;
        let statistics = prepared.sum.as_ref().map(|sum| sum.statistics());
        let environment = &prepared.light.environment;
        let mut warnings = scene.notes.clone();
        warnings.extend(statistics.and_then(|s| s.warning.clone()));
        let Options { size, technique, samples, strategy, density, footprint, taps, visibility, seed, .. } = *options;
        Self {
            scene: scene.name.clone(),
            size,
            technique,
            samples_requested: samples,
            samples: statistics.map_or(0, |s| s.samples),
            strategy,
            density,
            footprint,
            filter: statistics.map(|s| s.filter),
            taps,
            evaluation: statistics.map(|s| s.evaluation),
            visibility,
            cube_size: environment.cube.size(),
            seed,
            lookups,
            backend: backend.report(),
            warnings,
        }
    }
}
