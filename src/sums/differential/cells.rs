//! Cells: every candidate belongs to the nearest sample on its own side of creases and sheets.

use glam::Vec3;

use super::{PointTree, SurfacePoint};
use crate::parallel;

/// Each sample's candidates, as indices.
#[derive(Clone, Debug)]
pub struct Cells {
    /// Where each sample's candidates start; one more than there are samples.
    starts: Vec<u32>,
    candidates: Vec<u32>,
}

impl Cells {
    /// Sorts candidates by their nearest samples.
    pub fn new(count: usize, nearest_samples: &[u32]) -> Self {
        let mut starts = vec![0; count + 1];
        for &sample in nearest_samples {
            starts[sample as usize + 1] += 1;
        }
        for k in 0..count {
            starts[k + 1] += starts[k];
        }
        let mut next = starts.clone();
        let mut candidates = vec![0; nearest_samples.len()];
        for (candidate, &sample) in nearest_samples.iter().enumerate() {
            let free = &mut next[sample as usize];
            candidates[*free as usize] = candidate as u32;
            *free += 1;
        }
        Self { starts, candidates }
    }

    /// A sample's candidates.
    pub fn of(&self, sample: u32) -> &[u32] {
        &self.candidates[self.starts[sample as usize] as usize..self.starts[sample as usize + 1] as usize]
    }

    /// The samples' candidates, sample by sample.
    pub fn iter(&self) -> impl Iterator<Item = &[u32]> {
        self.starts.windows(2).map(|range| &self.candidates[range[0] as usize..range[1] as usize])
    }
}

/// The sample that each candidate belongs to. It is fastest where candidates that follow each other are near each other.
pub fn nearest_samples(samples: &NearestSample, candidates: &[SurfacePoint]) -> Vec<u32> {
    let of_run = |run: usize, nearest: &mut [u32]| {
        let mut last = 0;
        for (candidate, out) in candidates[run * RUN..].iter().zip(nearest) {
            last = samples.from(last, candidate.position);
            *out = samples.on_side_of(candidate, last);
        }
    };
    let mut nearest = vec![0; candidates.len()];
    parallel::for_each_chunk(&mut nearest, RUN, &of_run);
    nearest
}

/// Candidates that one thread takes in a row.
const RUN: usize = 4096;

/// Finds the samples that are nearest to places.
pub struct NearestSample<'a> {
    points: &'a [SurfacePoint],
    tree: PointTree,
    positions: Vec<Vec3>,
    /// Of each sample, the nearest first: squared distance and index.
    neighbours: Vec<Vec<(f32, u32)>>,
}

/// Neighbours that are known of a point.
const NEIGHBOURS: usize = 32;

impl<'a> NearestSample<'a> {
    /// Builds the search structure over points on a surface.
    pub fn new(points: &'a [SurfacePoint]) -> Self {
        let tree = PointTree::new(points);
        let of = |p: &SurfacePoint| tree.nearest(p.position, NEIGHBOURS).map(|(d2, k)| (d2, k as u32)).collect();
        let neighbours = parallel::map(points, &of);
        Self { points, positions: points.iter().map(|p| p.position).collect(), neighbours, tree }
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
                return self.tree.nearest_one(place).unwrap_or(best);
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

    /// The samples that may be nearest to places within `radius` of a candidate, on its side, if that belongs to the first of them;
    /// `None` where they are not known.
    pub fn around(&self, candidate: &SurfacePoint, sample: u32, radius: f32) -> Option<Vec<u32>> {
        let reach = candidate.position.distance(self.positions[sample as usize]) + 2.0 * radius;
        let neighbours = &self.neighbours[sample as usize];
        // Whoever is so near to the candidate is no farther from the sample than that.
        let between = 2.0 * reach;
        let reaches = neighbours.len() < NEIGHBOURS || neighbours[NEIGHBOURS - 1].0 >= between * between;
        if !reaches || !self.points[sample as usize].same_side(candidate) {
            return None;
        }
        let competes = |k: &u32| {
            let point = &self.points[*k as usize];
            *k != sample
                && point.position.distance_squared(candidate.position) < reach * reach
                && point.same_side(candidate)
        };
        let near = neighbours.iter().take_while(|(d2, _)| *d2 < between * between).map(|(_, k)| *k);
        Some(std::iter::once(sample).chain(near.filter(competes)).collect())
    }

    /// Whose a candidate is, if this is the nearest sample.
    fn on_side_of(&self, candidate: &SurfacePoint, nearest: usize) -> u32 {
        let points = self.points;
        if points[nearest].same_side(candidate) {
            return nearest as u32;
        }
        let distance2 = |k: &u32| points[*k as usize].position.distance_squared(candidate.position);
        let nearer = |a: &u32, b: &u32| distance2(a).total_cmp(&distance2(b));
        let near = || self.neighbours[nearest].iter().map(|(_, k)| *k);
        // A patch without a sample nearby lends its area to the nearest face that looks the same way.
        let same_side = near().filter(|k| points[*k as usize].same_side(candidate)).min_by(nearer);
        let same_way = || near().filter(|k| points[*k as usize].normal.dot(candidate.normal) > 0.0).min_by(nearer);
        same_side.or_else(same_way).unwrap_or(nearest as u32)
    }
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
            let nearest = NearestSample::new(&set.points);
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
