//! Strategy *elimination*: weighted sample elimination (Yuksel 2015, *Sample Elimination for Generating Poisson Disk Sample
//! Sets*), the state of the art beside the paper's four. Of five random points per sample the most crowded one is removed,
//! again and again.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use rand::rngs::ChaCha8Rng;

use super::{PointTree, Surface, SurfacePoint, random};

/// Random points per sample (Section 3: M = 5 N).
const POINTS_PER_SAMPLE: u32 = 5;
/// The weight function's exponent and the parameters of its weight limit (Sections 3 and 3.1).
const ALPHA: i32 = 8;
const BETA: f32 = 0.65;
const GAMMA: f32 = 1.5;

pub(super) fn elimination(
    surface: &Surface,
    area_per_sample: f32,
    samples: u32,
    rng: &mut ChaCha8Rng,
) -> Vec<SurfacePoint> {
    let mut points = random::random(surface, POINTS_PER_SAMPLE * samples, rng);
    super::patches::group_small(surface, area_per_sample, &mut points);
    // The radius of the densest packing of N discs (Section 3).
    let r_max = (area_per_sample / (2.0 * 3f32.sqrt())).sqrt();
    let r_min = r_max * (1.0 - (1.0 / POINTS_PER_SAMPLE as f32).powf(GAMMA)) * BETA;
    let weight = |distance: f32| (1.0 - distance.max(2.0 * r_min) / (2.0 * r_max)).max(0.0).powi(ALPHA);
    let tree = PointTree::new(&points);
    let for_neighbours = |k: usize, visit: &mut dyn FnMut(usize, f32)| {
        tree.within(points[k].position, 2.0 * r_max, |other| {
            if other != k && points[k].same_side(&points[other]) {
                visit(other, weight(points[k].position.distance(points[other].position)));
            }
        });
    };
    let mut weights = vec![0.0f32; points.len()];
    for (k, sum) in weights.iter_mut().enumerate() {
        for_neighbours(k, &mut |_, weight| *sum += weight);
    }
    let kept = remove_heaviest(&mut weights, samples as usize, for_neighbours);
    kept.into_iter().map(|k| points[k]).collect()
}

/// Removes the heaviest point until `count` are left; its neighbours lose the weight that it gave them.
fn remove_heaviest(
    weights: &mut [f32],
    count: usize,
    for_neighbours: impl Fn(usize, &mut dyn FnMut(usize, f32)),
) -> Vec<usize> {
    let mut heap: BinaryHeap<Entry> = weights.iter().enumerate().map(|(k, w)| Entry(*w, k)).collect();
    let mut removed = vec![false; weights.len()];
    let mut left = weights.len();
    while left > count {
        let Some(Entry(weight, k)) = heap.pop() else { break };
        // Weights only fall, so an entry that is out of date stands too high: put it back where it belongs.
        if weight > weights[k] {
            heap.push(Entry(weights[k], k));
            continue;
        }
        removed[k] = true;
        left -= 1;
        for_neighbours(k, &mut |other, weight| weights[other] -= weight);
    }
    (0..weights.len()).filter(|k| !removed[*k]).collect()
}

/// A point in the heap: its weight, and which.
#[derive(PartialEq)]
struct Entry(f32, usize);

impl Eq for Entry {}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0).then(self.1.cmp(&other.1))
    }
}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
