//! One tile of receivers: pairs of its blocks with cells, refined from the largest blocks to the smallest.

use glam::Vec4;

use super::super::Source;
use super::super::pair::ReceiverCellPair;
use super::super::receiver::{Receiver, ReceiverGroup, load_at};
use super::super::sky::OccludedSky;
use super::super::visibility::{Coverage, VisibilityMap};
use super::blocks::{Block, BlockPyramid, EDGES, FINEST, Kind, ReceiverTile, points_along};
use super::coverage::CoverageCache;
use super::criterion::{Accepted, Decision, RefinementCriterion};
use super::evaluation::CellAtReceivers;
use super::inspection::TakenCell;
use super::{Accuracy, TraversalContext};
use crate::lanes::{LANES, Simd, SimdBase, V3, bits, lanes, set_bits, splat, splat3};
use crate::pinhole::cell::Cell;
use crate::pinhole::constants::{CENTRAL_VISIBILITY_SHARE, INTERPOLATION_POINTS, PARTIAL_VISIBILITY_SHARE};
use crate::pinhole::receivers::TILE;
use crate::pinhole::tree::{CHANNEL_BITS, NODE_MASK};
use crate::pinhole::{PinholeSample, VisibilityMaps};
use crate::progress::Progress;

// A lane for each of a block's points.
const _: () = assert!(LANES == INTERPOLATION_POINTS as usize);

/// Marks a cell in a list as visible from the whole block, so that the cells below it need no test.
pub const FULLY_VISIBLE: u32 = 1 << 31;

/// A tile being gathered.
pub struct TileGather<'a> {
    pub context: &'a TraversalContext<'a>,
    receivers: ReceiverTile<'a>,
    blocks: BlockPyramid,
    pub criterion: RefinementCriterion<'a>,
    pub accuracy: Accuracy,
    /// Once nobody waits for the sums any more, what is left stays dark.
    progress: &'a dyn Progress,
    sums: Vec<Vec4>,
    /// Recycled lists of cells.
    spare_lists: Vec<Vec<u32>>,
    pub has_visibility: bool,
    coverage: CoverageCache,
    /// Recycled stack of cells with their lanes.
    pub packet_stack: Vec<(u32, u32)>,
    /// The cells that are taken for the first of sixteen receivers, if they are to be listed; then they are not added up.
    pub taken_by_first: Option<Vec<TakenCell>>,
}

/// A block: level, row and column among the blocks of its level.
#[derive(Clone, Copy)]
struct BlockPlace {
    level: usize,
    x: usize,
    y: usize,
}

impl BlockPlace {
    fn parts(self) -> [Self; 4] {
        let Self { level, x, y } = self;
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| Self { level: level + 1, x: 2 * x + i, y: 2 * y + j })
    }
}

impl<'a> TileGather<'a> {
    pub fn new(
        context: &'a TraversalContext<'a>,
        receivers: ReceiverTile<'a>,
        accuracy: Accuracy,
        progress: &'a dyn Progress,
    ) -> Self {
        let criterion = RefinementCriterion {
            uniforms: &context.gather.uniforms,
            light: context.bounds,
            error_budget: 0.0,
            coherent_error: 0.0,
            negligible: 0.0,
            texel_rad: context.gather.uniforms.texel_rad,
            map_texel_rad: context.gather.map_texel_rad(),
            has_view_directions: receivers.receivers().view_directions.is_some(),
            medium: context.gather.medium.as_ref(),
            along_rays: receivers.receivers().lengths.is_some(),
        };
        Self {
            context,
            receivers,
            blocks: BlockPyramid::new(&receivers, &context.weights),
            criterion,
            accuracy,
            progress,
            sums: vec![Vec4::ZERO; TILE * TILE],
            spare_lists: Vec::new(),
            has_visibility: context.gather.pinholes.visibility.is_some(),
            coverage: CoverageCache::new(context.gather.pinholes.samples.len()),
            packet_stack: Vec::new(),
            taken_by_first: None,
        }
    }

    /// The sums at the tile's points, row by row.
    pub fn into_sums(self) -> Vec<Vec4> {
        self.sums
    }

    /// Gathers the whole tile.
    #[inline(always)]
    pub fn run<S: Simd>(&mut self, simd: S) {
        self.block(simd, BlockPlace { level: 0, x: 0, y: 0 }, self.context.pinholes.roots());
    }

    /// Gathers what cells contribute to a block.
    #[inline(never)]
    fn block<S: Simd>(&mut self, simd: S, place: BlockPlace, cells: &[u32]) {
        simd.vectorize(
            #[inline(always)]
            || self.block_in_lanes(simd, place, cells),
        );
    }

