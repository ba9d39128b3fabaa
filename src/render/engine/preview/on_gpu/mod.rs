//! Previews on a GPU: from the scene's triangles to the picture in passes of one submission, without reading anything back in between.
//!
//! ```text
//! trace_views ─► own light, light in mirrors: nodes ─► gather ─► between ─► gather ─► shade ─► meter ─► display ─► smooth_edges
//! ```
//!
//! CPU twin: the rest of `preview`. Shaders: `shaders/preview_*.wgsl`.

pub mod layout;
mod lit;
mod near_light;
mod targets;
mod timer;

use std::fmt;
use std::sync::Arc;

use glam::Vec3;
use wgpu::{BindingResource, BufferUsages};

use self::layout::{Cubes, PreviewObject, PreviewUniforms, background_cube, reflectance_curves};
pub(super) use self::lit::LitStages;
use self::near_light::PackedNearLight;
pub(super) use self::targets::fits;
use self::targets::{ScatteredTexture, Targets};
pub use self::timer::PassTime;
use self::timer::{CAUSTIC, MAX_PASSES, Timer};
use super::scattering::{ScatteredGrid, SeenMedium};
use super::{Rendered, Wanted};
use crate::backend::SharedGpu;
use crate::engine::direct::DirectLight;
use crate::engine::ray_batches::on_gpu::packed_directions;
use crate::environment::{CubeMap, Environment};
use crate::gpu::{GpuError, KeptBuffer};
use crate::image::Image;
use crate::options::{Exposures, Options};
use crate::pinhole::gpu::pipeline::bind;
use crate::pinhole::gpu::{EnvironmentCube, Frame, Geometry, PreviewPipelines};
use crate::progress::{Progress, Stage};
use crate::scene::Scene;
use crate::stages::{Id, Memo, PreparedLight, PreparedScene};
use crate::technique::Sum;

/// Where timestamps begin in the report of a preview, and its size, bytes.
const TIMESTAMPS_AT: usize = 16;
const REPORT_BYTES: u64 = TIMESTAMPS_AT as u64 + 16 * MAX_PASSES as u64;

/// A preview from the GPU.
pub(super) struct OnGpu {
    pub rendered: Rendered,
    pub exposures: Exposures,
    pub passes: Vec<PassTime>,
}

/// Edge of the workgroups of all passes over pixels.
const WORKGROUP_EDGE: u32 = 8;

/// The gathers of all lights over the same receivers.
type Gathers = Vec<Frame>;

/// What a preview is rendered from.
pub(super) struct PreviewInputs<'a> {
    pub scene: &'a Scene,
    pub prepared: &'a PreparedScene,
    pub geometry: &'a Geometry,
    pub options: &'a Options,
    pub light: &'a PreparedLight,
    pub direct: &'a DirectLight<'a>,
    pub sum: Option<&'a Arc<dyn Sum>>,
    pub medium: Option<SeenMedium>,
    pub scattered: Option<&'a ScatteredGrid>,
    /// Pixels from node to node.
    pub spacing: u32,
    pub progress: &'a dyn Progress,
}

/// The passes of previews on one device, and what is kept from frame to frame.
pub(super) struct PreviewOnGpu {
    shared: Arc<SharedGpu>,
    pipelines: Arc<PreviewPipelines>,
    environment: Memo<Id<Environment>, EnvironmentCube>,
    background: Memo<Id<Environment>, EnvironmentCube>,
    irradiance: Memo<Id<CubeMap>, EnvironmentCube>,
    uniforms: KeptBuffer,
    objects: KeptBuffer,
    curves: KeptBuffer,
    directions: KeptBuffer,
    near_light: KeptBuffer,
    scattered: ScatteredTexture,
    timer: Option<Timer>,
    /// Exposures, unfinished rays and timestamps of a preview, copied to be read.
    report: Option<wgpu::Buffer>,
    targets: Option<Targets>,
    /// Of the sum that was used last, for the receivers of these targets.
    gather: Option<(Id<dyn Sum>, Vec<Gathers>)>,
}

impl fmt::Debug for PreviewOnGpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "PreviewOnGpu({})", self.shared.gpu.adapter)
    }
}

