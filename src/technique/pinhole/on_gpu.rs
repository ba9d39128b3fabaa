//! Sums on a GPU: copies of light and samples are made once and kept. Receivers are uploaded in strips,
//! work is submitted in pieces of bounded duration, and the sums are read back.

mod receivers;
mod submission;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use self::receivers::{Tiled, Uploaded, strips};
use self::submission::{Submission, pairs_per_submit};
use super::FlatInputs;
use crate::Error;
use crate::backend::SharedGpu;
use crate::environment::{Environment, LightBounds};
use crate::gpu::{Gpu, GpuError};
use crate::pinhole::cpu::Accuracy;
use crate::pinhole::gpu::{
    self, CellTreeBuffers, Engine, EnvironmentCube, FrameInputs, FrameViewers, Geometry, HierarchicalEngine,
    LightBoundsTexture, MapTracing, MapUse, PipelineKey, Tolerance, VisibilityMapBuffers,
};
use crate::pinhole::{BATCH_SIZE, ESTIMATE_MAX_RECEIVERS, Params, PinholeTree, Pinholes, ReceiverLayout, Receivers};
use crate::progress::{Progress, Stage};
use crate::scene::{Scene, Visibility};
use crate::stages::{Id, Memo, StageCounts};
use crate::technique::{Inputs, Pending, Statistics, Sum, SumOnGpu};
use crate::tracing::Tracer;

/// The largest number of passes that the traversal is split into, on adapters that end loops early.
const MAX_SPLIT_PASSES: u32 = 512;

/// Everything that is kept on the device.
#[derive(Debug)]
pub(super) struct GpuStages {
    environment: Memo<Id<Environment>, EnvironmentCube>,
    bounds: Memo<Id<LightBounds>, LightBoundsTexture>,
    /// With visibility maps if there is a tracer.
    tree: Memo<(Id<PinholeTree>, Option<Id<Tracer>>), CellTreeBuffers>,
    tree_maps: Memo<(Id<PinholeTree>, Id<Tracer>), NumberedMaps>,
    flat_maps: Memo<(Id<Pinholes>, Id<Tracer>), NumberedMaps>,
    /// Of the last preview: the next one uses its buffers.
    maps_of_frame: Option<MapTracing>,
}

/// Samples, which carry the numbers of their visibility maps, and the maps.
#[derive(Debug)]
struct NumberedMaps {
    pinholes: Pinholes,
    maps: VisibilityMapBuffers,
    /// Maps of a preview, which are traced by its own commands.
    later: Option<LaterMaps>,
}

/// Maps that are not traced yet.
#[derive(Debug)]
struct LaterMaps {
    tracing: MapTracing,
    is_recorded: AtomicBool,
}

/// A tree on the device, and the light.
#[derive(Debug)]
pub(super) struct HierarchyOnGpu {
    shared: Arc<SharedGpu>,
    pipelines: Arc<HierarchicalEngine>,
    environment: Arc<EnvironmentCube>,
    bounds: Arc<LightBoundsTexture>,
    tree: Arc<CellTreeBuffers>,
    params: Params,
}

impl GpuStages {
    pub fn new() -> Self {
        Self {
            environment: Memo::new(Stage::Upload),
            bounds: Memo::new(Stage::Upload),
            tree: Memo::new(Stage::Upload),
            tree_maps: Memo::new(Stage::Visibility),
            flat_maps: Memo::new(Stage::Visibility),
            maps_of_frame: None,
        }
    }

