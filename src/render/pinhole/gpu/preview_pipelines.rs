//! Layouts and pipelines of a preview's passes, which `engine/preview/on_gpu` records.

use wgpu::{BindGroupLayout, BindGroupLayoutEntry, ShaderStages, TextureFormat};

use super::geometry::ray_entries;
use super::pipeline::{
    compile, cube, layout, linear_sampler, sampler, seen_by, storage, texture, uniform, writable, written,
};
use super::shaders::{PREVIEW_DISPLAY, PREVIEW_LIGHT, PREVIEW_SHADING, PREVIEW_VIEWS};

/// The group of each shader's own buffers and, for light, those of the other layer and of the gather.
#[derive(Debug)]
pub(crate) struct PreviewLayouts {
    pub views: BindGroupLayout,
    pub light: BindGroupLayout,
    pub other: BindGroupLayout,
    pub gather: BindGroupLayout,
    pub shading: BindGroupLayout,
    pub display: BindGroupLayout,
    pub nothing: BindGroupLayout,
    pub rays: BindGroupLayout,
}

/// The passes of previews on one device.
#[derive(Debug)]
pub(crate) struct PreviewPipelines {
    pub trace_views: wgpu::ComputePipeline,
    pub begin: wgpu::ComputePipeline,
    pub begin_behind_mirrors: wgpu::ComputePipeline,
    pub light_nodes: wgpu::ComputePipeline,
    pub light_between: wgpu::ComputePipeline,
    pub add_caustic: wgpu::ComputePipeline,
    pub shade: wgpu::ComputePipeline,
    pub meter: wgpu::ComputePipeline,
    pub display: wgpu::ComputePipeline,
    pub smooth_edges: wgpu::ComputePipeline,
    pub layouts: PreviewLayouts,
    pub trilinear: wgpu::Sampler,
}

impl PreviewLayouts {
    fn new(device: &wgpu::Device) -> Self {
        let of = |label, entries: &[BindGroupLayoutEntry]| {
            let entries: Vec<_> = entries.iter().map(|entry| seen_by(ShaderStages::COMPUTE, *entry)).collect();
            layout(device, label, &entries)
        };
        let picture = |binding| written(binding, TextureFormat::Rgba32Float);
        Self {
            views: of(
                "views",
                &[
                    uniform(0),
                    storage(1),
                    storage(2),
                    writable(3),
                    writable(4),
                    writable(5),
                    writable(6),
                    writable(7),
                    storage(8),
                ],
            ),
            light: of(
                "light",
                &[
                    uniform(0),
                    storage(1),
                    writable(2),
                    storage(3),
                    cube(4),
                    sampler(5),
                    writable(6),
                    storage(7),
                    cube(8),
                    storage(9),
                ],
            ),
            other: of("other layer", &[storage(0), storage(1)]),
            gather: of("gather", &[picture(0), picture(1), texture(2), uniform(3)]),
            shading: of(
                "shading",
                &[
                    uniform(0),
                    storage(1),
                    storage(2),
                    storage(3),
                    storage(4),
                    storage(5),
                    writable(6),
                    cube(7),
                    cube(8),
                    sampler(9),
                    storage(10),
                    writable(11),
                    texture(12),
                ],
            ),
            display: of(
                "display",
                &[
                    uniform(0),
                    storage(1),
                    storage(2),
                    storage(3),
                    writable(4),
                    writable(5),
                    picture(6),
                    written(7, TextureFormat::Rgba8Unorm),
                    writable(8),
                ],
            ),
            nothing: of("nothing", &[]),
            rays: of("rays", &ray_entries(device, ShaderStages::COMPUTE)),
        }
    }
}

impl PreviewPipelines {
    pub fn new(device: &wgpu::Device) -> Self {
        let layouts = PreviewLayouts::new(device);
        let none = &layouts.nothing;
        let [trace_views] =
            compile(device, PREVIEW_VIEWS, [&layouts.views, none, none, &layouts.rays], ["trace_views"]);
        let of_light = [&layouts.light, &layouts.other, &layouts.gather, &layouts.rays];
        let [begin, begin_behind_mirrors, light_nodes, light_between, add_caustic] = compile(
            device,
            PREVIEW_LIGHT,
            of_light,
            ["begin", "begin_behind_mirrors", "light_nodes", "light_between", "add_caustic"],
        );
        let [shade] = compile(device, PREVIEW_SHADING, [&layouts.shading, none, none, &layouts.rays], ["shade"]);
        let of_display = [&layouts.display, none, none, &layouts.rays];
        let [meter, display, smooth_edges] =
            compile(device, PREVIEW_DISPLAY, of_display, ["meter", "display", "smooth_edges"]);
        Self {
            trace_views,
            begin,
            begin_behind_mirrors,
            light_nodes,
            light_between,
            add_caustic,
            shade,
            meter,
            display,
            smooth_edges,
            trilinear: linear_sampler(device, 1),
            layouts,
        }
    }
}
