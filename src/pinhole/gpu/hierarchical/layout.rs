//! What the passes of the hierarchical gather read, byte for byte as in `shaders/shared/hierarchy.wgsl` and `work.wgsl`.

use bytemuck::{Pod, Zeroable};

use crate::pinhole::PinholeTree;

/// Points along the edge of a tile.
pub const TILE: u32 = 64;
/// Levels of blocks within a tile.
pub const LEVELS: u32 = 4;
/// Blocks of all levels within a tile.
pub const BLOCKS: u32 = (4u32.pow(LEVELS) - 1) / 3;
/// Points that stand for a block.
pub const POINTS: u32 = 16;
/// Bytes of what is known of a block.
pub const BLOCK_BYTES: u64 = 48;

/// What the cells of a root have in common, 80 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct CellRoot {
    /// World position of the root's own cell, metres; width of the mirror's lobe, radians.
    pub position_lobe: [f32; 4],
    /// Its normal; ±(object + 1), negative where both sides reflect.
    pub normal_object: [f32; 4],
    /// Reflectance; the number of its curve, from 1, or 0.
    pub reflectance: [f32; 4],
    /// No channel reflects more; how far the map's texels are shifted.
    pub most_phase: [f32; 4],
    /// Its first map of visibility; the index of its node.
    pub map_node: [u32; 4],
}

impl CellRoot {
    /// The roots of a tree, in their order.
    pub fn of_tree(tree: &PinholeTree) -> Vec<Self> {
        let root = |(sample, &node): (&crate::pinhole::PinholeSample, &u32)| {
            let mirror = tree.mirror(sample.object());
            let phase = sample.phase();
            Self {
                position_lobe: sample.position().extend(mirror.lobe).to_array(),
                normal_object: sample.normal_object,
                reflectance: sample.reflectance,
                most_phase: [mirror.most, phase.x, phase.y, 0.0],
                map_node: [sample.map(), node, 0, 0],
            }
        };
        tree.roots().samples.iter().zip(tree.tree().roots()).map(root).collect()
    }
}

/// What is the same for all passes of an image, 48 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct TreeUniforms {
    /// Width and height of the picture.
    pub size: [u32; 2],
    /// Tiles in a row of it.
    pub tiles_across: u32,
    /// Entries of a list of cells.
    pub capacity: u32,
    /// Nodes above all others.
    pub tops: u32,
    /// Nodes from here on are roots or lie above them.
    pub first_above: u32,
    /// Number of roots.
    pub roots: u32,
    /// 1: sixteen points may stand for a block.
    pub may_interpolate: u32,
    /// 1: leaves are quartered for receivers near to them.
    pub split_near: u32,
    /// 1: receivers reflect to viewers.
    pub has_viewers: u32,
    /// Area of all cells, m².
    pub area: f32,
    /// Width of a texel of a map of visibility, radians.
    pub map_texel: f32,
}

/// Which tiles, and which blocks of theirs, a pass works on.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Stage {
    /// The first tile of the run, row by row over the picture.
    pub first_tile: u32,
    /// The level of blocks, 0 the largest.
    pub level: u32,
    /// Which of so many parts of the lists: of the last pass only.
    pub part: u32,
    /// How many parts.
    pub parts: u32,
}