    /// Uploads the inputs of a flat sum, and traces visibility maps if they count.
    pub async fn flat(
        &mut self,
        shared: &Arc<SharedGpu>,
        sum: FlatInputs,
        statistics: Statistics,
        inputs: &Inputs<'_>,
    ) -> Result<Arc<dyn Sum>, Error> {
        let geometry = occluding(inputs);
        let key = PipelineKey {
            filter: sum.params.filter,
            visibility: geometry.is_some(),
            refraction: sum.pinholes.refracts(),
        };
        let pipelines = shared.pipelines.flat(&shared.gpu.device, key);
        let environment = self.environment(shared, &sum.environment, inputs)?;
        let mut maps = None;
        if let Some(geometry) = geometry {
            let kept = &mut self.maps_of_frame;
            let make = async || {
                if inputs.is_preview {
                    return maps_of_frame(shared, geometry, (inputs, &sum.pinholes), kept).await;
                }
                trace_maps(shared, geometry, inputs.scene, &sum.pinholes, (MapUse::Maps, inputs.progress)).await
            };
            let key = (Id::of(&sum.pinholes), Id::of(&inputs.prepared.tracer));
            maps = Some(self.flat_maps.wait_for(key, (0, inputs.progress), make).await?);
        }
        shared.gpu.check()?;
        Ok(Arc::new(FlatOnGpu { shared: shared.clone(), pipelines, environment, sum, maps, statistics }))
    }

    /// Uploads a tree and the light, and traces visibility maps if they count.
    pub async fn hierarchy(
        &mut self,
        shared: &Arc<SharedGpu>,
        tree: &Arc<PinholeTree>,
        (environment, bounds): (&Arc<Environment>, &Arc<LightBounds>),
        params: Params,
        inputs: &Inputs<'_>,
    ) -> Result<HierarchyOnGpu, Error> {
        let Gpu { device, queue, .. } = &shared.gpu;
        let (visibility, refraction) = (occluding(inputs).is_some(), tree.refracts());
        let key = PipelineKey { filter: params.filter, visibility, refraction };
        let pipelines = shared.pipelines.hierarchical(device, key);
        let environment = self.environment(shared, environment, inputs)?;
        let bounds =
            self.bounds.get(Id::of(bounds), inputs.progress, || LightBoundsTexture::upload(device, queue, bounds));
        let tree = self.tree(shared, tree, inputs).await?;
        shared.gpu.check()?;
        Ok(HierarchyOnGpu { shared: shared.clone(), pipelines, environment, bounds, tree, params })
    }

    async fn tree(
        &mut self,
        shared: &SharedGpu,
        tree: &Arc<PinholeTree>,
        inputs: &Inputs<'_>,
    ) -> Result<Arc<CellTreeBuffers>, Error> {
        let device = &shared.gpu.device;
        let Some(geometry) = occluding(inputs) else {
            let upload = || CellTreeBuffers::upload(device, tree);
            return Ok(self.tree.try_get((Id::of(tree), None), inputs.progress, upload)?);
        };
        let tracer = Id::of(&inputs.prepared.tracer);
        let nodes = tree.sample_nodes();
        let make =
            async || trace_maps(shared, geometry, inputs.scene, nodes, (MapUse::MapsAndRays, inputs.progress)).await;
        let traced = self.tree_maps.wait_for((Id::of(tree), tracer.clone()), (0, inputs.progress), make).await?;
        let upload = || CellTreeBuffers::with_maps(device, tree, &traced.pinholes.samples, Some(traced.maps.clone()));
        Ok(self.tree.try_get((Id::of(tree), Some(tracer)), inputs.progress, upload)?)
    }

    fn environment(
        &mut self,
        shared: &SharedGpu,
        environment: &Arc<Environment>,
        inputs: &Inputs<'_>,
    ) -> Result<Arc<EnvironmentCube>, GpuError> {
        if let Some(drawn) = &inputs.light.on_gpu {
            return Ok(drawn.clone());
        }
        let Gpu { device, queue, .. } = &shared.gpu;
        let upload = || EnvironmentCube::upload(device, queue, &environment.cube);
        self.environment.try_get(Id::of(environment), inputs.progress, upload)
    }

    pub fn count(&self, counts: &mut StageCounts) {
        counts.add_memo(&self.environment);
        counts.add_memo(&self.bounds);
        counts.add_memo(&self.tree);
        counts.add_memo(&self.tree_maps);
        counts.add_memo(&self.flat_maps);
    }
}

