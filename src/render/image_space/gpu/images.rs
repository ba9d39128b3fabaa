//! Images of what a light's view shows, drawn by the rasterizer: the first and the last surfaces in one pass over the triangles, the
//! receivers alone and, where there are several closed objects, each of them alone. CPU twin: [`crate::image_space::surface_images`].
//! Shaders: `shaders/surface_images.wgsl`, `shared/image_hits.wgsl`.

use wgpu::{BindingResource, BufferUsages, CommandEncoder, RenderPipeline, ShaderStages, TextureFormat, TextureUsages};

use super::Device;
use super::layout::{DrawUniforms, ImagePlaneUniforms};
use crate::gpu::{GpuError, buffer_with};
use crate::image_space::constants::{SHOWS_ALL, SHOWS_BACK, SHOWS_FIRST_AND_LAST, SHOWS_FRONT};
use crate::image_space::lights::LightView;
use crate::image_space::maps::MapInputs;
use crate::image_space::projection::Projection;
use crate::pinhole::gpu::pipeline::{bind, entry, layout, seen_by, storage, texture, window};
use crate::pinhole::gpu::shaders::SURFACE_IMAGES;
use crate::pinhole::gpu::{DYNAMIC_OFFSET, Geometry, ray_entries, storage_buffer};
use crate::scene::Chain;

/// Normals with depths, and packed normals, objects and sides.
const FORMATS: [TextureFormat; 2] = [TextureFormat::Rgba32Float, TextureFormat::Rgba32Uint];
const DEPTH: TextureFormat = TextureFormat::Depth32Float;

/// The nearest that a lamp's view shows, relative to the farthest.
const NEAR: f64 = 1e-4;

/// The pipeline that draws images, and the layouts of what it reads and of what is read of them.
#[derive(Debug)]
pub(super) struct ImagePipelines {
    draw: RenderPipeline,
    of_draw: wgpu::BindGroupLayout,
    of_surfaces: wgpu::BindGroupLayout,
    geometry: wgpu::BindGroupLayout,
    nothing: wgpu::BindGroupLayout,
    pub(super) of_images: wgpu::BindGroupLayout,
}

impl ImagePipelines {
    pub fn new(device: &wgpu::Device) -> Self {
        let stages = ShaderStages::VERTEX_FRAGMENT;
        let of_draw = layout(device, "surfaces in an image", &[seen_by(stages, window(0))]);
        let of_surfaces = layout(device, "surfaces", &[seen_by(stages, storage(0))]);
        let geometry = layout(device, "rays", &ray_entries(device, stages));
        let nothing = layout(device, "nothing", &[]);
        let texture_of = |binding, sample_type, view_dimension| {
            entry(binding, wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false })
        };
        let array = wgpu::TextureViewDimension::D2Array;
        let entries = [
            storage(0),
            texture(1),
            texture_of(2, wgpu::TextureSampleType::Uint, wgpu::TextureViewDimension::D2),
            texture_of(3, wgpu::TextureSampleType::Float { filterable: false }, array),
            texture_of(4, wgpu::TextureSampleType::Uint, array),
        ];
        let of_images =
            layout(device, "images of surfaces", &entries.map(|entry| seen_by(ShaderStages::COMPUTE, entry)));
        let groups = [&of_draw, &of_surfaces, &nothing, &geometry].map(Some);
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(SURFACE_IMAGES.name),
            bind_group_layouts: &groups,
            immediate_size: 0,
        });
        let module = SURFACE_IMAGES.module(device);
        let targets = FORMATS
            .map(|format| Some(wgpu::ColorTargetState { format, blend: None, write_mask: wgpu::ColorWrites::ALL }));
        let draw = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(SURFACE_IMAGES.name),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("place"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Less),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("show"),
                compilation_options: Default::default(),
                targets: &targets,
            }),
            multiview_mask: None,
            cache: None,
        });
        Self { draw, of_draw, of_surfaces, geometry, nothing, of_images }
    }
}

/// What is bound where photons are traced.
pub(super) fn no_images(device: &wgpu::Device, pipelines: &ImagePipelines) -> wgpu::BindGroup {
    let [view, receivers] = [1, 1].map(|layers| textures(device, [1; 2], layers));
    let planes = storage_buffer(device, "planes of images", bytemuck::bytes_of(&ImagePlaneUniforms::default()));
    group(device, pipelines, &planes, [&view, &receivers])
}

