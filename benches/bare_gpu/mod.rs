//! A fragment shader that does nothing but trilinear look-ups of a cube map: the yardstick of the gather.

use pinspot::blocking::wait;
use pinspot::low_level::gpu::Gpu;
use pinspot::low_level::pinhole::gpu::{EnvironmentCube, TARGET_FORMAT};
use pinspot::wgpu;
use wgpu::util::DeviceExt;

pub struct BareLoop {
    pipeline: wgpu::RenderPipeline,
    target: wgpu::TextureView,
    cube: wgpu::TextureView,
    sampler: wgpu::Sampler,
}

impl BareLoop {
    /// A loop over `edge`² pixels.
    pub fn new(gpu: &Gpu, environment: &EnvironmentCube, edge: u32) -> Self {
        let device = &gpu.device;
        let module = device.create_shader_module(wgpu::include_wgsl!("bare_gpu.wgsl"));
        let stage = |entry_point| (Some(entry_point), wgpu::PipelineCompilationOptions::default());
        let (vertex, vertex_options) = stage("full_screen");
        let (fragment, fragment_options) = stage("bare");
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("bare look-ups"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: vertex,
                compilation_options: vertex_options,
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: fragment,
                compilation_options: fragment_options,
                targets: &[Some(TARGET_FORMAT.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let target = device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: edge, height: edge, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: TARGET_FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        Self { pipeline, target: target.create_view(&Default::default()), cube: environment.view().clone(), sampler }
    }

    /// `count` look-ups a pixel at levels from `levels[0]` to `levels[1]`; waits until they are done.
    pub fn run(&self, gpu: &Gpu, count: u32, levels: [f32; 2]) {
        let device = &gpu.device;
        let uniforms = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: None,
            contents: bytemuck::cast_slice(&[count, levels[0].to_bits(), (levels[1] - levels[0]).to_bits(), 0]),
            usage: wgpu::BufferUsages::UNIFORM,
        });
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[
                entry(0, uniforms.as_entire_binding()),
                entry(1, wgpu::BindingResource::TextureView(&self.cube)),
                entry(2, wgpu::BindingResource::Sampler(&self.sampler)),
            ],
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: None,
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &self.target,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                ..Default::default()
            });
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.draw(0..3, 0..1);
        }
        gpu.queue.submit([encoder.finish()]);
        wait(Some(&gpu.device), gpu.submitted_work_done()).expect("the device stays");
    }
}
