//! Surface → points: where on the reflectors the pinholes are (Wand & Straßer, Section 3.2).
//!
//! Data flows [`Surface`] → candidates (many points that cover it evenly) → a [`Strategy`] that keeps some of
//! them. One file per strategy. This module must not know environments, cameras or receivers.

mod candidates;
mod elimination;
mod grid;
mod hash_grid;
mod morton;
mod neighbourhood;
mod patches;
mod quality;
mod random;
mod spectrum;
mod statistics;
mod surface;

pub use quality::{Quality, quality};
pub use spectrum::{Parameterization, Spectrum};
pub use statistics::{StrategyStatistics, TestSurface, strategy_statistics};
pub use surface::{Surface, SurfacePoint};

pub use candidates::{Origin, SurfacePiece};
use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use serde::Deserialize;

use crate::parallel;

/// The most samples that can be asked for.
pub const MAX_SAMPLES: u32 = 1 << 22;

/// How the samples are placed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Strategy {
    /// Area-uniform random points.
    Random,
    /// One point of a dense set kept per cell of a 3-D grid.
    Grid,
    /// The same, snapped to the cells' centres.
    QuantisedGrid,
    /// Greedy removal of points that a sphere around another one covers.
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

/// Where samples are denser: the assumed importance of a place of the surface, by area. Each sample's weight is
/// the area that it stands for, so that none of them biases the sum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Density {
    /// All places are alike.
    #[default]
    Uniform,
    /// By how the normals turn.
    Curvature,
    /// By how the surface faces the receivers that the camera sees, and how near it is.
    Normal,
    /// The same for those receivers and that light which are not hidden.
    Visibility,
    /// By the light that it brings to them from this environment.
    Contribution,
}

impl Density {
    /// Its name in scene files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Curvature => "curvature",
            Self::Normal => "normal",
            Self::Visibility => "visibility",
            Self::Contribution => "contribution",
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
    /// The samples; their `area` is A/N, over their relative density where that is uneven.
    pub points: Vec<SurfacePoint>,
    /// Points that cover the surface evenly, each with the area that it stands for; they sum up to the surface's.
    pub candidates: Vec<SurfacePoint>,
    /// For each candidate the nearest point on its own side, where the strategy knows; else empty.
    pub(crate) nearest_samples: Vec<u32>,
    /// Of the first candidates, those that are pieces of triangles; the others were drawn on triangles finer than `stride`.
    origins: Vec<Origin>,
    /// No candidate stands for more, m².
    stride: f32,
}

impl PointSet {
    /// The piece of a triangle that a candidate stands for; `None` if it was drawn on triangles that are finer than candidates, see
    /// `Self::on_fine_triangles`.
    pub fn piece<'a>(&self, surface: &'a Surface, candidate: usize) -> Option<SurfacePiece<'a>> {
        let origin = *self.origins.get(candidate)?;
        Some(SurfacePiece::at(surface, origin, self.candidates[candidate].area))
    }

    /// Finer points for all candidates that were drawn on fine triangles, each for at most `stride` m², in an order that neighbours
    /// share; they are grouped as the set's points are.
    pub(crate) fn on_fine_triangles(&self, surface: &Surface, stride: f32, seed: u64) -> Vec<SurfacePoint> {
        if self.origins.len() == self.candidates.len() {
            return Vec::new();
        }
        let mut points = candidates::cover_fine(surface, self.stride, stride, &mut ChaCha8Rng::seed_from_u64(seed));
        patches::group_small(surface, surface.area() as f32 / self.points.len() as f32, &mut points);
        points
    }
}

/// Why a surface could not be sampled.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SamplingError {
    /// Nothing mirrors.
    #[error(
        "the scene has neither reflector nor refractor; give an object `reflector = {{ sides = \"front\" }}` or `refractor = {{ eta = 1.333 }}`"
    )]
    NoReflector,
    /// Only some strategies can place samples unevenly.
    #[error("strategy {} places its samples evenly; only neighbourhood and random follow a density", strategy.name())]
    Even {
        /// The strategy.
        strategy: Strategy,
    },
    /// The reflectors' area is beyond the range of 32-bit floats.
    #[error("the reflectors have an area of {area:e} m², which is out of range; scale the scene")]
    Area {
        /// m².
        area: f64,
    },
    /// No samples, or too many.
    #[error("{samples} samples were asked for; give from 1 to {MAX_SAMPLES}")]
    Count {
        /// Samples asked for.
        samples: u32,
    },
}

/// Places samples evenly on a surface.
pub fn sample(surface: &Surface, options: &Options) -> Result<PointSet, SamplingError> {
    place(surface, options, None)
}

/// Importance of a place, relative to others.
pub type Importance<'a> = &'a (dyn Fn(&SurfacePoint) -> f32 + Sync);

/// Places samples on a surface as densely as `importance` says; positive, and best within a factor of ten or so.
pub fn sample_by(surface: &Surface, options: &Options, importance: Importance) -> Result<PointSet, SamplingError> {
    match options.strategy {
        Strategy::Neighbourhood | Strategy::Random => place(surface, options, Some(importance)),
        strategy => Err(SamplingError::Even { strategy }),
    }
}

