//! Layouts, samplers and pipelines of the gather.

use std::sync::OnceLock;

use wgpu::{BindGroupLayoutEntry, BindingType, ShaderStages, TextureSampleType, TextureViewDimension};

use super::near_light::LightPlaceholders;
use super::shaders::{GATHER, Shader};
use super::sources::Sources;
use super::{GatherOptions, TARGET_FORMAT};
use crate::pinhole::constants::{FILTER_ANISOTROPIC, FILTER_EWA, FILTER_HARDWARE, FILTER_ISOTROPIC, FILTER_NONE};
use crate::pinhole::{BATCH_SIZE, Filter, PinholeSample};

/// Bytes of one batch of samples.
pub(crate) const BATCH_BYTES: u64 = BATCH_SIZE as u64 * size_of::<PinholeSample>() as u64;

#[derive(Debug)]
pub struct Pipelines {
    gather: wgpu::RenderPipeline,
    /// The same towards viewers, compiled when it is first needed.
    reflect: OnceLock<wgpu::RenderPipeline>,
    source: PipelineSource,
    pub placeholders: LightPlaceholders,
    inputs: wgpu::BindGroupLayout,
    pub receivers: wgpu::BindGroupLayout,
    previous: wgpu::BindGroupLayout,
    trilinear: wgpu::Sampler,
    anisotropic: wgpu::Sampler,
}

/// What the pipelines of a gather are compiled from.
#[derive(Debug)]
struct PipelineSource {
    module: wgpu::ShaderModule,
    layout: wgpu::PipelineLayout,
    options: GatherOptions,
    blends: bool,
}

impl Pipelines {
    pub fn new(device: &wgpu::Device, options: &GatherOptions, blends: bool) -> Self {
        let inputs = layout(device, "gather inputs", &[&gather_inputs()[..], &[window(GATHER_INPUTS)]].concat());
        let receivers = layout(device, "receivers", &[texture(0), texture(1), texture(2), storage(3), storage(4)]);
        let previous = layout(device, "previous target", &[texture(0)]);
        let groups = [Some(&inputs), Some(&receivers), Some(&previous)];
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("gather"),
            bind_group_layouts: if blends { &groups[..2] } else { &groups },
            immediate_size: 0,
        });
        let module = GATHER.module_in(device, options.light, options.medium);
        let source = PipelineSource { module, layout, options: *options, blends };
        Self {
            gather: source.compile(device, false),
            reflect: OnceLock::new(),
            source,
            placeholders: LightPlaceholders::new(device),
            inputs,
            receivers,
            previous,
            trilinear: linear_sampler(device, 1),
            anisotropic: linear_sampler(device, 16),
        }
    }

    pub fn options(&self) -> &GatherOptions {
        &self.source.options
    }

    /// The pipeline for receivers with or without viewers.
    pub fn pipeline(&self, device: &wgpu::Device, has_viewers: bool) -> &wgpu::RenderPipeline {
        if has_viewers { self.reflect.get_or_init(|| self.source.compile(device, true)) } else { &self.gather }
    }

    pub(super) fn bind_inputs(&self, device: &wgpu::Device, sources: &Sources) -> wgpu::BindGroup {
        let samples = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &sources.samples,
            offset: 0,
            size: std::num::NonZero::new(BATCH_BYTES),
        });
        let common = [
            sources.uniforms.as_entire_binding(),
            sources.light.environment(),
            wgpu::BindingResource::Sampler(&self.trilinear),
            wgpu::BindingResource::Sampler(&self.anisotropic),
            sources.curves.as_entire_binding(),
            sources.planes.as_entire_binding(),
            sources.sky_masks.as_entire_binding(),
        ];
        bind(device, &self.inputs, &[&common[..], &sources.light.near(), &[samples]].concat())
    }

    pub fn bind_previous(&self, device: &wgpu::Device, target: &wgpu::TextureView) -> wgpu::BindGroup {
        bind(device, &self.previous, &[wgpu::BindingResource::TextureView(target)])
    }
}

impl PipelineSource {
    fn compile(&self, device: &wgpu::Device, shading: bool) -> wgpu::RenderPipeline {
        let Self { module, layout, options, blends } = self;
        let GatherOptions { filter, light, visibility, refraction, .. } = *options;
        let add = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::One,
            dst_factor: wgpu::BlendFactor::One,
            operation: wgpu::BlendOperation::Add,
        };
        let constants = [
            ("FILTER", f64::from(filter_constant(light.filter(filter)))),
            ("LIGHT", f64::from(light.constant())),
            ("VISIBILITY", f64::from(u8::from(visibility))),
            ("SHADING", f64::from(u8::from(shading))),
            ("REFRACTION", f64::from(u8::from(refraction))),
        ];
        render_pipeline(
            device,
            layout,
            module,
            ["full_screen", if *blends { "gather" } else { "gather_onto_previous" }],
            &constants,
            &[Some(wgpu::ColorTargetState {
                format: TARGET_FORMAT,
                blend: blends.then_some(wgpu::BlendState { color: add, alpha: add }),
                write_mask: wgpu::ColorWrites::ALL,
            })],
        )
    }
}

/// A pipeline of two of a module's entry points, without vertex buffers.
pub(crate) fn render_pipeline(
    device: &wgpu::Device,
    layout: &wgpu::PipelineLayout,
    module: &wgpu::ShaderModule,
    [vertex, fragment]: [&str; 2],
    constants: &[(&str, f64)],
    targets: &[Option<wgpu::ColorTargetState>],
) -> wgpu::RenderPipeline {
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(fragment),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(vertex),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(fragment),
            compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
            targets,
        }),
        multiview_mask: None,
        cache: None,
    })
}

