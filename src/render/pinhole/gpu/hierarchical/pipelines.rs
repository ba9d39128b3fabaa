//! Layouts and pipelines of the hierarchical gather.

use std::sync::OnceLock;

use wgpu::{BindGroupLayout, BindGroupLayoutEntry, BindingType, ShaderStages, TextureFormat, TextureViewDimension};

use super::super::TARGET_FORMAT;
use super::super::geometry::{integers, ray_entries};
use super::super::near_light::LightPlaceholders;
use super::super::pipeline::{
    GATHER_INPUTS, compute_pipeline, entry, filter_constant, gather_inputs, layout, linear_sampler, render_pipeline,
    seen_by, storage, texture, uniform, window, writable, written,
};
use super::super::shaders::{IRRADIANCE_ESTIMATE, RECEIVER_BLOCKS, REFINE, RESOLVE, Shader};
use super::{HierarchicalOptions, WALK_FORMAT};

/// The pipelines of an image's passes.
#[derive(Clone, Debug)]
pub(super) struct Passes {
    pub receiver_blocks: wgpu::ComputePipeline,
    pub refine: wgpu::ComputePipeline,
    pub estimate: wgpu::ComputePipeline,
    pub set_tolerance: wgpu::ComputePipeline,
    pub resolve: wgpu::RenderPipeline,
}

#[derive(Debug)]
pub(super) struct Pipelines {
    passes: Passes,
    /// The last pass towards viewers, compiled when it is first needed.
    resolve_towards_viewers: OnceLock<wgpu::RenderPipeline>,
    resolve: ResolveSource,
    pub layouts: Layouts,
    pub placeholders: LightPlaceholders,
    pub trilinear: wgpu::Sampler,
    pub anisotropic: wgpu::Sampler,
}

/// What the last pass is compiled from.
#[derive(Debug)]
struct ResolveSource {
    module: wgpu::ShaderModule,
    layout: wgpu::PipelineLayout,
    constants: Constants,
}

