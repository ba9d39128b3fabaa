//! What the gather reads beside receivers: light, samples and parameters, in buffers that can be written anew from frame to frame.

use super::near_light::{LightPlaceholders, LightTextures, LightUniforms};
use super::{FrameInputs, VisibilityMapBuffers, filled_storage};
use crate::gpu::buffer_with;
use crate::pinhole::{BATCH_SIZE, PinholeSample};

/// Light and samples as shaders read them.
#[derive(Debug, PartialEq)]
pub(super) struct Sources {
    pub uniforms: wgpu::Buffer,
    pub samples: wgpu::Buffer,
    pub curves: wgpu::Buffer,
    pub planes: wgpu::Buffer,
    pub sky_masks: wgpu::Buffer,
    pub light: LightTextures,
}

/// The contents of the buffers of [`Sources`].
struct Contents<'a> {
    uniforms: LightUniforms,
    samples: Vec<PinholeSample>,
    curves: &'a [u8],
}

impl<'a> Contents<'a> {
    fn new(inputs: &FrameInputs<'a>, map_resolution: u32) -> Self {
        let FrameInputs { params, pinholes, .. } = inputs;
        let uniforms = inputs.light.uniforms(params, pinholes, map_resolution);
        // Whole batches, one at least; the shader reads `sample_count` samples only.
        let batches = inputs.pinholes.samples.len().div_ceil(BATCH_SIZE as usize).max(1);
        let mut samples = inputs.pinholes.samples.clone();
        samples.resize(batches * BATCH_SIZE as usize, PinholeSample::default());
        Self { uniforms, samples, curves: filled_storage(bytemuck::cast_slice(&inputs.pinholes.curves)) }
    }

    /// By buffer: the bytes.
    fn bytes(&self) -> [&[u8]; 3] {
        [bytemuck::bytes_of(&self.uniforms), bytemuck::cast_slice(&self.samples), self.curves]
    }
}

impl Sources {
    pub fn new(
        device: &wgpu::Device,
        inputs: &FrameInputs,
        maps: &VisibilityMapBuffers,
        placeholders: &LightPlaceholders,
    ) -> Self {
        let contents = Contents::new(inputs, maps.resolution);
        let [uniforms, samples, curves] = contents.bytes();
        let usage = wgpu::BufferUsages::COPY_DST;
        Self {
            uniforms: buffer_with(device, "gather uniforms", uniforms, usage | wgpu::BufferUsages::UNIFORM),
            samples: buffer_with(device, "pinhole samples", samples, usage | wgpu::BufferUsages::UNIFORM),
            curves: buffer_with(device, "reflectance curves", curves, usage | wgpu::BufferUsages::STORAGE),
            planes: maps.planes.clone(),
            sky_masks: maps.sky_masks.clone(),
            light: placeholders.with(inputs.light),
        }
    }

    /// The same buffers with other contents, and the visibility maps of the inputs; `None` if the contents have other sizes.
    pub fn updated(&self, queue: &wgpu::Queue, inputs: &FrameInputs, placeholders: &LightPlaceholders) -> Option<Self> {
        let contents = Contents::new(inputs, inputs.maps.map_or(0, |maps| maps.resolution));
        let buffers = [&self.uniforms, &self.samples, &self.curves];
        if !buffers.iter().zip(contents.bytes()).all(|(buffer, bytes)| buffer.size() == bytes.len() as u64) {
            return None;
        }
        buffers.iter().zip(contents.bytes()).for_each(|(buffer, bytes)| queue.write_buffer(buffer, 0, bytes));
        let [uniforms, samples, curves] = buffers.map(Clone::clone);
        // Without visibility, what is bound in place of maps stays.
        let maps = inputs.maps.map_or([&self.planes, &self.sky_masks], |maps| [&maps.planes, &maps.sky_masks]);
        let [planes, sky_masks] = maps.map(Clone::clone);
        Some(Self { uniforms, samples, curves, planes, sky_masks, light: placeholders.with(inputs.light) })
    }
}
