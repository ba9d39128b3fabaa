//! Strategy *neighbourhood* (Wand & Straßer, Section 3.2), the default: from a dense set in random order, every point that is not yet
//! covered is kept and covers those within a distance. The result is a maximal Poisson-disk subset. Where importance is
//! higher, the distance is shorter.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rayon::prelude::*;

use super::SurfacePoint;
use super::hash_grid::HashGrid;
use crate::parallel;

/// Close enough to the number asked for, as a fraction of it.
const TOLERANCE: f64 = 0.005;

/// Distances that are tried.
const MAX_SEARCHES: u32 = 16;

/// What is kept of a set.
pub(super) struct Kept {
    /// Which points.
    pub points: Vec<SurfacePoint>,
    /// For each candidate the nearest of them on its own side, if all cover alike; else nothing.
    pub nearest_samples: Vec<u32>,
}

/// Keeps about `samples` of the candidates, which it takes in this order; the distance is searched for.
pub(super) fn neighbourhood(
    candidates: &[SurfacePoint],
    order: &[u32],
    importances: Option<&[f32]>,
    area_per_sample: f32,
    samples: u32,
) -> Kept {
    // Of the distance that is searched for: the number of samples in an area goes with its inverse square.
    let scale = importances.map(|importances| {
        let mean = super::mean_importance(candidates, importances);
        importances.iter().map(|w| (mean / w).sqrt()).collect::<Vec<f32>>()
    });
    // The distance that 40 candidates a sample lead to on a plane.
    let mut radius = 0.79 * area_per_sample.sqrt();
    let mut grid = HashGrid::new(candidates, radius);
    let extent = super::extent(candidates);
    let (mut too_small, mut too_large) = (0.0f32, f32::INFINITY);
    let mut best: Option<(u32, Pruned)> = None;
    for _ in 0..MAX_SEARCHES {
        if !grid.suits(radius) {
            grid = HashGrid::new(candidates, radius);
        }
        let pruned = prune(candidates, order, &grid, |k| scale.as_ref().map_or(radius, |s| s[k] * radius));
        let count = pruned.kept.len() as u32;
        let miss = count.abs_diff(samples);
        if best.as_ref().is_none_or(|(least, _)| miss < *least) {
            best = Some((miss, pruned));
        }
        // Once a single point covers all that it can, a larger distance changes nothing.
        if f64::from(miss) <= TOLERANCE * f64::from(samples) || count > samples && radius > extent {
            break;
        }
        if count > samples {
            too_small = radius;
        } else {
            too_large = radius;
        }
        radius = next_radius(radius, count as f32 / samples as f32, too_small, too_large);
    }
    let (_, Pruned { kept, nearest_samples }) = best.expect("at least one try");
    let points = kept.into_iter().map(|k| candidates[k as usize]).collect();
    // Where some cover more than others, the nearest need not be among those that cover.
    Kept { points, nearest_samples: if importances.is_none() { nearest_samples } else { Vec::new() } }
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
    nearest_samples: Vec<u32>,
}

/// Candidates that one thread takes in a row.
const RUN: usize = 4096;

/// Candidates that are looked at together.
const BATCH: usize = 256;

fn prune(candidates: &[SurfacePoint], order: &[u32], grid: &HashGrid, radius: impl Fn(usize) -> f32 + Sync) -> Pruned {
    let covers = Covers::new(candidates.len());
    let mut kept: Vec<u32> = Vec::new();
    let mut uncovered = order.iter().copied().filter(|&k| !covers.is_covered(grid.slot_of(k as usize)));
    loop {
        let first = kept.len();
        // Those of a batch that none kept before covers, and none of their own that comes before them, will be kept: they cover what
        // they do side by side.
        for k in uncovered.by_ref().take(BATCH) {
            let candidate = &candidates[k as usize];
            let covers = |other: &u32| {
                let other = *other as usize;
                let d2 = candidates[other].position.distance_squared(candidate.position);
                d2 <= radius(other).powi(2) && candidates[other].same_side(candidate)
            };
            if !kept[first..].iter().any(covers) {
                kept.push(k);
            }
        }
        if kept.len() == first {
            break;
        }
        parallel::for_each(kept.len() - first, &|place| {
            let (k, number) = (kept[first + place], (first + place) as u32);
            let candidate = &candidates[k as usize];
            // Also where its own normal is none.
            covers.cover(grid.slot_of(k as usize), 0.0, number);
            grid.within(candidate.position, radius(k as usize), |slot, d2| {
                if grid.is_on_same_side(slot, candidate) {
                    covers.cover(slot, d2, number);
                }
            });
        });
    }
    let mut nearest_samples = vec![0; candidates.len()];
    parallel::for_each_chunk(&mut nearest_samples, RUN, &|run, nearest| {
        let of_candidates = (run * RUN..).map(|k| covers.nearest(grid.slot_of(k)));
        nearest.iter_mut().zip(of_candidates).for_each(|(nearest, number)| *nearest = number);
    });
    Pruned { kept, nearest_samples }
}

