//! A lamp on the GPU.

use bytemuck::{Pod, Zeroable};
use wgpu::util::DeviceExt;

use crate::gpu::GpuError;
use crate::pinhole::constants::{BEAM_CONE, BEAM_NONE, BEAM_SLIDE};
use crate::scene::{Beam, Lamp, Slide};

/// A lamp as shaders read it: what it is, and the slide of its beam. It serves any number of images.
#[derive(Clone, Debug)]
pub struct UploadedLamp {
    pub(crate) uniforms: LampUniforms,
    pub(crate) slide: wgpu::TextureView,
}

/// A lamp, 80 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct LampUniforms {
    /// Its centre, metres.
    pub position: [f32; 3],
    /// Metres.
    pub radius: f32,
    /// Of its disc where its beam is brightest, W/(m²·sr).
    pub radiance: [f32; 3],
    /// No channel has more from anywhere.
    pub max_radiance: f32,
    /// As in [`Beam`].
    pub direction: [f32; 3],
    /// From the axis to the edge of the beam, radians.
    pub half_angle: f32,
    /// As in [`Beam`].
    pub up: [f32; 3],
    /// As in [`Beam`].
    pub softness: f32,
    /// `BEAM_NONE` and so on.
    pub beam: u32,
    padding: [u32; 3],
}

impl From<&Lamp> for LampUniforms {
    fn from(lamp: &Lamp) -> Self {
        let all_around = Self {
            position: lamp.position.to_array(),
            radius: lamp.radius,
            radiance: lamp.max_radiance_of_disc().to_array(),
            max_radiance: lamp.max_radiance(),
            beam: BEAM_NONE,
            ..Self::default()
        };
        let Some(Beam { direction, up, half_angle_rad, softness, slide }) = &lamp.beam else { return all_around };
        Self {
            direction: direction.to_array(),
            half_angle: *half_angle_rad,
            up: up.to_array(),
            softness: *softness,
            beam: if slide.is_some() { BEAM_SLIDE } else { BEAM_CONE },
            ..all_around
        }
    }
}

impl UploadedLamp {
    /// Uploads a lamp. A slide must be no larger than the device's textures.
    pub fn upload(device: &wgpu::Device, queue: &wgpu::Queue, lamp: &Lamp) -> Result<Self, GpuError> {
        let slide = match lamp.beam.as_ref().and_then(|beam| beam.slide.as_ref()) {
            Some(slide) => upload_slide(device, queue, slide)?,
            None => no_slide(device),
        };
        Ok(Self { uniforms: lamp.into(), slide })
    }
}

fn descriptor([width, height]: [u32; 2]) -> wgpu::TextureDescriptor<'static> {
    wgpu::TextureDescriptor {
        label: Some("slide"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba32Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    }
}

/// What is bound where there is no slide.
pub(crate) fn no_slide(device: &wgpu::Device) -> wgpu::TextureView {
    device.create_texture(&descriptor([1; 2])).create_view(&Default::default())
}

fn upload_slide(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    Slide(image): &Slide,
) -> Result<wgpu::TextureView, GpuError> {
    let size = [image.width, image.height].map(|edge| u32::try_from(edge).unwrap_or(u32::MAX));
    let (edge, limit) = (size[0].max(size[1]), device.limits().max_texture_dimension_2d);
    if edge > limit {
        return Err(GpuError::TextureTooLarge { what: "the slide of a spotlight", size: edge, limit });
    }
    let texels: Vec<[f32; 4]> = image.pixels.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
    let order = wgpu::util::TextureDataOrder::LayerMajor;
    let texture = device.create_texture_with_data(queue, &descriptor(size), order, bytemuck::cast_slice(&texels));
    Ok(texture.create_view(&Default::default()))
}
