//! Sums on a GPU: copies of light and samples are made once and kept. Receivers are uploaded in strips,
//! work is submitted in pieces of bounded duration, and the sums are read back.

mod flat;
mod hierarchical;
mod near_light;
mod receivers;
mod submission;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use self::flat::FlatOnGpu;
pub(super) use self::hierarchical::HierarchicalOnGpu;
use self::hierarchical::HierarchyOnGpu;
use self::near_light::{NearLightOnGpu, key_for};
use self::submission::Submission;
use super::{FlatInputs, HierarchicalInputs, NearLight};
use crate::Error;
use crate::backend::SharedGpu;
use crate::environment::{Environment, LightBounds};
use crate::gpu::{Gpu, GpuError};
use crate::pinhole::gpu::{
    CellTreeBuffers, EnvironmentCube, Geometry, LightBoundsTexture, LightKind, MapTracing, MapUse, PipelineKey,
    VisibilityMapBuffers,
};
use crate::pinhole::{PinholeTree, Pinholes};
use crate::progress::{Progress, Stage};
use crate::scene::{Scene, Visibility};
use crate::stages::{Id, Memo, StageCounts};
use crate::technique::{Inputs, Statistics, Sum};
use crate::tracing::Tracer;

/// Everything that is kept on the device.
#[derive(Debug)]
pub(super) struct GpuStages {
    environment: Memo<Id<Environment>, EnvironmentCube>,
    near: Memo<NearLight, NearLightOnGpu>,
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

impl GpuStages {
    pub fn new() -> Self {
        Self {
            environment: Memo::new(Stage::Upload),
            near: Memo::new(Stage::Upload),
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
            light: LightKind::Environment,
            visibility: geometry.is_some(),
            refraction: sum.pinholes.refracts(),
            medium: sum.params.medium.is_some(),
        };
        let environment = self.environment(shared, &sum.environment, inputs)?;
        let near = self.near(shared, &sum.near, inputs)?;
        let engine = |light| shared.pipelines.flat(&shared.gpu.device, key_for(light, key));
        let engines = std::iter::once(LightKind::Environment).chain(near.kinds()).map(engine).collect();
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
        Ok(Arc::new(FlatOnGpu { shared: shared.clone(), engines, environment, near, sum, maps, statistics }))
    }

    /// Uploads a tree and the light, and traces visibility maps if they count.
    pub async fn hierarchy(
        &mut self,
        shared: &Arc<SharedGpu>,
        sum: &HierarchicalInputs,
        inputs: &Inputs<'_>,
    ) -> Result<HierarchyOnGpu, Error> {
        let Gpu { device, queue, .. } = &shared.gpu;
        let HierarchicalInputs { tree, environment, bounds, params, near, .. } = sum;
        let (visibility, refraction) = (occluding(inputs).is_some(), tree.refracts());
        let (filter, medium) = (params.filter, params.medium.is_some());
        let key = PipelineKey { filter, light: LightKind::Environment, visibility, refraction, medium };
        let environment = self.environment(shared, environment, inputs)?;
        let near = self.near(shared, near, inputs)?;
        let engine = |light| shared.pipelines.hierarchical(device, key_for(light, key));
        let engines = std::iter::once(LightKind::Environment).chain(near.kinds()).map(engine).collect();
        let bounds =
            self.bounds.get(Id::of(bounds), inputs.progress, || LightBoundsTexture::upload(device, queue, bounds));
        let tree = self.tree(shared, tree, inputs).await?;
        shared.gpu.check()?;
        Ok(HierarchyOnGpu { shared: shared.clone(), engines, environment, bounds, near, tree, params: *params })
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

    fn near(
        &mut self,
        shared: &SharedGpu,
        near: &NearLight,
        inputs: &Inputs<'_>,
    ) -> Result<Arc<NearLightOnGpu>, GpuError> {
        self.near.try_get(near.clone(), inputs.progress, || NearLightOnGpu::upload(&shared.gpu, near))
    }

    pub fn count(&self, counts: &mut StageCounts) {
        counts.add_memo(&self.environment);
        counts.add_memo(&self.near);
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
        let pinholes = Pinholes { samples, curves: pinholes.curves.clone(), visibility: None, shapes: pinholes.shapes };
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

/// Adds what one more light contributes.
fn add(sums: &mut Vec<[f32; 4]>, more: Vec<[f32; 4]>) {
    if sums.is_empty() {
        *sums = more;
    } else {
        super::add(sums, &more);
    }
}
