//! How evenly a set of points is spread: distances to neighbours, gaps, and whether some orientations get more than others.

use glam::Vec3;

use super::{PointSet, PointTree, SurfacePoint};
use crate::parallel;

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
    /// The largest distance from the surface to its nearest point, over d_max; 0.577 for the densest packing.
    pub coverage_radius: f64,
    /// Mean distance of the points from the surface, over d_max, to about 0.1: only snapped points have any.
    pub displacement: f64,
    /// Points per area where the normal is diagonal to the axes, over that where it is along one: 1 without bias, √3 for
    /// one point per occupied grid cell. From a line fitted over |n_x| + |n_y| + |n_z|; `None` where normals hardly differ.
    pub orientation_bias: Option<f64>,
}

/// Measures a point set on a surface of `area` m²; the figures are 0 for fewer than two points.
pub fn quality(set: &PointSet, area: f64) -> Quality {
    let PointSet { points, candidates, .. } = set;
    let d_max = 2.0 * (area / (2.0 * 3f64.sqrt() * points.len().max(1) as f64)).sqrt();
    let tree = PointTree::new(points);
    let to_nearest = |k: usize| {
        let point = &points[k];
        let (squared, _) = nearest_where(&tree, point.position, |n| n != k && points[n].same_side(point))?;
        Some(f64::from(squared).sqrt() / d_max)
    };
    let gaps = parallel::map(candidates, &|candidate| gap(&tree, points, candidate));
    let nearest: Vec<f64> = parallel::collect(points.len(), &to_nearest).into_iter().flatten().collect();
    let count = nearest.len().max(1) as f64;
    let mean = nearest.iter().sum::<f64>() / count;
    let variance = nearest.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / count;
    Quality {
        count: points.len(),
        area,
        relative_radius: nearest.iter().copied().reduce(f64::min).unwrap_or(0.0),
        nearest_mean: mean,
        nearest_spread: if mean > 0.0 { variance.sqrt() / mean } else { 0.0 },
        coverage_radius: gaps.into_iter().fold(0.0, f64::max) / d_max,
        displacement: displacement(points, candidates) / d_max,
        orientation_bias: orientation_bias(points, candidates),
    }
}

/// Squared distance and index of the nearest point that meets a condition, if it is among the 16 nearest. Usually it is one of the
/// first two, which are much faster to find.
fn nearest_where(tree: &PointTree, centre: Vec3, condition: impl Fn(usize) -> bool) -> Option<(f32, usize)> {
    [2, 16].into_iter().find_map(|count| tree.nearest(centre, count).find(|&(_, k)| condition(k)))
}

/// Distance from a candidate to the nearest point of its side; of the nearest point at all where none is near.
fn gap(tree: &PointTree, points: &[SurfacePoint], candidate: &SurfacePoint) -> f64 {
    let Some(first) = tree.nearest_one(candidate.position) else { return 0.0 };
    let on_its_side = |k: usize| points[k].same_side(candidate);
    let found = if on_its_side(first) { None } else { nearest_where(tree, candidate.position, on_its_side) };
    let nearest = found.map_or(first, |(_, k)| k);
    f64::from(points[nearest].position.distance(candidate.position))
}

/// Mean height of the points over the plane of the nearest candidate.
fn displacement(points: &[SurfacePoint], candidates: &[SurfacePoint]) -> f64 {
    let tree = PointTree::new(candidates);
    let height = |p: &SurfacePoint| {
        let nearest = tree.nearest_one(p.position).map(|k| candidates[k]);
        nearest.map_or(0.0, |c| f64::from((p.position - c.position).dot(c.normal).abs()))
    };
    points.iter().map(height).sum::<f64>() / points.len().max(1) as f64
}

/// Least squares over classes of orientation, each weighted by its area.
fn orientation_bias(points: &[SurfacePoint], candidates: &[SurfacePoint]) -> Option<f64> {
    const CLASSES: usize = 16;
    let diagonal = 3f64.sqrt();
    let spread = |p: &SurfacePoint| f64::from(p.normal.abs().element_sum()).clamp(1.0, diagonal);
    let class = |p: &SurfacePoint| ((spread(p) - 1.0) / (diagonal - 1.0) * (CLASSES as f64 - 0.001)) as usize;
    let (mut count, mut area, mut sum) = ([0.0; CLASSES], [0.0; CLASSES], [0.0; CLASSES]);
    for point in points {
        count[class(point)] += 1.0;
    }
    for candidate in candidates {
        let (k, a) = (class(candidate), f64::from(candidate.area));
        area[k] += a;
        sum[k] += a * spread(candidate);
    }
    let (total, mean) = (area.iter().sum::<f64>(), sum.iter().sum::<f64>() / area.iter().sum::<f64>());
    let (mut xx, mut xy) = (0.0, 0.0);
    for k in (0..CLASSES).filter(|k| area[*k] > 0.0) {
        let x = sum[k] / area[k] - mean;
        xx += area[k] * x * x;
        xy += x * (count[k] / points.len() as f64 * total - area[k]);
    }
    // Density over its mean, at an orientation: 1 + slope · (spread − mean).
    let slope = xy / xx;
    let density = |at: f64| 1.0 + slope * (at - mean);
    (xx > 0.002 * total).then(|| density(diagonal) / density(1.0))
}
