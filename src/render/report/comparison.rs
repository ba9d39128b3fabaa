//! A finished comparison, as data.

use std::fmt;

use glam::Vec3;
use serde::Serialize;

use super::findings::Finding;
use super::rows::Row;
use crate::image::Image;
use crate::reference::Statistics;
use crate::sampling::{Quality, Strategy, StrategyStatistics, TestSurface};
use crate::technique::Technique;

/// The reference of a comparison.
#[derive(Clone, Debug, Serialize)]
pub struct ReferenceSummary {
    /// Its file.
    pub file: String,
    /// What it shows.
    pub aov: &'static str,
    /// Occlusion.
    pub visibility: crate::scene::Visibility,
    /// √Σse² / √ΣE².
    pub rel_error: f64,
    /// How it came about.
    #[serde(flatten)]
    pub statistics: Statistics,
    /// Seconds of work, by the caller's clock.
    pub seconds: f64,
}

/// A technique that cannot be compared on a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unavailable {
    /// The technique.
    pub technique: Technique,
    /// Why.
    pub reason: String,
}

impl fmt::Display for Unavailable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is not available: it {}", self.technique, self.reason)
    }
}

/// Figures of a strategy on a surface that unrolls.
#[derive(Clone, Debug, Serialize)]
pub(super) struct TestSurfaceResult {
    pub surface: TestSurface,
    pub strategy: Strategy,
    pub statistics: StrategyStatistics,
}

/// A finished comparison.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The scene's name.
    pub scene: String,
    /// The adapter, or the CPU, in words.
    pub adapter: String,
    /// Names and values of everything that the results depend on.
    pub made_with: Vec<(String, String)>,
    /// The reference.
    pub reference: ReferenceSummary,
    /// One entry a combination and seed.
    pub rows: Vec<Row>,
    /// Techniques that were asked for, and cannot be compared.
    pub unavailable: Vec<Unavailable>,
    /// What the numbers say.
    pub findings: Vec<Finding>,
    /// Figures of the strategies on the scene's own reflectors.
    pub reflectors: Vec<(Strategy, Quality)>,
    pub(super) sampling: Vec<TestSurfaceResult>,
    /// What was repaired or is to be mistrusted.
    pub warnings: Vec<String>,
    #[serde(skip)]
    pub(super) pictures: Vec<Picture>,
    #[serde(skip)]
    pub(super) exposure_ev: f32,
    #[serde(skip)]
    pub(super) size: [u32; 2],
}

/// A picture of the page.
#[derive(Clone, Debug)]
pub(super) struct Picture {
    pub label: String,
    pub image: Image,
    pub flip: Option<Vec<f32>>,
    pub dots: Option<Vec<[f32; 2]>>,
    /// The row that it belongs to.
    pub row: Option<usize>,
}

/// Where the first set's points lie on a square of its rectangle, in fractions of that.
pub(super) fn unit_square_places(result: &TestSurfaceResult) -> Vec<[f64; 2]> {
    let (_, parameterization) = result.surface.surface();
    let size = parameterization.size();
    // Points may lie on either side of where the rectangle begins.
    let place = |p: Vec3| parameterization.place_of(p.as_dvec3()).rem_euclid(size) / size.min_element();
    let places = result.statistics.first.points.iter().map(|p| place(p.position).into());
    places.filter(|p: &[f64; 2]| p[0] < 1.0 && p[1] < 1.0).collect()
}