/// Draws images of a view. Submits.
///
/// # Errors
/// They are larger than the device's textures.
pub(super) fn draw_images(
    device: Device,
    pipelines: &ImagePipelines,
    inputs: &MapInputs,
    (view, size): (&LightView, u32),
    surfaces: &wgpu::Buffer,
) -> Result<wgpu::BindGroup, GpuError> {
    let on = &device.gpu.device;
    let limit = on.limits().max_texture_dimension_2d;
    if 2 * size > limit {
        return Err(GpuError::TextureTooLarge { what: "the image of a light's view", size: 2 * size, limit });
    }
    let plane = view.projection.resized(size);
    let of_receivers = inputs.receiver_planes(view, size);
    let in_view = textures(on, [2 * size, size], 1);
    let solids = several_solids(inputs);
    let layers = (of_receivers.len() + 2 * solids.len()) as u32;
    let most = on.limits().max_texture_array_layers;
    if layers > most {
        return Err(GpuError::TooManySolids { count: solids.len(), limit: (most as usize - of_receivers.len()) / 2 });
    }
    let others = textures(on, [size; 2], layers);
    let draws = Draws { device, pipelines, inputs, surfaces };
    let mut encoder = on.create_command_encoder(&Default::default());
    draws.draw(&mut encoder, &plane, (&in_view, 0), Content::FirstAndLast);
    let of_solids = solids.iter().flat_map(|solid| [(&plane, Content::Front(*solid)), (&plane, Content::Back(*solid))]);
    let contents: Vec<_> = of_receivers.iter().map(|plane| (plane, Content::Receivers)).chain(of_solids).collect();
    for (layer, (plane, content)) in (0..).zip(&contents) {
        draws.draw(&mut encoder, plane, (&others, layer), *content);
    }
    device.gpu.queue.submit([encoder.finish()]);
    let uniforms = |(plane, content): (&Projection, Content)| ImagePlaneUniforms {
        plane: plane.into(),
        size,
        receivers: of_receivers.len() as u32,
        diagonal: inputs.bounds.diagonal() as f32,
        solids: solids.len() as u32,
        object: content.object().unwrap_or(0),
        padding: [0; 3],
    };
    let first = std::iter::once((&plane, Content::FirstAndLast));
    let planes: Vec<ImagePlaneUniforms> = first.chain(contents).map(uniforms).collect();
    let planes = storage_buffer(on, "planes of images", bytemuck::cast_slice(&planes));
    Ok(group(on, pipelines, &planes, [&in_view, &others]))
}

/// The closed objects that have images of their own; none where there is only one, whose surfaces the light sees as the first and the last.
fn several_solids(inputs: &MapInputs) -> Vec<u32> {
    let objects = inputs.surroundings.objects.iter().enumerate();
    let solids: Vec<u32> =
        objects.filter(|(_, object)| object.casts(Chain::TT)).map(|(number, _)| number as u32).collect();
    if solids.len() > 1 { solids } else { Vec::new() }
}

/// What an image shows.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Content {
    /// In its halves the nearest surfaces, and the farthest ones of closed objects.
    FirstAndLast,
    Receivers,
    /// The fronts of an object.
    Front(u32),
    /// Its backs, the farthest ones.
    Back(u32),
}

impl Content {
    /// The object that it shows alone.
    fn object(self) -> Option<u32> {
        match self {
            Self::FirstAndLast | Self::Receivers => None,
            Self::Front(object) | Self::Back(object) => Some(object),
        }
    }

    /// The shader's `SHOWS_…` constants.
    fn constant(self) -> u32 {
        match self {
            Self::FirstAndLast => SHOWS_FIRST_AND_LAST,
            Self::Receivers => SHOWS_ALL,
            Self::Front(_) => SHOWS_FRONT,
            Self::Back(_) => SHOWS_BACK,
        }
    }
}

/// Normals with depths, and packed surfaces.
type Textures = [wgpu::Texture; 2];

fn textures(device: &wgpu::Device, [width, height]: [u32; 2], layers: u32) -> Textures {
    FORMATS.map(|format| {
        device.create_texture(&wgpu::TextureDescriptor {
            label: Some("image of surfaces"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: layers },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        })
    })
}

fn group(
    device: &wgpu::Device,
    pipelines: &ImagePipelines,
    planes: &wgpu::Buffer,
    [view, receivers]: [&Textures; 2],
) -> wgpu::BindGroup {
    let plain = view.each_ref().map(|texture| texture.create_view(&Default::default()));
    let array =
        wgpu::TextureViewDescriptor { dimension: Some(wgpu::TextureViewDimension::D2Array), ..Default::default() };
    let arrays = receivers.each_ref().map(|texture| texture.create_view(&array));
    let [a, b, c, d] = [&plain[0], &plain[1], &arrays[0], &arrays[1]].map(BindingResource::TextureView);
    bind(device, &pipelines.of_images, &[planes.as_entire_binding(), a, b, c, d])
}

