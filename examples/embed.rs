//! Pinspot inside a program with a wgpu device of its own: its own G-buffer and encoder, a mirror that moves, the caustic as a
//! texture.
//!
//! `cargo run --example embed [FILE.png]`
//!
//! What a host does is in [`Caustics`] and [`cells_of`]. Everything else here is the host: a device, a rasterised G-buffer, a
//! read-back.

use glam::Vec3;
use glam::camera::rh;
use pinspot::image::{Image, display, write_png};
use pinspot::low_level::cell_tree::{CellTree, TreeOptions};
use pinspot::low_level::environment::{Environment, LightBounds};
use pinspot::low_level::pinhole::gpu::{
    CellTreeBuffers, EnvironmentCube, HierarchicalEngine, HierarchicalFrame, HierarchicalInputs, HierarchicalOptions,
    LightBoundsTexture, LightKind, Tolerance, TreeLight,
};
use pinspot::low_level::pinhole::{Params, PinholeTree};
use pinspot::low_level::sampling::{self, Surface, sample};
use pinspot::low_level::tracing::Tracer;
use pinspot::scene::{Scene, load};
use pinspot::{Filter, Settings, wgpu};
use wgpu::util::DeviceExt;

/// Pixels of a frame.
pub const SIZE: [u32; 2] = [96, 72];
/// Frames of the animation.
pub const FRAMES: u32 = 3;
/// The error that is allowed, as a part of the image's mean irradiance.
pub const TOLERANCE: f32 = 0.02;

/// A frame, read back.
pub struct Output {
    /// The host's G-buffer.
    pub positions: Vec<[f32; 4]>,
    /// The host's G-buffer.
    pub normals: Vec<[f32; 4]>,
    /// What Pinspot gathered: irradiance, W/m², and the number of fetches.
    pub caustic: Vec<[f32; 4]>,
}

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let file = std::env::args().nth(1).unwrap_or("embed.png".into());
    let frames = render_frames(FRAMES)?;
    // One below the other.
    let caustics = frames.iter().flat_map(|frame| &frame.caustic);
    let pixels = caustics.map(|c| display(Vec3::new(c[0], c[1], c[2]) * 0.25)).collect();
    write_png(file.as_ref(), &Image { width: SIZE[0], height: SIZE[1] * FRAMES, pixels })?;
    println!("{file}");
    Ok(())
}

/// What Pinspot keeps on the host's device.
struct Caustics {
    engine: HierarchicalEngine,
    /// The light: an upload, or a cube texture of the host's own.
    environment: EnvironmentCube,
    bounds: LightBoundsTexture,
}

impl Caustics {
    /// Once, and again for another light.
    fn new(device: &wgpu::Device, queue: &wgpu::Queue, scene: &Scene) -> Result<Self, Failure> {
        let light = Environment::new(&scene.environment.light, Default::default())?;
        let options = HierarchicalOptions {
            filter: Filter::Anisotropic,
            light: LightKind::Environment,
            visibility: true,
            refraction: false,
            medium: false,
        };
        Ok(Self {
            engine: HierarchicalEngine::new(device, &options),
            environment: EnvironmentCube::upload(device, queue, &light.cube)?,
            bounds: LightBoundsTexture::upload(device, queue, &LightBounds::new(&light.cube)),
        })
    }

    /// Every frame: records the gather behind the G-buffer, into the host's encoder. Nothing is submitted or read back.
    fn record(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        gbuffer: &GBuffer,
        cells: &CellTreeBuffers,
    ) -> Result<HierarchicalFrame, Failure> {
        let inputs = HierarchicalInputs {
            positions: &gbuffer.positions.create_view(&Default::default()),
            normals: &gbuffer.normals.create_view(&Default::default()),
            viewers: None,
            size: SIZE,
            is_grid: true,
            tree: cells,
            light: TreeLight::Environment { cube: &self.environment, bounds: &self.bounds },
            params: Params::default(),
            tolerance: Tolerance::Relative(TOLERANCE),
            has_tolerances: false,
            split_near: true,
            // One will do on hardware; Mesa's software adapter limits loops.
            split_passes: 64,
        };
        let mut frame = self.engine.frame(device, &inputs)?;
        frame.record(encoder, 0..frame.batch_count());
        Ok(frame)
    }
}

