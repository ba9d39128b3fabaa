//! The gather on the GPU, recorded into the caller's encoder on the caller's device.
//!
//! [`Engine`] is made once per device and filter; [`Engine::frame`] once per image, with the receivers' textures, the
//! samples and the environment; [`Frame::record`] adds ranges of batches, so that a caller can submit between them
//! and no watchdog fires. Neither submits, polls or owns a window; [`Geometry::upload`] submits on devices with ray queries, [`check_hardware_filter`] and
//! [`probe()`] on a device of Pinspot's own. Shader: `shaders/gather.wgsl`; CPU twin: [`cpu::gather`](super::cpu::gather).

mod acceleration;
mod cache;
mod environment;
mod geometry;
mod hardware_check;
mod hierarchical;
mod lamp;
mod lit_environment;
mod maps;
mod medium;
mod near_light;
pub(crate) mod pipeline;
mod preview_pipelines;
mod probe;
pub(crate) mod ray_batch;
pub mod shaders;
mod sources;
mod surroundings;

pub(crate) use cache::{PipelineCache, PipelineKey};
pub use environment::EnvironmentCube;
pub use geometry::Geometry;
pub(crate) use geometry::{MovingGeometry, ray_entries};
pub use hardware_check::{HardwareVerdict, automatic_filter, check_hardware_filter};
pub(crate) use hierarchical::DYNAMIC_OFFSET;
pub use hierarchical::{
    CellTreeBuffers, HierarchicalEngine, HierarchicalFrame, HierarchicalInputs, HierarchicalOptions,
    LightBoundsBuilder, LightBoundsTexture, Tolerance, TreeLight,
};
pub use lamp::UploadedLamp;
pub(crate) use lamp::{LampUniforms, no_slide};
pub(crate) use lit_environment::{CubeView, LitEnvironment, LitPipelines, PlacedEmitter};
pub use maps::{MapTracer, MapTracing, MapUse, VisibilityMapBuffers};
pub use near_light::{FrameLight, LightKind};
pub(crate) use preview_pipelines::PreviewPipelines;
pub use probe::probe;
pub(crate) use ray_batch::RayBatchPipelines;

pub use surroundings::UploadedSurroundings;

use std::ops::Range;

use self::pipeline::{BATCH_BYTES, Pipelines};
use self::sources::Sources;
use super::{BATCH_SIZE, Filter, Params, Pinholes};
use crate::brdf::Materials;
use crate::gpu::{GpuError, buffer_with};

/// The format of the caustic texture.
pub const TARGET_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// What is fixed when an engine is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "they are independent of each other")]
pub struct GatherOptions {
    /// The filter; it is compiled into the shader.
    pub filter: Filter,
    /// What the light is; only an environment takes other filters than the anisotropic one.
    pub light: LightKind,
    /// Whether the samples' visibility maps count; that, too, is compiled in.
    pub visibility: bool,
    /// Whether samples may be on interfaces between two media; without, the shader is faster.
    pub refraction: bool,
    /// Whether there may be a medium, and receivers that are parts of rays through it; likewise.
    pub medium: bool,
    /// Accumulate by ping-pong between two textures even where 32-bit targets blend.
    pub force_ping_pong: bool,
}

impl Default for GatherOptions {
    fn default() -> Self {
        Self {
            filter: Filter::Anisotropic,
            light: LightKind::Environment,
            visibility: false,
            refraction: false,
            medium: false,
            force_ping_pong: false,
        }
    }
}

/// The gather's pipelines on one device. Enable `FLOAT32_BLENDABLE` on the device where the adapter has it; without it
/// the engine accumulates by ping-pong.
#[derive(Debug)]
pub struct Engine {
    pipelines: Pipelines,
    blends: bool,
}

/// What one image is gathered from.
#[derive(Clone, Copy, Debug)]
pub struct FrameInputs<'a> {
    /// World positions; `w` is the object's index in the scene, or negative where there is no receiver. Any float format.
    pub positions: &'a wgpu::TextureView,
    /// Unit normals on the side that receives; of parts of rays, whose object is [`MEDIUM_OBJECT`](crate::pinhole::MEDIUM_OBJECT), the
    /// way from one end to the other, towards the viewer, metres. Any float format.
    pub normals: &'a wgpu::TextureView,
    /// `None`: irradiance is gathered. Else the radiance that receivers reflect to their viewers.
    pub viewers: Option<FrameViewers<'a>>,
    /// Width and height of all.
    pub size: [u32; 2],
    /// The samples; with visibility maps if, and only if, the engine was made for them.
    pub pinholes: &'a Pinholes,
    /// Visibility maps that were traced on the GPU, whose numbers the samples carry; `None`: those of the samples, if they have any.
    pub maps: Option<&'a VisibilityMapBuffers>,
    /// The light, of the engine's kind.
    pub light: FrameLight<'a>,
    /// Parameters; the filter must be the engine's.
    pub params: Params,
}

