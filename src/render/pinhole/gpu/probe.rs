//! Asks a filter for the mean over given footprints, on the device, through the gather's own shader code.

use super::near_light::LightPlaceholders;
use super::pipeline::{
    GATHER_INPUTS, bind, filter_constant, gather_inputs, layout, linear_sampler, render_pipeline, storage,
};
use super::shaders::FILTER_PROBE;
use super::storage_buffer;
use crate::boxed::BoxFuture;
use crate::environment::CubeMap;
use crate::gpu::{Gpu, GpuError, buffer_with};
use crate::pinhole::gpu::{EnvironmentCube, FrameLight, TARGET_FORMAT};
use crate::pinhole::{Filter, Params, Probe};

/// Probes in a row of the target.
pub(super) const PROBES_PER_ROW: u32 = 256;

/// A probe as the shader reads it.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct GpuProbe {
    pub direction: [f32; 3],
    padding_1: f32,
    pub side_1: [f32; 3],
    padding_2: f32,
    pub side_2: [f32; 3],
    padding_3: f32,
}

impl From<&Probe> for GpuProbe {
    fn from(probe: &Probe) -> Self {
        let [side_1, side_2] = probe.sides.map(|side| side.to_array());
        let direction = probe.direction.to_array();
        Self { direction, side_1, side_2, padding_1: 0.0, padding_2: 0.0, padding_3: 0.0 }
    }
}

/// Means over footprints: rgb, and the number of fetches.
pub fn probe<'a>(
    gpu: &'a Gpu,
    environment: &'a CubeMap,
    filter: Filter,
    most_taps: u32,
    probes: &'a [Probe],
) -> BoxFuture<'a, Result<Vec<[f32; 4]>, GpuError>> {
    Box::pin(async move {
        let uploaded = EnvironmentCube::upload(&gpu.device, &gpu.queue, environment)?;
        let params = Params { filter, taps: most_taps, ..Params::default() };
        let mut means = Vec::with_capacity(probes.len());
        // Whole rows, no more than fit into any texture.
        for probes in probes.chunks((PROBES_PER_ROW * 1024) as usize) {
            means.extend(probe_batch(gpu, &uploaded, &params, probes).await?);
        }
        let scale = uploaded.radiance_scale();
        Ok(means.into_iter().map(|[r, g, b, n]| [scale * r, scale * g, scale * b, n]).collect())
    })
}

async fn probe_batch(
    gpu: &Gpu,
    environment: &EnvironmentCube,
    params: &Params,
    probes: &[Probe],
) -> Result<Vec<[f32; 4]>, GpuError> {
    let device = &gpu.device;
    let group_layout = layout(device, "filter probe", &[&gather_inputs()[..], &[storage(GATHER_INPUTS)]].concat());
    let group = bind_probes(device, &group_layout, environment, params, probes);
    let pipeline = pipeline(device, &group_layout, params.filter);
    let rows = (probes.len() as u32).div_ceil(PROBES_PER_ROW);
    let target = super::target(device, [PROBES_PER_ROW, rows], TARGET_FORMAT);
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

fn bind_probes(
    device: &wgpu::Device,
    group_layout: &wgpu::BindGroupLayout,
    environment: &EnvironmentCube,
    params: &Params,
    probes: &[Probe],
) -> wgpu::BindGroup {
    // What the texels are to be multiplied by, the caller does.
    let scaled = EnvironmentCube::from_view(environment.view().clone(), environment.size(), 1.0);
    let light = FrameLight::Environment(&scaled);
    let uniforms = buffer_with(
        device,
        "gather uniforms",
        bytemuck::bytes_of(&light.uniforms(params, &Default::default(), 0)),
        wgpu::BufferUsages::UNIFORM,
    );
    let packed: Vec<GpuProbe> = probes.iter().map(GpuProbe::from).collect();
    let probes = storage_buffer(device, "probes", bytemuck::cast_slice(&packed));
    let textures = LightPlaceholders::new(device).with(light);
    // There are no curves and no visibility maps.
    let nothing = storage_buffer(device, "nothing", &[]);
    let (trilinear, anisotropic) = (linear_sampler(device, 1), linear_sampler(device, 16));
    let common = [
        uniforms.as_entire_binding(),
        textures.environment(),
        wgpu::BindingResource::Sampler(&trilinear),
        wgpu::BindingResource::Sampler(&anisotropic),
        nothing.as_entire_binding(),
        nothing.as_entire_binding(),
        nothing.as_entire_binding(),
    ];
    bind(device, group_layout, &[&common[..], &textures.near(), &[probes.as_entire_binding()]].concat())
}

fn pipeline(device: &wgpu::Device, group_layout: &wgpu::BindGroupLayout, filter: Filter) -> wgpu::RenderPipeline {
    let module = FILTER_PROBE.module(device);
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("filter probe"),
        bind_group_layouts: &[Some(group_layout)],
        immediate_size: 0,
    });
    let constants = [("FILTER", f64::from(filter_constant(filter)))];
    render_pipeline(
        device,
        &pipeline_layout,
        &module,
        ["full_screen", "probe"],
        &constants,
        &[Some(TARGET_FORMAT.into())],
    )
}