/// What images are drawn from.
struct Draws<'a> {
    device: Device<'a>,
    pipelines: &'a ImagePipelines,
    inputs: &'a MapInputs<'a>,
    surfaces: &'a wgpu::Buffer,
}

impl Draws<'_> {
    /// Draws an image into a layer.
    fn draw(
        &self,
        encoder: &mut CommandEncoder,
        plane: &Projection,
        (textures, layer): (&Textures, u32),
        content: Content,
    ) {
        let on = &self.device.gpu.device;
        let geometry: &Geometry = self.device.geometry;
        let objects = self.inputs.surroundings.objects;
        let is_shown = |number: u32| match content {
            Content::FirstAndLast => true,
            Content::Receivers => objects[number as usize].receiver.is_some(),
            Content::Front(object) | Content::Back(object) => object == number,
        };
        let drawn: Vec<_> = geometry.draws().iter().filter(|draw| is_shown(draw.object)).collect();
        let (near, far) = self.range(plane);
        let mut bytes = Vec::new();
        for draw in &drawn {
            bytes.extend_from_slice(bytemuck::bytes_of(&DrawUniforms {
                plane: plane.into(),
                size: plane.size[0] as f32,
                near: near as f32,
                far: far as f32,
                instance: draw.first_texel,
                shown: content.constant(),
                padding: [0; 3],
            }));
            bytes.resize(bytes.len().next_multiple_of(DYNAMIC_OFFSET as usize), 0);
        }
        bytes.resize(bytes.len().max(DYNAMIC_OFFSET as usize), 0);
        let uniforms = buffer_with(on, "surfaces in an image", &bytes, BufferUsages::UNIFORM);
        let size = std::num::NonZero::new(size_of::<DrawUniforms>() as u64);
        let window = BindingResource::Buffer(wgpu::BufferBinding { buffer: &uniforms, offset: 0, size });
        let of_draw = bind(on, &self.pipelines.of_draw, &[window]);
        let of_surfaces = bind(on, &self.pipelines.of_surfaces, &[self.surfaces.as_entire_binding()]);
        let nothing = bind(on, &self.pipelines.nothing, &[]);
        let geometry = geometry.bind(on, &self.pipelines.geometry);
        let mut pass = begin(on, encoder, textures, layer);
        pass.set_pipeline(&self.pipelines.draw);
        pass.set_bind_group(1, &of_surfaces, &[]);
        pass.set_bind_group(2, &nothing, &[]);
        pass.set_bind_group(3, &geometry, &[]);
        for (k, draw) in (0..).zip(drawn) {
            pass.set_bind_group(0, &of_draw, &[k * DYNAMIC_OFFSET as u32]);
            pass.draw(0..3 * draw.triangles, 0..if content == Content::FirstAndLast { 2 } else { 1 });
        }
    }

    /// Between which depths everything lies.
    fn range(&self, plane: &Projection) -> (f64, f64) {
        let depths = self.inputs.bounds.corners().map(|corner| plane.depth(corner));
        let far = depths.fold(f64::MIN_POSITIVE, f64::max) * 1.01;
        (if plane.is_parallel { 0.0 } else { NEAR * far }, far)
    }
}

fn begin<'e>(
    device: &wgpu::Device,
    encoder: &'e mut CommandEncoder,
    textures: &Textures,
    layer: u32,
) -> wgpu::RenderPass<'e> {
    let views = textures.each_ref().map(|texture| {
        texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_array_layer: layer,
            array_layer_count: Some(1),
            ..Default::default()
        })
    });
    let depth = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("depth of an image of surfaces"),
        size: wgpu::Extent3d { depth_or_array_layers: 1, ..textures[0].size() },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: DEPTH,
        usage: TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    let depth = depth.create_view(&Default::default());
    let target = |view| {
        let ops = wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), store: wgpu::StoreOp::Store };
        Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
    };
    let depth_ops = wgpu::Operations { load: wgpu::LoadOp::Clear(1.0), store: wgpu::StoreOp::Discard };
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("image of surfaces"),
        color_attachments: &[target(&views[0]), target(&views[1])],
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: &depth,
            depth_ops: Some(depth_ops),
            stencil_ops: None,
        }),
        ..Default::default()
    })
}
