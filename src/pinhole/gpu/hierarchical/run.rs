//! What the passes work on: a run of tiles at a time, in buffers that the next run uses again.

use wgpu::util::DeviceExt;

use super::layout::{BLOCK_BYTES, BLOCKS, LEVELS, POINTS, Stage};
use super::{HierarchicalInputs, REPORT_BYTES, STAGE_STRIDE, Tolerance, uniform_buffer};

/// What a run of tiles works on; the next one uses it again.
pub(super) struct Run {
    stages: wgpu::Buffer,
    pub lists: wgpu::Buffer,
    pub blocks: wgpu::Buffer,
    pub smooth: wgpu::TextureView,
    pub reports: wgpu::Buffer,
    pub tolerance: wgpu::Buffer,
}

impl Run {
    pub fn new(
        device: &wgpu::Device,
        inputs: &HierarchicalInputs,
        tiles: u32,
        per_run: u32,
        bytes_per_tile: u64,
    ) -> Self {
        let blocks = u64::from(per_run * BLOCKS);
        let empty = |label, size| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let smooth = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("sums at blocks' points"),
            size: wgpu::Extent3d { width: BLOCKS * POINTS, height: per_run, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING,
            view_formats: &[],
        });
        let (Tolerance::Absolute(error) | Tolerance::Relative(error)) = inputs.tolerance;
        let tolerance = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("tolerance"),
            // Allowed at a point, and as a part of what is typical: one of them is not read.
            contents: bytemuck::cast_slice(&[error; 8]),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::UNIFORM,
        });
        Self {
            stages: uniform_buffer(device, "stages", &stages(tiles, per_run, inputs.parts.max(1))),
            lists: empty("lists of cells", u64::from(inputs.tree.top_count) * 4 + bytes_per_tile * u64::from(per_run)),
            blocks: empty("blocks of receivers", blocks * BLOCK_BYTES),
            smooth: smooth.create_view(&Default::default()),
            reports: empty("scouts' reports", REPORT_BYTES),
            tolerance,
        }
    }

    /// The window on the stages.
    pub fn stage(&self) -> wgpu::BindingResource<'_> {
        let size = std::num::NonZero::new(size_of::<Stage>() as u64);
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &self.stages, offset: 0, size })
    }

    /// The error that is allowed, as a uniform.
    pub fn allowed(&self) -> wgpu::BindingResource<'_> {
        let size = std::num::NonZero::new(16);
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &self.tolerance, offset: 0, size })
    }
}

/// The stages of all runs: level by level, then part by part.
fn stages(tiles: u32, per_run: u32, parts: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    for first_tile in (0..tiles).step_by(per_run as usize) {
        let of_levels = (0..LEVELS).map(|level| Stage { first_tile, level, part: 0, parts });
        let of_parts = (0..parts).map(|part| Stage { first_tile, level: LEVELS, part, parts });
        for stage in of_levels.chain(of_parts) {
            bytes.extend_from_slice(bytemuck::bytes_of(&stage));
            bytes.resize(bytes.len().next_multiple_of(STAGE_STRIDE as usize), 0);
        }
    }
    bytes
}
