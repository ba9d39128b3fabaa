//! One tile: pairs of its blocks with cells, from the largest to the smallest.

use glam::Vec4;

use super::super::lanes::{LANES, Simd, SimdBase, bits, splat, vector};
use super::super::visibility::{Outlook, Surroundings, Unhindered};
use super::super::{Group, Pair, load_at};
use super::blocks::{EDGES, FINEST, Grid, Kind, Tile, points_along};
use super::bounds::{Cell, Judge, Verdict};
use super::{Accuracy, Walked};
use crate::pinhole::PinholeSample;
use crate::pinhole::constants::{FOOTPRINT_RADIUS, NEGLIGIBLE_SHARE, PAIR_ERROR_SHARE};
use crate::pinhole::receivers::TILE;

/// A tile being gathered.
pub struct TileGather<'a> {
    pub scene: &'a Walked<'a>,
    grid: Grid<'a>,
    tile: Tile,
    pub judge: Judge<'a>,
    pub accuracy: Accuracy,
    sums: Vec<Vec4>,
    /// Lists of cells, to be used again.
    spare: Vec<Vec<u32>>,
    /// Cells, and for which lanes, to be used again.
    pub pending: Vec<(u32, u32)>,
}

impl<'a> TileGather<'a> {
    pub fn new(scene: &'a Walked<'a>, grid: Grid<'a>, accuracy: Accuracy) -> Self {
        let judge = Judge {
            uniforms: &scene.gather.uniforms,
            light: scene.bounds,
            share: PAIR_ERROR_SHARE * accuracy.error,
            negligible: NEGLIGIBLE_SHARE * accuracy.error / scene.pinholes.tree.area(),
            texel: scene.gather.environment.texel_rad(),
            map_texel: scene.gather.map_texel(),
            has_viewers: grid.receivers().viewers.is_some(),
        };
        let tile = Tile::new(&grid, &scene.weights);
        let sums = vec![Vec4::ZERO; TILE * TILE];
        Self { scene, grid, tile, judge, accuracy, sums, spare: Vec::new(), pending: Vec::new() }
    }

    /// The sums at the tile's points, row by row.
    pub fn into_sums(self) -> Vec<Vec4> {
        self.sums
    }

    /// Gathers the whole tile.
    #[inline(always)]
    pub fn run<S: Simd>(&mut self, simd: S) {
        let tops = self.scene.pinholes.tree.tops();
        self.block(simd, 0, 0, 0, tops);
    }

    /// Gathers what cells bring to a block.
    fn block<S: Simd>(&mut self, simd: S, level: usize, x: usize, y: usize, cells: &[u32]) {
        simd.vectorize(
            #[inline(always)]
            || self.block_in_lanes(simd, level, x, y, cells),
        );
    }

