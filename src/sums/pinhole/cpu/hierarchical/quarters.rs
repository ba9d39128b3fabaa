//! Leaves that are near to receivers: quartered until each piece is one sample for them.

use glam::Vec4;

use super::super::Source;
use super::super::pair::ReceiverCellPair;
use super::super::receiver::Receiver;
use super::super::sky::OccludedSky;
use super::evaluation::CellAtReceivers;
use super::tile::TileGather;
use crate::lanes::{ALL, F, LANES, Simd, SimdBase, bits, splat};
use crate::pinhole::PinholeParts;
use crate::pinhole::cell::Cell;
use crate::pinhole::constants::{
    MAX_LAMP_QUARTERINGS, MAX_PIECE_SIZE, MAX_QUARTERINGS, MAX_RELATIVE_SIZE, MIN_UNEVEN_SIZE, WEIGHT_ERROR_SCALE,
};

impl TileGather<'_> {
    /// The lanes so near to a leaf of this relative size that it is not one sample for them.
    #[inline(always)]
    pub(super) fn near_lanes<S: Simd>(
        &self,
        simd: S,
        area: f32,
        (max_contribution, size): (F<S>, F<S>),
        active: u32,
    ) -> u32 {
        if !self.accuracy.split_near {
            return 0;
        }
        active & self.uneven_lanes(simd, area, max_contribution, size)
    }

    /// The lanes within which the weight of a cell of this relative size differs too much.
    #[inline(always)]
    fn uneven_lanes<S: Simd>(&self, simd: S, area: f32, max_contribution: F<S>, size: F<S>) -> u32 {
        // A lamp's light comes from anywhere on the cell, that of the environment from all of it.
        let (of_size, may_be) = match self.context.gather.source {
            Source::Lamp(_) => (size, bits(size.simd_gt(MIN_UNEVEN_SIZE))),
            _ => (size * size, ALL),
        };
        let error = max_contribution * of_size * WEIGHT_ERROR_SCALE;
        may_be & bits(error.simd_gt(splat(simd, self.criterion.error_budget_of(area))))
    }

    /// Adds what a leaf contributes to receivers so near to it that it is not one sample for them: its parallelogram is quartered
    /// until each piece is, or is too small to matter.
    #[inline(always)]
    pub(super) fn add_quarters<S: Simd>(
        &self,
        simd: S,
        leaf: &Cell,
        (near, max_light): (u32, F<S>),
        receiver: &Receiver<S>,
        visible_fraction: F<S>,
        sum: &mut [Vec4; LANES],
    ) {
        let gather = &self.context.gather;
        let taps = splat(simd, gather.uniforms.taps as f32);
        let mut pieces: Vec<(PinholeParts, u32, u32)> = leaf.sample.quarters().map(|q| (q, near, 1)).to_vec();
        let max_depth = match &gather.source {
            Source::Lamp(_) => MAX_LAMP_QUARTERINGS,
            _ => MAX_QUARTERINGS,
        };
        while let Some((piece, lanes, depth)) = pieces.pop() {
            let pair = ReceiverCellPair::new(simd, &piece, receiver);
            let lanes = match &gather.source {
                Source::Lamp(lamp) => lanes & lamp.lanes_lit_by_piece(simd, &piece, &pair),
                _ => lanes,
            };
            if lanes == 0 {
                continue;
            }
            let extent = 0.5 * (piece.sides[0].length() + piece.sides[1].length());
            let size = self.size_for_light(pair.inverse_l * extent, &piece, extent);
            let weight = gather.weight(simd, &piece, &pair, receiver);
            let is_large = bits(size.simd_gt(MAX_RELATIVE_SIZE))
                | bits(size.simd_gt(MAX_PIECE_SIZE)) & self.uneven_lanes(simd, piece.area, weight * max_light, size);
            let refined = if depth < max_depth { lanes & is_large } else { 0 };
            if refined != 0 {
                pieces.extend(piece.quarters().map(|q| (q, refined, depth + 1)));
            }
            let lit = lanes & pair.lit() & !refined;
            if lit == 0 {
                continue;
            }
            let weight = weight * visible_fraction;
            let footprint = &pair.footprint(simd, &piece);
            let map = self.sky_map(leaf, pair.dn);
            let max = weight * max_light;
            let piece =
                CellAtReceivers { sample: &piece, leaf: &leaf.sample, receiver, pair: &pair, footprint, weight };
            match &gather.source {
                Source::Environment(_) => {
                    let sky = map.as_ref().map(OccludedSky::from);
                    gather.add_cell(simd, &piece, sky.as_ref(), Some(taps), lit, sum);
                }
                _ => self.add_near_light(simd, &piece, map.as_ref(), (taps, max), lit, sum),
            }
        }
    }

    /// The relative size of a cell for receivers and, if that is larger, for a lamp.
    #[inline(always)]
    pub(super) fn size_for_light<S: Simd>(&self, size: F<S>, cell: &PinholeParts, extent: f32) -> F<S> {
        match &self.context.gather.source {
            Source::Lamp(lamp) => size.max(lamp.relative_size(cell, extent)),
            _ => size,
        }
    }
}