fn place(surface: &Surface, options: &Options, importance: Option<Importance>) -> Result<PointSet, SamplingError> {
    let Options { samples, strategy, seed } = *options;
    if samples == 0 || samples > MAX_SAMPLES {
        return Err(SamplingError::Count { samples });
    }
    if surface.triangles().is_empty() {
        return Err(SamplingError::NoReflector);
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let area_per_sample = surface.area() as f32 / samples as f32;
    // Candidates are thousands of times smaller than a sample's area at most.
    if !(area_per_sample * 1e-4).is_normal() {
        return Err(SamplingError::Area { area: surface.area() });
    }
    // Where samples are dense they need more to choose from.
    let finer = if importance.is_some() { 2.0 } else { 1.0 };
    let stride = area_per_sample / (finer * candidates::per_sample(samples));
    let candidates::Candidates { points: mut candidates, origins } = candidates::cover(surface, stride, &mut rng);
    let order = candidates::in_random_order(candidates.len(), &mut rng);
    patches::group_small(surface, area_per_sample, &mut candidates);
    let importances = importance.map(|importance| relative_importance(&candidates, importance));
    let mut nearest_samples = Vec::new();
    let mut points = match strategy {
        Strategy::Random => match &importances {
            Some(importances) => random::among(&candidates, importances, samples, &mut rng),
            None => random::random(surface, samples, &mut rng),
        },
        Strategy::Grid => grid::one_per_cell(&candidates, &order, area_per_sample, samples, false, &mut rng),
        Strategy::QuantisedGrid => grid::one_per_cell(&candidates, &order, area_per_sample, samples, true, &mut rng),
        Strategy::Elimination => elimination::elimination(surface, area_per_sample, samples, &mut rng),
        Strategy::Neighbourhood => {
            let kept =
                neighbourhood::neighbourhood(&candidates, &order, importances.as_deref(), area_per_sample, samples);
            nearest_samples = kept.nearest_samples;
            kept.points
        }
    };
    patches::group_small(surface, area_per_sample, &mut points);
    let area = (surface.area() / points.len() as f64) as f32;
    let mean = importances.map_or(1.0, |importances| mean_importance(&candidates, &importances));
    for point in &mut points {
        point.area = area * importance.map_or(1.0, |importance| mean / importance(point));
    }
    Ok(PointSet { points, candidates, nearest_samples, origins, stride })
}

/// The diagonal of the points' bounds, m.
fn extent(points: &[SurfacePoint]) -> f32 {
    let low = points.iter().fold(Vec3::INFINITY, |low, p| low.min(p.position));
    let high = points.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(p.position));
    low.distance(high)
}

/// Importance of each candidate.
fn relative_importance(candidates: &[SurfacePoint], importance: Importance) -> Vec<f32> {
    parallel::map(candidates, importance)
}

/// The mean over the surface.
fn mean_importance(candidates: &[SurfacePoint], importances: &[f32]) -> f32 {
    let sum: f64 = candidates.iter().zip(importances).map(|(c, w)| f64::from(c.area * w)).sum();
    (sum / candidates.iter().map(|c| f64::from(c.area)).sum::<f64>()) as f32
}

/// A k-d tree over points; queries return indices into the slice it was made from.
#[derive(Debug)]
pub struct PointTree(ImmutableKdTree<f32, 3>);

impl PointTree {
    /// Builds the search structure over points on a surface.
    pub fn new(points: &[SurfacePoint]) -> Self {
        Self::of_positions(points.iter().map(|p| p.position))
    }

    /// The same over other points, which are finite.
    pub fn of_positions(positions: impl Iterator<Item = Vec3>) -> Self {
        let positions: Vec<[f32; 3]> = positions.map(|position| position.to_array()).collect();
        Self(ImmutableKdTree::new_from_slice(&positions).expect("finite positions make a tree"))
    }

    /// Calls `visit` with every point within `radius` of `centre`, in no particular order.
    pub fn within(&self, centre: Vec3, radius: f32, mut visit: impl FnMut(usize)) {
        let query = centre.to_array();
        self.0
            .query(&query)
            .within::<SquaredEuclidean<f32>>(radius * radius)
            .unsorted()
            .visit(|found| visit(found.item as usize));
    }

    /// The nearest point; `None` if there are none.
    pub fn nearest_one(&self, centre: Vec3) -> Option<usize> {
        let query = centre.to_array();
        let found = || self.0.query(&query).nearest_one::<SquaredEuclidean<f32>>().execute().item as usize;
        (self.0.size() > 0).then(found)
    }

    /// The `count` nearest points (fewer if there are fewer), nearest first: squared distance and index.
    pub fn nearest(&self, centre: Vec3, count: usize) -> impl Iterator<Item = (f32, usize)> {
        let query = centre.to_array();
        let count = std::num::NonZero::new(count).expect("at least one");
        let found = self.0.query(&query).nearest_n::<SquaredEuclidean<f32>>(count).execute();
        found.into_iter().map(|f| (f.distance, f.item as usize))
    }
}
