//! Receivers as a pyramid of blocks: where the points of a block lie, which way they face, and whether sixteen of them
//! represent all.
//!
//! This module must not know samples or light.

use glam::Vec3;

use crate::pinhole::constants::{SMOOTH_NORMAL_TOLERANCE, SMOOTH_POSITION_TOLERANCE};
use crate::pinhole::receivers::{TILE, along_z_curve};
use crate::pinhole::{ReceiverLayout, Receivers};

/// Points along the edge of a block of each level.
pub const EDGES: [usize; LEVELS] = [TILE, 32, 16, 8, 4];
/// Levels of blocks.
pub const LEVELS: usize = 5;
/// The level whose blocks are their own sixteen points.
pub const FINEST: usize = LEVELS - 1;

/// Bounds of a block's points.
#[derive(Clone, Copy, Debug, Default)]
pub struct Block {
    /// Centre of its bounding box, metres.
    pub centre: Vec3,
    /// No point is farther from the centre, metres.
    pub radius: f32,
    /// Unit mean normal.
    pub normal: Vec3,
    /// No normal is farther from the mean one.
    pub normal_radius: f32,
    /// What its points are like.
    pub kind: Kind,
    /// Error that may be made at all of its points beyond the accuracy of the sum, W/m².
    pub tolerated: f32,
}

/// What the points of a block are like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// There are no points.
    #[default]
    Empty,
    /// They are not on one smooth piece of one object.
    Rough,
    /// A bicubic through sixteen of them predicts the positions and normals of the rest.
    Smooth,
}

/// A bounding box, and the sum of the normals.
#[derive(Clone, Copy)]
struct Extent {
    low: Vec3,
    high: Vec3,
    normal: Vec3,
}

const NOWHERE: Extent = Extent { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY, normal: Vec3::ZERO };

impl Extent {
    fn join(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high), normal: self.normal + other.normal }
    }
}

/// Places along an edge of its four columns of interpolation points, for a block of a level.
pub const fn points_along(level: usize) -> [usize; 4] {
    let last = EDGES[level] - 1;
    [0, last / 3, last - last / 3, last]
}

/// Weights of four columns for every place along an edge: Lagrange's cubic through them.
#[derive(Clone, Debug)]
pub struct Weights(Vec<[f32; 4]>);

impl Weights {
    /// For the blocks of a level.
    pub fn new(level: usize) -> Self {
        let at = points_along(level).map(|p| p as f32);
        let weight = |x: f32, i: usize| (0..4).filter(|&j| j != i).map(|j| (x - at[j]) / (at[i] - at[j])).product();
        Self((0..EDGES[level]).map(|x| std::array::from_fn(|i| weight(x as f32, i))).collect())
    }

    /// The four weights for a place.
    #[inline]
    pub fn at(&self, place: usize) -> &[f32; 4] {
        &self.0[place]
    }
}

/// The blocks of a tile.
#[derive(Clone, Debug)]
pub struct BlockPyramid {
    /// Level by level, row by row.
    levels: [Vec<Block>; LEVELS],
}

impl BlockPyramid {
    /// A block: row and column among those of its level.
    #[inline]
    pub fn block(&self, level: usize, x: usize, y: usize) -> &Block {
        &self.levels[level][y * (TILE / EDGES[level]) + x]
    }

    /// Bounds the receivers of a tile.
    pub fn new(tile: &ReceiverTile, weights: &[Weights; LEVELS]) -> Self {
        let mut levels: [Vec<Block>; LEVELS] = Default::default();
        let mut extents: Vec<Extent> = Vec::new();
        for level in (0..LEVELS).rev() {
            let count = TILE / EDGES[level];
            let (mut blocks, mut joined) = (Vec::with_capacity(count * count), Vec::with_capacity(count * count));
            for y in 0..count {
                for x in 0..count {
                    let parts = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| (2 * y + j) * 2 * count + 2 * x + i);
                    let (block, extent) = if level == FINEST {
                        tile.finest_block(x, y)
                    } else {
                        let extent = parts.into_iter().map(|k| extents[k]).fold(NOWHERE, Extent::join);
                        let parts = parts.map(|k| levels[level + 1][k]);
                        (tile.block(level, x, y, &parts, &extent, &weights[level]), extent)
                    };
                    blocks.push(block);
                    joined.push(extent);
                }
            }
            (levels[level], extents) = (blocks, joined);
        }
        Self { levels }
    }
}

/// A tile of 64² receivers.
#[derive(Clone, Copy, Debug)]
pub struct ReceiverTile<'a> {
    receivers: &'a Receivers,
    /// Index of the tile: row by row in a grid, else in order.
    tile: usize,
}

impl<'a> ReceiverTile<'a> {
    /// All tiles of a set of receivers.
    pub fn all(receivers: &'a Receivers) -> impl Iterator<Item = Self> {
        let count = match receivers.layout {
            ReceiverLayout::Grid => {
                (receivers.width as usize).div_ceil(TILE) * (receivers.height as usize).div_ceil(TILE)
            }
            ReceiverLayout::Unordered => receivers.positions.len().div_ceil(TILE * TILE),
        };
        (0..count).map(move |tile| Self { receivers, tile })
    }

