//! Bounds of the light, as a texture.

use wgpu::util::DeviceExt;

use crate::environment::{FACES, LightBounds};

/// Bounds of an environment's radiance: a texture of six layers with all mips, each texel the most and the contrast around it.
#[derive(Clone, Debug)]
pub struct LightBoundsTexture {
    pub(super) view: wgpu::TextureView,
}

impl LightBoundsTexture {
    /// Uploads bounds that the CPU made.
    pub fn upload(device: &wgpu::Device, queue: &wgpu::Queue, bounds: &LightBounds) -> Self {
        let levels: Vec<_> = bounds.levels().collect();
        let (size, _) = levels[0];
        let mut bytes = Vec::new();
        for face in 0..FACES {
            for (edge, texels) in &levels {
                let count = (edge * edge) as usize;
                for bound in &texels[face * count..(face + 1) * count] {
                    bytes.extend_from_slice(bytemuck::bytes_of(&[bound.most, bound.contrast]));
                }
            }
        }
        let descriptor = descriptor(size, wgpu::TextureUsages::TEXTURE_BINDING);
        let texture =
            device.create_texture_with_data(queue, &descriptor, wgpu::util::TextureDataOrder::LayerMajor, &bytes);
        Self { view: view_of(&texture) }
    }
}

fn view_of(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

fn descriptor(size: u32, usage: wgpu::TextureUsages) -> wgpu::TextureDescriptor<'static> {
    wgpu::TextureDescriptor {
        label: Some("bounds of the light"),
        size: wgpu::Extent3d { width: size, height: size, depth_or_array_layers: FACES as u32 },
        mip_level_count: size.ilog2() + 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rg32Float,
        usage,
        view_formats: &[],
    }
}
