//! Hierarchical sums: a tree of cells is traversed as deep as the tolerance requires, light by light.

use std::sync::Arc;

use super::add;
use super::near_light::NearLightOnGpu;
use super::receivers::{Tiled, Uploaded, in_strips};
use super::submission::Submission;
use crate::backend::SharedGpu;
use crate::gpu::GpuError;
use crate::pinhole::cpu::Accuracy;
use crate::pinhole::gpu::{
    self, CellTreeBuffers, EnvironmentCube, HierarchicalEngine, LightBoundsTexture, Tolerance, TreeLight,
};
use crate::pinhole::{ESTIMATE_MAX_RECEIVERS, Params, ReceiverLayout, Receivers};
use crate::progress::{Progress, Uncounted};
use crate::technique::pinhole::clearance::MirrorClearance;
use crate::technique::{Pending, Statistics, Sum};

/// The largest number of passes that the traversal is split into, on adapters that end loops early.
const MAX_SPLIT_PASSES: u32 = 4096;

/// A tree on the device, and the light.
#[derive(Debug)]
pub(in crate::technique::pinhole) struct HierarchyOnGpu {
    pub shared: Arc<SharedGpu>,
    /// For each light, the environment first.
    pub engines: Vec<Arc<HierarchicalEngine>>,
    pub environment: Arc<EnvironmentCube>,
    pub bounds: Arc<LightBoundsTexture>,
    pub near: Arc<NearLightOnGpu>,
    pub tree: Arc<CellTreeBuffers>,
    pub params: Params,
}

/// The hierarchical sum.
#[derive(Debug)]
pub(in crate::technique::pinhole) struct HierarchicalOnGpu {
    pub hierarchy: HierarchyOnGpu,
    pub accuracy: Accuracy,
    pub clearance: MirrorClearance,
    pub statistics: Statistics,
}

impl Sum for HierarchicalOnGpu {
    fn irradiance<'a>(&'a self, receivers: &'a Receivers, progress: &'a dyn Progress) -> Pending<'a, Vec<[f32; 4]>> {
        Box::pin(async move {
            let strip = async |strip: &Receivers| {
                let tiled = Tiled::new(strip);
                Ok(tiled.in_order(self.strip(&tiled.receivers, progress).await?))
            };
            let most = (self.hierarchy.shared.gpu.adapter.max_texture, usize::MAX);
            let receivers = self.clearance.receivers(receivers);
            Ok(in_strips(&receivers, most, progress, strip).await?)
        })
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }
}

impl HierarchicalOnGpu {
    async fn strip(&self, receivers: &Receivers, progress: &dyn Progress) -> Result<Vec<[f32; 4]>, GpuError> {
        let uploaded = Uploaded::new(&self.hierarchy.shared.gpu, receivers);
        let mut sums = Vec::new();
        for (k, (engine, light)) in self.hierarchy.lights().enumerate() {
            let inputs = gpu::HierarchicalInputs {
                tolerance: Tolerance::Absolute(self.accuracy.error),
                split_near: self.accuracy.split_near,
                ..self.hierarchy.inputs(&uploaded, light)
            };
            let uncounted = Uncounted(progress);
            let progress = if k == 0 { progress } else { &uncounted };
            add(&mut sums, self.of_light(engine, inputs, receivers, progress).await?);
        }
        Ok(sums)
    }

    /// The sum under one light; where the adapter ends loops early, in more and more passes.
    async fn of_light(
        &self,
        engine: &HierarchicalEngine,
        mut inputs: gpu::HierarchicalInputs<'_>,
        receivers: &Receivers,
        progress: &dyn Progress,
    ) -> Result<Vec<[f32; 4]>, GpuError> {
        let gpu = &self.hierarchy.shared.gpu;
        let points = receivers.positions.len() as u64;
        while inputs.split_passes <= MAX_SPLIT_PASSES {
            let mut frame = engine.frame(&gpu.device, &inputs)?;
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
    /// Each light with the engine for it.
    fn lights(&self) -> impl Iterator<Item = (&HierarchicalEngine, TreeLight<'_>)> {
        let environment = TreeLight::Environment { cube: &self.environment, bounds: &self.bounds };
        let lights = std::iter::once(environment).chain(self.near.tree_lights());
        self.engines.iter().map(|engine| &**engine).zip(lights)
    }

    /// The inputs of an image; as exact as it can be.
    fn inputs<'a>(&'a self, receivers: &'a Uploaded<'a>, light: TreeLight<'a>) -> gpu::HierarchicalInputs<'a> {
        gpu::HierarchicalInputs {
            positions: &receivers.positions,
            normals: &receivers.normals,
            viewers: receivers.viewers(),
            size: receivers.size(),
            is_grid: receivers.receivers.layout == ReceiverLayout::Grid,
            tree: &self.tree,
            light,
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
        let mut estimate = 0.0;
        for (engine, light) in self.lights() {
            let tolerance = Tolerance::Relative(1.0);
            let inputs = gpu::HierarchicalInputs { tolerance, ..self.inputs(&uploaded, light) };
            let frame = engine.frame(&gpu.device, &inputs)?;
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            frame.record_estimate_only(&mut encoder);
            gpu.queue.submit([encoder.finish()]);
            estimate += bytemuck::pod_read_unaligned::<f32>(&gpu.read_buffer(frame.allowed_error(), 4).await?);
        }
        Ok(estimate)
    }
}
