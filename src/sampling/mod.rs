//! Surface → points: where on the reflectors the pinholes are (Wand & Straßer, Section 3.2).
//!
//! Data flows [`Surface`] → candidates (many points that cover it evenly) → a [`Strategy`] that keeps some of
//! them. One file per strategy. This module must not know environments, cameras or receivers.

mod candidates;
mod elimination;
mod grid;
mod morton;
mod neighbourhood;
mod patches;
mod quality;
mod random;
mod spectrum;
mod study;
mod surface;

pub use quality::{Quality, quality};
pub use spectrum::{Development, Spectrum};
pub use study::{GROUNDS, Ground, Study, study};
pub use surface::{Surface, SurfacePoint};

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde::Deserialize;

/// The most samples that can be asked for.
pub const MAX_SAMPLES: u32 = 1 << 22;

/// How the samples are placed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Strategy {
    /// Area-uniform random points (WS-11).
    Random,
    /// One point of a dense set kept per cell of a 3-D grid (WS-12).
    Grid,
    /// The same, snapped to the cells' centres (WS-13).
    QuantisedGrid,
    /// Greedy removal of points that a sphere around another one covers (WS-14).
    #[default]
    Neighbourhood,
    /// Weighted sample elimination (Yuksel 2015): meets the number exactly.
    Elimination,
}

impl Strategy {
    /// Its name in scene files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Random => "random",
            Self::Grid => "grid",
            Self::QuantisedGrid => "quantised-grid",
            Self::Neighbourhood => "neighbourhood",
            Self::Elimination => "elimination",
        }
    }
}

/// What to sample.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Number of samples asked for; `neighbourhood` meets it within 2 %, grids come close.
    pub samples: u32,
    /// The strategy.
    pub strategy: Strategy,
    /// The same seed gives the same bits.
    pub seed: u64,
}

/// The samples' positions and the denser set they were chosen from.
#[derive(Clone, Debug)]
pub struct PointSet {
    /// The samples; their `area` is A/N.
    pub points: Vec<SurfacePoint>,
    /// Points that cover the surface evenly, each with the area that it stands for; they sum up to the surface's.
    pub candidates: Vec<SurfacePoint>,
}

/// Why a surface could not be sampled.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SamplingError {
    /// Nothing mirrors.
    #[error("the scene has no reflector; give an object `reflector = {{ sides = \"front\" }}`")]
    NoReflector,
    /// No samples, or too many.
    #[error("{samples} samples were asked for; give from 1 to {MAX_SAMPLES}")]
    Count {
        /// Samples asked for.
        samples: u32,
    },
}

/// Places samples on a surface.
pub fn sample(surface: &Surface, options: &Options) -> Result<PointSet, SamplingError> {
    let Options { samples, strategy, seed } = *options;
    if samples == 0 || samples > MAX_SAMPLES {
        return Err(SamplingError::Count { samples });
    }
    if surface.triangles().is_empty() {
        return Err(SamplingError::NoReflector);
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let area_per_sample = surface.area() as f32 / samples as f32;
    let mut candidates = candidates::stratified(surface, area_per_sample / candidates::per_sample(samples), &mut rng);
    patches::group_small(surface, area_per_sample, &mut candidates);
    let mut points = match strategy {
        Strategy::Random => random::random(surface, samples, &mut rng),
        Strategy::Grid => grid::one_per_cell(&candidates, area_per_sample, samples, false, &mut rng),
        Strategy::QuantisedGrid => grid::one_per_cell(&candidates, area_per_sample, samples, true, &mut rng),
        Strategy::Elimination => elimination::elimination(surface, area_per_sample, samples, &mut rng),
        Strategy::Neighbourhood => neighbourhood::neighbourhood(&candidates, area_per_sample, samples),
    };
    patches::group_small(surface, area_per_sample, &mut points);
    let area = (surface.area() / points.len() as f64) as f32;
    for point in &mut points {
        point.area = area;
    }
    Ok(PointSet { points, candidates })
}

/// A k-d tree over points; queries return indices into the slice it was made from.
pub(crate) struct PointTree(ImmutableKdTree<f32, 3>);

impl PointTree {
    pub fn new(points: &[SurfacePoint]) -> Self {
        let positions: Vec<[f32; 3]> = points.iter().map(|p| p.position.to_array()).collect();
        Self(ImmutableKdTree::new_from_slice(&positions).expect("finite positions make a tree"))
    }

    /// Calls `visit` with every point within `radius` of `centre`, in no particular order.
    pub fn within(&self, centre: glam::Vec3, radius: f32, mut visit: impl FnMut(usize)) {
        let query = centre.to_array();
        self.0
            .query(&query)
            .within::<SquaredEuclidean<f32>>(radius * radius)
            .unsorted()
            .visit(|found| visit(found.item as usize));
    }

    /// The `count` nearest points (fewer if there are fewer), nearest first: squared distance and index.
    pub fn nearest(&self, centre: glam::Vec3, count: usize) -> impl Iterator<Item = (f32, usize)> {
        let query = centre.to_array();
        let count = std::num::NonZero::new(count).expect("at least one");
        let found = self.0.query(&query).nearest_n::<SquaredEuclidean<f32>>(count).execute();
        found.into_iter().map(|f| (f.distance, f.item as usize))
    }
}
