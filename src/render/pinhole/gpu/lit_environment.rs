//! Emitters drawn into the environment's cube map on the GPU, and its mips, again in every frame (Wand and Straßer 2003, Section 3.1).
//! CPU twin: [`crate::environment::LightGeometry`]. Shaders: `shaders/emitters.wgsl`, `lit_environment.wgsl`, `coarser_level.wgsl`.
//! Records passes; does not submit.

mod emitter;

use std::num::NonZero;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::{Mat3, Mat4, Vec3, Vec4};
use wgpu::{BindGroupLayout, BindingResource, BufferUsages, ShaderStages, TextureFormat, TextureUsages, TextureView};

pub use self::emitter::PlacedEmitter;
use self::emitter::{Placed, UploadedMesh};
use super::EnvironmentCube;
use super::environment::HALF_MAX;
use super::geometry::integers;
use super::hierarchical::DYNAMIC_OFFSET;
use super::pipeline::{bind, compute_pipeline, cube, layout, linear_sampler, sampler, seen_by, storage, window};
use super::shaders::{COARSER_LEVEL, EMITTERS, LIT_ENVIRONMENT, Shader};
use crate::environment::{FACES, FaceAxes};
use crate::gpu::KeptBuffer;

/// Points along a texel's edge, where textures are large enough.
const POINTS: u32 = 4;
/// Edge of the workgroups of compute passes.
const WORKGROUP_EDGE: u32 = 8;
/// The nearest that is drawn, relative to the farthest.
const NEAR: f32 = 1e-4;
const NUMBERS: TextureFormat = TextureFormat::R16Uint;
const DEPTH: TextureFormat = TextureFormat::Depth32Float;

/// An emitter on a face.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(super) struct EmitterUniforms {
    pub clip_from_mesh: [[f32; 4]; 4],
    pub number: u32,
    padding: [u32; 3],
}

/// A face of the cube map.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(super) struct LitFace {
    pub face: u32,
    pub points: u32,
    pub background_factor: f32,
    padding: u32,
}

/// From where emitters are seen, and what lies behind them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CubeView {
    /// In the world, metres.
    pub centre: Vec3,
    /// Of the environment about +Y, counter-clockwise, radians.
    pub rotation_rad: f32,
    /// Factor on the background's radiance.
    pub intensity: f32,
}

/// The passes on one device.
#[derive(Debug)]
pub(crate) struct LitPipelines {
    draw: wgpu::RenderPipeline,
    light_texels: wgpu::ComputePipeline,
    average: wgpu::ComputePipeline,
    of_emitter: BindGroupLayout,
    of_face: BindGroupLayout,
    of_level: BindGroupLayout,
    trilinear: wgpu::Sampler,
    /// Of the cube maps that they make: the one that the device filters.
    format: TextureFormat,
}

/// A cube map of the environment behind emitters.
#[derive(Debug)]
pub(crate) struct LitEnvironment {
    pipelines: Arc<LitPipelines>,
    background: Arc<EnvironmentCube>,
    cube: Arc<EnvironmentCube>,
    /// One level each, as an array of faces.
    levels: Vec<TextureView>,
    numbers: TextureView,
    depth: TextureView,
    points: u32,
    meshes: Vec<UploadedMesh>,
    /// Of emitters on faces, of faces, and the emitters' radiance.
    buffers: [KeptBuffer; 3],
    of_levels: Vec<wgpu::BindGroup>,
    frame: Option<Frame>,
}

/// What is drawn in a frame.
#[derive(Debug)]
struct Frame {
    buffers: [wgpu::Buffer; 3],
    of_emitters: wgpu::BindGroup,
    of_faces: wgpu::BindGroup,
    /// By face: the numbers of emitters that it may show, from 0 on, and their meshes.
    shown: [Vec<(u32, usize)>; FACES],
    emitter_count: u32,
}

