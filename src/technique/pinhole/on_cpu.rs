//! Sums on the CPU.

use super::{FlatInputs, HierarchicalInputs};
use crate::pinhole::Receivers;
use crate::pinhole::cpu::{Light, gather, gather_hierarchical};
use crate::progress::Progress;
use crate::technique::{Pending, Statistics, Sum};

/// The flat sum: every sample is evaluated at every receiver.
#[derive(Debug)]
pub(super) struct FlatOnCpu {
    pub sum: FlatInputs,
    pub statistics: Statistics,
}

impl Sum for FlatOnCpu {
    fn irradiance<'a>(&'a self, receivers: &'a Receivers, progress: &'a dyn Progress) -> Pending<'a, Vec<[f32; 4]>> {
        let FlatInputs { pinholes, environment, params } = &self.sum;
        let sums = gather(receivers, pinholes, &environment.cube, params, progress);
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
        let HierarchicalInputs { tree, environment, bounds, params, accuracy } = &self.sum;
        let light = Light { cube: &environment.cube, bounds };
        let sums = gather_hierarchical(receivers, tree, light, params, *accuracy, progress);
        Box::pin(std::future::ready(Ok(sums)))
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }
}
