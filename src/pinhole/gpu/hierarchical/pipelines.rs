//! Layouts and pipelines of the hierarchical gather.

use wgpu::{BindGroupLayout, BindGroupLayoutEntry, BindingType, ShaderStages, TextureFormat, TextureViewDimension};

use super::super::pipeline::{
    cube, filter_constant, layout, linear_sampler, render_pipeline, sampler, seen_by, storage, texture, uniform, window,
};
use crate::gpu::resolve;
use crate::pinhole::Filter;

#[derive(Debug)]
pub(super) struct Pipelines {
    pub blocks: wgpu::ComputePipeline,
    pub cut: wgpu::ComputePipeline,
    pub scout: wgpu::ComputePipeline,
    pub settle: wgpu::ComputePipeline,
    pub finish: wgpu::RenderPipeline,
    /// The same towards viewers.
    pub reflect: wgpu::RenderPipeline,
    pub layouts: Layouts,
    pub trilinear: wgpu::Sampler,
    pub anisotropic: wgpu::Sampler,
}

/// Layouts of the bind groups.
#[derive(Debug)]
pub(super) struct Layouts {
    /// Cells, light and parameters.
    pub scene: BindGroupLayout,
    pub receivers: BindGroupLayout,
    /// What the compute passes work on.
    pub work: BindGroupLayout,
    /// The same, as the last pass reads it.
    pub result: BindGroupLayout,
    /// What scouts report.
    pub scouts: BindGroupLayout,
}

const BOTH: ShaderStages = ShaderStages::COMPUTE.union(ShaderStages::FRAGMENT);
const COMPUTE: ShaderStages = ShaderStages::COMPUTE;

impl Layouts {
    fn new(device: &wgpu::Device) -> Self {
        let bounds = bounds_texture(5);
        let scene = [
            uniform(0),
            uniform(1),
            cube(2),
            sampler(3),
            sampler(4),
            bounds,
            storage(6),
            storage(7),
            storage(8),
            storage(9),
            storage(10),
        ];
        let all = BOTH | ShaderStages::VERTEX;
        let scene = scene.map(|entry| seen_by(if entry.binding == 1 { all } else { BOTH }, entry));
        let of_points = [texture(0), texture(1)].map(|entry| seen_by(BOTH, entry));
        let receivers = [&of_points[..], &[texture(2), storage(3), storage(4)]].concat();
        let work = [window(0), writable(1), writable(2), written(3), uniform(4)].map(|entry| seen_by(COMPUTE, entry));
        let stage = seen_by(ShaderStages::VERTEX_FRAGMENT, window(0));
        let scouts = [writable(0), writable(1)].map(|entry| seen_by(COMPUTE, entry));
        Self {
            scene: layout(device, "cells and light", &scene),
            receivers: layout(device, "receivers", &receivers),
            work: layout(device, "cuts", &work),
            result: layout(device, "cuts made", &[stage, storage(1), texture(2), uniform(3), texture(4)]),
            scouts: layout(device, "scouts", &scouts),
        }
    }
}

impl Pipelines {
    pub fn new(device: &wgpu::Device, filter: Filter, visibility: bool) -> Self {
        let layouts = Layouts::new(device);
        let of_groups = |groups: [&BindGroupLayout; 3]| {
            device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("hierarchical gather"),
                bind_group_layouts: &groups.map(Some),
                immediate_size: 0,
            })
        };
        let with_work = of_groups([&layouts.scene, &layouts.receivers, &layouts.work]);
        let with_scouts = of_groups([&layouts.scene, &layouts.receivers, &layouts.scouts]);
        let with_result = of_groups([&layouts.scene, &layouts.receivers, &layouts.result]);
        let constants =
            [("FILTER", f64::from(filter_constant(filter))), ("VISIBILITY", f64::from(u8::from(visibility)))];
        let module = |name: &str| {
            device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(name),
                source: wgpu::ShaderSource::Wgsl(resolve(name)),
            })
        };
        let (scout, finish) = (module("scout"), module("finish"));
        let last = |shading: bool| {
            let constants = [constants[0], constants[1], ("SHADING", f64::from(u8::from(shading)))];
            render_pipeline(device, &with_result, &finish, ["tile_corner", "finish"], &constants, None)
        };
        Self {
            blocks: compute_pipeline(device, &with_work, &module("blocks"), "look_at_blocks", &[]),
            cut: compute_pipeline(device, &with_work, &module("cut"), "cut", &constants),
            scout: compute_pipeline(device, &with_scouts, &scout, "scout", &constants[1..]),
            settle: compute_pipeline(device, &with_scouts, &scout, "settle", &[]),
            finish: last(false),
            reflect: last(true),
            layouts,
            trilinear: linear_sampler(device, 1),
            anisotropic: linear_sampler(device, 16),
        }
    }
}

pub(super) fn compute_pipeline(
    device: &wgpu::Device,
    layout: &wgpu::PipelineLayout,
    module: &wgpu::ShaderModule,
    entry: &str,
    constants: &[(&str, f64)],
) -> wgpu::ComputePipeline {
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry),
        layout: Some(layout),
        module,
        entry_point: Some(entry),
        compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
        cache: None,
    })
}

pub(super) fn entry(binding: u32, ty: BindingType) -> BindGroupLayoutEntry {
    BindGroupLayoutEntry { binding, visibility: ShaderStages::NONE, ty, count: None }
}

/// The bounds of the light: a texture that is not filtered.
pub(super) fn bounds_texture(binding: u32) -> BindGroupLayoutEntry {
    let sample_type = wgpu::TextureSampleType::Float { filterable: false };
    let view_dimension = TextureViewDimension::D2Array;
    entry(binding, BindingType::Texture { sample_type, view_dimension, multisampled: false })
}

/// A buffer that shaders write.
pub(super) fn writable(binding: u32) -> BindGroupLayoutEntry {
    let ty = wgpu::BufferBindingType::Storage { read_only: false };
    entry(binding, BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None })
}

/// A texture that shaders write.
fn written(binding: u32) -> BindGroupLayoutEntry {
    let access = wgpu::StorageTextureAccess::WriteOnly;
    let ty = BindingType::StorageTexture {
        access,
        format: TextureFormat::Rgba32Float,
        view_dimension: TextureViewDimension::D2,
    };
    entry(binding, ty)
}
