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
        let (texture, radiance_scale) = upload_cubes(device, queue, "the environment's cube map", &[cube])?;
        Ok(Self::of_texture(&texture, cube.size(), radiance_scale))
    }

    /// The first six layers of a texture.
    pub(super) fn of_texture(texture: &wgpu::Texture, size: u32, radiance_scale: f32) -> Self {
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::Cube),
            array_layer_count: Some(FACES as u32),
            ..Default::default()
        });
        Self { view, size, radiance_scale }
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

/// Uploads cube maps of one size as layers of a texture, and says what their texels are to be multiplied by.
pub(super) fn upload_cubes(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    what: &'static str,
    cubes: &[&CubeMap],
) -> Result<(wgpu::Texture, f32), GpuError> {
    let (size, level_count) = cubes.first().map_or((1, 1), |cube| (cube.size(), cube.level_count()));
    let limit = device.limits().max_texture_dimension_2d;
    if size > limit {
        return Err(GpuError::TextureTooLarge { what, size, limit });
    }
    let wide = device.features().contains(wgpu::Features::FLOAT32_FILTERABLE);
    let texels = cubes.iter().flat_map(|cube| cube.padded_texels());
    let largest = texels.map(|texel| texel.truncate().abs().max_element()).fold(0.0, f32::max);
    let scale = if wide { 1.0 } else { (largest / HALF_MAX).max(1.0) };
    let format = if wide { wgpu::TextureFormat::Rgba32Float } else { wgpu::TextureFormat::Rgba16Float };
    let layers = (FACES * cubes.len()) as u32;
    let bytes: Vec<u8> = cubes.iter().flat_map(|cube| bytes_by_face(cube, wide, scale)).collect();
    let descriptor = cube_descriptor(what, [size, layers], level_count, format);
    let order = wgpu::util::TextureDataOrder::LayerMajor;
    Ok((device.create_texture_with_data(queue, &descriptor, order, &bytes), scale))
}

/// A black cube of one texel a face.
pub(super) fn black_cube(device: &wgpu::Device) -> wgpu::Texture {
    device.create_texture(&cube_descriptor("no light", [1, FACES as u32], 1, wgpu::TextureFormat::Rgba16Float))
}

fn cube_descriptor(
    label: &'static str,
    [size, layers]: [u32; 2],
    mip_level_count: u32,
    format: wgpu::TextureFormat,
) -> wgpu::TextureDescriptor<'static> {
    wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width: size, height: size, depth_or_array_layers: layers },
        mip_level_count,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
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