impl PreviewOnGpu {
    pub fn new(shared: &Arc<SharedGpu>) -> Self {
        let storage = |label| KeptBuffer::new(label, BufferUsages::STORAGE);
        Self {
            shared: shared.clone(),
            pipelines: shared.pipelines.preview(&shared.gpu.device),
            environment: Memo::new(Stage::Upload),
            background: Memo::new(Stage::Upload),
            irradiance: Memo::new(Stage::Upload),
            uniforms: KeptBuffer::new("preview", BufferUsages::UNIFORM),
            objects: storage("objects"),
            curves: storage("reflectance"),
            directions: storage("shadow rays"),
            near_light: storage("near light"),
            scattered: ScatteredTexture::default(),
            timer: Timer::new(&shared.gpu.device),
            report: None,
            targets: None,
            gather: None,
        }
    }

    /// Renders a preview. `None` where rays would take longer than the adapter lets them.
    pub async fn render(
        &mut self,
        inputs: &PreviewInputs<'_>,
        cubes: &[Arc<EnvironmentCube>; 3],
        lit: &mut LitStages,
        wanted: Wanted,
    ) -> Result<Option<OnGpu>, GpuError> {
        self.make_targets(inputs)?;
        let [environment, background, irradiance] = cubes;
        let buffers = self.buffers(inputs, Cubes { environment, background, irradiance });
        let gpu = &self.shared.gpu;
        // If nobody waited for the last preview, its report is lost.
        let report = self.report.take().unwrap_or_else(|| gpu.read_back_buffer(REPORT_BYTES));
        let Some(targets) = &self.targets else { return Ok(None) };
        let scattered = self.scattered.with(&gpu.device, &gpu.queue, inputs.scattered);
        let passes = Passes {
            scattered,
            device: &gpu.device,
            pipelines: &self.pipelines,
            targets,
            cubes: Cubes { environment, background, irradiance },
            buffers,
            rays: inputs.geometry.bind(&gpu.device, &self.pipelines.layouts.rays),
            timer: self.timer.as_ref(),
        };
        let frames = self.gather.as_mut().map_or(&mut [][..], |(_, frames)| &mut frames[..]);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        lit.record(&mut encoder);
        let sum = inputs.sum.and_then(|sum| sum.on_gpu());
        let unfinished_maps = sum.and_then(|sum| sum.record_maps(&mut encoder));
        passes.record(&mut encoder, frames);
        encoder.copy_buffer_to_buffer(&targets.exposures, 0, &report, 0, 8);
        encoder.copy_buffer_to_buffer(&targets.unfinished, 0, &report, 8, 4);
        if let Some(unfinished) = unfinished_maps {
            encoder.copy_buffer_to_buffer(unfinished, 0, &report, 12, 4);
        }
        if let Some(timer) = &self.timer {
            timer.finish(&mut encoder, &report, TIMESTAMPS_AT as u64);
        }
        gpu.queue.submit([encoder.finish()]);
        gpu.check()?;
        let rendered = match wanted {
            Wanted::OnDevice => Rendered::Texture(targets.shown.clone()),
            Wanted::InMemory => {
                let texels = gpu.read_texture(&targets.picture).await?;
                let pixels = texels.into_iter().map(|[r, g, b, _]| Vec3::new(r, g, b)).collect();
                let [width, height] = targets.size;
                Rendered::Image(Image { width, height, pixels })
            }
        };
        let bytes = gpu.read_mapped(report.clone()).await?;
        self.report = Some(report);
        let [exposure_ev, background_exposure_ev] = bytemuck::pod_read_unaligned(&bytes[..8]);
        let [unfinished, of_maps]: [u32; 2] = bytemuck::pod_read_unaligned(&bytes[8..16]);
        if unfinished_maps.is_some() && of_maps != 0 {
            return Err(GpuError::LoopCutShort { adapter: gpu.adapter.name.clone() });
        }
        let period_ns = gpu.queue.get_timestamp_period();
        let passes = self.timer.as_ref().map(|timer| timer.pass_times(&bytes[TIMESTAMPS_AT..], period_ns));
        Ok((unfinished == 0).then(|| OnGpu {
            rendered,
            exposures: Exposures { exposure_ev, background_exposure_ev },
            passes: passes.unwrap_or_default(),
        }))
    }