    /// The index in the set of a point of the tile; `None` outside the set.
    #[inline]
    pub fn place(&self, x: usize, y: usize) -> Option<usize> {
        let Receivers { width, height, layout, positions, .. } = self.receivers;
        match layout {
            ReceiverLayout::Grid => {
                let columns = (*width as usize).div_ceil(TILE);
                let (x, y) = (self.tile % columns * TILE + x, self.tile / columns * TILE + y);
                (x < *width as usize && y < *height as usize).then_some(y * *width as usize + x)
            }
            ReceiverLayout::Unordered => {
                let place = self.tile * TILE * TILE + along_z_curve(x, y);
                (place < positions.len()).then_some(place)
            }
        }
    }

    /// The indices of all points, row by row.
    pub fn places(&self) -> impl Iterator<Item = Option<usize>> {
        (0..TILE * TILE).map(|k| self.place(k % TILE, k / TILE))
    }

    /// Number of indices in the set.
    pub fn count(&self) -> usize {
        self.places().flatten().count()
    }

    /// The set.
    pub fn receivers(&self) -> &'a Receivers {
        self.receivers
    }

    fn index(&self, x: usize, y: usize) -> Option<usize> {
        self.place(x, y).filter(|&place| self.receivers.object(place).is_some())
    }

    fn position(&self, index: usize) -> Vec3 {
        Vec3::from_slice(&self.receivers.positions[index])
    }

    fn normal(&self, index: usize) -> Vec3 {
        Vec3::from_slice(&self.receivers.normals[index])
    }

    /// From the middle of a part of a ray to its end.
    fn half_part(&self, index: usize) -> Vec3 {
        let lengths = self.receivers.lengths.as_ref();
        lengths.map_or(Vec3::ZERO, |lengths| 0.5 * lengths[index] * self.normal(index))
    }

    fn finest_block(&self, x: usize, y: usize) -> (Block, Extent) {
        let indices = (0..16).filter_map(|k| self.index(4 * x + k % 4, 4 * y + k / 4));
        let extent = indices.clone().fold(NOWHERE, |extent, k| {
            let (p, half) = (self.position(k), self.half_part(k).abs());
            extent.join(Extent { low: p - half, high: p + half, normal: self.normal(k) })
        });
        let Some(first) = indices.clone().next() else { return (Block::default(), extent) };
        let normal = extent.normal.try_normalize().unwrap_or(Vec3::Y);
        let normal_radius = indices.clone().map(|k| self.normal(k).distance(normal)).fold(0.0, f32::max);
        let object = self.receivers.object(first);
        let of_one_object = indices.clone().all(|k| self.receivers.object(k) == object);
        let kind = if of_one_object && indices.clone().count() == 16 { Kind::Smooth } else { Kind::Rough };
        let mut block = block(&extent, normal, normal_radius, kind);
        block.tolerated = indices.map(|k| self.receivers.normals[k][3]).fold(f32::INFINITY, f32::min);
        (block, extent)
    }

    fn block(&self, level: usize, x: usize, y: usize, parts: &[Block; 4], extent: &Extent, weights: &Weights) -> Block {
        if parts.iter().all(|part| part.kind == Kind::Empty) {
            return Block::default();
        }
        let normal = extent.normal.try_normalize().unwrap_or(Vec3::Y);
        let farthest = |part: &Block| part.normal.distance(normal) + part.normal_radius;
        let filled = parts.iter().filter(|part| part.kind != Kind::Empty);
        let normal_radius = filled.clone().map(farthest).fold(0.0, f32::max);
        let mut block = block(extent, normal, normal_radius, Kind::Rough);
        block.tolerated = filled.map(|part| part.tolerated).fold(f32::INFINITY, f32::min);
        let all_smooth = parts.iter().all(|part| part.kind == Kind::Smooth);
        if all_smooth && self.is_bicubic(level, x, y, &block, weights) {
            block.kind = Kind::Smooth;
        }
        block
    }

    /// Whether a bicubic through sixteen points of a block predicts others of it, eight by eight. Its parts, which are smooth,
    /// account for the points between those.
    fn is_bicubic(&self, level: usize, x: usize, y: usize, block: &Block, weights: &Weights) -> bool {
        // Radiance towards viewers does not change as smoothly as their directions.
        if self.receivers.layout == ReceiverLayout::Unordered || self.receivers.view_directions.is_some() {
            return false;
        }
        let edge = EDGES[level];
        let index = |i: usize, j: usize| self.index(x * edge + i, y * edge + j).expect("smooth blocks are full");
        let at = points_along(level);
        let object = self.receivers.object(index(0, 0));
        let points: [[usize; 4]; 4] = at.map(|j| at.map(|i| index(i, j)));
        let tolerance = SMOOTH_POSITION_TOLERANCE * block.radius;
        for j in (edge / 16..edge).step_by(edge / 8) {
            let rows = weights.at(j);
            let column = |i: usize| {
                let sum = |of: &dyn Fn(usize) -> Vec3| (0..4).map(|r| rows[r] * of(points[r][i])).sum::<Vec3>();
                (sum(&|k| self.position(k)), sum(&|k| self.normal(k)))
            };
            let columns: [(Vec3, Vec3); 4] = std::array::from_fn(column);
            for i in (edge / 16..edge).step_by(edge / 8) {
                let weights = weights.at(i);
                let position: Vec3 = (0..4).map(|c| weights[c] * columns[c].0).sum();
                let normal: Vec3 = (0..4).map(|c| weights[c] * columns[c].1).sum();
                let k = index(i, j);
                if self.receivers.object(k) != object
                    || self.position(k).distance(position) > tolerance
                    || self.normal(k).distance(normal) > SMOOTH_NORMAL_TOLERANCE
                {
                    return false;
                }
            }
        }
        true
    }
}

