//! Strategy *neighbourhood* (WS-14), the default: from a dense set in random order, every point that is not yet
//! covered is kept and covers those within a distance. The result is a maximal Poisson-disk subset. Where places are worth
//! more, the distance is shorter.

use super::{PointTree, SurfacePoint};

/// Close enough to the number asked for, as a fraction of it.
const TOLERANCE: f64 = 0.005;

/// Keeps about `samples` of the candidates, which are in random order; the distance is searched for.
pub(super) fn neighbourhood(
    candidates: &[SurfacePoint],
    worth: Option<&[f32]>,
    area_per_sample: f32,
    samples: u32,
) -> Vec<SurfacePoint> {
    let tree = PointTree::new(candidates);
    // Of the distance that is searched for: the number of samples in an area goes with its inverse square.
    let scale = worth.map(|worth| {
        let mean = super::mean_worth(candidates, worth);
        worth.iter().map(|w| (mean / w).sqrt()).collect::<Vec<f32>>()
    });
    // The distance that 40 candidates a sample lead to on a plane.
    let mut radius = 0.79 * area_per_sample.sqrt();
    let (mut too_small, mut too_large) = (0.0f32, f32::INFINITY);
    let mut best: Option<(u32, Vec<u32>)> = None;
    for _ in 0..16 {
        let kept = prune(candidates, &tree, |k| scale.as_ref().map_or(radius, |s| s[k] * radius));
        let count = kept.len() as u32;
        let miss = count.abs_diff(samples);
        if best.as_ref().is_none_or(|(least, _)| miss < *least) {
            best = Some((miss, kept));
        }
        if f64::from(miss) <= TOLERANCE * f64::from(samples) {
            break;
        }
        if count > samples {
            too_small = radius;
        } else {
            too_large = radius;
        }
        radius = next_radius(radius, count as f32 / samples as f32, too_small, too_large);
    }
    let (_, kept) = best.expect("at least one try");
    kept.into_iter().map(|k| candidates[k as usize]).collect()
}

/// The count goes with 1/radius²; where that overshoots what is known, bisect.
fn next_radius(radius: f32, excess: f32, too_small: f32, too_large: f32) -> f32 {
    let predicted = radius * excess.sqrt();
    if predicted > too_small && predicted < too_large {
        predicted
    } else {
        0.5 * (too_small + too_large.min(4.0 * radius))
    }
}

/// Indices of the points kept.
fn prune(candidates: &[SurfacePoint], tree: &PointTree, radius: impl Fn(usize) -> f32) -> Vec<u32> {
    let mut covered = vec![false; candidates.len()];
    let mut kept = Vec::new();
    for (k, candidate) in candidates.iter().enumerate() {
        if covered[k] {
            continue;
        }
        kept.push(k as u32);
        tree.within(candidate.position, radius(k), |other| {
            covered[other] |= candidate.same_side(&candidates[other]);
        });
    }
    kept
}