    fn make_targets(&mut self, inputs: &PreviewInputs) -> Result<(), GpuError> {
        let (size, spacing) = (inputs.options.size, inputs.spacing);
        if self.targets.as_ref().is_none_or(|targets| (targets.size, targets.spacing) != (size, spacing)) {
            self.gather = None;
            self.targets = Some(Targets::new(&self.shared.gpu.device, size, spacing));
        }
        let (Some(sum), Some(targets)) = (inputs.sum, &self.targets) else {
            self.gather = None;
            return Ok(());
        };
        if self.gather.as_ref().is_some_and(|(known, _)| *known == Id::of(sum)) {
            return Ok(());
        }
        let Some(on_gpu) = sum.on_gpu() else {
            self.gather = None;
            return Ok(());
        };
        let mut kept = self.gather.take().map_or(Vec::new(), |(_, frames)| frames).into_iter();
        let mut frames = Vec::new();
        for receivers in &targets.receivers {
            let textures = [&receivers.positions, &receivers.normals];
            let updated = match kept.next() {
                Some(mut frames) => on_gpu.update(&mut frames, textures, receivers.size)?.then_some(frames),
                None => None,
            };
            frames.push(if let Some(frames) = updated { frames } else { on_gpu.frames(textures, receivers.size)? });
        }
        self.gather = Some((Id::of(sum), frames));
        Ok(())
    }

    /// The environment, the background and the irradiance as textures.
    pub fn cubes(&mut self, inputs: &PreviewInputs) -> Result<[Arc<EnvironmentCube>; 3], GpuError> {
        let PreviewInputs { light, progress, .. } = inputs;
        let gpu = &self.shared.gpu;
        let upload = |cube: &CubeMap| EnvironmentCube::upload(&gpu.device, &gpu.queue, cube);
        let of_sum = inputs.sum.and_then(|sum| Some(sum.on_gpu()?.environment().clone()));
        let environment = if let Some(known) = light.on_gpu.clone().or(of_sum) {
            known
        } else {
            let key = Id::of(&light.environment);
            self.environment.try_get(key, *progress, || upload(&light.environment.cube))?
        };
        let key = Id::of(&light.background.0);
        let background = self.background.try_get(key, *progress, || upload(&background_cube(light)))?;
        let unoccluded = inputs.direct.unoccluded();
        let irradiance = self.irradiance.try_get(Id::of(unoccluded), *progress, || upload(unoccluded))?;
        Ok([environment, background, irradiance])
    }

    fn buffers(&mut self, inputs: &PreviewInputs, cubes: Cubes) -> Buffers {
        let (device, queue) = (&self.shared.gpu.device, &self.shared.gpu.queue);
        let PreviewInputs { scene, prepared, options, light, .. } = inputs;
        let directions = packed_directions(inputs.direct.shadow_directions());
        let near_light = PackedNearLight::new(light);
        let uniforms = PreviewUniforms::new(inputs, cubes, directions.len(), &near_light);
        let materials = prepared.materials.receivers.of_object.iter();
        let object =
            |(object, material)| PreviewObject::new(object, material, options.plain_diffuse, light.of_emitters());
        let objects: Vec<_> = scene.objects.iter().zip(materials).map(object).collect();
        let curves = reflectance_curves(&prepared.materials);
        Buffers {
            uniforms: self.uniforms.with(device, queue, bytemuck::bytes_of(&uniforms)),
            objects: self.objects.with(device, queue, bytemuck::cast_slice(&objects)),
            curves: self.curves.with(device, queue, bytemuck::cast_slice(&curves)),
            directions: self.directions.with(device, queue, bytemuck::cast_slice(&directions)),
            near_light: self.near_light.with(device, queue, bytemuck::cast_slice(&near_light.texels)),
        }
    }
}

/// What the passes read, beside targets.
struct Buffers {
    uniforms: wgpu::Buffer,
    objects: wgpu::Buffer,
    curves: wgpu::Buffer,
    directions: wgpu::Buffer,
    near_light: wgpu::Buffer,
}