fn block(extent: &Extent, normal: Vec3, normal_radius: f32, kind: Kind) -> Block {
    let centre = 0.5 * (extent.low + extent.high);
    Block { centre, radius: extent.high.distance(centre), normal, normal_radius, kind, tolerated: 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blocks_of(receivers: &Receivers) -> BlockPyramid {
        BlockPyramid::new(&ReceiverTile::all(receivers).next().unwrap(), &std::array::from_fn(Weights::new))
    }

    fn grid(size: u32, point: impl Fn(Vec3) -> Option<(Vec3, Vec3, u32)>) -> Receivers {
        let mut receivers = Receivers::empty(size, size);
        for k in 0..size * size {
            let at = Vec3::new((k % size) as f32, 0.0, (k / size) as f32) / size as f32;
            if let Some((position, normal, object)) = point(at) {
                receivers.set(k as usize, position, normal, object);
            }
        }
        receivers
    }

    #[test]
    fn weights_reproduce_cubics() {
        for (level, edge) in EDGES.into_iter().enumerate() {
            let weights = Weights::new(level);
            let cubic = |x: f32| 1.0 + x * (0.5 - x * (0.02 - 0.003 * x));
            let at = points_along(level).map(|p| cubic(p as f32));
            for x in 0..edge {
                let sum: f32 = weights.at(x).iter().zip(at).map(|(w, v)| w * v).sum();
                assert!((sum - cubic(x as f32)).abs() < 1e-3 * cubic(x as f32).abs() + 1e-4);
            }
        }
    }

    #[test]
    fn planes_are_smooth_steps_and_seams_are_not() {
        let tile = blocks_of(&grid(64, |p| Some((p, Vec3::Y, 0))));
        assert_eq!(tile.block(0, 0, 0).kind, Kind::Smooth);
        assert!((tile.block(0, 0, 0).radius - 0.5 * 2f32.sqrt()).abs() < 0.02);

        let step = |p: Vec3| Some((p.with_y(if p.x > 0.4 { 0.1 } else { 0.0 }), Vec3::Y, 0));
        let seam = |p: Vec3| Some((p, Vec3::Y, u32::from(p.x > 0.4)));
        let hole = |p: Vec3| (p.distance(Vec3::new(0.4, 0.0, 0.4)) > 0.02).then_some((p, Vec3::Y, 0));
        for receivers in [grid(64, step), grid(64, seam), grid(64, hole)] {
            let tile = blocks_of(&receivers);
            assert_eq!(tile.block(0, 0, 0).kind, Kind::Rough);
            assert_eq!(tile.block(1, 1, 1).kind, Kind::Smooth);
        }
        let part = blocks_of(&grid(40, |p| Some((p, Vec3::Y, 0))));
        assert_eq!([part.block(0, 0, 0).kind, part.block(1, 0, 0).kind], [Kind::Rough, Kind::Smooth]);
        assert_eq!(part.block(2, 3, 3).kind, Kind::Empty);
    }

    #[test]
    fn tiles_cover_grids_and_unordered_sets() {
        let mut list = grid(100, |p| Some((p, Vec3::Y, 0)));
        for layout in [ReceiverLayout::Grid, ReceiverLayout::Unordered] {
            list.layout = layout;
            let mut seen = vec![0; 100 * 100];
            for tile in ReceiverTile::all(&list) {
                (0..TILE * TILE).filter_map(|k| tile.place(k % TILE, k / TILE)).for_each(|place| seen[place] += 1);
            }
            assert!(seen.iter().all(|&count| count == 1), "{layout:?}");
        }
        let first = ReceiverTile::all(&list).next().unwrap();
        let mut block: Vec<usize> = (0..16).map(|k| first.place(4 + k % 4, k / 4).unwrap()).collect();
        block.sort_unstable();
        assert_eq!(block, (16..32).collect::<Vec<_>>());
    }
}
