//! Asks a filter for the mean over given footprints, on the device, through the gather's own shader code.

use wgpu::util::DeviceExt;

use super::pipeline::{bind, cube, filter_constant, layout, linear_sampler, render_pipeline, sampler, storage};
use crate::environment::CubeMap;
use crate::gpu::{Gpu, GpuError, resolve};
use crate::pinhole::gpu::EnvironmentCube;
use crate::pinhole::{Filter, Probe};

/// Probes in a row of the target; the shader's `WIDTH`.
const WIDTH: u32 = 256;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct GpuProbe {
    direction: [f32; 3],
    taps: f32,
    side_1: [f32; 3],
    texel_rad: f32,
    side_2: [f32; 3],
    padding: f32,
}

/// Means over footprints: rgb, and the number of fetches.
pub async fn probe(
    gpu: &Gpu,
    environment: &CubeMap,
    filter: Filter,
    most_taps: u32,
    probes: &[Probe],
) -> Result<Vec<[f32; 4]>, GpuError> {
    let uploaded = EnvironmentCube::upload(&gpu.device, &gpu.queue, environment)?;
    let mut means = Vec::with_capacity(probes.len());
    // Whole rows, no more than fit into any texture.
    for probes in probes.chunks((WIDTH * 1024) as usize) {
        means.extend(probe_batch(gpu, &uploaded, filter, most_taps as f32, probes).await?);
    }
    let scale = uploaded.radiance_scale();
    Ok(means.into_iter().map(|[r, g, b, n]| [scale * r, scale * g, scale * b, n]).collect())
}

async fn probe_batch(
    gpu: &Gpu,
    environment: &EnvironmentCube,
    filter: Filter,
    taps: f32,
    probes: &[Probe],
) -> Result<Vec<[f32; 4]>, GpuError> {
    let device = &gpu.device;
    let texel_rad = 2.0 / environment.size() as f32;
    let pack = |p: &Probe| {
        let [side_1, side_2] = p.sides.map(|side| side.to_array());
        GpuProbe { direction: p.direction.to_array(), taps, side_1, texel_rad, side_2, padding: 0.0 }
    };
    let packed: Vec<GpuProbe> = probes.iter().map(pack).collect();
    let buffer = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some("probes"),
        contents: bytemuck::cast_slice(&packed),
        usage: wgpu::BufferUsages::STORAGE,
    });
    let group_layout = layout(device, "filter probe", &[storage(0), cube(1), sampler(2), sampler(3)]);
    let (trilinear, anisotropic) = (linear_sampler(device, 1), linear_sampler(device, 16));
    let group = bind(
        device,
        &group_layout,
        &[
            buffer.as_entire_binding(),
            wgpu::BindingResource::TextureView(environment.view()),
            wgpu::BindingResource::Sampler(&trilinear),
            wgpu::BindingResource::Sampler(&anisotropic),
        ],
    );
    let pipeline = pipeline(device, &group_layout, filter);
    let target = super::target(device, [WIDTH, (probes.len() as u32).div_ceil(WIDTH)]);
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
    let mut means = gpu.read_texture(&target).await?;
    means.truncate(probes.len());
    Ok(means)
}

fn pipeline(device: &wgpu::Device, group_layout: &wgpu::BindGroupLayout, filter: Filter) -> wgpu::RenderPipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("filter probe"),
        source: wgpu::ShaderSource::Wgsl(resolve("filter_probe")),
    });
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("filter probe"),
        bind_group_layouts: &[Some(group_layout)],
        immediate_size: 0,
    });
    let constants = [("FILTER", f64::from(filter_constant(filter)))];
    render_pipeline(device, &pipeline_layout, &module, ["full_screen", "probe"], &constants, None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probes_are_laid_out_as_in_the_shader() {
        let module = naga::front::wgsl::parse_str(&resolve("filter_probe")).unwrap();
        let (_, ty) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some("Probe")).unwrap();
        let naga::TypeInner::Struct { members, span } = &ty.inner else { panic!("Probe is no struct") };
        let in_shader: Vec<(&str, u32)> = members.iter().map(|m| (m.name.as_deref().unwrap(), m.offset)).collect();
        macro_rules! field {
            ($name:ident) => {
                (stringify!($name), std::mem::offset_of!(GpuProbe, $name) as u32)
            };
        }
        let here = [field!(direction), field!(taps), field!(side_1), field!(texel_rad), field!(side_2)];
        assert_eq!(in_shader, here);
        assert_eq!(*span, size_of::<GpuProbe>() as u32);
    }
}
