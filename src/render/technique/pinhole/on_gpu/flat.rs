//! Flat sums: every sample is evaluated at every receiver, light by light.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::near_light::NearLightOnGpu;
use super::receivers::{Uploaded, in_strips};
use super::submission::{Submission, pairs_per_submit};
use super::{NumberedMaps, add};
use crate::backend::SharedGpu;
use crate::gpu::{Gpu, GpuError};
use crate::pinhole::gpu::{self, Engine, EnvironmentCube, FrameInputs, FrameLight, FrameViewers};
use crate::pinhole::{BATCH_SIZE, Receivers};
use crate::progress::{Progress, Uncounted};
use crate::technique::pinhole::FlatInputs;
use crate::technique::{Pending, Statistics, Sum, SumOnGpu};

/// The flat sum: every sample is evaluated at every receiver.
#[derive(Debug)]
pub(super) struct FlatOnGpu {
    pub shared: Arc<SharedGpu>,
    /// For each light, the environment first.
    pub engines: Vec<Arc<Engine>>,
    pub environment: Arc<EnvironmentCube>,
    pub near: Arc<NearLightOnGpu>,
    pub sum: FlatInputs,
    /// The samples with the numbers of their maps, and the maps, if they count.
    pub maps: Option<Arc<NumberedMaps>>,
    pub statistics: Statistics,
}

impl Sum for FlatOnGpu {
    fn irradiance<'a>(&'a self, receivers: &'a Receivers, progress: &'a dyn Progress) -> Pending<'a, Vec<[f32; 4]>> {
        Box::pin(async move {
            let gpu = &self.shared.gpu;
            if let Some(maps) = &self.maps {
                maps.trace_now(gpu, progress).await?;
            }
            let most = (pairs_per_submit(gpu) / u64::from(BATCH_SIZE)) as usize;
            let strip = async |strip: &Receivers| self.strip(strip, progress).await;
            Ok(in_strips(receivers, (gpu.adapter.max_texture, most), progress, strip).await?)
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
    fn frames(&self, receivers: [&wgpu::TextureView; 2], size: [u32; 2]) -> Result<Vec<gpu::Frame>, GpuError> {
        let frame = |(engine, light): (&Arc<Engine>, FrameLight)| {
            engine.frame(&self.shared.gpu.device, &self.inputs(receivers, None, size, light))
        };
        self.engines.iter().zip(self.lights()).map(frame).collect()
    }

    fn update(
        &self,
        frames: &mut [gpu::Frame],
        receivers: [&wgpu::TextureView; 2],
        size: [u32; 2],
    ) -> Result<bool, GpuError> {
        let Gpu { device, queue, .. } = &self.shared.gpu;
        if frames.len() != self.engines.len() {
            return Ok(false);
        }
        for ((frame, engine), light) in frames.iter_mut().zip(&self.engines).zip(self.lights()) {
            if !engine.update((device, queue), frame, &self.inputs(receivers, None, size, light))? {
                return Ok(false);
            }
        }
        Ok(true)
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
    /// In the order of the engines.
    fn lights(&self) -> impl Iterator<Item = FrameLight<'_>> {
        std::iter::once(FrameLight::Environment(&self.environment)).chain(self.near.frame_lights())
    }

    fn inputs<'a>(
        &'a self,
        [positions, normals]: [&'a wgpu::TextureView; 2],
        viewers: Option<FrameViewers<'a>>,
        size: [u32; 2],
        light: FrameLight<'a>,
    ) -> FrameInputs<'a> {
        FrameInputs {
            positions,
            normals,
            viewers,
            size,
            pinholes: self.maps.as_ref().map_or(&self.sum.pinholes, |traced| &traced.pinholes),
            maps: self.maps.as_ref().map(|traced| &traced.maps),
            light,
            params: self.sum.params,
        }
    }

    async fn strip(&self, receivers: &Receivers, progress: &dyn Progress) -> Result<Vec<[f32; 4]>, GpuError> {
        let gpu = &self.shared.gpu;
        let uploaded = Uploaded::new(gpu, receivers);
        let textures = [&uploaded.positions, &uploaded.normals];
        let points = receivers.positions.len() as u64;
        let pairs = pairs_per_submit(gpu);
        let step = (pairs / (points * u64::from(BATCH_SIZE)).max(1)).clamp(1, u64::from(u32::MAX)) as u32;
        let omitted = self.sum.near.seen.surfaces.iter().filter(|_| self.sum.omits_surfaces(receivers)).count();
        let mut sums = Vec::new();
        for (k, (engine, light)) in
            self.engines.iter().zip(self.lights()).enumerate().take(self.engines.len() - omitted)
        {
            let inputs = self.inputs(textures, uploaded.viewers(), uploaded.size(), light);
            let mut frame = engine.frame(&gpu.device, &inputs)?;
            let uncounted = Uncounted(progress);
            let progress = if k == 0 { progress } else { &uncounted };
            let submission = Submission { gpu, points, pieces: frame.batch_count(), step, progress };
            submission.run(|encoder, batches| frame.record(encoder, batches)).await?;
            add(&mut sums, gpu.read_texture(frame.caustic()).await?);
        }
        Ok(sums)
    }
}
