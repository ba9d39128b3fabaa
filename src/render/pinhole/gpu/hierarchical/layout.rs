//! What the passes of the hierarchical gather read, byte for byte as in `shaders/shared/cell_tree.wgsl` and
//! `receiver_tiles.wgsl`.

use bytemuck::{Pod, Zeroable};

use crate::cell_tree::MAX_LEAVES;
use crate::pinhole::{PinholeSample, PinholeTree};
use crate::sampling::MAX_SAMPLES;

/// Levels of blocks within a tile.
pub const BLOCK_LEVELS: u32 = 4;
/// Blocks of all levels within a tile.
pub const BLOCKS_PER_TILE: u32 = (4u32.pow(BLOCK_LEVELS) - 1) / 3;
/// Bytes of a block, which only shaders write and read.
pub const BLOCK_BYTES: u64 = 48;
/// Invocations of a workgroup.
pub const WORKGROUP_SIZE: u32 = 64;
/// Workgroups of an irradiance estimate: each receiver it asks is an invocation.
pub const ESTIMATE_WORKGROUPS: u32 = 64;
/// Invocations along an edge of the workgroups that compute bounds of the light.
pub const BOUNDS_WORKGROUP_EDGE: u32 = 8;
/// Levels of a tree that a traversal keeps track of.
pub const MAX_TREE_DEPTH: u32 = 20;
const _: () = {
    let (above, below) = (MAX_SAMPLES.ilog2().div_ceil(2), MAX_LEAVES.ilog2().div_ceil(2));
    assert!(above + below < MAX_TREE_DEPTH, "the deepest tree has more levels than a traversal keeps track of");
};

/// What the cells of a sample have in common, 80 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(in crate::pinhole::gpu) struct SampleNode {
    /// World position of the sample's own cell, metres.
    pub position: [f32; 3],
    /// Width of the mirror's lobe, radians.
    pub lobe: f32,
    /// Unit normal.
    pub normal: [f32; 3],
    /// Sixteen times the object's index in the scene, plus flags as in [`PinholeSample`].
    pub object_flags: u32,
    /// Reflectance where there is no curve; of an interface the relative refractive indices of the channels.
    pub reflectance: [f32; 3],
    /// The number of its curve of reflectance, or `NO_CURVE`.
    pub curve: u32,
    /// How far its map's texels are shifted.
    pub texel_jitter: [f32; 2],
    /// No channel reflects more.
    pub max_reflectance: f32,
    /// Its first visibility map.
    pub map: u32,
    /// The index of its node.
    pub node: u32,
    /// 1 where the side that its normal points to is the one that the mesh's normals point to, else -1.
    pub face: f32,
    padding: [u32; 2],
}

impl SampleNode {
    /// The sample nodes of a tree, in their order; `samples` are theirs, with the numbers of their maps.
    pub fn of_tree(tree: &PinholeTree, samples: &[PinholeSample]) -> Vec<Self> {
        let node = |(sample, &node): (&PinholeSample, &u32)| {
            let caster = tree.caster(sample.object());
            Self {
                position: sample.position,
                lobe: caster.lobe,
                normal: sample.normal,
                object_flags: sample.object_flags,
                reflectance: caster.interface.map_or(sample.reflectance, |r| r.eta.as_vec3().to_array()),
                curve: sample.curve,
                texel_jitter: sample.texel_jitter().to_array(),
                max_reflectance: caster.max_reflectance,
                map: sample.map,
                node,
                face: if caster.faces_front { 1.0 } else { -1.0 },
                padding: [0; 2],
            }
        };
        samples.iter().zip(tree.tree().sample_nodes()).map(node).collect()
    }
}

/// What is the same for all passes of an image, 56 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(in crate::pinhole::gpu) struct TreeUniforms {
    /// Width and height of the picture.
    pub size: [u32; 2],
    /// Tiles in a row of it.
    pub tiles_across: u32,
    /// Entries of a list of cells.
    pub list_capacity: u32,
    /// Nodes without a parent.
    pub root_count: u32,
    /// Nodes from here on are cluster nodes, or sample nodes among them.
    pub first_cluster: u32,
    /// Number of samples.
    pub sample_count: u32,
    /// 1: sixteen points may stand for a block.
    pub may_interpolate: u32,
    /// 1: leaves are quartered for receivers near to them.
    pub split_near: u32,
    /// 1: receivers reflect to viewers.
    pub has_view_directions: u32,
    /// Area of all cells, m².
    pub area: f32,
    /// 1: rays are traced where visibility maps are in doubt.
    pub traces_rays: u32,
    /// 1: the fourth component of a receiver's normal is an error that may be made there beyond the others, W/m².
    pub has_tolerances: u32,
    /// Unused.
    pub padding: u32,
}

/// The error that is allowed, 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(in crate::pinhole::gpu) struct Tolerance {
    /// At a point, W/m².
    pub error: f32,
    /// As a part of the estimated irradiance, from which the estimate's pass computes the other.
    pub relative_error: f32,
    padding: [u32; 2],
}

impl From<super::Tolerance> for Tolerance {
    fn from(tolerance: super::Tolerance) -> Self {
        match tolerance {
            super::Tolerance::Absolute(error) => Self { error, ..Self::default() },
            super::Tolerance::Relative(relative_error) => Self { relative_error, ..Self::default() },
        }
    }
}

/// Which tiles, and which blocks of theirs, a pass works on.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(in crate::pinhole::gpu) struct TilePass {
    /// The first tile of the batch, row by row over the picture.
    pub first_tile: u32,
    /// The level of blocks, 0 the largest.
    pub level: u32,
    /// Which of the resolve passes it is,
    pub split: u32,
    /// of how many.
    pub split_count: u32,
}
