//! The density that points are drawn from: regions in proportion to their measure times the bound of the integrand over
//! them, uniform inside. So a point's weight, integrand over density, never exceeds the sum of measure × bound: there are no
//! fireflies, whatever the light.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::domain::Domain;

/// A tiling of a domain, fine where much light may come from.
pub(super) struct Cut<R> {
    regions: Vec<Weighted<R>>,
    /// Sums of mass up to and including each region.
    cumulative: Vec<f64>,
    queue: BinaryHeap<Entry>,
    /// Of all receivers so far.
    pub splits: u64,
}

/// How often a cut is split.
#[derive(Clone, Copy, Debug)]
pub(super) struct Depth {
    /// At least so often (while there is anything to split), and further while that pays,
    pub least: u32,
    /// but at most so often,
    pub most: u32,
    /// and not once the integral can be no more than this,
    pub negligible: f64,
    /// but certainly while it could be more than this.
    pub refined_above: f64,
}

struct Weighted<R> {
    region: R,
    bound: f64,
    /// Measure × bound.
    mass: f64,
    order: u64,
}

/// A region in the queue: its mass, and where it is.
#[derive(PartialEq)]
struct Entry(f64, usize);

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

impl<R: Copy> Cut<R> {
    pub fn new() -> Self {
        Self { regions: Vec::new(), cumulative: Vec::new(), queue: BinaryHeap::new(), splits: 0 }
    }

    /// Makes the cut for a receiver: splits the region of the largest mass, again and again. Returns whether more splits than
    /// are allowed would have paid.
    pub fn refine<D: Domain<Region = R>>(&mut self, domain: &D, receiver: &D::Receiver, depth: &Depth) -> bool {
        self.regions.clear();
        self.queue.clear();
        domain.roots(&mut |root| self.add(domain, receiver, root, None));
        let mut wanted = (depth.least / 2).max(1);
        let mut mass = f64::INFINITY;
        let mut pays = true;
        self.split(domain, receiver, wanted);
        while !self.queue.is_empty() && wanted < depth.most {
            let more = wanted.min(depth.most - wanted);
            self.split(domain, receiver, more);
            wanted += more;
            let before = std::mem::replace(&mut mass, self.regions.iter().map(|r| r.mass).sum());
            pays =
                mass > depth.negligible && (mass < domain.fineness().worthwhile * before || mass > depth.refined_above);
            if wanted >= depth.least && !pays {
                break;
            }
        }
        let limited = pays && !self.queue.is_empty();
        self.finish(domain);
        limited
    }

    /// Every root as one region, in proportion to its measure alone: no importance at all.
    pub fn uniform<D: Domain<Region = R>>(&mut self, domain: &D) {
        self.regions.clear();
        domain.roots(&mut |region| {
            let mass = domain.measure(&region);
            self.regions.push(Weighted { region, bound: 1.0, mass, order: 0 });
        });
        self.finish(domain);
    }

    /// Splits so many times, or until there is nothing left to split.
    fn split<D: Domain<Region = R>>(&mut self, domain: &D, receiver: &D::Receiver, times: u32) {
        for _ in 0..times {
            let Some(Entry(_, index)) = self.queue.pop() else { return };
            let region = self.regions[index].region;
            // The first part takes the whole's place.
            let mut place = Some(index);
            domain.split(&region, receiver, &mut |part| self.add(domain, receiver, part, place.take()));
        }
        self.splits += u64::from(times);
    }

    fn add<D: Domain<Region = R>>(&mut self, domain: &D, receiver: &D::Receiver, region: R, place: Option<usize>) {
        let bound = domain.bound(&region, receiver);
        let mass = domain.measure(&region) * bound;
        let weighted = Weighted { region, bound, mass, order: 0 };
        let index = place.unwrap_or(self.regions.len());
        if index < self.regions.len() {
            self.regions[index] = weighted;
        } else if mass > 0.0 {
            self.regions.push(weighted);
        }
        if mass > 0.0 {
            self.queue.push(Entry(mass, index));
        }
    }

    fn finish<D: Domain<Region = R>>(&mut self, domain: &D) {
        // What is left out is less than the rounding of the sum.
        let least = 1e-18 * self.regions.iter().map(|r| r.mass).sum::<f64>();
        self.regions.retain(|r| r.mass > least);
        for weighted in &mut self.regions {
            weighted.order = domain.order(&weighted.region);
        }
        self.regions.sort_unstable_by_key(|r| r.order);
        self.cumulative.clear();
        let mut sum = 0.0;
        self.cumulative.extend(self.regions.iter().map(|r| {
            sum += r.mass;
            sum
        }));
    }

    /// The largest weight that any point can have: at least the integral.
    pub fn total(&self) -> f64 {
        self.cumulative.last().copied().unwrap_or(0.0)
    }

    /// One point's estimate of the integral, for `u` uniform in [0, 1)⁹.
    pub fn estimate<D: Domain<Region = R>>(&self, domain: &D, receiver: &D::Receiver, u: [f64; 9]) -> DVec3 {
        let total = self.total();
        let index = self.cumulative.partition_point(|c| *c <= u[0] * total).min(self.regions.len() - 1);
        let Weighted { region, bound, .. } = &self.regions[index];
        // Density = (mass / total) / measure = bound / total.
        domain.integrand(region, [u[1], u[2], u[3], u[4], u[5], u[6], u[7], u[8]], receiver) * (total / bound)
    }
}