/// What is between samples, receivers and light, if that counts.
fn occluding<'a>(inputs: &Inputs<'a>) -> Option<&'a Geometry> {
    inputs.prepared.on_gpu.as_deref().filter(|_| inputs.options.visibility == Visibility::Full)
}

/// The flat sum: every sample is evaluated at every receiver.
#[derive(Debug)]
struct FlatOnGpu {
    shared: Arc<SharedGpu>,
    pipelines: Arc<Engine>,
    environment: Arc<EnvironmentCube>,
    sum: FlatInputs,
    /// The samples with the numbers of their maps, and the maps, if they count.
    maps: Option<Arc<NumberedMaps>>,
    statistics: Statistics,
}

/// The hierarchical sum.
#[derive(Debug)]
pub(super) struct HierarchicalOnGpu {
    pub hierarchy: HierarchyOnGpu,
    pub accuracy: Accuracy,
    pub statistics: Statistics,
}

/// Traces what samples see, in pieces of bounded duration.
async fn trace_maps(
    shared: &SharedGpu,
    geometry: &Geometry,
    scene: &Scene,
    pinholes: &Pinholes,
    (map_use, progress): (MapUse, &dyn Progress),
) -> Result<NumberedMaps, GpuError> {
    let device = &shared.gpu.device;
    let tracer = shared.pipelines.map_tracer(device);
    let mut tracing = MapTracing::new(device, &tracer, geometry, (scene, pinholes.samples.clone()), map_use)?;
    submit(&shared.gpu, &tracing, progress).await?;
    Ok(NumberedMaps::new(&mut tracing, pinholes, false))
}

/// Traces all maps.
async fn submit(gpu: &Gpu, tracing: &MapTracing, progress: &dyn Progress) -> Result<(), GpuError> {
    let pieces = tracing.dispatch_count();
    let submission = Submission { gpu, points: 0, pieces, step: 1, progress };
    submission.run(|encoder, dispatches| tracing.record(encoder, dispatches)).await?;
    let unfinished = gpu.read_buffer(tracing.unfinished(), 4).await?;
    if !progress.is_cancelled() && unfinished.iter().any(|&byte| byte != 0) {
        return Err(GpuError::LoopCutShort { adapter: gpu.adapter.name.clone() });
    }
    Ok(())
}

/// Dispatches of maps that a preview's own commands take on; more are submitted piece by piece.
const MOST_DISPATCHES_OF_FRAME: u32 = 16;

