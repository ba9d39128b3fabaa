//! The sums on the CPU.

use super::{FlatInputs, HierarchicalInputs};
use crate::pinhole::Receivers;
use crate::pinhole::cpu::{Light, gather, gather_hierarchical};
use crate::progress::Progress;
use crate::technique::{Pending, Statistics, Sum};

/// Every sample for every receiver.
#[derive(Debug)]
pub(super) struct FlatOnCpu {
    pub sum: FlatInputs,
    pub statistics: Statistics,
}

impl Sum for FlatOnCpu {
    fn irradiance<'a>(&'a self, receivers: &'a Receivers, progress: &'a dyn Progress) -> Pending<'a, Vec<[f32; 4]>> {
        let FlatInputs { pinholes, environment, params } = &self.sum;
        let sums = gather(receivers, pinholes, &environment.cube, params, &|n| progress.advance(n));
        Box::pin(std::future::ready(sums.map_err(Into::into)))
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }
}

/// By a tree of cells, as finely as the tolerance asks for.
#[derive(Debug)]
pub(super) struct HierarchicalOnCpu {
    pub sum: HierarchicalInputs,
    pub statistics: Statistics,
}

impl Sum for HierarchicalOnCpu {
    fn irradiance<'a>(&'a self, receivers: &'a Receivers, progress: &'a dyn Progress) -> Pending<'a, Vec<[f32; 4]>> {
        let HierarchicalInputs { tree, environment, bounds, params, accuracy } = &self.sum;
        let light = Light { cube: &environment.cube, bounds };
        let sums = gather_hierarchical(receivers, tree, light, params, *accuracy, &|n| progress.advance(n));
        Box::pin(std::future::ready(Ok(sums)))
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }
}
