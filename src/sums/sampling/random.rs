//! Strategy *random* (Wand & Straßer, Section 3.2): area-uniform, independent points.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;

use super::candidates::random_barycentric;
use super::{Surface, SurfacePoint};

pub(super) fn random(surface: &Surface, samples: u32, rng: &mut ChaCha8Rng) -> Vec<SurfacePoint> {
    let mut accumulated = 0.0;
    let cumulative: Vec<f64> = surface
        .areas()
        .iter()
        .map(|area| {
            accumulated += f64::from(*area);
            accumulated
        })
        .collect();
    (0..samples)
        .map(|_| {
            let at = rng.random::<f64>() * accumulated;
            let triangle = cumulative.partition_point(|&c| c <= at).min(cumulative.len() - 1);
            surface.triangles()[triangle].point(random_barycentric(rng), 0.0)
        })
        .collect()
}

/// Independent points among candidates, in proportion to their areas and importances.
pub(super) fn among(
    candidates: &[SurfacePoint],
    importances: &[f32],
    samples: u32,
    rng: &mut ChaCha8Rng,
) -> Vec<SurfacePoint> {
    let mut accumulated = 0.0;
    let cumulative: Vec<f64> = candidates
        .iter()
        .zip(importances)
        .map(|(candidate, importance)| {
            accumulated += f64::from(candidate.area * importance);
            accumulated
        })
        .collect();
    let draw = |_| {
        let at = rng.random::<f64>() * accumulated;
        candidates[cumulative.partition_point(|&c| c <= at).min(candidates.len() - 1)]
    };
    (0..samples).map(draw).collect()
}