/// What a preview's samples see, in the buffers of the last preview if these fit.
async fn maps_of_frame(
    shared: &SharedGpu,
    geometry: &Geometry,
    (inputs, pinholes): (&Inputs<'_>, &Pinholes),
    kept: &mut Option<MapTracing>,
) -> Result<NumberedMaps, GpuError> {
    let Gpu { device, queue, .. } = &shared.gpu;
    let samples = || (inputs.scene, pinholes.samples.clone());
    let again = kept.take().and_then(|kept| kept.again(queue, geometry, samples()));
    let mut tracing = if let Some(again) = again {
        again
    } else {
        let tracer = shared.pipelines.map_tracer(device);
        MapTracing::new(device, &tracer, geometry, samples(), MapUse::Maps)?
    };
    let is_small = tracing.dispatch_count() <= MOST_DISPATCHES_OF_FRAME;
    if !is_small {
        submit(&shared.gpu, &tracing, inputs.progress).await?;
    }
    let numbered = NumberedMaps::new(&mut tracing, pinholes, is_small);
    *kept = Some(tracing);
    Ok(numbered)
}

impl NumberedMaps {
    fn new(tracing: &mut MapTracing, pinholes: &Pinholes, is_later: bool) -> Self {
        let samples = tracing.take_samples();
        let later = is_later.then(|| LaterMaps { tracing: tracing.clone(), is_recorded: AtomicBool::new(false) });
        let pinholes = Pinholes { samples, curves: pinholes.curves.clone(), visibility: None };
        Self { pinholes, maps: tracing.maps().clone(), later }
    }

    /// Traces what has not been traced, for sums that are not part of a preview's commands.
    async fn trace_now(&self, gpu: &Gpu, progress: &dyn Progress) -> Result<(), GpuError> {
        let Some(later) = self.later.as_ref().filter(|later| !later.is_recorded.load(Ordering::Relaxed)) else {
            return Ok(());
        };
        submit(gpu, &later.tracing, progress).await?;
        // What was cancelled or failed is traced again.
        later.is_recorded.store(!progress.is_cancelled(), Ordering::Relaxed);
        Ok(())
    }
}

impl Sum for FlatOnGpu {
    fn irradiance<'a>(&'a self, receivers: &'a Receivers, progress: &'a dyn Progress) -> Pending<'a, Vec<[f32; 4]>> {
        Box::pin(async move {
            let gpu = &self.shared.gpu;
            if let Some(maps) = &self.maps {
                maps.trace_now(gpu, progress).await?;
            }
            let most = (pairs_per_submit(gpu) / u64::from(BATCH_SIZE)) as usize;
            let mut sums = Vec::with_capacity(receivers.positions.len());
            for strip in strips(receivers, gpu.adapter.max_texture, most) {
                sums.extend(self.strip(&strip, progress).await?);
                if progress.is_cancelled() {
                    break;
                }
            }
            sums.resize(receivers.positions.len(), [0.0; 4]);
            Ok(sums)
        })
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    fn on_gpu(&self) -> Option<&dyn SumOnGpu> {
        Some(self)
    }
}

impl SumOnGpu for FlatOnGpu {
    fn frame(&self, [positions, normals]: [&wgpu::TextureView; 2], size: [u32; 2]) -> Result<gpu::Frame, GpuError> {
        self.pipelines.frame(&self.shared.gpu.device, &self.inputs([positions, normals], None, size))
    }

    fn update(
        &self,
        frame: &mut gpu::Frame,
        receivers: [&wgpu::TextureView; 2],
        size: [u32; 2],
    ) -> Result<bool, GpuError> {
        let Gpu { device, queue, .. } = &self.shared.gpu;
        self.pipelines.update((device, queue), frame, &self.inputs(receivers, None, size))
    }

    fn record_maps(&self, encoder: &mut wgpu::CommandEncoder) -> Option<&wgpu::Buffer> {
        let later = self.maps.as_ref()?.later.as_ref()?;
        if !later.is_recorded.swap(true, Ordering::Relaxed) {
            later.tracing.record(encoder, 0..later.tracing.dispatch_count());
        }
        Some(later.tracing.unfinished())
    }

    fn environment(&self) -> &Arc<EnvironmentCube> {
        &self.environment
    }
}

impl FlatOnGpu {
    fn inputs<'a>(
        &'a self,
        [positions, normals]: [&'a wgpu::TextureView; 2],
        viewers: Option<FrameViewers<'a>>,
        size: [u32; 2],
    ) -> FrameInputs<'a> {
        FrameInputs {
            positions,
            normals,
            viewers,
            size,
            pinholes: self.maps.as_ref().map_or(&self.sum.pinholes, |traced| &traced.pinholes),
            maps: self.maps.as_ref().map(|traced| &traced.maps),
            environment: &self.environment,
            params: self.sum.params,
        }
    }

    async fn strip(&self, receivers: &Receivers, progress: &dyn Progress) -> Result<Vec<[f32; 4]>, GpuError> {
        let gpu = &self.shared.gpu;
        let uploaded = Uploaded::new(gpu, receivers);
        let textures = [&uploaded.positions, &uploaded.normals];
        let inputs = self.inputs(textures, uploaded.viewers(), uploaded.size());
        let mut frame = self.pipelines.frame(&gpu.device, &inputs)?;
        let points = receivers.positions.len() as u64;
        let pairs = pairs_per_submit(gpu);
        let step = (pairs / (points * u64::from(BATCH_SIZE)).max(1)).clamp(1, u64::from(u32::MAX)) as u32;
        let submission = Submission { gpu, points, pieces: frame.batch_count(), step, progress };
        submission.run(|encoder, batches| frame.record(encoder, batches)).await?;
        gpu.read_texture(frame.caustic()).await
    }
}

