//! Cells: every candidate belongs to the nearest sample on its own side of creases and sheets.

use glam::Vec3;
use rayon::prelude::*;

use super::{PointTree, SurfacePoint};

/// Each sample's candidates, as indices. It is fastest where candidates that follow each other are near each other.
pub(crate) fn assign(points: &[SurfacePoint], candidates: &[SurfacePoint]) -> Vec<Vec<u32>> {
    let nearest = Nearest::new(points);
    let of_run = |run: &[SurfacePoint]| {
        let mut last = 0;
        let owner = |candidate: &SurfacePoint| {
            last = nearest.from(last, candidate.position);
            owner(candidate, points, last, &nearest)
        };
        run.iter().map(owner).collect::<Vec<u32>>()
    };
    let owners = candidates.par_chunks(RUN).flat_map_iter(of_run).collect::<Vec<u32>>();
    gather(points.len(), &owners)
}

/// Candidates that one thread takes in a row.
const RUN: usize = 4096;

/// Lists of candidates by their owners.
pub(super) fn gather(count: usize, owners: &[u32]) -> Vec<Vec<u32>> {
    let mut cells = vec![Vec::new(); count];
    for (candidate, &owner) in owners.iter().enumerate() {
        cells[owner as usize].push(candidate as u32);
    }
    cells
}

/// Finds nearest points from nearby ones.
struct Nearest {
    tree: PointTree,
    positions: Vec<Vec3>,
    /// Of each point, the nearest first: squared distance and index.
    neighbours: Vec<Vec<(f32, u32)>>,
}

/// Neighbours that are known of a point.
const NEIGHBOURS: usize = 32;

impl Nearest {
    fn new(points: &[SurfacePoint]) -> Self {
        let tree = PointTree::new(points);
        let of = |p: &SurfacePoint| tree.nearest(p.position, NEIGHBOURS).map(|(d2, k)| (d2, k as u32)).collect();
        let neighbours = points.par_iter().map(of).collect();
        Self { positions: points.iter().map(|p| p.position).collect(), neighbours, tree }
    }

    /// The nearest point, by way of one that may be near it. What is nearer than that is no farther from it than twice its
    /// distance.
    fn from(&self, mut best: usize, place: Vec3) -> usize {
        let mut d2 = self.positions[best].distance_squared(place);
        loop {
            let from = best;
            let neighbours = &self.neighbours[from];
            // Rounding must not hide anything.
            let reach2 = 4.001 * d2;
            if neighbours.last().is_none_or(|(last, _)| *last < reach2) {
                return self.tree.nearest_one(place);
            }
            for &(_, k) in neighbours.iter().take_while(|(between, _)| *between < reach2) {
                let other = self.positions[k as usize].distance_squared(place);
                if other < d2 {
                    (best, d2) = (k as usize, other);
                }
            }
            if best == from {
                return best;
            }
        }
    }
}

/// Whose a candidate is, if this is the nearest point.
fn owner(candidate: &SurfacePoint, points: &[SurfacePoint], nearest: usize, all: &Nearest) -> u32 {
    if points[nearest].same_side(candidate) {
        return nearest as u32;
    }
    let distance2 = |k: &u32| points[*k as usize].position.distance_squared(candidate.position);
    let nearer = |a: &u32, b: &u32| distance2(a).total_cmp(&distance2(b));
    let near = || all.neighbours[nearest].iter().map(|(_, k)| *k);
    // A patch without a sample nearby lends its area to the nearest face that looks the same way.
    let same_side = near().filter(|k| points[*k as usize].same_side(candidate)).min_by(nearer);
    let same_way = || near().filter(|k| points[*k as usize].normal.dot(candidate.normal) > 0.0).min_by(nearer);
    same_side.or_else(same_way).unwrap_or(nearest as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Options, Strategy, Surface, sample};
    use crate::scene::shapes::{Shape, Spoon};

    #[test]
    fn the_way_by_neighbours_ends_at_the_nearest() {
        let mut surface = Surface::default();
        surface.append(&Shape::Spoon(Spoon { thickness: 0.004, ..Default::default() }).mesh().unwrap(), 0, false);
        for (samples, strategy) in [(1, Strategy::Random), (20, Strategy::Random), (700, Strategy::Random)] {
            let set = sample(&surface, &Options { samples, strategy, seed: 1 }).unwrap();
            let nearest = Nearest::new(&set.points);
            let mut last = 0;
            for candidate in &set.candidates {
                last = nearest.from(last, candidate.position);
                let distance = |k: usize| set.points[k].position.distance(candidate.position);
                let least = (0..set.points.len()).map(distance).fold(f32::INFINITY, f32::min);
                assert!(distance(last) <= 1.0001 * least, "{samples}");
            }
        }
    }
}
