//! Strategies *grid* and *quantised grid* (Wand & Straßer, Section 3.2): of a dense set one point is kept per cell of a 3-D grid.
//!
//! The two faces of a thin sheet, or two sides of a crease, may share a cell: each keeps a point of its own.

use std::collections::HashMap;

use glam::{IVec3, Vec3};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;

use super::SurfacePoint;

/// Close enough to the number asked for, as a fraction of it.
const TOLERANCE: f64 = 0.005;

/// Keeps one candidate per cell, the first in this order; `quantised` moves it to the cell's centre. The cells' edge is
/// searched for so that about `samples` are kept.
pub(super) fn one_per_cell(
    candidates: &[SurfacePoint],
    order: &[u32],
    area_per_sample: f32,
    samples: u32,
    quantised: bool,
    rng: &mut ChaCha8Rng,
) -> Vec<SurfacePoint> {
    let phase = Vec3::new(rng.random(), rng.random(), rng.random());
    // Cells occupied per edge² of area range from 1 (parallel to the grid) to √3 (diagonal).
    let mut edge = 1.15 * area_per_sample.sqrt();
    let mut best: Option<(u32, Vec<SurfacePoint>)> = None;
    for _ in 0..10 {
        let kept = keep(candidates, order, edge, phase, quantised);
        let count = kept.len() as u32;
        let miss = count.abs_diff(samples);
        if best.as_ref().is_none_or(|(least, _)| miss < *least) {
            best = Some((miss, kept));
        }
        if f64::from(miss) <= TOLERANCE * f64::from(samples) {
            break;
        }
        // The count goes with 1/edge².
        edge *= (count as f32 / samples as f32).sqrt();
    }
    best.expect("at least one try").1
}

fn keep(candidates: &[SurfacePoint], order: &[u32], edge: f32, phase: Vec3, quantised: bool) -> Vec<SurfacePoint> {
    let mut kept: Vec<SurfacePoint> = Vec::new();
    let mut cells: HashMap<IVec3, Vec<u32>> = HashMap::new();
    for candidate in order.iter().map(|&k| &candidates[k as usize]) {
        let cell = (candidate.position / edge + phase).floor();
        let in_cell = cells.entry(cell.as_ivec3()).or_default();
        if in_cell.iter().any(|&k| kept[k as usize].same_side(candidate)) {
            continue;
        }
        in_cell.push(kept.len() as u32);
        let position = if quantised { (cell + 0.5 - phase) * edge } else { candidate.position };
        kept.push(SurfacePoint { position, ..*candidate });
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Surface, candidates};
    use crate::scene::shapes::{Shape, SolidRing};
    use rand::SeedableRng;
    use std::collections::HashSet;

    #[test]
    fn every_occupied_cell_keeps_one_point_a_side() {
        let mut surface = Surface::default();
        surface.append(&Shape::SolidRing(SolidRing::default()).mesh().unwrap(), 0, false);
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let all = candidates::cover(&surface, 5e-4, &mut rng).points;
        let order = candidates::in_random_order(all.len(), &mut rng);
        let (edge, phase) = (0.11, Vec3::new(0.2, 0.5, 0.7));
        let cell = |p: &SurfacePoint| (p.position / edge + phase).floor().as_ivec3();
        for quantised in [false, true] {
            let kept = keep(&all, &order, edge, phase, quantised);
            let occupied: HashSet<IVec3> = all.iter().map(cell).collect();
            let held: HashSet<IVec3> = kept.iter().map(cell).collect();
            assert_eq!(occupied, held);
            for (i, a) in kept.iter().enumerate() {
                assert!(!kept[..i].iter().any(|b| cell(a) == cell(b) && a.same_side(b)));
                let from_centre = a.position / edge + phase - cell(a).as_vec3() - 0.5;
                assert!(!quantised || from_centre.abs().max_element() < 1e-3);
            }
        }
    }
}
