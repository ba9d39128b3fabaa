//! Receivers as a pyramid of blocks: where the points of a block are, which way they face, and whether sixteen of them
//! stand for all.
//!
//! This module must not know samples or light.

use glam::Vec3;

use crate::pinhole::Receivers;

/// Points along the edge of a block of each level.
pub const EDGES: [usize; LEVELS] = [64, 32, 16, 8, 4];
/// Levels of blocks.
pub const LEVELS: usize = 5;
/// The level whose blocks are their own sixteen points.
pub const FINEST: usize = LEVELS - 1;
/// Points along the edge of the largest blocks.
pub const TILE: usize = EDGES[0];

/// How far a point may lie from where its block's sixteen points lead one to expect it, in radii of the block; and a normal.
const SMOOTH_POSITION: f32 = 0.01;
const SMOOTH_NORMAL: f32 = 0.02;

/// What is known of a block.
#[derive(Clone, Copy, Debug, Default)]
pub struct Block {
    /// Middle of its bounds, metres.
    pub centre: Vec3,
    /// No point is farther from the centre, metres.
    pub radius: f32,
    /// Unit mean normal.
    pub normal: Vec3,
    /// No normal is farther from the mean one.
    pub normal_radius: f32,
    /// What its points are like.
    pub kind: Kind,
}

/// What the points of a block are like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// There are none.
    #[default]
    Empty,
    /// They are not one smooth piece of one object.
    Rough,
    /// Positions and normals are what a bicubic through sixteen of them makes of the rest.
    Smooth,
}

/// The bounds from which a block is made.
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

/// Where along an edge of a block of a level its four columns of points are.
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

/// A tile: the largest block and all within it.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Level by level, row by row.
    levels: [Vec<Block>; LEVELS],
}

impl Tile {
    /// A block: row and column among those of its level.
    #[inline]
    pub fn block(&self, level: usize, x: usize, y: usize) -> &Block {
        &self.levels[level][y * (TILE / EDGES[level]) + x]
    }