/// The passes of one preview.
struct Passes<'a> {
    device: &'a wgpu::Device,
    pipelines: &'a PreviewPipelines,
    targets: &'a Targets,
    cubes: Cubes<'a>,
    buffers: Buffers,
    scattered: wgpu::TextureView,
    rays: wgpu::BindGroup,
    timer: Option<&'a Timer>,
}

/// The points of one kind, and the light there.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Layer {
    Own,
    InMirrors,
}

impl Passes<'_> {
    fn record(&self, encoder: &mut wgpu::CommandEncoder, frames: &mut [Gathers]) {
        if let Some(timer) = self.timer {
            timer.restart();
        }
        let PreviewPipelines { trace_views, shade, meter, display: tone_map, smooth_edges, .. } = self.pipelines;
        let (views, shading, display) = (self.bind_views(), self.bind_shading(), self.bind_display());
        let (size, nothing) = (self.targets.size, bind(self.device, &self.pipelines.layouts.nothing, &[]));
        encoder.clear_buffer(&self.targets.unfinished, 0, None);
        self.pass(encoder, "rays", &[trace_views], size, [&views, &nothing, &nothing]);
        self.light(encoder, Layer::Own, frames);
        self.light(encoder, Layer::InMirrors, frames);
        encoder.clear_buffer(&self.targets.histogram, 0, None);
        self.pass(encoder, "shading", &[shade], size, [&shading, &nothing, &nothing]);
        self.pass(encoder, "display", &[meter], [1, 1], [&display, &nothing, &nothing]);
        self.pass(encoder, "display", &[tone_map, smooth_edges], size, [&display, &nothing, &nothing]);
    }

    /// The light on the points of a layer.
    fn light(&self, encoder: &mut wgpu::CommandEncoder, layer: Layer, frames: &mut [Gathers]) {
        let PreviewPipelines { begin, begin_behind_mirrors, light_nodes, light_between, add_caustic, .. } =
            self.pipelines;
        let begin = if layer == Layer::Own { begin } else { begin_behind_mirrors };
        let (light, other) = (self.bind_light(layer), self.bind_other(layer));
        for (grid, receivers) in self.targets.receivers.iter().enumerate() {
            let of_lights = frames.get_mut(grid).map_or(&mut [][..], |frames| &mut frames[..]);
            let no_caustic = self.bind_gather(receivers, None);
            let groups = [&light, &other, &no_caustic];
            if grid == 0 {
                self.pass(encoder, "direct light", &[begin], self.targets.size, groups);
            }
            let direct = if grid == 0 { light_nodes } else { light_between };
            self.pass(encoder, "direct light", &[direct], receivers.size, groups);
            for frame in of_lights {
                frame.restart(encoder);
                frame.record(encoder, 0..frame.batch_count());
                let gathered = self.bind_gather(receivers, Some(frame));
                self.pass(encoder, CAUSTIC, &[add_caustic], receivers.size, [&light, &other, &gathered]);
            }
        }
    }

    /// Records a pass over so many pixels, with one pipeline after another.
    fn pass(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        name: &'static str,
        pipelines: &[&wgpu::ComputePipeline],
        size: [u32; 2],
        groups: [&wgpu::BindGroup; 3],
    ) {
        let timestamp_writes = self.timer.and_then(|timer| timer.pass(name));
        let descriptor = wgpu::ComputePassDescriptor { label: Some(name), timestamp_writes };
        let mut pass = encoder.begin_compute_pass(&descriptor);
        for (index, group) in groups.into_iter().chain([&self.rays]).enumerate() {
            pass.set_bind_group(index as u32, group, &[]);
        }
        let [x, y] = size.map(|edge| edge.div_ceil(WORKGROUP_EDGE));
        for pipeline in pipelines {
            pass.set_pipeline(pipeline);
            pass.dispatch_workgroups(x, y, 1);
        }
    }

    fn bind_views(&self) -> wgpu::BindGroup {
        let (Buffers { uniforms, objects, curves, near_light, .. }, targets) = (&self.buffers, self.targets);
        let Targets { surfaces, mirrored, escapes, first, unfinished, .. } = targets;
        self.bind_buffers(
            &self.pipelines.layouts.views,
            &[uniforms, objects, curves, surfaces, mirrored, escapes, first, unfinished, near_light],
        )
    }

    fn bind_light(&self, layer: Layer) -> wgpu::BindGroup {
        let [points, light] = self.of_layer(layer);
        let resources = [
            self.buffers.uniforms.as_entire_binding(),
            points.as_entire_binding(),
            light.as_entire_binding(),
            self.buffers.directions.as_entire_binding(),
            BindingResource::TextureView(self.cubes.irradiance.view()),
            BindingResource::Sampler(&self.pipelines.trilinear),
            self.targets.unfinished.as_entire_binding(),
            self.buffers.objects.as_entire_binding(),
            BindingResource::TextureView(self.cubes.environment.view()),
            self.buffers.near_light.as_entire_binding(),
        ];
        bind(self.device, &self.pipelines.layouts.light, &resources)
    }

    /// What the camera sees directly is known when points in mirrors are lit. Before that, nothing is, and nothing is read.
    fn bind_other(&self, layer: Layer) -> wgpu::BindGroup {
        let other = if layer == Layer::Own { Layer::InMirrors } else { Layer::Own };
        self.bind_buffers(&self.pipelines.layouts.other, &self.of_layer(other))
    }

    fn of_layer(&self, layer: Layer) -> [&wgpu::Buffer; 2] {
        match layer {
            Layer::Own => [&self.targets.surfaces, &self.targets.own_light],
            Layer::InMirrors => [&self.targets.mirrored, &self.targets.mirrored_light],
        }
    }

    fn bind_gather(&self, receivers: &targets::ReceiverTextures, frame: Option<&Frame>) -> wgpu::BindGroup {
        let targets::ReceiverTextures { positions, normals, grid, .. } = receivers;
        // Where there is no caustic, what is bound in its place is not read.
        let unused = self.targets.picture.create_view(&Default::default());
        let caustic = frame.map_or(&unused, Frame::complete);
        let [positions, normals, caustic] = [positions, normals, caustic].map(BindingResource::TextureView);
        let resources = [positions, normals, caustic, grid.as_entire_binding()];
        bind(self.device, &self.pipelines.layouts.gather, &resources)
    }

    fn bind_shading(&self) -> wgpu::BindGroup {
        let Targets { surfaces, mirrored, escapes, own_light, mirrored_light, shaded, histogram, .. } = self.targets;
        let buffers = [&self.buffers.uniforms, surfaces, mirrored, escapes, own_light, mirrored_light, shaded];
        let mut resources: Vec<_> = buffers.iter().map(|buffer| buffer.as_entire_binding()).collect();
        resources.extend([
            BindingResource::TextureView(self.cubes.environment.view()),
            BindingResource::TextureView(self.cubes.background.view()),
            BindingResource::Sampler(&self.pipelines.trilinear),
            self.buffers.objects.as_entire_binding(),
            histogram.as_entire_binding(),
            BindingResource::TextureView(&self.scattered),
        ]);
        bind(self.device, &self.pipelines.layouts.shading, &resources)
    }

    fn bind_display(&self) -> wgpu::BindGroup {
        let Targets { shaded, first, histogram, exposures, colours, picture, shown, unfinished, .. } = self.targets;
        let buffers = [&self.buffers.uniforms, shaded, first, histogram, exposures, colours];
        let mut resources: Vec<_> = buffers.iter().map(|buffer| buffer.as_entire_binding()).collect();
        let picture = picture.create_view(&Default::default());
        resources.extend([&picture, shown].map(BindingResource::TextureView));
        resources.push(unfinished.as_entire_binding());
        bind(self.device, &self.pipelines.layouts.display, &resources)
    }

    fn bind_buffers(&self, layout: &wgpu::BindGroupLayout, buffers: &[&wgpu::Buffer]) -> wgpu::BindGroup {
        let resources: Vec<_> = buffers.iter().map(|buffer| buffer.as_entire_binding()).collect();
        bind(self.device, layout, &resources)
    }
}