/// When anything moves: the hierarchy of samples, and what each sample sees.
pub fn cells_of(scene: &Scene) -> Result<PinholeTree, Failure> {
    let surface = Surface::of_scene(scene);
    let options = sampling::Options { samples: 300, strategy: Default::default(), seed: 1 };
    let cells = CellTree::new(&surface, &sample(&surface, &options)?, &TreeOptions { leaves: 16, seed: 1 });
    let mut tree = PinholeTree::new(scene, cells);
    tree.trace_visibility(scene, &Tracer::new(scene), &pinspot::NoProgress);
    Ok(tree)
}

/// The host's scene: the ring tilts from frame to frame.
pub fn scene_at(frame: u32) -> Result<Scene, Failure> {
    let mut scene = load::<Settings>("ring-natural")?.scene;
    let placement = &mut scene.objects[0].placement;
    placement.rotate_rad.z += 0.2 * frame as f32;
    placement.translate.y += 0.2 * frame as f32;
    Ok(scene)
}

/// The host: every frame is one encoder and one submission.
pub fn render_frames(count: u32) -> Result<Vec<Output>, Failure> {
    let (device, queue) = pollster::block_on(open_device())?;
    let caustics = Caustics::new(&device, &queue, &scene_at(0)?)?;
    let gbuffer = GBuffer::new(&device);
    let mut outputs = Vec::new();
    for number in 0..count {
        let scene = scene_at(number)?;
        let cells = CellTreeBuffers::upload(&device, &cells_of(&scene)?)?;
        let mut encoder = device.create_command_encoder(&Default::default());
        gbuffer.record(&device, &mut encoder, &scene);
        let frame = caustics.record(&device, &mut encoder, &gbuffer, &cells)?;
        // The caustic is a texture like any other; this host only reads it back.
        let textures = [&gbuffer.positions, &gbuffer.normals, frame.caustic()];
        let buffers = textures.map(|texture| copy_to_buffer(&device, &mut encoder, texture));
        queue.submit([encoder.finish()]);
        let [positions, normals, caustic] = buffers.map(|buffer| read(&device, &buffer));
        outputs.push(Output { positions: positions?, normals: normals?, caustic: caustic? });
    }
    Ok(outputs)
}

async fn open_device() -> Result<(wgpu::Device, wgpu::Queue), Failure> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = instance.request_adapter(&Default::default()).await?;
    let wanted = wgpu::Features::FLOAT32_FILTERABLE | wgpu::Features::FLOAT32_BLENDABLE;
    let descriptor = wgpu::DeviceDescriptor {
        required_features: adapter.features() & wanted,
        // Two 32-bit targets at once are twice what WebGPU promises by default.
        required_limits: wgpu::Limits { max_color_attachment_bytes_per_sample: 32, ..Default::default() },
        ..Default::default()
    };
    Ok(adapter.request_device(&descriptor).await?)
}

/// The host's G-buffer: world positions (w: the object's index, −1 for none) and normals towards the camera.
struct GBuffer {
    positions: wgpu::Texture,
    normals: wgpu::Texture,
    depth: wgpu::Texture,
    pipeline: wgpu::RenderPipeline,
}

const GBUFFER_SHADER: &str = "
struct View { clip_from_world: mat4x4f, camera: vec4f }
struct Varyings { @builtin(position) clip: vec4f, @location(0) position: vec4f, @location(1) normal: vec3f }
struct Targets { @location(0) position: vec4f, @location(1) normal: vec4f }
@group(0) @binding(0) var<uniform> view: View;
@vertex fn vertex(@location(0) position: vec4f, @location(1) normal: vec4f) -> Varyings {
    return Varyings(view.clip_from_world * vec4f(position.xyz, 1.0), position, normal.xyz);
}
@fragment fn fragment(in: Varyings) -> Targets {
    let n = normalize(in.normal);
    return Targets(in.position, vec4f(select(-n, n, dot(n, view.camera.xyz - in.position.xyz) > 0.0), 0.0));
}";

const GBUFFER_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