pub(crate) fn compute_pipeline(
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

/// The pipelines of a shader's entry points.
pub(crate) fn compile<const N: usize>(
    device: &wgpu::Device,
    shader: Shader,
    groups: [&wgpu::BindGroupLayout; 4],
    entries: [&str; N],
) -> [wgpu::ComputePipeline; N] {
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(shader.name),
        bind_group_layouts: &groups.map(Some),
        immediate_size: 0,
    });
    let module = shader.module(device);
    entries.map(|entry| compute_pipeline(device, &pipeline_layout, &module, entry, &[]))
}

/// A buffer that shaders write.
pub fn writable(binding: u32) -> BindGroupLayoutEntry {
    let ty = wgpu::BufferBindingType::Storage { read_only: false };
    entry(binding, BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None })
}

/// A texture that shaders write.
pub fn written(binding: u32, format: wgpu::TextureFormat) -> BindGroupLayoutEntry {
    let access = wgpu::StorageTextureAccess::WriteOnly;
    entry(binding, BindingType::StorageTexture { access, format, view_dimension: TextureViewDimension::D2 })
}

/// The shader's `FILTER_…` constants.
pub(crate) fn filter_constant(filter: Filter) -> u32 {
    match filter {
        Filter::None => FILTER_NONE,
        Filter::Isotropic => FILTER_ISOTROPIC,
        Filter::Anisotropic => FILTER_ANISOTROPIC,
        Filter::Hardware => FILTER_HARDWARE,
        Filter::Ewa => FILTER_EWA,
    }
}

/// Bindings of `shaders/shared/gather_inputs.wgsl`.
pub(crate) const GATHER_INPUTS: u32 = 10;

pub(crate) fn gather_inputs() -> [BindGroupLayoutEntry; GATHER_INPUTS as usize] {
    [
        uniform(0),
        cube(1),
        sampler(2),
        sampler(3),
        storage(4),
        storage(5),
        storage(6),
        texture(7),
        cube_array(8),
        cube_array(9),
    ]
}

pub(crate) fn linear_sampler(device: &wgpu::Device, anisotropy_clamp: u16) -> wgpu::Sampler {
    device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("environment"),
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        mipmap_filter: wgpu::MipmapFilterMode::Linear,
        anisotropy_clamp,
        ..Default::default()
    })
}

pub fn layout(device: &wgpu::Device, label: &str, entries: &[BindGroupLayoutEntry]) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries })
}

/// Binds resources in the order of their binding numbers.
pub(crate) fn bind(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    resources: &[wgpu::BindingResource],
) -> wgpu::BindGroup {
    bind_numbered(device, layout, (0..).zip(resources.iter().cloned()))
}

/// The same for bindings with gaps between their numbers.
pub(crate) fn bind_numbered<'a>(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    resources: impl IntoIterator<Item = (u32, wgpu::BindingResource<'a>)>,
) -> wgpu::BindGroup {
    let entry = |(binding, resource)| wgpu::BindGroupEntry { binding, resource };
    let entries: Vec<_> = resources.into_iter().map(entry).collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}

pub fn entry(binding: u32, ty: BindingType) -> BindGroupLayoutEntry {
    BindGroupLayoutEntry { binding, visibility: ShaderStages::FRAGMENT, ty, count: None }
}

fn buffer(binding: u32, ty: wgpu::BufferBindingType) -> BindGroupLayoutEntry {
    entry(binding, BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None })
}

pub fn uniform(binding: u32) -> BindGroupLayoutEntry {
    buffer(binding, wgpu::BufferBindingType::Uniform)
}

/// An entry that other stages see.
pub(crate) fn seen_by(stages: ShaderStages, entry: BindGroupLayoutEntry) -> BindGroupLayoutEntry {
    BindGroupLayoutEntry { visibility: stages, ..entry }
}

/// A uniform buffer whose start is given when it is bound.
pub fn window(binding: u32) -> BindGroupLayoutEntry {
    let ty = wgpu::BufferBindingType::Uniform;
    entry(binding, BindingType::Buffer { ty, has_dynamic_offset: true, min_binding_size: None })
}

pub fn storage(binding: u32) -> BindGroupLayoutEntry {
    buffer(binding, wgpu::BufferBindingType::Storage { read_only: true })
}

pub fn cube(binding: u32) -> BindGroupLayoutEntry {
    entry(
        binding,
        BindingType::Texture {
            sample_type: TextureSampleType::Float { filterable: true },
            view_dimension: TextureViewDimension::Cube,
            multisampled: false,
        },
    )
}

fn cube_array(binding: u32) -> BindGroupLayoutEntry {
    entry(
        binding,
        BindingType::Texture {
            sample_type: TextureSampleType::Float { filterable: true },
            view_dimension: TextureViewDimension::CubeArray,
            multisampled: false,
        },
    )
}

pub(crate) fn sampler(binding: u32) -> BindGroupLayoutEntry {
    entry(binding, BindingType::Sampler(wgpu::SamplerBindingType::Filtering))
}

pub fn texture(binding: u32) -> BindGroupLayoutEntry {
    entry(
        binding,
        BindingType::Texture {
            sample_type: TextureSampleType::Float { filterable: false },
            view_dimension: TextureViewDimension::D2,
            multisampled: false,
        },
    )
}