    #[inline(always)]
    fn block_in_lanes<S: Simd>(&mut self, simd: S, place: BlockPlace, cells: &[u32]) {
        let Block { kind, tolerated, .. } = *self.blocks.block(place.level, place.x, place.y);
        if kind == Kind::Empty || cells.is_empty() || self.progress.is_cancelled() {
            return;
        }
        self.criterion.allow(self.accuracy.error + tolerated, self.context.pinholes.tree.area());
        let points = self.points(place);
        let mut sum = [Vec4::ZERO; LANES];
        if place.level == FINEST {
            self.packet(simd, &points, cells, &mut sum);
            self.interpolate(place, &sum, 0.0);
            return;
        }
        if self.has_visibility {
            self.coverage.enter(place.level);
        }
        let mut deferred = self.spare_lists.pop().unwrap_or_default();
        let decisions = self.refine(simd, place, &points, cells, &mut deferred, &mut sum);
        self.interpolate(place, &sum, decisions as f32);
        for part in place.parts() {
            self.block(simd, part, &deferred);
        }
        self.recycle(deferred);
    }

    /// Adds what cells contribute to a block that can be interpolated within it; the rest is deferred to its parts. Returns the
    /// number of decisions.
    #[inline(always)]
    fn refine<S: Simd>(
        &mut self,
        simd: S,
        place: BlockPlace,
        points: &ReceiverGroup,
        cells: &[u32],
        deferred: &mut Vec<u32>,
        sum: &mut [Vec4; LANES],
    ) -> usize {
        let block = *self.blocks.block(place.level, place.x, place.y);
        let pinholes = self.context.pinholes;
        let mut stack = self.spare_lists.pop().unwrap_or_default();
        stack.extend_from_slice(cells);
        let mut decisions = 0;
        while let Some(item) = stack.pop() {
            let index = item & !FULLY_VISIBLE;
            let cell = pinholes.cell(item);
            decisions += 1;
            let decision = self.criterion.decide(&block, &cell);
            if decision == Decision::Drop {
                continue;
            }
            let is_cluster = self.has_visibility && pinholes.tree.is_cluster(index & NODE_MASK);
            let mut seen = item & FULLY_VISIBLE;
            if block.kind == Kind::Smooth && seen == 0 && self.has_visibility && !is_cluster {
                match self.receiver_coverage(simd, place, points, cell.sample_node) {
                    Coverage::None => continue,
                    Coverage::Full => seen = FULLY_VISIBLE,
                    Coverage::Partial => {}
                }
            }
            let accepted = match decision {
                Decision::Drop => continue,
                Decision::RefineCell => {
                    stack.extend(cell.children.map(|child| child | seen | index & CHANNEL_BITS));
                    continue;
                }
                Decision::RefineBlock => {
                    deferred.push(index | seen);
                    continue;
                }
                Decision::Accept(accepted) => accepted,
            };
            if is_cluster
                && accepted.max_contribution
                    >= CENTRAL_VISIBILITY_SHARE * self.criterion.error_budget_of(cell.sample.area)
            {
                stack.extend(cell.children.map(|child| child | index & CHANNEL_BITS));
                continue;
            }
            let coverage = match seen {
                0 if self.has_visibility => self.receiver_coverage(simd, place, points, cell.sample_node),
                _ => Coverage::Full,
            };
            if !self.add(simd, &cell, points, (accepted, coverage), sum) {
                deferred.push(index | seen);
            }
        }
        self.recycle(stack);
        decisions
    }

    fn recycle(&mut self, mut list: Vec<u32>) {
        list.clear();
        self.spare_lists.push(list);
    }

    /// The sixteen interpolation points of a block.
    fn points(&self, BlockPlace { level, x, y }: BlockPlace) -> ReceiverGroup {
        let (edge, at) = (EDGES[level], points_along(level));
        let place = |lane: usize| self.receivers.place(x * edge + at[lane % 4], y * edge + at[lane / 4]);
        load_at(self.receivers.receivers(), place)
    }

    /// How much of a smooth block the sample sees whose map a cell shares.
    #[inline(always)]
    fn receiver_coverage<S: Simd>(
        &mut self,
        simd: S,
        place: BlockPlace,
        points: &ReceiverGroup,
        sample_node: u32,
    ) -> Coverage {
        if let Some(known) = self.coverage.known(place.level, sample_node) {
            return known;
        }
        let pinholes = self.context.gather.pinholes;
        let Some(maps) = &pinholes.visibility else { return Coverage::Full };
        let receiver = points.in_lanes(simd);
        let (map, l) = map_towards(simd, maps, &pinholes.samples[sample_node as usize], &receiver);
        let coverage = map.receiver_coverage(simd, l, self.doubted(&receiver), receiver.occupied());
        self.coverage.keep(place.level, sample_node, coverage);
        coverage
    }

