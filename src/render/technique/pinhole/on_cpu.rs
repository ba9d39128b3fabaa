//! Sums on the CPU.

use super::{FlatInputs, HierarchicalInputs, add};
use crate::pinhole::Receivers;
use crate::pinhole::cpu::{gather, gather_hierarchical, gather_lamp, gather_surroundings};
use crate::progress::{Progress, Uncounted};
use crate::technique::{Pending, Statistics, Sum};

/// The flat sum: every sample is evaluated at every receiver.
#[derive(Debug)]
pub(super) struct FlatOnCpu {
    pub sum: FlatInputs,
    pub statistics: Statistics,
}

impl Sum for FlatOnCpu {
    fn irradiance<'a>(&'a self, receivers: &'a Receivers, progress: &'a dyn Progress) -> Pending<'a, Vec<[f32; 4]>> {
        let FlatInputs { pinholes, environment, params, near, .. } = &self.sum;
        let mut sums = gather(receivers, pinholes, &environment.cube, params, progress);
        if let Ok(sums) = &mut sums {
            let uncounted = Uncounted(progress);
            for lamp in near.lamps.iter() {
                add(sums, &gather_lamp(receivers, pinholes, lamp, params, &uncounted));
            }
            let surfaces = near.seen.surfaces.iter().filter(|_| !self.sum.omits_surfaces(receivers));
            for surroundings in near.seen.emitters.iter().chain(surfaces) {
                add(sums, &gather_surroundings(receivers, pinholes, surroundings, params, &uncounted));
            }
        }
        Box::pin(std::future::ready(sums.map_err(Into::into)))
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }
}

/// The hierarchical sum: a tree of cells is traversed as deep as the tolerance requires.
#[derive(Debug)]
pub(super) struct HierarchicalOnCpu {
    pub sum: HierarchicalInputs,
    pub statistics: Statistics,
}

impl Sum for HierarchicalOnCpu {
    fn irradiance<'a>(&'a self, receivers: &'a Receivers, progress: &'a dyn Progress) -> Pending<'a, Vec<[f32; 4]>> {
        let HierarchicalInputs { tree, params, accuracy, clearance, .. } = &self.sum;
        let receivers = &*clearance.receivers(receivers);
        let mut sums = vec![[0.0; 4]; receivers.positions.len()];
        for (k, light) in self.sum.lights().enumerate() {
            let uncounted = Uncounted(progress);
            let progress = if k == 0 { progress } else { &uncounted };
            add(&mut sums, &gather_hierarchical(receivers, tree, light, params, *accuracy, progress));
        }
        Box::pin(std::future::ready(Ok(sums)))
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }
}