    #[inline(always)]
    fn block_in_lanes<S: Simd>(&mut self, simd: S, level: usize, x: usize, y: usize, cells: &[u32]) {
        let block = *self.tile.block(level, x, y);
        if block.kind == Kind::Empty || cells.is_empty() {
            return;
        }
        let points = self.points(level, x, y);
        let mut sum = [Vec4::ZERO; LANES];
        if level == FINEST {
            self.packet(simd, &points, cells, &mut sum);
            self.spread(level, x, y, &sum, 0.0);
            return;
        }
        let tree = &self.scene.pinholes.tree;
        let mut stack = self.spare.pop().unwrap_or_default();
        let mut deferred = self.spare.pop().unwrap_or_default();
        stack.extend_from_slice(cells);
        let shadowed = self.scene.gather.pinholes.visibility.is_some();
        let mut judged = 0;
        while let Some(index) = stack.pop() {
            let node = tree.node(index);
            let geometry = node.geometry();
            let sample = self.scene.pinholes.sample(node, &geometry);
            let mirror = self.scene.pinholes.mirror(sample.object());
            let cell = Cell {
                geometry: &geometry,
                two_sided: mirror.two_sided,
                reflects: mirror.most,
                lobe: sample.lobe(),
                is_leaf: node.children().is_empty(),
            };
            judged += 1;
            match self.judge.judge(&block, level, &cell) {
                Verdict::Drop => {}
                Verdict::SplitCell => stack.extend(node.children()),
                Verdict::SplitBlock => deferred.push(index),
                // What several roots see together is not known.
                Verdict::Add { .. } if shadowed && tree.is_above_roots(index) => stack.extend(node.children()),
                Verdict::Add { varies, even_if_hidden } => {
                    if !self.add(simd, node.root(), &sample, &points, (varies, even_if_hidden), &mut sum) {
                        deferred.push(index);
                    }
                }
            }
        }
        self.spread(level, x, y, &sum, judged as f32);
        for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            self.block(simd, level + 1, 2 * x + i, 2 * y + j, &deferred);
        }
        for mut list in [stack, deferred] {
            list.clear();
            self.spare.push(list);
        }
    }

    /// The sixteen points of a block.
    fn points(&self, level: usize, x: usize, y: usize) -> Group {
        let (edge, at) = (EDGES[level], points_along(level));
        let place = |lane: usize| self.grid.place(x * edge + at[lane % 4], y * edge + at[lane / 4]);
        load_at(self.grid.receivers(), place)
    }

    /// Adds what a cell brings to sixteen points; `false` if it cannot be interpolated between them.
    #[inline(always)]
    fn add<S: Simd>(
        &self,
        simd: S,
        root: u32,
        sample: &PinholeSample,
        points: &Group,
        (varies, even_if_hidden): (f32, bool),
        sum: &mut [Vec4; LANES],
    ) -> bool {
        let gather = &self.scene.gather;
        let receiver = points.in_lanes(simd);
        let pair = Pair::new(simd, sample, &receiver);
        let lit = bits(pair.cosines.simd_gt(0.0));
        if lit == 0 {
            return true;
        }
        let footprint = pair.footprint(simd, sample);
        let taps = (varies >= self.judge.share).then(|| self.judge.taps(splat(simd, varies)));
        let weight = gather.weight(simd, sample, &pair, &receiver);
        if let Some(maps) = &gather.pinholes.visibility {
            let root = &gather.pinholes.samples[root as usize];
            let sight = Surroundings::new(maps, root, pair.dn);
            match sight.outlook(simd, receiver.position - vector(simd, root.position()), lit) {
                Outlook::Clear => {}
                Outlook::Dark => return true,
                Outlook::Mixed => return false,
            }
            let reach = FOOTPRINT_RADIUS
                * (footprint.v1.dot(footprint.v1) + footprint.v2.dot(footprint.v2)).reduce_max().sqrt();
            match sight.sky(simd, pair.r, reach, lit) {
                Outlook::Clear => {}
                Outlook::Dark => return true,
                Outlook::Mixed if even_if_hidden => {
                    let radiance = gather.cell_radiance(simd, &footprint, sample.lobe() > 0.0, &sight, taps, lit);
                    gather.add(sample, &pair, &receiver, (weight, &radiance, lit), sum);
                    return true;
                }
                Outlook::Mixed => return false,
            }
        }
        let radiance = gather.cell_radiance(simd, &footprint, sample.lobe() > 0.0, &Unhindered, taps, lit);
        gather.add(sample, &pair, &receiver, (weight, &radiance, lit), sum);
        true
    }

    /// Adds sums at a block's sixteen points to all of its points; the fourth component, and `more`, are counts that the
    /// points share.
    fn spread(&mut self, level: usize, x: usize, y: usize, sum: &[Vec4; LANES], more: f32) {
        let edge = EDGES[level];
        let count = (sum.iter().map(|s| s.w).sum::<f32>() + more) / (edge * edge) as f32;
        let weights = &self.scene.weights[level];
        for j in 0..edge {
            let rows = weights.at(j);
            let columns: [Vec4; 4] = std::array::from_fn(|i| {
                let value: Vec4 = (0..4).map(|r| rows[r] * sum[4 * r + i]).sum();
                value.truncate().extend(count)
            });
            let start = (y * edge + j) * TILE + x * edge;
            for (i, out) in self.sums[start..start + edge].iter_mut().enumerate() {
                let [a, b, c, d] = *weights.at(i);
                // The weights' sum is 1.
                *out += a * columns[0] + b * columns[1] + c * columns[2] + d * columns[3];
            }
        }
    }
}