    /// Adds what a cell contributes to sixteen points; `false` if that cannot be interpolated between them.
    #[inline(always)]
    fn add<S: Simd>(
        &self,
        simd: S,
        cell: &Cell,
        points: &ReceiverGroup,
        (accepted, coverage): (Accepted, Coverage),
        sum: &mut [Vec4; LANES],
    ) -> bool {
        let gather = &self.context.gather;
        let (sample, receiver) = (&cell.sample, points.in_lanes(simd));
        let pair = ReceiverCellPair::new(simd, sample, &receiver);
        let mut lit = pair.lit();
        if lit == 0 || coverage == Coverage::None {
            return true;
        }
        let error_budget = self.criterion.error_budget_of(sample.area);
        let is_small = accepted.max_contribution < PARTIAL_VISIBILITY_SHARE * error_budget;
        let mut weight = gather.weight(simd, sample, &pair, &receiver);
        let footprint = pair.footprint(simd, sample);
        let mut occlusion = None;
        if let Some(maps) = &gather.pinholes.visibility {
            let node = &gather.pinholes.samples[cell.sample_node as usize];
            if coverage == Coverage::Partial {
                if !is_small {
                    return false;
                }
                let (map, l) = map_towards(simd, maps, node, &receiver);
                let (fraction, doubtful) = map.visible_fraction(simd, l, self.doubted(&receiver), lit);
                let max = splat(simd, accepted.max_contribution);
                let fraction = self.visible_fraction(simd, sample, &pair, (lanes(simd, fraction), doubtful), max);
                weight *= fraction;
                lit &= bits(fraction.simd_gt(0.0));
                if lit == 0 {
                    return true;
                }
            }
            let map = VisibilityMap::of_sky(maps, node, pair.dn);
            let sky = map.sky_coverage(simd, pair.r, footprint.max_radius(sample.lobe), lit);
            match sky {
                _ if !gather.source.is_environment() => {
                    if let Source::Lamp(lamp) = &gather.source
                        && !is_small
                        && lamp.is_partly_seen(simd, sample.position, &map)
                    {
                        return false;
                    }
                    occlusion = Some(map);
                }
                Coverage::Full => {}
                Coverage::None => return true,
                Coverage::Partial if accepted.allows_partial_sky || is_small => occlusion = Some(map),
                // What lobes see of the sky changes smoothly.
                Coverage::Partial if sample.is_wide_lobe(self.criterion.map_texel_rad) => {
                    let seen = map.lobe_fraction(simd, pair.r, sample.lobe, lit).to_array();
                    let [least, most] = set_bits(lit).fold([1.0f32, 0.0], |[l, m], k| [l.min(seen[k]), m.max(seen[k])]);
                    if (most - least) * accepted.max_contribution > error_budget {
                        return false;
                    }
                    occlusion = Some(map);
                }
                Coverage::Partial => return false,
            }
        }
        let cell =
            CellAtReceivers { sample, leaf: sample, receiver: &receiver, pair: &pair, footprint: &footprint, weight };
        if !gather.source.is_environment() {
            let taps = splat(simd, gather.uniforms.taps as f32);
            let max = splat(simd, accepted.max_contribution);
            self.add_near_light(simd, &cell, occlusion.as_ref(), (taps, max), lit, sum);
            return true;
        }
        let is_uneven = accepted.contribution_range >= error_budget;
        // No closure: it might be compiled by itself, without the instruction set.
        let taps = if is_uneven { Some(self.criterion.taps(splat(simd, accepted.contribution_range))) } else { None };
        let sky = occlusion.as_ref().map(OccludedSky::from);
        gather.add_cell(simd, &cell, sky.as_ref(), taps, lit, sum);
        true
    }

    /// Interpolates the sums at a block's sixteen points to all of its points. Their fourth components, and `more`, are counts,
    /// which the points share.
    fn interpolate(&mut self, BlockPlace { level, x, y }: BlockPlace, sum: &[Vec4; LANES], more: f32) {
        let edge = EDGES[level];
        let count = (sum.iter().map(|s| s.w).sum::<f32>() + more) / (edge * edge) as f32;
        let weights = &self.context.weights[level];
        for j in 0..edge {
            let rows = weights.at(j);
            let columns: [Vec4; 4] = std::array::from_fn(|i| {
                let value: Vec4 = (0..4).map(|r| rows[r] * sum[4 * r + i]).sum();
                value.truncate().extend(count)
            });
            let start = (y * edge + j) * TILE + x * edge;
            for (i, out) in self.sums[start..start + edge].iter_mut().enumerate() {
                let [a, b, c, d] = *weights.at(i);
                // The weights add up to 1.
                *out += a * columns[0] + b * columns[1] + c * columns[2] + d * columns[3];
            }
        }
    }
}

/// A sample's map, for the sides that receivers lie on, and the receivers relative to the sample.
#[inline(always)]
pub fn map_towards<'a, S: Simd>(
    simd: S,
    maps: &'a VisibilityMaps,
    sample: &PinholeSample,
    receiver: &Receiver<S>,
) -> (VisibilityMap<'a>, V3<S>) {
    let l = receiver.position - splat3(simd, sample.position());
    let dn = -l.dot(splat3(simd, sample.normal()));
    (VisibilityMap::of_receivers(maps, sample, dn), l)
}
