//! The scene's triangles on the GPU, for rays; read by `shaders/shared/rays.wgsl`.

use bytemuck::{Pod, Zeroable};
use wgpu::util::DeviceExt;

use super::pipeline::{entry, seen_by, uniform};
use crate::gpu::GpuError;
use crate::tracing::{SkipList, Tracer};

/// Texels in a row of the texture.
pub(super) const GEOMETRY_ROW: u32 = 2048;

/// The triangles of a scene, and a hierarchy over them.
#[derive(Clone, Debug)]
pub struct Geometry {
    pub(super) texels: wgpu::TextureView,
    pub(super) uniforms: wgpu::Buffer,
}

/// What rays have to know, 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(super) struct RayUniforms {
    pub node_count: u32,
    /// Units per metre.
    pub scale: f32,
    /// Rays start this far off a surface, units.
    pub offset: f32,
    padding: u32,
}

impl Geometry {
    /// Uploads a scene's triangles.
    pub fn upload(device: &wgpu::Device, queue: &wgpu::Queue, tracer: &Tracer) -> Result<Self, GpuError> {
        let limit = device.limits().max_texture_dimension_2d;
        let too_large = || GpuError::TooManyTriangles { limit: most_triangles(limit) };
        let list = tracer.skip_list().ok_or_else(too_large)?;
        if list.texels.len() as u64 > u64::from(GEOMETRY_ROW) * u64::from(limit) {
            return Err(too_large());
        }
        Ok(Self::of_list(device, queue, list))
    }

    /// No triangles.
    pub(super) fn none(device: &wgpu::Device) -> Self {
        let nothing = SkipList { texels: Vec::new(), node_count: 0, scale: 1.0, offset: 0.0 };
        Self::with_texels(device, &device.create_texture(&triangle_texture(1)), &nothing)
    }

    fn of_list(device: &wgpu::Device, queue: &wgpu::Queue, mut list: SkipList) -> Self {
        let rows = (list.texels.len() as u32).div_ceil(GEOMETRY_ROW).max(1);
        list.texels.resize((rows * GEOMETRY_ROW) as usize, [0; 4]);
        let order = wgpu::util::TextureDataOrder::LayerMajor;
        let texels = bytemuck::cast_slice(&list.texels);
        let texture = device.create_texture_with_data(queue, &triangle_texture(rows), order, texels);
        Self::with_texels(device, &texture, &list)
    }

    fn with_texels(device: &wgpu::Device, texture: &wgpu::Texture, list: &SkipList) -> Self {
        let SkipList { node_count, scale, offset, .. } = *list;
        let uniforms = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("ray uniforms"),
            contents: bytemuck::bytes_of(&RayUniforms { node_count, scale, offset, padding: 0 }),
            usage: wgpu::BufferUsages::UNIFORM,
        });
        Self { texels: texture.create_view(&Default::default()), uniforms }
    }
}

fn triangle_texture(rows: u32) -> wgpu::TextureDescriptor<'static> {
    wgpu::TextureDescriptor {
        label: Some("triangles"),
        size: wgpu::Extent3d { width: GEOMETRY_ROW, height: rows, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba32Uint,
        usage: wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    }
}

/// The largest number of triangles: each takes four texels, and its leaf with what is above no more than four.
fn most_triangles(max_texture: u32) -> u64 {
    (u64::from(GEOMETRY_ROW) * u64::from(max_texture) / 8).min(1 << 24)
}

/// A texture of integers.
pub(super) fn integers(binding: u32) -> wgpu::BindGroupLayoutEntry {
    let sample_type = wgpu::TextureSampleType::Uint;
    let view_dimension = wgpu::TextureViewDimension::D2;
    entry(binding, wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false })
}

/// The bindings that rays read.
pub(super) fn ray_entries(stages: wgpu::ShaderStages) -> [wgpu::BindGroupLayoutEntry; 2] {
    [integers(0), uniform(1)].map(|entry| seen_by(stages, entry))
}
