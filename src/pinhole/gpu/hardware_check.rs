//! Does this adapter's anisotropic filter honour explicit gradients on cube maps? Several do not, and none says so.
//!
//! A striped cube is sampled with footprints that are long across the stripes or along them. Averaging across makes
//! grey; an adapter that ignores the gradients returns a stripe's own colour.

use glam::Vec3;
use wgpu::util::DeviceExt;

use super::pipeline::{bind, cube, full_screen_pipeline, layout, linear_sampler, sampler, storage};
use crate::environment::CubeMap;
use crate::gpu::{Gpu, GpuError, resolve};
use crate::pinhole::gpu::EnvironmentCube;

/// What the check found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HardwareVerdict {
    /// Root mean square difference from the exact means; the pattern's own deviation is 1.
    pub rms_error: f32,
}

impl HardwareVerdict {
    /// Whether `--filter hardware` can be trusted here.
    pub fn is_right(&self) -> bool {
        self.rms_error < 0.25
    }
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Probe {
    direction: [f32; 3],
    padding_0: f32,
    side_1: [f32; 3],
    padding_1: f32,
    side_2: [f32; 3],
    padding_2: f32,
}

/// Stripes that vary with height on the four upright faces: 0 or 2, so that their mean and their deviation are 1.
fn stripes(direction: Vec3) -> Vec3 {
    let height = direction.y / direction.x.abs().max(direction.z.abs());
    Vec3::splat(if (height * 32.0).rem_euclid(2.0) < 1.0 { 0.0 } else { 2.0 })
}

/// Footprints of aspect 8 at the centres of stripes: across, where the mean is 1, and along, where it is the stripe's own.
fn probes() -> Vec<(Probe, f32)> {
    let mut probes = Vec::new();
    for (axis, side) in [(Vec3::X, Vec3::Z), (Vec3::Z, Vec3::X), (Vec3::NEG_X, Vec3::Z), (Vec3::NEG_Z, Vec3::X)] {
        for stripe in [0, 1, 5, 8] {
            let direction = axis + side * 0.1 + Vec3::Y * ((stripe as f32 + 0.5) / 32.0);
            let own = if stripe % 2 == 0 { 0.0 } else { 2.0 };
            for (long, short, mean) in [(Vec3::Y, side, 1.0), (side, Vec3::Y, own)] {
                let probe = Probe {
                    direction: direction.to_array(),
                    padding_0: 0.0,
                    side_1: (long * 0.25).to_array(),
                    padding_1: 0.0,
                    side_2: (short * 0.01).to_array(),
                    padding_2: 0.0,
                };
                probes.push((probe, mean));
            }
        }
    }
    probes
}

/// Runs the check; a few milliseconds.
pub fn check_hardware_filter(gpu: &Gpu) -> Result<HardwareVerdict, GpuError> {
    let pattern = EnvironmentCube::upload(&gpu.device, &gpu.queue, &CubeMap::from_radiance(256, Some(0.01), stripes))?;
    let probes = probes();
    let answers = sample(gpu, &pattern, &probes.iter().map(|(p, _)| *p).collect::<Vec<_>>())?;
    let squared =
        answers.iter().zip(&probes).map(|(got, (_, mean))| (got[0] * pattern.radiance_scale() - mean).powi(2));
    Ok(HardwareVerdict { rms_error: (squared.sum::<f32>() / probes.len() as f32).sqrt() })
}

fn sample(gpu: &Gpu, pattern: &EnvironmentCube, probes: &[Probe]) -> Result<Vec<[f32; 4]>, GpuError> {
    let device = &gpu.device;
    let group_layout = layout(device, "filter probe", &[storage(0), cube(1), sampler(2)]);
    let buffer = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some("probes"),
        contents: bytemuck::cast_slice(probes),
        usage: wgpu::BufferUsages::STORAGE,
    });
    let anisotropic = linear_sampler(device, 16);
    let group = bind(
        device,
        &group_layout,
        &[
            buffer.as_entire_binding(),
            wgpu::BindingResource::TextureView(pattern.view()),
            wgpu::BindingResource::Sampler(&anisotropic),
        ],
    );
    let pipeline = pipeline(device, &group_layout);
    let target = super::target(device, [probes.len() as u32, 1]);
    let view = target.create_view(&Default::default());
    let mut encoder = device.create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("filter probe"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
    }
    gpu.queue.submit([encoder.finish()]);
    gpu.read_texture(&target)
}

fn pipeline(device: &wgpu::Device, group_layout: &wgpu::BindGroupLayout) -> wgpu::RenderPipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("filter probe"),
        source: wgpu::ShaderSource::Wgsl(resolve("filter_probe")),
    });
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("filter probe"),
        bind_group_layouts: &[Some(group_layout)],
        immediate_size: 0,
    });
    full_screen_pipeline(device, &pipeline_layout, &module, "probe", &[], None)
}
