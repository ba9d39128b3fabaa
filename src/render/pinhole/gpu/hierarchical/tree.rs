//! A cell tree, with what its samples see, on the GPU.

use super::super::maps::{MapTracing, VisibilityMapBuffers};
use super::super::storage_buffer;
use super::layout::SampleNode;
use crate::gpu::{GpuError, buffer_with};
use crate::pinhole::{CellShapes, PinholeSample, PinholeTree};

/// The buffers of a tree. They serve any number of images.
#[derive(Clone, Debug)]
pub struct CellTreeBuffers {
    pub(super) nodes: wgpu::Buffer,
    pub(super) sample_nodes: wgpu::Buffer,
    pub(super) curves: wgpu::Buffer,
    /// The items that a traversal begins with; copied to where the lists are.
    pub(super) roots: wgpu::Buffer,
    pub(super) root_count: u32,
    pub(super) sample_count: u32,
    pub(super) first_cluster: u32,
    /// m².
    pub(super) area: f32,
    pub(super) shapes: CellShapes,
    /// Whether any of its cells is on an interface between two media.
    pub(super) refracts: bool,
    /// `None`: nothing is occluded.
    pub(super) maps: Option<VisibilityMapBuffers>,
}

impl CellTreeBuffers {
    /// Uploads a tree: 64 bytes a node, and the visibility maps of its samples if they were traced on the CPU.
    pub fn upload(device: &wgpu::Device, tree: &PinholeTree) -> Result<Self, GpuError> {
        let nodes = tree.sample_nodes();
        let maps = nodes.visibility.as_ref().map(|maps| VisibilityMapBuffers::upload(device, maps)).transpose()?;
        Self::with_maps(device, tree, &nodes.samples, maps)
    }

    /// Uploads a tree whose maps were traced on the GPU.
    pub fn with_traced_maps(device: &wgpu::Device, tree: &PinholeTree, traced: MapTracing) -> Result<Self, GpuError> {
        let (samples, maps) = traced.finish();
        Self::with_maps(device, tree, &samples, Some(maps))
    }

    /// `samples` are those of the tree, with the numbers of their maps.
    pub(crate) fn with_maps(
        device: &wgpu::Device,
        tree: &PinholeTree,
        samples: &[PinholeSample],
        maps: Option<VisibilityMapBuffers>,
    ) -> Result<Self, GpuError> {
        let cells = tree.tree();
        let limit = device.limits().max_storage_buffer_binding_size.min(device.limits().max_buffer_size);
        let bytes = size_of_val(cells.nodes()) as u64;
        if bytes > limit {
            return Err(GpuError::TreeTooLarge { cells: cells.nodes().len(), bytes, limit });
        }
        let buffer = |label, contents: &[u8]| storage_buffer(device, label, contents);
        Ok(Self {
            nodes: buffer("cells", bytemuck::cast_slice(cells.nodes())),
            sample_nodes: buffer("sample nodes", bytemuck::cast_slice(&SampleNode::of_tree(tree, samples))),
            curves: buffer("reflectance curves", bytemuck::cast_slice(&tree.sample_nodes().curves)),
            roots: buffer_with(
                device,
                "nodes without a parent",
                bytemuck::cast_slice(tree.roots()),
                wgpu::BufferUsages::COPY_SRC,
            ),
            root_count: tree.roots().len() as u32,
            sample_count: samples.len() as u32,
            first_cluster: cells.first_cluster(),
            area: cells.area(),
            shapes: tree.sample_nodes().shapes,
            refracts: tree.refracts(),
            maps,
        })
    }
}
