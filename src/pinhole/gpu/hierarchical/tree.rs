//! A cell tree, with what its roots see, on the GPU.

use wgpu::util::DeviceExt;

use super::super::storage_buffer;
use super::layout::CellRoot;
use crate::gpu::GpuError;
use crate::pinhole::PinholeTree;

/// The buffers of a tree. They serve any number of images.
#[derive(Clone, Debug)]
pub struct CellTreeBuffers {
    pub(super) nodes: wgpu::Buffer,
    pub(super) roots: wgpu::Buffer,
    pub(super) curves: wgpu::Buffer,
    pub(super) planes: wgpu::Buffer,
    pub(super) open: wgpu::Buffer,
    /// Indices of the nodes above all others; copied to where the lists are.
    pub(super) tops: wgpu::Buffer,
    pub(super) top_count: u32,
    pub(super) root_count: u32,
    pub(super) first_above: u32,
    /// m².
    pub(super) area: f32,
    /// Texels along the edge of a map of visibility; `None`: there are no maps.
    pub(super) map_resolution: Option<u32>,
}

impl CellTreeBuffers {
    /// Uploads a tree: 64 bytes a node, and the maps of its roots if there are any.
    pub fn upload(device: &wgpu::Device, tree: &PinholeTree) -> Result<Self, GpuError> {
        let (cells, roots) = (tree.tree(), tree.roots());
        let most = device.limits().max_storage_buffer_binding_size.min(device.limits().max_buffer_size);
        let bytes = size_of_val(cells.nodes()) as u64;
        if bytes > most {
            return Err(GpuError::TreeTooLarge { cells: cells.nodes().len(), bytes, limit: most });
        }
        let (planes, open): (&[[f32; 4]], &[u32]) =
            roots.visibility.as_ref().map_or((&[], &[]), |maps| (&maps.planes, &maps.open));
        let bytes = size_of_val(planes) as u64;
        if bytes > most {
            return Err(GpuError::MapsTooLarge { samples: roots.samples.len(), bytes, limit: most });
        }
        let buffer = |label, contents: &[u8]| storage_buffer(device, label, contents);
        Ok(Self {
            nodes: buffer("cells", bytemuck::cast_slice(cells.nodes())),
            roots: buffer("roots of cells", bytemuck::cast_slice(&CellRoot::of_tree(tree))),
            curves: buffer("reflectance curves", bytemuck::cast_slice(&roots.curves)),
            planes: buffer("planes seen", bytemuck::cast_slice(planes)),
            open: buffer("environment seen", bytemuck::cast_slice(open)),
            tops: device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("top cells"),
                contents: bytemuck::cast_slice(cells.tops()),
                usage: wgpu::BufferUsages::COPY_SRC,
            }),
            top_count: cells.tops().len() as u32,
            root_count: roots.samples.len() as u32,
            first_above: cells.first_above(),
            area: cells.area(),
            map_resolution: roots.visibility.as_ref().map(|maps| maps.resolution),
        })
    }
}
