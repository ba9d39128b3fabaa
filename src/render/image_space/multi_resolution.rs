//! Splats of several sizes at once: where photons are dense, the small ones count, else the large ones (Wyman and Dachsbacher 2006, Section 4.1).

use std::sync::atomic::{AtomicU32, Ordering};

use glam::DVec3;

use super::caustic_map::CausticMap;
use super::constants::{FIRST_SPLAT_DIAMETER, SPLAT_DIAMETER_STEP, SPLAT_SIZES};
use super::ledger::{Ledger, total};
use super::photons::PhotonGrid;
use super::splats::of_diameter;
use crate::parallel;

/// Diameters of the splats, texels.
pub const DIAMETERS: [u32; SPLAT_SIZES as usize] = {
    let mut diameters = [FIRST_SPLAT_DIAMETER; SPLAT_SIZES as usize];
    let mut size = 1;
    while size < diameters.len() {
        diameters[size] = diameters[size - 1] + SPLAT_DIAMETER_STEP;
        size += 1;
    }
    diameters
};

/// A size counts from this many photons on, and alone from twice as many.
const LEAST_PHOTONS: f64 = 8.0;

/// Sizes that are mixed in a texel at most.
const MOST_SIZES: usize = 3;

/// A map for each size, and how many of its splats reach each texel.
#[derive(Debug)]
pub struct Resolutions<'a> {
    maps: Vec<CausticMap<'a>>,
    counts: Vec<Vec<AtomicU32>>,
}

impl<'a> Resolutions<'a> {
    /// Empty ones that show what a map does.
    pub fn like(map: &CausticMap<'a>) -> Self {
        let count = map.len();
        let counts = DIAMETERS.map(|_| (0..count).map(|_| AtomicU32::new(0)).collect());
        Self { maps: DIAMETERS.map(|_| map.emptied()).into(), counts: counts.into() }
    }

    /// Maps and counts that another program has made, from the smallest splats up.
    #[cfg(feature = "gpu")]
    pub fn of_sums(maps: Vec<CausticMap<'a>>, counts: Vec<Vec<u32>>) -> Self {
        let atomic = |counts: Vec<u32>| counts.into_iter().map(AtomicU32::new).collect();
        Self { maps, counts: counts.into_iter().map(atomic).collect() }
    }

    /// Adds photons to all of them. Returns what is lost.
    pub fn add(&self, grid: &PhotonGrid) -> Ledger {
        let mut ledger = Ledger::default();
        for ((diameter, map), counts) in DIAMETERS.into_iter().zip(&self.maps).zip(&self.counts) {
            ledger = of_diameter(map, grid, f64::from(diameter));
            let photons = grid.own_photons();
            parallel::for_each(photons.len(), &|photon| {
                let Ok((_, index)) = map.place(&photons[photon]) else { return };
                let reach = i64::from(diameter / 2);
                let is_reached = |[dx, dy]: [i64; 2]| 4 * (dx * dx + dy * dy) <= i64::from(diameter * diameter);
                for (texel, _) in map.around(index, reach).filter(|(_, offset)| is_reached(*offset)) {
                    counts[texel].fetch_add(1, Ordering::Relaxed);
                }
            });
        }
        // What arrives is known when the sizes have been chosen.
        ledger.deposited = 0.0;
        ledger
    }

    /// What a size has counted in each texel, and its flux, W.
    #[cfg(test)]
    pub fn sums(&self, size: usize) -> (Vec<u32>, f64) {
        let counts = self.counts[size].iter().map(|count| count.load(Ordering::Relaxed)).collect();
        let map = &self.maps[size];
        (counts, (0..map.len()).map(|texel| map.flux(texel).element_sum()).sum())
    }

    /// Chooses between the sizes in every texel, and adds the outcome to a map.
    pub fn resolve(self, map: &CausticMap) -> Ledger {
        let choose = |texel: usize| {
            let flux = self.choose(texel);
            // The direction is that of the smallest splats.
            let of_smallest = self.maps[0].flux(texel);
            let factors = DVec3::select(of_smallest.cmpeq(DVec3::ZERO), DVec3::ZERO, flux / of_smallest);
            map.add_flux(texel, flux);
            map.add_for_gloss(texel, (&self.maps[0], texel), factors);
            Ledger { deposited: flux.element_sum(), ..Ledger::default() }
        };
        total(0..self.counts[0].len(), &choose)
    }

    /// The smallest size with enough photons, and with what is left of the weight the next ones. A size without enough of them counts only
    /// where it is brighter than the next one.
    fn choose(&self, texel: usize) -> DVec3 {
        let flux = |size: usize| self.maps[size].flux(texel);
        let (mut sum, mut left, mut used) = (DVec3::ZERO, 1.0, 0);
        for size in 0..DIAMETERS.len() {
            let is_last = size + 1 == DIAMETERS.len() || used + 1 == MOST_SIZES;
            let count = f64::from(self.counts[size][texel].load(Ordering::Relaxed));
            let weight = if is_last { 1.0 } else { weight_of(count) };
            if weight == 0.0 || weight < 1.0 && flux(size).element_sum() < flux(size + 1).element_sum() {
                continue;
            }
            sum += left * weight * flux(size);
            left *= 1.0 - weight;
            used += 1;
            if left == 0.0 {
                break;
            }
        }
        sum
    }
}

/// The weight of a size that so many photons reach a texel with.
fn weight_of(count: f64) -> f64 {
    let t = (count / LEAST_PHOTONS - 1.0).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::weight_of;

    #[test]
    fn weights_rise_from_eight_to_sixteen_photons() {
        assert_eq!([0.0, 8.0, 12.0, 16.0, 100.0].map(weight_of), [0.0, 0.0, 0.5, 1.0, 1.0]);
    }
}
