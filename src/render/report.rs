//! What was rendered, with what, and how long it took.

use serde::Serialize;

use super::gather::BackendReport;
use super::{Evaluation, Renderer};
use crate::pinhole::{Filter, Footprint};
use crate::sampling::{Density, Strategy};
use crate::scene::Visibility;

/// The object that `--json` prints.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The scene's name.
    pub scene: String,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Samples asked for.
    pub samples_requested: u32,
    /// Samples in use.
    pub samples: usize,
    /// How they were placed.
    pub strategy: Strategy,
    /// Where they are denser.
    pub density: Density,
    /// How their footprints were found.
    pub footprint: Footprint,
    /// The filter.
    pub filter: Filter,
    /// Most taps along a footprint.
    pub taps: u32,
    /// How they were summed: `flat` or `hierarchical`, with `leaves` and `tolerance`.
    #[serde(flatten)]
    pub evaluation: Evaluation,
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
    /// Seconds per stage.
    pub seconds: Seconds,
    /// What was repaired or is to be mistrusted, a sentence each.
    pub warnings: Vec<String>,
}

/// Wall-clock seconds per stage.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Seconds {
    /// Reading and prefiltering the light.
    pub environment: f64,
    /// Placing the samples.
    pub sampling: f64,
    /// Cells and curvature.
    pub differentials: f64,
    /// Splitting the samples' cells.
    pub tree: f64,
    /// Letting the samples look around.
    pub visibility: f64,
    /// Opening the device and compiling the shader.
    pub backend: f64,
    /// Building the BVH and tracing the camera's and the mirrors' rays.
    pub tracing: f64,
    /// The environment's light on the receivers.
    pub direct: f64,
    /// The gather.
    pub gather: f64,
    /// All of rendering: tracing, gather and shading.
    pub render: f64,
}

impl Report {
    pub(super) fn new(renderer: &Renderer, lookups: f64, seconds: Seconds) -> Self {
        let Renderer { scene, options, environment, backend, .. } = renderer;
        let mut warnings = scene.notes.clone();
        warnings.extend(backend.warning().map(str::to_owned));
        Self {
            scene: scene.name.clone(),
            size: options.size,
            samples_requested: options.samples,
            samples: renderer.differentials.len(),
            strategy: options.strategy,
            density: options.density,
            footprint: options.footprint,
            filter: options.params.filter,
            taps: options.params.taps,
            evaluation: renderer.evaluation,
            visibility: options.visibility,
            cube_size: environment.cube.size(),
            seed: options.seed,
            lookups,
            backend: backend.report(),
            seconds,
            warnings,
        }
    }
}
