//! The environment cube on the GPU.

use wgpu::util::DeviceExt;

use crate::environment::{CubeMap, FACES};
use crate::gpu::GpuError;

/// A cube texture with mips and the factor that its texels were divided by.
#[derive(Clone, Debug)]
pub struct EnvironmentCube {
    view: wgpu::TextureView,
    size: u32,
    radiance_scale: f32,
}

/// The largest half float, with room for sums of rounding.
pub(super) const HALF_MAX: f32 = 65000.0;

impl EnvironmentCube {
    /// Uploads a cube map: 32-bit texels where the device filters them, else half floats, scaled down where the radiance
    /// exceeds their range.
    pub fn upload(device: &wgpu::Device, queue: &wgpu::Queue, cube: &CubeMap) -> Result<Self, GpuError> {
        let limit = device.limits().max_texture_dimension_2d;
        if cube.size() > limit {
            return Err(GpuError::TextureTooLarge { what: "the environment's cube map", size: cube.size(), limit });
        }
        let wide = device.features().contains(wgpu::Features::FLOAT32_FILTERABLE);
        let brightest = cube.padded_texels().iter().map(|t| t.truncate().max_element()).fold(0.0, f32::max);
        let radiance_scale = if wide { 1.0 } else { (brightest / HALF_MAX).max(1.0) };
        let format = if wide { wgpu::TextureFormat::Rgba32Float } else { wgpu::TextureFormat::Rgba16Float };
        let texture = device.create_texture_with_data(
            queue,
            &wgpu::TextureDescriptor {
                label: Some("environment cube"),
                size: wgpu::Extent3d { width: cube.size(), height: cube.size(), depth_or_array_layers: FACES as u32 },
                mip_level_count: cube.level_count(),
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
                view_formats: &[],
            },
            wgpu::util::TextureDataOrder::LayerMajor,
            &bytes_by_face(cube, wide, radiance_scale),
        );
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::Cube),
            ..Default::default()
        });
        Ok(Self { view, size: cube.size(), radiance_scale })
    }

    /// A cube texture of the caller's, with a full mip chain: `size` texels along a face's edge; the radiance is
    /// `radiance_scale` times the texels.
    pub fn from_view(view: wgpu::TextureView, size: u32, radiance_scale: f32) -> Self {
        Self { view, size, radiance_scale }
    }

    /// The cube view.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }

    /// Texels along a face's edge.
    pub fn size(&self) -> u32 {
        self.size
    }

    /// What texels are to be multiplied by, W/(m²·sr).
    pub fn radiance_scale(&self) -> f32 {
        self.radiance_scale
    }
}

/// Face by face, each with all of its levels.
fn bytes_by_face(cube: &CubeMap, wide: bool, radiance_scale: f32) -> Vec<u8> {
    let mut bytes = Vec::new();
    for face in 0..FACES {
        for level in 0..cube.level_count() {
            let rows = (cube.size() >> level) as usize;
            for texel in cube.rows(level).skip(face * rows).take(rows).flatten() {
                let texel = (texel.truncate() / radiance_scale).extend(1.0).to_array();
                if wide {
                    bytes.extend_from_slice(bytemuck::bytes_of(&texel));
                } else {
                    bytes.extend_from_slice(bytemuck::bytes_of(&texel.map(half::f16::from_f32)));
                }
            }
        }
    }
    bytes
}
