//! What the passes work on: a batch of tiles at a time, in buffers that the next batch uses again.

use super::layout::{self, BLOCK_BYTES, BLOCK_LEVELS, BLOCKS_PER_TILE, TilePass};
use super::{DYNAMIC_OFFSET, HierarchicalInputs, PARTIAL_SUM_BYTES, Tiling, uniform_buffer};
use crate::gpu::buffer_with;
use crate::pinhole::constants::INTERPOLATION_POINTS;

/// What a batch of tiles works on; the next one uses it again.
pub(super) struct TileBatch {
    passes: wgpu::Buffer,
    pub lists: wgpu::Buffer,
    pub blocks: wgpu::Buffer,
    pub interpolated_part: wgpu::TextureView,
    pub partial_sums: wgpu::Buffer,
    pub tolerance: wgpu::Buffer,
}

impl TileBatch {
    pub fn new(device: &wgpu::Device, inputs: &HierarchicalInputs, tiling: &Tiling) -> Self {
        let blocks = u64::from(tiling.per_batch * BLOCKS_PER_TILE);
        let empty = |label, size| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let interpolated_part = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("sums at blocks' points"),
            size: wgpu::Extent3d {
                width: BLOCKS_PER_TILE * INTERPOLATION_POINTS,
                height: tiling.per_batch,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING,
            view_formats: &[],
        });
        let tolerance = buffer_with(
            device,
            "tolerance",
            bytemuck::bytes_of(&layout::Tolerance::from(inputs.tolerance)),
            wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_SRC,
        );
        Self {
            passes: uniform_buffer(device, "tile passes", &tile_passes(tiling)),
            lists: empty("lists of cells", tiling.list_bytes(inputs.tree)),
            blocks: empty("blocks of receivers", blocks * BLOCK_BYTES),
            interpolated_part: interpolated_part.create_view(&Default::default()),
            partial_sums: empty("partial sums of the irradiance estimate", PARTIAL_SUM_BYTES),
            tolerance,
        }
    }

    /// The window on the passes' uniforms.
    pub fn tile_pass(&self) -> wgpu::BindingResource<'_> {
        let size = std::num::NonZero::new(size_of::<TilePass>() as u64);
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &self.passes, offset: 0, size })
    }
}

/// The uniforms of all batches' passes: level by level, then split by split.
fn tile_passes(tiling: &Tiling) -> Vec<u8> {
    let split_count = tiling.split_passes;
    let mut bytes = Vec::new();
    for first_tile in (0..tiling.count()).step_by(tiling.per_batch as usize) {
        let of_levels = (0..BLOCK_LEVELS).map(|level| TilePass { first_tile, level, split: 0, split_count });
        let of_splits = (0..split_count).map(|split| TilePass { first_tile, level: BLOCK_LEVELS, split, split_count });
        for pass in of_levels.chain(of_splits) {
            bytes.extend_from_slice(bytemuck::bytes_of(&pass));
            bytes.resize(bytes.len().next_multiple_of(DYNAMIC_OFFSET as usize), 0);
        }
    }
    bytes
}
