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
        Box::pin(async move {
            let hits = self.hits(rays, RayKind::Secondary, |ray| self.prepared.tracer.secondary_hit(ray)).await?;
            Ok(rays.iter().zip(hits).map(|(ray, hit)| self.prepared.camera.or_emitter(*ray, hit)).collect())
        })
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

#[cfg(all(test, feature = "blocking"))]
mod tests {
    use glam::{UVec2, Vec2};

    use super::*;
    use crate::blocking::wait;
    use crate::environment::CubeSize;
    use crate::gpu::Gpu;
    use crate::stages::{LightStages, SceneStages};
    use crate::{Backend, NoProgress};

    const SIZE: [u32; 2] = [48, 36];

    /// What rays meet on the GPU is what they meet on the CPU, up to those that graze an edge. Emitters are seen by the
    /// camera and in mirrors. Rays are traced by ray queries, if the adapter has them, and by shaders.
    #[test]
    fn both_back_ends_find_the_same() {
        for gpu in [wait(None, Gpu::open(None)), wait(None, Gpu::open_minimal())] {
            finds_what_the_cpu_finds(&Backend::gpu(gpu.unwrap()));
        }
    }

    fn finds_what_the_cpu_finds(backend: &Backend) {
        let shared = backend.shared_gpu().unwrap();
        for name in ["cup", "columns", "dynamic"] {
            let scene = crate::load(name).unwrap().0;
            let mut stages = SceneStages::new();
            let mut prepared = stages.prepare(&scene, &NoProgress).unwrap();
            prepared.on_gpu = Some(stages.upload(&scene, &shared.gpu, false, &NoProgress).unwrap());
            let rays = RaysOnGpu::new(shared, &prepared, &NoProgress).unwrap();
            let ray = |k: u32| {
                let at = Vec2::new((k % SIZE[0]) as f32 + 0.5, (k / SIZE[0]) as f32 + 0.5);
                scene.camera.ray(at, UVec2::from_array(SIZE).as_vec2())
            };
            let of_camera: Vec<Ray> = (0..SIZE[0] * SIZE[1]).map(ray).collect();
            let seen = wait(backend.device(), rays.camera_hits(&of_camera)).unwrap();
            assert_alike(name, &seen, &of_camera, |ray| prepared.camera.hit(ray));

            let hits: Vec<&Hit> = seen.iter().flatten().collect();
            let mirrored = |hit: &&Hit| Ray {
                origin: hit.position,
                direction: (hit.position - scene.camera.position).normalize().reflect(hit.normal),
            };
            let secondary: Vec<Ray> = hits.iter().map(mirrored).collect();
            let met = wait(backend.device(), rays.secondary_hits(&secondary)).unwrap();
            assert_alike(name, &met, &secondary, |ray| prepared.camera.secondary_hit(ray));
            let blocked = wait(backend.device(), rays.blocked(&secondary)).unwrap();
            let differ = secondary.iter().zip(&blocked).filter(|(r, b)| prepared.tracer.is_blocked(**r) != **b).count();
            assert!(differ * 500 < secondary.len(), "{name}: {differ} of {}", secondary.len());

            let mut stages = LightStages::new();
            let light = stages.prepare(&scene, None, CubeSize::default(), &NoProgress).unwrap();
            let shadows = Shadows::new(&light, &stages.sampler(&light, &NoProgress), &prepared.tracer);
            let some: Vec<&Hit> = hits.iter().step_by(7).copied().collect();
            let found = wait(backend.device(), rays.unoccluded_fractions(&some, shadows.directions())).unwrap();
            let expected = shadows.unoccluded_fractions_apart(&some);
            let differences = found.iter().zip(&expected).map(|(a, b)| (*a - *b).abs().max_element());
            let mean = differences.sum::<f32>() / some.len() as f32;
            assert!(some.len() > 50 && expected.iter().any(|fraction| fraction.x < 0.9), "{name}");
            assert!(mean < 2e-4, "{name}: {mean}");
        }
    }

    fn assert_alike(name: &str, found: &[Option<Hit>], rays: &[Ray], expected: impl Fn(Ray) -> Option<Hit>) {
        let is_alike = |(found, ray): (&Option<Hit>, &Ray)| match (found, expected(*ray)) {
            (Some(a), Some(b)) => {
                (a.object, a.front) == (b.object, b.front)
                    && a.position.distance(b.position) < 1e-3
                    && (a.distance - b.distance).abs() < 1e-3
                    && a.normal.dot(b.normal) > 0.999
                    && a.face_normal.dot(b.face_normal) > 0.999
            }
            (None, None) => true,
            _ => false,
        };
        let differ = found.iter().zip(rays).filter(|pair| !is_alike(*pair)).count();
        println!("{name}: {differ} of {} differ", rays.len());
        assert!(
            found.len() == rays.len() && found.iter().any(Option::is_some) && differ * 200 < rays.len(),
            "{name}: {differ}"
        );
    }
}