impl LitPipelines {
    /// Compiles the shaders.
    pub fn new(device: &wgpu::Device) -> Self {
        let wide = device.features().contains(wgpu::Features::FLOAT32_FILTERABLE);
        let format = if wide { TextureFormat::Rgba32Float } else { TextureFormat::Rgba16Float };
        let compute = |entries: &[wgpu::BindGroupLayoutEntry]| -> BindGroupLayout {
            let entries: Vec<_> = entries.iter().map(|entry| seen_by(ShaderStages::COMPUTE, *entry)).collect();
            layout(device, "environment behind emitters", &entries)
        };
        let of_emitter = layout(device, "emitter", &[seen_by(ShaderStages::VERTEX_FRAGMENT, window(0))]);
        let of_face = compute(&[window(0), integers(1), cube(2), sampler(3), storage(4), written_faces(5, format)]);
        let of_level = compute(&[faces(0), written_faces(1, format)]);
        let pipeline = |shader: Shader, group: &BindGroupLayout, entry: &str| {
            let module = shader.module_writing(device, format);
            compute_pipeline(device, &pipeline_layout(device, group), &module, entry, &[])
        };
        Self {
            draw: draw_pipeline(device, &of_emitter),
            light_texels: pipeline(LIT_ENVIRONMENT, &of_face, "light_texels"),
            average: pipeline(COARSER_LEVEL, &of_level, "average"),
            of_emitter,
            of_face,
            of_level,
            trilinear: linear_sampler(device, 1),
            format,
        }
    }
}

fn pipeline_layout(device: &wgpu::Device, group: &BindGroupLayout) -> wgpu::PipelineLayout {
    device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("environment behind emitters"),
        bind_group_layouts: &[Some(group)],
        immediate_size: 0,
    })
}

