//! The sum at one receiver taken apart: the cells that are taken for it.

use glam::{Vec3, Vec4};

use super::super::receiver::ReceiverGroup;
use super::super::receiver::load_receivers;
use super::blocks::ReceiverTile;
use super::occlusion::VisibleReceivers;
use super::tile::TileGather;
use super::{Accuracy, Light, TraversalContext};
use crate::lanes::{LANES, Simd, dispatch, level};
use crate::pinhole::tree::CHANNEL_BITS;
use crate::pinhole::{Params, PinholeTree, Receivers};

/// A cell that is taken as one sample of the mirrors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TakenCell {
    /// What it adds to the receiver's irradiance, W/m².
    pub irradiance: Vec3,
    /// Its middle, metres.
    pub centroid: Vec3,
    /// Full sides of a parallelogram with its moments, metres.
    pub sides: [Vec3; 2],
}

/// The cells that add something to a receiver, given by its position, unit normal and object. Neighbouring receivers of a picture may
/// share coarser cells, between whose light is interpolated.
pub fn cells_taken(
    receiver: (Vec3, Vec3, u32),
    pinholes: &PinholeTree,
    light: Light,
    params: &Params,
    accuracy: Accuracy,
) -> Vec<TakenCell> {
    let context = TraversalContext::new(pinholes, light, params, None);
    let receivers = Receivers::from_points(&[receiver], 1);
    let group = load_receivers(&receivers, 0, 1);
    let Some(tile) = ReceiverTile::all(&receivers).next() else { return Vec::new() };
    let mut gather = TileGather::new(&context, tile, accuracy);
    gather.criterion.allow(accuracy.error, pinholes.tree.area());
    dispatch!(level(), simd => gather.cells_taken(simd, &group))
}

impl TileGather<'_> {
    /// As [`Self::packet`], for the first lane.
    #[inline(always)]
    fn cells_taken<S: Simd>(&self, simd: S, receiver: &ReceiverGroup) -> Vec<TakenCell> {
        let receiver = receiver.in_lanes(simd);
        let mut stack: Vec<u32> = self.context.pinholes.roots().to_vec();
        let mut visible = VisibleReceivers::all(simd);
        let mut taken = Vec::new();
        while let Some(item) = stack.pop() {
            let cell = self.context.pinholes.cell(item);
            let mut sum = [Vec4::ZERO; LANES];
            let (_, refined) = self.visit(simd, (item, &cell), 1, &receiver, &mut visible, &mut sum);
            let irradiance = sum[0].truncate();
            if irradiance != Vec3::ZERO {
                taken.push(TakenCell { irradiance, centroid: cell.sample.position, sides: cell.sample.sides });
            }
            if refined & 1 != 0 {
                stack.extend(cell.children.clone().map(|child| child | item & CHANNEL_BITS));
            }
        }
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell_tree::{CellTree, TreeOptions};
    use crate::environment::{CubeMap, LightBounds};
    use crate::pinhole::cpu::gather_hierarchical;
    use crate::sampling::{Options, Strategy, Surface, sample};

    #[test]
    fn cells_add_up_to_the_sum() {
        let scene = crate::scene::load::<toml::Table>("ring").unwrap().scene;
        let surface = Surface::of_scene(&scene);
        let set = sample(&surface, &Options { samples: 300, strategy: Strategy::Neighbourhood, seed: 2 }).unwrap();
        let tree = CellTree::new(&surface, &set, &TreeOptions { leaves: 16, seed: 1 });
        let mut pinholes = PinholeTree::new(&scene, tree);
        let tracer = std::sync::Arc::new(crate::tracing::Tracer::new(&scene));
        pinholes.trace_visibility_and_doubts(&scene, tracer, &pinspot_base::NoProgress);
        let cube = CubeMap::from_radiance(64, None, |d| Vec3::new(1.0 + d.x, 1.5 + d.y, 2.0 - d.z));
        let bounds = LightBounds::new(&cube);
        let light = Light::Environment { cube: &cube, bounds: &bounds };
        let params = Params::default();
        let counts = [1e-4, 1e-2].map(|error| {
            let receiver = (Vec3::new(0.4, 0.0, 0.2), Vec3::Y, 1);
            let accuracy = Accuracy { error, split_near: true };
            let cells = cells_taken(receiver, &pinholes, light, &params, accuracy);
            let receivers = Receivers::from_points(&[receiver], 1);
            let sums = gather_hierarchical(&receivers, &pinholes, light, &params, accuracy, &pinspot_base::NoProgress);
            let sum: Vec3 = cells.iter().map(|cell| cell.irradiance).sum();
            assert!(sum.abs_diff_eq(Vec4::from(sums[0]).truncate(), 2.0 * error + 1e-5), "{sum} {:?}", sums[0]);
            cells.len()
        });
        assert!(counts[0] > counts[1] && counts[1] > 10, "{counts:?}");
    }
}
