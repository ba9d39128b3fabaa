//! Strategy *neighbourhood* (WS-14), the default: from a dense set in random order, every point that is not yet
//! covered is kept and covers those within a distance. The result is a maximal Poisson-disk subset. Where places are worth
//! more, the distance is shorter.

use super::SurfacePoint;
use super::hash_grid::HashGrid;

/// Close enough to the number asked for, as a fraction of it.
const TOLERANCE: f64 = 0.005;

/// What is kept of a set.
pub(super) struct Kept {
    /// Which points.
    pub points: Vec<SurfacePoint>,
    /// For each candidate the nearest of them on its own side, if all cover alike; else nothing.
    pub owners: Vec<u32>,
}

/// Keeps about `samples` of the candidates, which are in random order; the distance is searched for.
pub(super) fn neighbourhood(
    candidates: &[SurfacePoint],
    worth: Option<&[f32]>,
    area_per_sample: f32,
    samples: u32,
) -> Kept {
    // Of the distance that is searched for: the number of samples in an area goes with its inverse square.
    let scale = worth.map(|worth| {
        let mean = super::mean_worth(candidates, worth);
        worth.iter().map(|w| (mean / w).sqrt()).collect::<Vec<f32>>()
    });
    // The distance that 40 candidates a sample lead to on a plane.
    let mut radius = 0.79 * area_per_sample.sqrt();
    let grid = HashGrid::new(candidates, radius);
    let (mut too_small, mut too_large) = (0.0f32, f32::INFINITY);
    let mut best: Option<(u32, Pruned)> = None;
    for _ in 0..16 {
        let pruned = prune(candidates, &grid, |k| scale.as_ref().map_or(radius, |s| s[k] * radius));
        let count = pruned.kept.len() as u32;
        let miss = count.abs_diff(samples);
        if best.as_ref().is_none_or(|(least, _)| miss < *least) {
            best = Some((miss, pruned));
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
    let (_, Pruned { kept, owners }) = best.expect("at least one try");
    let points = kept.into_iter().map(|k| candidates[k as usize]).collect();
    // Where some cover more than others, the nearest need not be among those that cover.
    Kept { points, owners: if worth.is_none() { owners } else { Vec::new() } }
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

/// A maximal set of points that do not cover each other.
struct Pruned {
    /// Their indices.
    kept: Vec<u32>,
    /// For each candidate the nearest, by its number among those kept, of those that cover it.
    owners: Vec<u32>,
}

/// How far a candidate is from the nearest point that covers it, squared, and that point's number.
type Cover = (f32, u32);

fn prune(candidates: &[SurfacePoint], grid: &HashGrid, radius: impl Fn(usize) -> f32) -> Pruned {
    // In the grid's order: neighbours are close to each other in memory, too.
    let mut covers: Vec<Cover> = vec![(f32::INFINITY, 0); candidates.len()];
    let mut kept = Vec::new();
    for (k, candidate) in candidates.iter().enumerate() {
        let own = &mut covers[grid.slot_of(k)];
        if own.0 < f32::INFINITY {
            continue;
        }
        let number = kept.len() as u32;
        kept.push(k as u32);
        // Also where its own normal is none.
        *own = (0.0, number);
        grid.within(candidate.position, radius(k), |slot, found, d2| {
            if d2 < covers[slot].0 && found.same_side(candidate) {
                covers[slot] = (d2, number);
            }
        });
    }
    let owners = (0..candidates.len()).map(|k| covers[grid.slot_of(k)].1).collect();
    Pruned { kept, owners }
}