/// By name.
type Constants = [(&'static str, f64); 4];

/// Layouts of the bind groups.
#[derive(Debug)]
pub(super) struct Layouts {
    /// Cells, light and parameters.
    pub scene: BindGroupLayout,
    pub receivers: BindGroupLayout,
    /// What the compute passes work on.
    pub work: BindGroupLayout,
    /// The same, as the resolve pass reads it.
    pub result: BindGroupLayout,
    /// What the irradiance estimate writes.
    pub estimate: BindGroupLayout,
    /// What settles doubts about visibility.
    pub rays: BindGroupLayout,
}

/// The binding of doubts, beside those of rays.
pub(super) const DOUBTS: u32 = 3;

const BOTH: ShaderStages = ShaderStages::COMPUTE.union(ShaderStages::FRAGMENT);
const COMPUTE: ShaderStages = ShaderStages::COMPUTE;

impl Layouts {
    fn new(device: &wgpu::Device) -> Self {
        let tree = seen_by(BOTH | ShaderStages::VERTEX, uniform(GATHER_INPUTS));
        let cells = [
            bounds_texture(GATHER_INPUTS + 1),
            storage(GATHER_INPUTS + 2),
            storage(GATHER_INPUTS + 3),
            bounds_texture(GATHER_INPUTS + 4),
        ]
        .map(|entry| seen_by(BOTH, entry));
        let scene = [&gather_inputs().map(|entry| seen_by(BOTH, entry))[..], &[tree], &cells].concat();
        let of_points = [texture(0), texture(1)].map(|entry| seen_by(BOTH, entry));
        let receivers = [&of_points[..], &[texture(2), storage(3), storage(4)]].concat();
        let work = [window(0), writable(1), writable(2), written(3, TextureFormat::Rgba32Float), uniform(4)]
            .map(|entry| seen_by(COMPUTE, entry));
        let tile_pass = seen_by(ShaderStages::VERTEX_FRAGMENT, window(0));
        let mut rays = ray_entries(device, ShaderStages::FRAGMENT);
        rays.push(seen_by(BOTH, integers(DOUBTS)));
        let estimate = [writable(0), writable(1)].map(|entry| seen_by(COMPUTE, entry));
        Self {
            scene: layout(device, "cells and light", &scene),
            receivers: layout(device, "receivers", &receivers),
            work: layout(device, "tile batch", &work),
            result: layout(
                device,
                "refined tiles",
                &[
                    tile_pass,
                    storage(1),
                    texture(2),
                    uniform(3),
                    texture(4),
                    seen_by(ShaderStages::FRAGMENT, integers(5)),
                ],
            ),
            estimate: layout(device, "irradiance estimate", &estimate),
            rays: layout(device, "rays", &rays),
        }
    }
}

impl Pipelines {
    pub fn new(device: &wgpu::Device, options: &HierarchicalOptions) -> Self {
        let HierarchicalOptions { filter, light, visibility, refraction, medium } = *options;
        let layouts = Layouts::new(device);
        let with_groups = |more: &[&BindGroupLayout]| {
            let groups = [&[&layouts.scene, &layouts.receivers], more].concat();
            device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("hierarchical gather"),
                bind_group_layouts: &groups.into_iter().map(Some).collect::<Vec<_>>(),
                immediate_size: 0,
            })
        };
        let switch = |is_on: bool| f64::from(u8::from(is_on));
        let constants: Constants = [
            ("FILTER", f64::from(filter_constant(light.filter(filter)))),
            ("LIGHT", f64::from(light.constant())),
            ("VISIBILITY", switch(visibility)),
            ("REFRACTION", switch(refraction)),
        ];
        let (work, estimate) = (with_groups(&[&layouts.work, &layouts.rays]), with_groups(&[&layouts.estimate]));
        let module = |shader: Shader| shader.module_in(device, light, medium);
        let of_estimate = module(IRRADIANCE_ESTIMATE);
        let layout = with_groups(&[&layouts.result, &layouts.rays]);
        let resolve = ResolveSource { module: module(RESOLVE), layout, constants };
        let compute = |layout, module: &wgpu::ShaderModule, entry, constants: &[(&str, f64)]| {
            compute_pipeline(device, layout, module, entry, constants)
        };
        Self {
            passes: Passes {
                receiver_blocks: compute(&work, &module(RECEIVER_BLOCKS), "make_block", &[]),
                refine: compute(&work, &module(REFINE), "refine", &constants),
                estimate: compute(&estimate, &of_estimate, "estimate", &constants[1..]),
                set_tolerance: compute(&estimate, &of_estimate, "set_tolerance", &[]),
                resolve: resolve.compile(device, false),
            },
            resolve_towards_viewers: OnceLock::new(),
            resolve,
            layouts,
            placeholders: LightPlaceholders::new(device),
            trilinear: linear_sampler(device, 1),
            anisotropic: linear_sampler(device, 16),
        }
    }

    /// The passes of an image with, or without, viewers.
    pub fn passes(&self, device: &wgpu::Device, has_viewers: bool) -> Passes {
        let mut passes = self.passes.clone();
        if has_viewers {
            passes.resolve = self.resolve_towards_viewers.get_or_init(|| self.resolve.compile(device, true)).clone();
        }
        passes
    }
}

impl ResolveSource {
    fn compile(&self, device: &wgpu::Device, shading: bool) -> wgpu::RenderPipeline {
        let constants = [&self.constants[..], &[("SHADING", f64::from(u8::from(shading)))]].concat();
        let targets = [TARGET_FORMAT, WALK_FORMAT].map(|format| Some(format.into()));
        render_pipeline(device, &self.layout, &self.module, ["tile_corner", "resolve"], &constants, &targets)
    }
}

/// The bounds of the light: a texture that is not filtered.
pub(super) fn bounds_texture(binding: u32) -> BindGroupLayoutEntry {
    let sample_type = wgpu::TextureSampleType::Float { filterable: false };
    let view_dimension = TextureViewDimension::D2Array;
    entry(binding, BindingType::Texture { sample_type, view_dimension, multisampled: false })
}