/// Of each slot of the grid, the nearest point that covers it: above its squared distance, whose bits are ordered as distances
/// are, below its number. Whoever comes first, the least remains.
struct Covers(Vec<AtomicU64>);

impl Covers {
    fn new(count: usize) -> Self {
        Self((0..count).into_par_iter().map(|_| AtomicU64::new(u64::MAX)).collect())
    }

    fn is_covered(&self, slot: usize) -> bool {
        self.0[slot].load(Relaxed) != u64::MAX
    }

    fn cover(&self, slot: usize, distance2: f32, number: u32) {
        self.0[slot].fetch_min(u64::from(distance2.to_bits()) << 32 | u64::from(number), Relaxed);
    }

    fn nearest(&self, slot: usize) -> u32 {
        self.0[slot].load(Relaxed) as u32
    }
}

#[cfg(test)]
mod tests {
    use crate::sampling::{Options, Strategy, Surface, sample};
    use crate::scene::Mesh;
    use crate::scene::shapes::{Plane, Ring, Shape, Sphere};
    use glam::Vec3;

    fn placed(mesh: &Mesh, scale: Vec3, offset: Vec3) -> Mesh {
        let positions = mesh.positions().iter().map(|p| scale * *p + offset).collect();
        Mesh::new("mesh", positions, mesh.normals().to_vec(), mesh.triangles().to_vec()).unwrap().0
    }

    /// The search ends, with as many samples as there are pieces that cannot stand for each other if those are more than were asked
    /// for. A grid whose cells stayed as small as those of the first distance would take minutes.
    #[test]
    fn fewer_samples_than_separate_pieces_end_the_search() {
        let ring = Shape::Ring(Ring::default()).mesh().unwrap();
        let sphere = Shape::Sphere(Sphere::of_radius(1.0)).mesh().unwrap();
        let plane = Shape::Plane(Plane { size: [1.0, 1.0] }).mesh().unwrap();
        let alone = |mesh: Mesh| {
            let mut surface = Surface::default();
            surface.append(&mesh, 0, false);
            surface
        };
        let mut apart = Surface::default();
        for k in 0..400u32 {
            let place = 100.0 * Vec3::new((k % 20) as f32, 0.0, (k / 20) as f32);
            apart.append(&placed(&plane, Vec3::splat(0.1), place), k, false);
        }
        let cases = [
            ("one sample of a ring", alone(ring.clone()), 1, 1..=8),
            ("one sample of a sphere", alone(sphere), 1, 1..=8),
            ("mirrors far apart", apart, 100, 400..=400),
            ("a needle", alone(placed(&plane, Vec3::new(3e2, 1.0, 1e-3), Vec3::ZERO)), 1000, 900..=1100),
            ("a long thin tube", alone(placed(&ring, Vec3::new(1e-3, 2e3, 1e-3), Vec3::ZERO)), 1000, 800..=1200),
            ("a tiny ring", alone(placed(&ring, Vec3::splat(1e-8), Vec3::ZERO)), 1000, 980..=1020),
            ("a ring far away", alone(placed(&ring, Vec3::splat(1e3), Vec3::splat(1e6))), 1000, 980..=1020),
        ];
        for (name, surface, samples, expected) in cases {
            let options = Options { samples, strategy: Strategy::Neighbourhood, seed: 1 };
            let count = sample(&surface, &options).unwrap().points.len();
            assert!(expected.contains(&count), "{name}: {count}");
        }
    }
}
