//! Batches of rays on a GPU. Rays whose traversal the adapter ends early, as Mesa's software one does after 65,535 iterations, are traced
//! again by the CPU.

use std::sync::Arc;

use glam::Vec3;

use super::RayBatches;
use crate::Error;
use crate::backend::SharedGpu;
use crate::engine::shadows::{LightDirection, Shadows};
use crate::pinhole::gpu::ray_batch::{
    ArrivingLight, BatchHit, BatchRay, PackedDirection, RayBatch, RayKind, is_blocked,
};
use crate::pinhole::gpu::{Geometry, RayBatchPipelines};
use crate::progress::Progress;
use crate::scene::Ray;
use crate::stages::PreparedScene;
use crate::technique::Pending;
use crate::tracing::Hit;

/// Rays of a submission: well under a second on a slow GPU, so that no watchdog fires.
const RAYS_PER_SUBMIT: usize = 1 << 22;
/// The same for software adapters, where it sets how soon a cancelled picture ends.
const RAYS_PER_SUBMIT_IN_SOFTWARE: usize = 1 << 20;
/// Rays whose results are read back together: 12 MiB of them.
const RAYS_PER_BATCH: usize = 1 << 18;

/// The rays of a picture of a scene whose triangles are on the device.
pub(in crate::engine) struct RaysOnGpu<'a> {
    shared: &'a SharedGpu,
    pipelines: Arc<RayBatchPipelines>,
    geometry: &'a Geometry,
    prepared: &'a PreparedScene,
    progress: &'a dyn Progress,
}

impl<'a> RaysOnGpu<'a> {
    /// `None` if the scene is not on the device.
    pub fn new(shared: &'a SharedGpu, prepared: &'a PreparedScene, progress: &'a dyn Progress) -> Option<Self> {
        let geometry = prepared.on_gpu.as_deref()?;
        let pipelines = shared.pipelines.ray_batches(&shared.gpu.device);
        Some(Self { shared, pipelines, geometry, prepared, progress })
    }

    async fn hits(
        &self,
        rays: &[Ray],
        kind: RayKind,
        again: impl Fn(Ray) -> Option<Hit>,
    ) -> Result<Vec<Option<Hit>>, Error> {
        let mut all = Vec::with_capacity(rays.len());
        for rays in rays.chunks(RAYS_PER_BATCH) {
            let batch = self.pipelines.hits(&self.shared.gpu.device, self.geometry, &packed(rays), kind);
            let found: Vec<BatchHit> = self.results(&batch, rays.len()).await?;
            let hit = |(ray, hit): (&Ray, &BatchHit)| if hit.is_finished() { unpacked(hit) } else { again(*ray) };
            all.extend(rays.iter().zip(&found).map(hit));
        }
        Ok(all)
    }

    /// Submits a batch and reads its results.
    async fn results<T: bytemuck::Pod>(&self, batch: &RayBatch, count: usize) -> Result<Vec<T>, Error> {
        if self.progress.is_cancelled() {
            return Err(Error::Cancelled);
        }
        let gpu = &self.shared.gpu;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        batch.record(&mut encoder);
        gpu.queue.submit([encoder.finish()]);
        let bytes = gpu.read_buffer(&batch.results, (count * size_of::<T>()) as u64).await?;
        gpu.check()?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }

    /// So many points that their rays in so many directions make up a submission.
    fn points_per_submit(&self, directions: usize) -> usize {
        let rays = if self.shared.gpu.adapter.software { RAYS_PER_SUBMIT_IN_SOFTWARE } else { RAYS_PER_SUBMIT };
        (rays / directions.max(1)).clamp(1, RAYS_PER_BATCH)
    }
}

impl RayBatches for RaysOnGpu<'_> {
    fn camera_hits<'a>(&'a self, rays: &'a [Ray]) -> Pending<'a, Vec<Option<Hit>>> {
        Box::pin(self.hits(rays, RayKind::Camera, |ray| self.prepared.camera.hit(ray)))
    }

    fn secondary_hits<'a>(&'a self, rays: &'a [Ray]) -> Pending<'a, Vec<Option<Hit>>> {
        Box::pin(self.hits(rays, RayKind::Secondary, |ray| self.prepared.tracer.secondary_hit(ray)))
    }

    fn blocked<'a>(&'a self, rays: &'a [Ray]) -> Pending<'a, Vec<bool>> {
        Box::pin(async move {
            let mut all = Vec::with_capacity(rays.len());
            for rays in rays.chunks(RAYS_PER_BATCH) {
                let batch = self.pipelines.blocked(&self.shared.gpu.device, self.geometry, &packed(rays));
                let found: Vec<u32> = self.results(&batch, rays.len()).await?;
                let again = |ray: &Ray| self.prepared.tracer.is_blocked(*ray);
                all.extend(
                    rays.iter().zip(&found).map(|(ray, flags)| is_blocked(*flags).unwrap_or_else(|| again(ray))),
                );
            }
            Ok(all)
        })
    }

    fn unoccluded_fractions<'a>(
        &'a self,
        points: &'a [&'a Hit],
        directions: &'a [LightDirection],
    ) -> Pending<'a, Vec<Vec3>> {
        Box::pin(async move {
            let of_light = packed_directions(directions);
            let mut all = Vec::with_capacity(points.len());
            for points in points.chunks(self.points_per_submit(directions.len())) {
                let rays: Vec<BatchRay> = points.iter().map(|hit| BatchRay::new(hit.position, hit.normal)).collect();
                let batch = self.pipelines.arriving(&self.shared.gpu.device, self.geometry, &rays, &of_light);
                let found: Vec<ArrivingLight> = self.results(&batch, points.len()).await?;
                let again = Shadows::along(directions, &self.prepared.tracer);
                let fraction = |(point, light): (&&Hit, &ArrivingLight)| {
                    light.fraction().unwrap_or_else(|| again.unoccluded_fractions_apart(&[point])[0])
                };
                all.extend(points.iter().zip(&found).map(fraction));
            }
            Ok(all)
        })
    }
}

/// Directions of shadow rays as the device reads them.
pub(in crate::engine) fn packed_directions(directions: &[LightDirection]) -> Vec<PackedDirection> {
    directions.iter().map(|light| PackedDirection::new(light.direction, light.radiance)).collect()
}

fn packed(rays: &[Ray]) -> Vec<BatchRay> {
    rays.iter().map(|ray| BatchRay::new(ray.origin, ray.direction)).collect()
}

fn unpacked(hit: &BatchHit) -> Option<Hit> {
    let [position, normal, face_normal] = [hit.position, hit.normal, hit.face_normal].map(Vec3::from_array);
    hit.is_hit().then(|| Hit {
        object: hit.object,
        position,
        distance: hit.distance,
        normal,
        face_normal,
        front: hit.is_front(),
    })
}