    /// Looks at the receivers of the tile whose first point is (`left`, `top`).
    pub fn new(receivers: &Receivers, left: usize, top: usize, weights: &[Weights; LEVELS]) -> Self {
        let grid = Grid { receivers, left, top };
        let mut levels: [Vec<Block>; LEVELS] = Default::default();
        let mut extents: Vec<Extent> = Vec::new();
        for level in (0..LEVELS).rev() {
            let count = TILE / EDGES[level];
            let (mut blocks, mut joined) = (Vec::with_capacity(count * count), Vec::with_capacity(count * count));
            for y in 0..count {
                for x in 0..count {
                    let parts = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| (2 * y + j) * 2 * count + 2 * x + i);
                    let (block, extent) = if level == FINEST {
                        grid.finest_block(x, y)
                    } else {
                        let extent = parts.into_iter().map(|k| extents[k]).fold(NOWHERE, Extent::join);
                        let parts = parts.map(|k| levels[level + 1][k]);
                        (grid.block(level, x, y, &parts, &extent, &weights[level]), extent)
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

/// A tile's receivers.
struct Grid<'a> {
    receivers: &'a Receivers,
    left: usize,
    top: usize,
}

impl Grid<'_> {
    fn index(&self, x: usize, y: usize) -> Option<usize> {
        let (x, y) = (self.left + x, self.top + y);
        let inside = x < self.receivers.width as usize && y < self.receivers.height as usize;
        let index = y * self.receivers.width as usize + x;
        (inside && self.receivers.positions[index][3] >= 0.0).then_some(index)
    }

    fn position(&self, index: usize) -> Vec3 {
        Vec3::from_slice(&self.receivers.positions[index])
    }

    fn normal(&self, index: usize) -> Vec3 {
        Vec3::from_slice(&self.receivers.normals[index])
    }

    fn finest_block(&self, x: usize, y: usize) -> (Block, Extent) {
        let indices = (0..16).filter_map(|k| self.index(4 * x + k % 4, 4 * y + k / 4));
        let extent = indices.clone().fold(NOWHERE, |extent, k| {
            let p = self.position(k);
            extent.join(Extent { low: p, high: p, normal: self.normal(k) })
        });
        let Some(first) = indices.clone().next() else { return (Block::default(), extent) };
        let normal = extent.normal.try_normalize().unwrap_or(Vec3::Y);
        let normal_radius = indices.clone().map(|k| self.normal(k).distance(normal)).fold(0.0, f32::max);
        let of_one_object =
            indices.clone().all(|k| self.receivers.positions[k][3] == self.receivers.positions[first][3]);
        let kind = if of_one_object && indices.count() == 16 { Kind::Smooth } else { Kind::Rough };
        (block(&extent, normal, normal_radius, kind), extent)
    }

    fn block(&self, level: usize, x: usize, y: usize, parts: &[Block; 4], extent: &Extent, weights: &Weights) -> Block {
        if parts.iter().all(|part| part.kind == Kind::Empty) {
            return Block::default();
        }
        let normal = extent.normal.try_normalize().unwrap_or(Vec3::Y);
        let farthest = |part: &Block| part.normal.distance(normal) + part.normal_radius;
        let filled = parts.iter().filter(|part| part.kind != Kind::Empty);
        let normal_radius = filled.map(farthest).fold(0.0, f32::max);
        let mut block = block(extent, normal, normal_radius, Kind::Rough);
        let all_smooth = parts.iter().all(|part| part.kind == Kind::Smooth);
        if all_smooth && self.is_bicubic(level, x, y, &block, weights) {
            block.kind = Kind::Smooth;
        }
        block
    }

    /// Whether a bicubic through sixteen points of a block leads to others of it, eight by eight; that there is nothing
    /// else between them its parts know.
    fn is_bicubic(&self, level: usize, x: usize, y: usize, block: &Block, weights: &Weights) -> bool {
        let edge = EDGES[level];
        let index = |i: usize, j: usize| self.index(x * edge + i, y * edge + j).expect("smooth blocks are full");
        let at = points_along(level);
        let object = self.receivers.positions[index(0, 0)][3];
        let points: [[usize; 4]; 4] = at.map(|j| at.map(|i| index(i, j)));
        let tolerance = SMOOTH_POSITION * block.radius;
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
                if self.receivers.positions[k][3] != object
                    || self.position(k).distance(position) > tolerance
                    || self.normal(k).distance(normal) > SMOOTH_NORMAL
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
    Block { centre, radius: extent.high.distance(centre), normal, normal_radius, kind }
}

/// All tiles of a grid of receivers, row by row: the first point of each.
pub fn tiles(receivers: &Receivers) -> Vec<(usize, usize)> {
    let (width, height) = (receivers.width as usize, receivers.height as usize);
    (0..height).step_by(TILE).flat_map(|top| (0..width).step_by(TILE).map(move |left| (left, top))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights() -> [Weights; LEVELS] {
        std::array::from_fn(Weights::new)
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
    fn a_cubic_is_met_everywhere() {
        for level in 0..LEVELS {
            let weights = Weights::new(level);
            let cubic = |x: f32| 1.0 + x * (0.5 - x * (0.02 - 0.003 * x));
            let at = points_along(level).map(|p| cubic(p as f32));
            for x in 0..EDGES[level] {
                let sum: f32 = weights.at(x).iter().zip(at).map(|(w, v)| w * v).sum();
                assert!((sum - cubic(x as f32)).abs() < 1e-3 * cubic(x as f32).abs() + 1e-4);
            }
        }
    }

    #[test]
    fn planes_are_smooth_steps_and_seams_are_not() {
        let tile = Tile::new(&grid(64, |p| Some((p, Vec3::Y, 0))), 0, 0, &weights());
        assert_eq!(tile.block(0, 0, 0).kind, Kind::Smooth);
        assert!((tile.block(0, 0, 0).radius - 0.5 * 2f32.sqrt()).abs() < 0.02);

        let step = |p: Vec3| Some((p.with_y(if p.x > 0.4 { 0.1 } else { 0.0 }), Vec3::Y, 0));
        let seam = |p: Vec3| Some((p, Vec3::Y, u32::from(p.x > 0.4)));
        let hole = |p: Vec3| (p.distance(Vec3::new(0.4, 0.0, 0.4)) > 0.02).then_some((p, Vec3::Y, 0));
        for receivers in [grid(64, step), grid(64, seam), grid(64, hole)] {
            let tile = Tile::new(&receivers, 0, 0, &weights());
            assert_eq!(tile.block(0, 0, 0).kind, Kind::Rough);
            assert_eq!(tile.block(1, 1, 1).kind, Kind::Smooth);
        }
        let part = Tile::new(&grid(40, |p| Some((p, Vec3::Y, 0))), 0, 0, &weights());
        assert_eq!([part.block(0, 0, 0).kind, part.block(1, 0, 0).kind], [Kind::Rough, Kind::Smooth]);
        assert_eq!(part.block(2, 3, 3).kind, Kind::Empty);
    }
}
