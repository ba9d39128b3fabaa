//! A cell tree, with what its samples see, on the GPU.

use wgpu::util::DeviceExt;

use super::super::storage_buffer;
use super::layout::SampleNode;
use crate::gpu::GpuError;
use crate::pinhole::PinholeTree;

/// The buffers of a tree. They serve any number of images.
#[derive(Clone, Debug)]
pub struct CellTreeBuffers {
    pub(super) nodes: wgpu::Buffer,
    pub(super) sample_nodes: wgpu::Buffer,
    pub(super) curves: wgpu::Buffer,
    pub(super) planes: wgpu::Buffer,
    pub(super) sky_masks: wgpu::Buffer,
    /// Indices of the nodes without a parent; copied to where the lists are.
    pub(super) roots: wgpu::Buffer,
    pub(super) root_count: u32,
    pub(super) sample_count: u32,
    pub(super) first_cluster: u32,
    /// m².
    pub(super) area: f32,
    /// Texels along the edge of a visibility map; `None`: there are no maps.
    pub(super) map_resolution: Option<u32>,
}

impl CellTreeBuffers {
    /// Uploads a tree: 64 bytes a node, and the visibility maps of its samples if there are any.
    pub fn upload(device: &wgpu::Device, tree: &PinholeTree) -> Result<Self, GpuError> {
        let (cells, samples) = (tree.tree(), tree.sample_nodes());
        let limit = device.limits().max_storage_buffer_binding_size.min(device.limits().max_buffer_size);
        let bytes = size_of_val(cells.nodes()) as u64;
        if bytes > limit {
            return Err(GpuError::TreeTooLarge { cells: cells.nodes().len(), bytes, limit });
        }
        let (planes, sky_masks): (&[[f32; 4]], &[u32]) =
            samples.visibility.as_ref().map_or((&[], &[]), |maps| (&maps.planes, &maps.sky_mask));
        let bytes = size_of_val(planes) as u64;
        if bytes > limit {
            return Err(GpuError::MapsTooLarge { samples: samples.samples.len(), bytes, limit });
        }
        let buffer = |label, contents: &[u8]| storage_buffer(device, label, contents);
        Ok(Self {
            nodes: buffer("cells", bytemuck::cast_slice(cells.nodes())),
            sample_nodes: buffer("sample nodes", bytemuck::cast_slice(&SampleNode::of_tree(tree))),
            curves: buffer("reflectance curves", bytemuck::cast_slice(&samples.curves)),
            planes: buffer("visible planes", bytemuck::cast_slice(planes)),
            sky_masks: buffer("sky masks", bytemuck::cast_slice(sky_masks)),
            roots: device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("nodes without a parent"),
                contents: bytemuck::cast_slice(cells.roots()),
                usage: wgpu::BufferUsages::COPY_SRC,
            }),
            root_count: cells.roots().len() as u32,
            sample_count: samples.samples.len() as u32,
            first_cluster: cells.first_cluster(),
            area: cells.area(),
            map_resolution: samples.visibility.as_ref().map(|maps| maps.resolution),
        })
    }
}
