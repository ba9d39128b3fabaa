//! The report of a render: what was rendered, and how.

use serde::Serialize;

use super::lost_light::LostLight;
use super::{Engine, Prepared};
use crate::backend::BackendReport;
use crate::options::{Evaluation, Exposures, Options};
use crate::pinhole::{Filter, Footprint};
use crate::sampling::{Density, Strategy};
use crate::scene::Visibility;
use crate::technique::{PhotonStatistics, Technique};

/// What was rendered, and how. The command prints it as JSON.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The scene's name.
    pub scene: String,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// How the caustic's irradiance was computed.
    pub technique: Technique,
    /// Requested number of samples.
    pub samples_requested: u32,
    /// Samples in use; 0 if no caustics were requested.
    pub samples: usize,
    /// How the samples were placed.
    pub strategy: Strategy,
    /// What the samples' density follows.
    pub density: Density,
    /// How the samples' footprints were derived.
    pub footprint: Footprint,
    /// How the environment was filtered; `None` if no caustics were requested.
    pub filter: Option<Filter>,
    /// The largest number of taps along a footprint.
    pub taps: u32,
    /// How the samples were summed: the `mode` (`flat` or `hierarchical`), with `leaves` and `tolerance`.
    #[serde(flatten)]
    pub evaluation: Option<Evaluation>,
    /// What became of photons: the `mode` and the account of their flux; missing of techniques that send none.
    #[serde(flatten)]
    pub photons: Option<PhotonStatistics>,
    /// Which occlusion is taken into account.
    pub visibility: Visibility,
    /// Cube-map face size, texels.
    pub cube_size: u32,
    /// Random seed.
    pub seed: u64,
    /// Mean number of fetches of the environment per pixel, for light and for its bounds.
    pub lookups: f64,
    /// `exposure_ev` and `background_exposure_ev`, fixed or metered; missing if no beauty picture was requested.
    #[serde(flatten)]
    pub exposures: Option<Exposures>,
    /// Back end and adapter.
    #[serde(flatten)]
    pub backend: BackendReport,
    /// What was repaired while loading, and what may be wrong; one sentence each.
    pub warnings: Vec<String>,
}

impl Report {
    pub(super) fn new(
        engine: &Engine,
        prepared: &Prepared,
        lookups: f64,
        (exposures, lost): (Option<Exposures>, LostLight),
    ) -> Self {
        let Engine { scene, options, backend, fell_back, .. } = engine;
        let statistics = prepared.sum.as_ref().map(|sum| sum.statistics());
        let environment = &prepared.light.environment;
        let mut warnings = scene.notes.clone();
        warnings.extend(fell_back.as_ref().map(|fell_back| fell_back.reason.clone()));
        warnings.extend(prepared.scene.notes.clone());
        warnings.extend(lost.warnings(scene));
        warnings.extend(statistics.into_iter().flat_map(|s| s.warnings.clone()));
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
            filter: statistics.and_then(|s| s.filter),
            taps,
            evaluation: statistics.and_then(|s| s.evaluation),
            photons: statistics.and_then(|s| s.photons),
            visibility,
            cube_size: environment.cube.size(),
            seed,
            lookups,
            exposures,
            backend: backend.report(),
            warnings,
        }
    }
}
