//! How evenly a set of points is spread: nearest-neighbour figures.

use super::{PointTree, SurfacePoint};

/// Figures of a point set. Distances are relative to d_max = 2·√(A / (2√3·N)), that of the densest packing of N
/// points on a plane of the same area (Lagae & Dutré 2008).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Quality {
    /// Number of points.
    pub count: usize,
    /// Total area, m².
    pub area: f64,
    /// ρ: the smallest distance between two points of one side, over d_max.
    pub relative_radius: f64,
    /// Mean distance to the nearest neighbour over d_max.
    pub nearest_mean: f64,
    /// Its standard deviation over its mean.
    pub nearest_spread: f64,
}

/// Measures a point set on a surface of `area` m²; the figures are 0 for fewer than two points.
pub fn quality(points: &[SurfacePoint], area: f64) -> Quality {
    let d_max = 2.0 * (area / (2.0 * 3f64.sqrt() * points.len().max(1) as f64)).sqrt();
    let tree = PointTree::new(points);
    let nearest: Vec<f64> = points
        .iter()
        .enumerate()
        .filter_map(|(k, point)| {
            let mut neighbours = tree.nearest(point.position, 16);
            let (squared, _) = neighbours.find(|&(_, n)| n != k && points[n].same_side(point))?;
            Some(f64::from(squared).sqrt() / d_max)
        })
        .collect();
    let count = nearest.len().max(1) as f64;
    let mean = nearest.iter().sum::<f64>() / count;
    let variance = nearest.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / count;
    let smallest = nearest.iter().copied().reduce(f64::min).unwrap_or(0.0);
    let nearest_spread = if mean > 0.0 { variance.sqrt() / mean } else { 0.0 };
    Quality { count: points.len(), area, relative_radius: smallest, nearest_mean: mean, nearest_spread }
}
