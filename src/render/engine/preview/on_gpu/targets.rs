//! What the passes of a preview write, for one size of the picture.

use glam::Vec4;
use wgpu::TextureFormat;

use super::layout::{PIXEL_BYTES, PreviewGrid};
use crate::engine::preview::nodes::finer_spacing;
use crate::engine::preview::scattering::ScatteredGrid;
use crate::gpu::buffer_with;
use crate::pinhole::gpu::shaders::HISTOGRAM_BINS;

/// Buffers with something for each pixel, and textures.
#[derive(Debug)]
pub(super) struct Targets {
    pub size: [u32; 2],
    pub spacing: u32,
    pub surfaces: wgpu::Buffer,
    pub mirrored: wgpu::Buffer,
    pub escapes: wgpu::Buffer,
    pub first: wgpu::Buffer,
    pub own_light: wgpu::Buffer,
    pub mirrored_light: wgpu::Buffer,
    pub shaded: wgpu::Buffer,
    pub colours: wgpu::Buffer,
    pub histogram: wgpu::Buffer,
    pub exposures: wgpu::Buffer,
    /// The number of rays that the adapter did not let be finished.
    pub unfinished: wgpu::Buffer,
    /// Receivers at nodes and, if there are pixels between them, at these.
    pub receivers: Vec<ReceiverTextures>,
    /// Display-linear.
    pub picture: wgpu::Texture,
    /// The same for the eye: sRGB, eight bits a channel.
    pub shown: wgpu::TextureView,
}

/// From nodes to all pixels, each grid finer than the one before.
fn grids(spacing: u32) -> impl Iterator<Item = PreviewGrid> {
    let first = PreviewGrid::new(spacing, spacing);
    std::iter::successors(Some(first), |grid| {
        (grid.spacing > 1).then(|| PreviewGrid::new(finer_spacing(grid.spacing), grid.spacing))
    })
}

/// Receivers of the gather.
#[derive(Debug)]
pub(super) struct ReceiverTextures {
    pub size: [u32; 2],
    /// Which pixels they are.
    pub grid: wgpu::Buffer,
    pub positions: wgpu::TextureView,
    pub normals: wgpu::TextureView,
}

impl ReceiverTextures {
    /// Receivers `spacing` pixels apart in a picture of this size.
    fn new(device: &wgpu::Device, picture: [u32; 2], grid: PreviewGrid) -> Self {
        let size = picture.map(|edge| edge.div_ceil(grid.spacing));
        let grid = buffer_with(device, "grid", bytemuck::bytes_of(&grid), wgpu::BufferUsages::UNIFORM);
        let view = || texture(device, size, TextureFormat::Rgba32Float).create_view(&Default::default());
        Self { size, grid, positions: view(), normals: view() }
    }
}

/// Scattered light along some rays, which the CPU writes.
#[derive(Debug, Default)]
pub(super) struct ScatteredTexture(Option<wgpu::Texture>);

impl ScatteredTexture {
    /// The texture of a grid of rays; one that is not read if there is none.
    pub fn with(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        grid: Option<&ScatteredGrid>,
    ) -> wgpu::TextureView {
        let [width, height] = grid.map_or([1; 2], |grid| grid.size);
        let known = self.0.take().filter(|texture| [texture.width(), texture.height()] == [width, height]);
        let texture = known.unwrap_or_else(|| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some("scattered light"),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: TextureFormat::Rgba32Float,
                usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
                view_formats: &[],
            })
        });
        if let Some(grid) = grid {
            let texels: Vec<[f32; 4]> = grid.light.iter().map(Vec4::to_array).collect();
            let layout =
                wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(16 * width), rows_per_image: None };
            queue.write_texture(texture.as_image_copy(), bytemuck::cast_slice(&texels), layout, texture.size());
        }
        let view = texture.create_view(&Default::default());
        self.0 = Some(texture);
        view
    }
}

/// Whether a device has room for the buffers of a picture of this size.
pub fn fits(device: &wgpu::Device, [width, height]: [u32; 2]) -> bool {
    let limits = device.limits();
    let most = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    width.max(height) <= limits.max_texture_dimension_2d
        && u64::from(width) * u64::from(height) * PIXEL_BYTES[0] <= most
}

impl Targets {
    pub fn new(device: &wgpu::Device, size: [u32; 2], spacing: u32) -> Self {
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let buffer = |label, bytes| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            })
        };
        let [point, escape, first] = PIXEL_BYTES.map(|bytes| bytes * pixels);
        Self {
            size,
            spacing,
            surfaces: buffer("surfaces", point),
            mirrored: buffer("surfaces in mirrors", point),
            escapes: buffer("escapes", escape),
            first: buffer("what the camera sees first", first),
            own_light: buffer("light", 16 * pixels),
            mirrored_light: buffer("light in mirrors", 16 * pixels),
            shaded: buffer("radiance", 32 * pixels),
            colours: buffer("colours", 16 * pixels),
            // Of surfaces, of everything, and the number of pixels that show surfaces.
            histogram: buffer("histogram of luminance", 4 * (2 * u64::from(HISTOGRAM_BINS) + 1)),
            exposures: buffer("exposures", 8),
            unfinished: buffer("unfinished rays", 4),
            receivers: grids(spacing).map(|grid| ReceiverTextures::new(device, size, grid)).collect(),
            picture: texture(device, size, TextureFormat::Rgba32Float),
            shown: texture(device, size, TextureFormat::Rgba8Unorm).create_view(&Default::default()),
        }
    }
}

fn texture(device: &wgpu::Device, [width, height]: [u32; 2], format: TextureFormat) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some("preview"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::STORAGE_BINDING
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}