impl Sum for HierarchicalOnGpu {
    fn irradiance<'a>(&'a self, receivers: &'a Receivers, progress: &'a dyn Progress) -> Pending<'a, Vec<[f32; 4]>> {
        Box::pin(async move {
            let mut sums = Vec::with_capacity(receivers.positions.len());
            for strip in strips(receivers, self.hierarchy.shared.gpu.adapter.max_texture, usize::MAX) {
                let tiled = Tiled::new(&strip);
                let in_tiles = self.strip(&tiled.receivers, progress).await?;
                sums.extend(tiled.in_order(in_tiles));
                if progress.is_cancelled() {
                    break;
                }
            }
            sums.resize(receivers.positions.len(), [0.0; 4]);
            Ok(sums)
        })
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }
}

impl HierarchicalOnGpu {
    async fn strip(&self, receivers: &Receivers, progress: &dyn Progress) -> Result<Vec<[f32; 4]>, GpuError> {
        let gpu = &self.hierarchy.shared.gpu;
        let uploaded = Uploaded::new(gpu, receivers);
        let mut inputs = gpu::HierarchicalInputs {
            tolerance: Tolerance::Absolute(self.accuracy.error),
            split_near: self.accuracy.split_near,
            ..self.hierarchy.inputs(&uploaded)
        };
        let points = receivers.positions.len() as u64;
        while inputs.split_passes <= MAX_SPLIT_PASSES {
            let mut frame = self.hierarchy.pipelines.frame(&gpu.device, &inputs)?;
            let submission = Submission { gpu, points, pieces: frame.batch_count(), step: 1, progress };
            submission.run(|encoder, batches| frame.record(encoder, batches)).await?;
            let sums = gpu.read_texture(frame.caustic()).await?;
            if progress.is_cancelled() || sums.iter().all(|sum| sum[3] >= 0.0) {
                return Ok(sums);
            }
            inputs.split_passes *= 8;
        }
        Err(GpuError::LoopCutShort { adapter: gpu.adapter.name.clone() })
    }
}

impl HierarchyOnGpu {
    /// The inputs of an image; as exact as it can be.
    fn inputs<'a>(&'a self, receivers: &'a Uploaded<'a>) -> gpu::HierarchicalInputs<'a> {
        gpu::HierarchicalInputs {
            positions: &receivers.positions,
            normals: &receivers.normals,
            viewers: receivers.viewers(),
            size: receivers.size(),
            is_grid: receivers.receivers.layout == ReceiverLayout::Grid,
            tree: &self.tree,
            environment: &self.environment,
            bounds: &self.bounds,
            params: self.params,
            tolerance: Tolerance::Absolute(0.0),
            has_tolerances: true,
            split_near: false,
            split_passes: if self.shared.gpu.adapter.software { 16 } else { 1 },
        }
    }

    /// Estimate of the mean irradiance at receivers, W/m².
    pub async fn estimate(&self, receivers: &Receivers) -> Result<f32, GpuError> {
        let gpu = &self.shared.gpu;
        let some = receivers.some(ESTIMATE_MAX_RECEIVERS);
        if some.positions.is_empty() {
            return Ok(f32::MIN_POSITIVE);
        }
        let uploaded = Uploaded::new(gpu, &some);
        let inputs = gpu::HierarchicalInputs { tolerance: Tolerance::Relative(1.0), ..self.inputs(&uploaded) };
        let frame = self.pipelines.frame(&gpu.device, &inputs)?;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        frame.record_estimate_only(&mut encoder);
        gpu.queue.submit([encoder.finish()]);
        Ok(bytemuck::pod_read_unaligned(&gpu.read_buffer(frame.allowed_error(), 4).await?))
    }
}