/// Who looks at the receivers of an image.
#[derive(Clone, Copy, Debug)]
pub struct FrameViewers<'a> {
    /// Unit directions from the receivers towards their viewers. Any float format.
    pub directions: &'a wgpu::TextureView,
    /// What the scene's objects do with light.
    pub materials: &'a Materials,
}

/// One image being gathered.
#[derive(Debug)]
pub struct Frame {
    targets: Vec<wgpu::Texture>,
    views: Vec<wgpu::TextureView>,
    sources: Sources,
    inputs: wgpu::BindGroup,
    receivers: wgpu::BindGroup,
    /// For ping-pong: the bind group that reads target i.
    previous: Vec<wgpu::BindGroup>,
    pipeline: wgpu::RenderPipeline,
    batches: u32,
    /// The target that holds the sum so far; `None` before the first pass.
    current: Option<usize>,
}

impl Engine {
    /// Compiles the shader; towards viewers when a frame first has some.
    pub fn new(device: &wgpu::Device, options: &GatherOptions) -> Self {
        let blends = device.features().contains(wgpu::Features::FLOAT32_BLENDABLE) && !options.force_ping_pong;
        Self { pipelines: Pipelines::new(device, options, blends), blends }
    }

    /// Uploads one image's inputs and makes its targets. The samples are copied.
    pub fn frame(&self, device: &wgpu::Device, inputs: &FrameInputs) -> Result<Frame, GpuError> {
        self.check(device, inputs)?;
        let count = if self.blends { 1 } else { 2 };
        let targets: Vec<wgpu::Texture> = (0..count).map(|_| target(device, inputs.size, TARGET_FORMAT)).collect();
        let views: Vec<wgpu::TextureView> = targets.iter().map(|t| t.create_view(&Default::default())).collect();
        let previous = if self.blends {
            Vec::new()
        } else {
            views.iter().map(|v| self.pipelines.bind_previous(device, v)).collect()
        };
        let maps = match (inputs.maps, &inputs.pinholes.visibility) {
            (Some(traced), _) => traced.clone(),
            (None, Some(maps)) => VisibilityMapBuffers::upload(device, maps)?,
            (None, None) => VisibilityMapBuffers::none(device),
        };
        let sources = Sources::new(device, inputs, &maps, &self.pipelines.placeholders);
        Ok(Frame {
            inputs: self.pipelines.bind_inputs(device, &sources),
            sources,
            receivers: bind_receivers(
                device,
                &self.pipelines.receivers,
                [inputs.positions, inputs.normals],
                inputs.viewers,
            ),
            previous,
            pipeline: self.pipelines.pipeline(device, inputs.viewers.is_some()).clone(),
            batches: (inputs.pinholes.samples.len() as u32).div_ceil(BATCH_SIZE),
            targets,
            views,
            current: None,
        })
    }

    /// Gives a frame other samples, light and parameters over the same receivers, in the buffers that it has. Returns whether that is
    /// possible; if not, the frame is as before.
    pub(crate) fn update(
        &self,
        (device, queue): (&wgpu::Device, &wgpu::Queue),
        frame: &mut Frame,
        inputs: &FrameInputs,
    ) -> Result<bool, GpuError> {
        self.check(device, inputs)?;
        if frame.pipeline != *self.pipelines.pipeline(device, inputs.viewers.is_some())
            || inputs.pinholes.visibility.is_some()
        {
            return Ok(false);
        }
        let Some(sources) = frame.sources.updated(queue, inputs, &self.pipelines.placeholders) else {
            return Ok(false);
        };
        if sources != frame.sources {
            frame.inputs = self.pipelines.bind_inputs(device, &sources);
            frame.sources = sources;
        }
        frame.batches = (inputs.pinholes.samples.len() as u32).div_ceil(BATCH_SIZE);
        Ok(true)
    }

    fn check(&self, device: &wgpu::Device, inputs: &FrameInputs) -> Result<(), GpuError> {
        let GatherOptions { filter, light, visibility, refraction, medium, .. } = *self.pipelines.options();
        if light == LightKind::Environment && inputs.params.filter != filter {
            return Err(GpuError::OtherFilter { engine: filter.name(), params: inputs.params.filter.name() });
        }
        inputs.light.kind().check(light)?;
        if (inputs.maps.is_some() || inputs.pinholes.visibility.is_some()) != visibility {
            return Err(GpuError::OtherVisibility { engine: visibility });
        }
        if inputs.pinholes.refracts() && !refraction {
            return Err(GpuError::NoRefraction);
        }
        if inputs.params.medium.is_some() && !medium {
            return Err(GpuError::NoMedium);
        }
        check_limits(&device.limits(), inputs)
    }
}

