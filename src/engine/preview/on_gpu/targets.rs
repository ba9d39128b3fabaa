//! What the passes of a preview write, for one size of the picture.

use wgpu::TextureFormat;

use super::layout::PIXEL_BYTES;
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
    /// Receivers at nodes and, if there are pixels between them, at all pixels.
    pub receivers: Vec<ReceiverTextures>,
    /// Display-linear.
    pub picture: wgpu::Texture,
    /// The same for the eye: sRGB, eight bits a channel.
    pub shown: wgpu::TextureView,
}

/// Receivers of the gather.
#[derive(Debug)]
pub(super) struct ReceiverTextures {
    pub size: [u32; 2],
    pub positions: wgpu::TextureView,
    pub normals: wgpu::TextureView,
}

impl ReceiverTextures {
    fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        let view = || texture(device, size, TextureFormat::Rgba32Float).create_view(&Default::default());
        Self { size, positions: view(), normals: view() }
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
        let nodes = size.map(|edge| edge.div_ceil(spacing));
        let grids = if spacing == 1 { vec![nodes] } else { vec![nodes, size] };
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
            receivers: grids.into_iter().map(|size| ReceiverTextures::new(device, size)).collect(),
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