fn draw_pipeline(device: &wgpu::Device, of_emitter: &BindGroupLayout) -> wgpu::RenderPipeline {
    let module = EMITTERS.module(device);
    let position = wgpu::VertexAttribute { format: wgpu::VertexFormat::Float32x3, offset: 0, shader_location: 0 };
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("emitters"),
        layout: Some(&pipeline_layout(device, of_emitter)),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("place"),
            compilation_options: Default::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<Vec3>() as u64,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &[position],
            })],
        },
        primitive: Default::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("number"),
            compilation_options: Default::default(),
            targets: &[Some(NUMBERS.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// The faces of a level that shaders write.
fn written_faces(binding: u32, format: TextureFormat) -> wgpu::BindGroupLayoutEntry {
    let (access, view_dimension) = (wgpu::StorageTextureAccess::WriteOnly, wgpu::TextureViewDimension::D2Array);
    super::pipeline::entry(binding, wgpu::BindingType::StorageTexture { access, format, view_dimension })
}

/// The faces of a level that shaders read.
fn faces(binding: u32) -> wgpu::BindGroupLayoutEntry {
    let sample_type = wgpu::TextureSampleType::Float { filterable: false };
    let view_dimension = wgpu::TextureViewDimension::D2Array;
    super::pipeline::entry(binding, wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false })
}

impl LitEnvironment {
    /// A cube map as fine as that of the environment behind it; nothing is drawn yet.
    pub fn new(device: &wgpu::Device, pipelines: Arc<LitPipelines>, background: Arc<EnvironmentCube>) -> Self {
        let size = background.size();
        let descriptor = |label, size: u32, layers: u32, levels: u32, format, usage| wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width: size, height: size, depth_or_array_layers: layers },
            mip_level_count: levels,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        };
        let level_count = size.ilog2() + 1;
        let usage = TextureUsages::TEXTURE_BINDING | TextureUsages::STORAGE_BINDING | TextureUsages::COPY_SRC;
        let lit = descriptor("environment behind emitters", size, FACES as u32, level_count, pipelines.format, usage);
        let texture = device.create_texture(&lit);
        let level = |level| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                base_mip_level: level,
                mip_level_count: Some(1),
                ..Default::default()
            })
        };
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::Cube),
            ..Default::default()
        });
        let most = device.limits().max_texture_dimension_2d;
        let points = (1..=POINTS).rev().find(|points| points * size <= most).unwrap_or(1);
        let attachment = |label, format, usage| {
            let usage = usage | TextureUsages::RENDER_ATTACHMENT;
            device
                .create_texture(&descriptor(label, points * size, 1, 1, format, usage))
                .create_view(&Default::default())
        };
        let levels: Vec<TextureView> = (0..level_count).map(level).collect();
        let average = |pair: &[TextureView]| {
            bind(device, &pipelines.of_level, &[&pair[0], &pair[1]].map(BindingResource::TextureView))
        };
        let of_levels = levels.windows(2).map(average).collect();
        Self {
            levels,
            cube: Arc::new(EnvironmentCube::from_view(view, size, 1.0)),
            numbers: attachment("emitters' numbers", NUMBERS, TextureUsages::TEXTURE_BINDING),
            depth: attachment("emitters' depth", DEPTH, TextureUsages::empty()),
            points,
            pipelines,
            background,
            meshes: Vec::new(),
            buffers: [
                KeptBuffer::new("emitters", BufferUsages::UNIFORM),
                KeptBuffer::new("faces", BufferUsages::UNIFORM),
                KeptBuffer::new("emitters' radiance", BufferUsages::STORAGE),
            ],
            of_levels,
            frame: None,
        }
    }

    /// The environment behind the emitters.
    pub fn background(&self) -> &Arc<EnvironmentCube> {
        &self.background
    }

    /// The cube map, as it will be once what is recorded next is done.
    pub fn cube(&self) -> &Arc<EnvironmentCube> {
        &self.cube
    }

    /// Takes over where emitters are, and from where they are seen.
    pub fn update(
        &mut self,
        (device, queue): (&wgpu::Device, &wgpu::Queue),
        emitters: &[PlacedEmitter],
        view: CubeView,
    ) {
        self.upload(device, emitters);
        let wide = self.pipelines.format == TextureFormat::Rgba32Float;
        let brightest = emitters.iter().map(|emitter| emitter.radiance.max_element()).fold(0.0, f32::max);
        let behind = view.intensity * self.background.radiance_scale();
        let scale = if wide { 1.0 } else { behind.max(brightest / HALF_MAX).max(1.0) };
        let cube = &self.cube;
        if cube.radiance_scale().to_bits() != scale.to_bits() {
            self.cube = Arc::new(EnvironmentCube::from_view(cube.view().clone(), cube.size(), scale));
        }
        let placed: Vec<Placed> =
            emitters.iter().map(|emitter| Placed::new(emitter, &self.meshes, view.centre)).collect();
        let farthest = placed.iter().map(|p| p.centre.length() + p.radius).fold(f32::MIN_POSITIVE, f32::max);
        let axes: [FaceAxes; FACES] =
            std::array::from_fn(|face| FaceAxes::new(face, Mat3::from_rotation_y(view.rotation_rad)));
        let may_show = |face: usize, (_, placed): &(u32, &Placed)| axes[face].may_show(placed.centre, placed.radius);
        let shown = std::array::from_fn(|face| {
            let emitters = (0..).zip(&placed).filter(|emitter| may_show(face, emitter));
            emitters.map(|(number, placed)| (number, placed.mesh)).collect::<Vec<_>>()
        });
        let (mut of_emitters, mut of_faces) = (Vec::new(), Vec::new());
        for (face, axes) in axes.iter().enumerate() {
            let clip_from_world = clip_from_world(axes, view.centre, NEAR * farthest);
            for (number, placed) in (1..).zip(&placed) {
                let clip_from_mesh = (clip_from_world * placed.world_from_mesh).to_cols_array_2d();
                add_window(&mut of_emitters, &EmitterUniforms { clip_from_mesh, number, padding: [0; 3] });
            }
            let points = if shown[face].is_empty() { 0 } else { self.points };
            let background_factor = behind / scale;
            add_window(&mut of_faces, &LitFace { face: face as u32, points, background_factor, padding: 0 });
        }
        let radiance: Vec<Vec4> = emitters.iter().map(|emitter| (emitter.radiance / scale).extend(1.0)).collect();
        let contents = [&of_emitters[..], &of_faces, bytemuck::cast_slice(&radiance)];
        let [a, b, c] = &mut self.buffers;
        let [x, y, z] = contents;
        let buffers = [a.with(device, queue, x), b.with(device, queue, y), c.with(device, queue, z)];
        let emitter_count = (of_emitters.len() / FACES / DYNAMIC_OFFSET as usize) as u32;
        self.frame = Some(match self.frame.take().filter(|frame| frame.buffers == buffers) {
            Some(frame) => Frame { shown, emitter_count, ..frame },
            None => self.bind(device, buffers, emitter_count, shown),
        });
    }

    /// Records the passes that draw the emitters and make the mips.
    pub fn record(&self, encoder: &mut wgpu::CommandEncoder) {
        let Some(frame) = &self.frame else { return };
        for face in 0..FACES {
            if !frame.shown[face].is_empty() {
                self.draw(encoder, frame, face);
            }
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&self.pipelines.light_texels);
            pass.set_bind_group(0, &frame.of_faces, &[offset(face as u32)]);
            let groups = self.cube.size().div_ceil(WORKGROUP_EDGE);
            pass.dispatch_workgroups(groups, groups, 1);
        }
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.pipelines.average);
        for (level, group) in (1..).zip(&self.of_levels) {
            pass.set_bind_group(0, group, &[]);
            let groups = (self.cube.size() >> level).div_ceil(WORKGROUP_EDGE);
            pass.dispatch_workgroups(groups, groups, FACES as u32);
        }
    }

    fn draw(&self, encoder: &mut wgpu::CommandEncoder, frame: &Frame, face: usize) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("emitters"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.numbers,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipelines.draw);
        for &(number, mesh) in &frame.shown[face] {
            let mesh = &self.meshes[mesh];
            pass.set_bind_group(0, &frame.of_emitters, &[offset(face as u32 * frame.emitter_count + number)]);
            pass.set_vertex_buffer(0, mesh.corners.slice(..));
            pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..3 * mesh.mesh.triangles().len() as u32, 0, 0..1);
        }
    }

    fn upload(&mut self, device: &wgpu::Device, emitters: &[PlacedEmitter]) {
        self.meshes.retain(|known| emitters.iter().any(|emitter| Arc::ptr_eq(&emitter.mesh, &known.mesh)));
        for emitter in emitters {
            if !self.meshes.iter().any(|known| Arc::ptr_eq(&known.mesh, &emitter.mesh)) {
                self.meshes.push(UploadedMesh::new(device, &emitter.mesh));
            }
        }
    }

    fn bind(
        &self,
        device: &wgpu::Device,
        buffers: [wgpu::Buffer; 3],
        emitter_count: u32,
        shown: [Vec<(u32, usize)>; FACES],
    ) -> Frame {
        let LitPipelines { of_emitter, of_face, trilinear, .. } = &*self.pipelines;
        let [emitters, faces, radiance] = &buffers;
        let own = [
            window_of::<LitFace>(faces),
            BindingResource::TextureView(&self.numbers),
            BindingResource::TextureView(self.background.view()),
            BindingResource::Sampler(trilinear),
            radiance.as_entire_binding(),
            BindingResource::TextureView(&self.levels[0]),
        ];
        let of_emitters = bind(device, of_emitter, &[window_of::<EmitterUniforms>(emitters)]);
        Frame { of_emitters, of_faces: bind(device, of_face, &own), buffers, emitter_count, shown }
    }
}

/// A projection on a face; depth is 1 at `near` and 0 at infinity.
fn clip_from_world(face: &FaceAxes, centre: Vec3, near: f32) -> Mat4 {
    let [right, down, towards] = face.axes;
    let row = |axis: Vec3| axis.extend(-axis.dot(centre));
    Mat4::from_cols(row(right), row(-down), Vec4::new(0.0, 0.0, 0.0, near), row(towards)).transpose()
}

/// Adds what a dispatch or a draw reads from a uniform buffer.
fn add_window<T: Pod>(bytes: &mut Vec<u8>, uniforms: &T) {
    bytes.extend_from_slice(bytemuck::bytes_of(uniforms));
    bytes.resize(bytes.len().next_multiple_of(DYNAMIC_OFFSET as usize), 0);
}

fn window_of<T>(buffer: &wgpu::Buffer) -> BindingResource<'_> {
    BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size: NonZero::new(size_of::<T>() as u64) })
}

fn offset(index: u32) -> u32 {
    index * DYNAMIC_OFFSET as u32
}

#[cfg(all(test, feature = "blocking"))]
mod tests;