impl Frame {
    /// Number of batches; a batch is [`BATCH_SIZE`] samples.
    pub fn batch_count(&self) -> u32 {
        self.batches
    }

    /// Records the gather of a range of batches, up to [`Self::batch_count`]. Record every batch once, in order, in one encoder or
    /// in several.
    pub fn record(&mut self, encoder: &mut wgpu::CommandEncoder, batches: Range<u32>) {
        let batches = batches.start..batches.end.min(self.batches);
        if self.previous.is_empty() {
            // With blending, the whole range is one pass.
            self.pass(encoder, 0, batches);
        } else {
            for batch in batches {
                let next = self.current.map_or(0, |current| 1 - current);
                self.pass(encoder, next, batch..batch + 1);
            }
        }
    }

    fn pass(&mut self, encoder: &mut wgpu::CommandEncoder, target: usize, batches: Range<u32>) {
        let blends = self.previous.is_empty();
        let load = match self.current {
            Some(_) if blends => wgpu::LoadOp::Load,
            _ => wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("pinhole gather"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.views[target],
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(1, &self.receivers, &[]);
        if !blends {
            // Before the first pass the other target is as cleared as WebGPU makes it: zero.
            pass.set_bind_group(2, &self.previous[1 - target], &[]);
        }
        for batch in batches {
            pass.set_bind_group(0, &self.inputs, &[batch * BATCH_BYTES as u32]);
            pass.draw(0..3, batch..batch + 1);
        }
        drop(pass);
        self.current = Some(target);
    }

    /// Begins anew: what is recorded next is added to nothing.
    pub fn restart(&mut self, encoder: &mut wgpu::CommandEncoder) {
        self.current = None;
        // The first batch reads the other target; without batches, the first target is the result.
        let stale = usize::from(self.batches > 0);
        if let Some(other) = self.views.get(stale).filter(|_| self.views.len() > 1) {
            encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("restart"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: other,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                ..Default::default()
            });
        }
    }

    /// The texture that [`Self::caustic`] is once all batches are recorded.
    pub fn complete(&self) -> &wgpu::TextureView {
        &self.views[(self.batches.saturating_sub(1) as usize) % self.views.len()]
    }

    /// The caustic: rgb = irradiance, W/m²; a = number of fetches. Complete once all batches are recorded and submitted.
    pub fn caustic(&self) -> &wgpu::Texture {
        &self.targets[self.current.unwrap_or(0)]
    }
}

/// Binds receivers, and what they reflect to whom; where there are no viewers nothing of that is read.
fn bind_receivers(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    [positions, normals]: [&wgpu::TextureView; 2],
    viewers: Option<FrameViewers>,
) -> wgpu::BindGroup {
    let none = Materials::default();
    let (directions, materials) = viewers.map_or((normals, &none), |viewers| (viewers.directions, viewers.materials));
    let of_objects = storage_buffer(device, "materials", bytemuck::cast_slice(&materials.of_object));
    let tables = storage_buffer(device, "tables of reflectance", bytemuck::cast_slice(&materials.tables));
    let [a, b, c] = [positions, normals, directions].map(wgpu::BindingResource::TextureView);
    pipeline::bind(device, layout, &[a, b, c, of_objects.as_entire_binding(), tables.as_entire_binding()])
}

fn check_image(limits: &wgpu::Limits, [width, height]: [u32; 2]) -> Result<(), GpuError> {
    if width == 0 || height == 0 {
        return Err(GpuError::EmptyImage { width, height });
    }
    let size = width.max(height);
    if size > limits.max_texture_dimension_2d {
        return Err(GpuError::TextureTooLarge { what: "the image", size, limit: limits.max_texture_dimension_2d });
    }
    Ok(())
}

fn check_limits(limits: &wgpu::Limits, inputs: &FrameInputs) -> Result<(), GpuError> {
    check_image(limits, inputs.size)?;
    // Whole batches; their offsets are 32-bit.
    let most = (limits.max_buffer_size.min(u64::from(u32::MAX)) / BATCH_BYTES) as usize * BATCH_SIZE as usize;
    if inputs.pinholes.samples.len() > most {
        return Err(GpuError::TooManySamples { samples: inputs.pinholes.samples.len(), limit: most });
    }
    Ok(())
}

/// A buffer that shaders read.
pub(crate) fn storage_buffer(device: &wgpu::Device, label: &str, contents: &[u8]) -> wgpu::Buffer {
    buffer_with(device, label, filled_storage(contents), wgpu::BufferUsages::STORAGE)
}

/// Contents of a buffer that shaders read: a binding cannot be empty.
fn filled_storage(contents: &[u8]) -> &[u8] {
    if contents.is_empty() { &[0; 48] } else { contents }
}

/// A texture that passes draw into and read, and that can be copied.
fn target(device: &wgpu::Device, [width, height]: [u32; 2], format: wgpu::TextureFormat) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some("target"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}