impl GBuffer {
    fn new(device: &wgpu::Device) -> Self {
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(GBUFFER_SHADER.into()),
        });
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("G-buffer"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vertex"),
                compilation_options: Default::default(),
                buffers: &[Some(wgpu::VertexBufferLayout {
                    array_stride: 32,
                    step_mode: wgpu::VertexStepMode::Vertex,
                    attributes: &wgpu::vertex_attr_array![0 => Float32x4, 1 => Float32x4],
                })],
            },
            primitive: Default::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH_FORMAT,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Less),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("fragment"),
                compilation_options: Default::default(),
                targets: &[Some(GBUFFER_FORMAT.into()), Some(GBUFFER_FORMAT.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        Self {
            positions: target(device, GBUFFER_FORMAT),
            normals: target(device, GBUFFER_FORMAT),
            depth: target(device, DEPTH_FORMAT),
            pipeline,
        }
    }

    fn record(&self, device: &wgpu::Device, encoder: &mut wgpu::CommandEncoder, scene: &Scene) {
        let vertices = vertices(scene);
        let vertex_buffer = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: None,
            contents: bytemuck::cast_slice(&vertices),
            usage: wgpu::BufferUsages::VERTEX,
        });
        let camera = scene.camera;
        let view_from_world = rh::view::look_to_mat4(camera.position, camera.forward, camera.up);
        let aspect = SIZE[0] as f32 / SIZE[1] as f32;
        let clip_from_view = rh::proj::directx::perspective(38f32.to_radians(), aspect, 0.1, 100.0);
        let mut view = (clip_from_view * view_from_world).to_cols_array().to_vec();
        view.extend(camera.position.extend(1.0).to_array());
        let uniforms = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: None,
            contents: bytemuck::cast_slice(&view),
            usage: wgpu::BufferUsages::UNIFORM,
        });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: uniforms.as_entire_binding() }],
        });
        let [positions, normals, depth] =
            [&self.positions, &self.normals, &self.depth].map(|t| t.create_view(&Default::default()));
        let clear = |view, clear| {
            Some(wgpu::RenderPassColorAttachment {
                view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(clear), store: wgpu::StoreOp::Store },
            })
        };
        let nothing = wgpu::Color { r: 0.0, g: 0.0, b: 0.0, a: -1.0 };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("G-buffer"),
            color_attachments: &[clear(&positions, nothing), clear(&normals, wgpu::Color::TRANSPARENT)],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(1.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.set_vertex_buffer(0, vertex_buffer.slice(..));
        pass.draw(0..vertices.len() as u32, 0..1);
    }
}

/// Position (w: object index, or −1 for what does not receive) and normal, triangle by triangle.
fn vertices(scene: &Scene) -> Vec<[[f32; 4]; 2]> {
    let mut vertices = Vec::new();
    for (index, object) in scene.objects.iter().enumerate() {
        let w = if object.receiver.is_some() { index as f32 } else { -1.0 };
        let mesh = object.mesh_in_world();
        for t in 0..mesh.triangles().len() {
            for (p, n) in mesh.corners(t).into_iter().zip(mesh.corner_normals(t)) {
                vertices.push([p.extend(w).to_array(), n.extend(0.0).to_array()]);
            }
        }
    }
    vertices
}

fn target(device: &wgpu::Device, format: wgpu::TextureFormat) -> wgpu::Texture {
    let mut usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
    if format == GBUFFER_FORMAT {
        usage |= wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC;
    }
    device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: SIZE[0], height: SIZE[1], depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

/// 96 texels of 16 bytes: a row is a whole number of the 256 bytes that copies are aligned to.
fn copy_to_buffer(device: &wgpu::Device, encoder: &mut wgpu::CommandEncoder, texture: &wgpu::Texture) -> wgpu::Buffer {
    let row = SIZE[0] * 16;
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(row * SIZE[1]),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
    let destination = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), destination, texture.size());
    buffer
}

fn read(device: &wgpu::Device, buffer: &wgpu::Buffer) -> Result<Vec<[f32; 4]>, Failure> {
    let (sender, receiver) = std::sync::mpsc::channel();
    buffer.map_async(wgpu::MapMode::Read, .., move |result| drop(sender.send(result)));
    device.poll(wgpu::PollType::wait_indefinitely())?;
    receiver.recv()??;
    Ok(bytemuck::cast_slice(&buffer.get_mapped_range(..)?).to_vec())
}
