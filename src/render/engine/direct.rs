//! Direct light on diffuse surfaces: the unoccluded irradiance, which is known exactly, times the fraction of it that
//! shadow rays find unblocked (Heitz, Hill, McGuire 2018, *Combining Analytic Direct Illumination and Stochastic
//! Shadows*). At a point, nothing is approximated where nothing is occluded, or everything; between every other pixel of a picture the
//! light is interpolated where it is smooth.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;

use super::every_other::{AdaptiveLight, PixelGrid, STEP};
use super::ray_batches::RayBatches;
#[cfg(feature = "gpu")]
use super::shadows::LightDirection;
use super::shadows::{Shadows, is_enclosed};
use crate::Error;
use crate::environment::CubeMap;
use crate::error::check_wanted;
use crate::parallel;
use crate::progress::Progress;
use crate::scene::Visibility;
use crate::stages::{CameraRays, DirectNearLight, LightStages, PreparedLight};
use crate::tracing::{Hit, Tracer};

/// Camera rays, approximately, that tell how enclosed the place is that the picture shows.
const SEEN_POINTS: usize = 64;
/// Edge of the blocks of camera rays whose shadows are found together, at most.
const BLOCK: usize = 32;
/// Blocks along a row of the picture, at least: in small pictures, large blocks would be much larger than what throws shadows.
const MIN_BLOCKS: usize = 4;

/// Irradiance of the environment, of lamps and of near emitters on receivers, at an intensity of 1.
pub(super) struct DirectLight<'a> {
    light: &'a PreparedLight,
    irradiance: Arc<CubeMap>,
    near_light: DirectNearLight<'a>,
    /// Where receivers may be occluded.
    shadows: Option<Shadows<'a>>,
    /// Where shadow rays are traced in batches.
    batches: Option<&'a dyn RayBatches>,
    progress: &'a dyn Progress,
}

impl<'a> DirectLight<'a> {
    /// With as many directions of shadow rays as what the camera sees needs.
    pub async fn new(
        light: &'a PreparedLight,
        stages: &mut LightStages,
        (tracer, batches): (&'a Tracer, Option<&'a dyn RayBatches>),
        (visibility, rays): (Visibility, &CameraRays),
        progress: &'a dyn Progress,
    ) -> Result<Self, Error> {
        let mut shadows = None;
        if visibility == Visibility::Full {
            let sampler = stages.sampler(light, progress);
            let mut usual = Shadows::new(light, &sampler, tracer);
            let step = rays.hits.len() / SEEN_POINTS + 1;
            let seen: Vec<&Hit> = rays.hits.iter().step_by(step).flatten().collect();
            let fractions = match batches {
                Some(batches) => batches.unoccluded_fractions(&seen, usual.directions()).await?,
                None => usual.unoccluded_fractions_apart(&seen),
            };
            if is_enclosed(&fractions) {
                usual = Shadows::of_enclosed(light, &sampler, tracer);
            }
            shadows = Some(usual);
        }
        let near_light = DirectNearLight::new(light, (visibility == Visibility::Full).then_some(tracer));
        Ok(Self { light, irradiance: stages.irradiance(light, progress), near_light, shadows, batches, progress })
    }

    /// With so many directions of shadow rays, for previews; without shadows if there are none.
    pub fn of_few(
        light: &'a PreparedLight,
        stages: &mut LightStages,
        tracer: &'a Tracer,
        directions: Option<usize>,
        progress: &'a dyn Progress,
    ) -> Self {
        let shadows = directions.map(|count| Shadows::of_few(light, &stages.sampler(light, progress), tracer, count));
        let near_light = DirectNearLight::new(light, shadows.is_some().then_some(tracer));
        Self { light, irradiance: stages.irradiance(light, progress), near_light, shadows, batches: None, progress }
    }

    /// The unoccluded irradiance by normal, in the environment's frame.
    #[cfg(feature = "gpu")]
    pub fn unoccluded(&self) -> &Arc<CubeMap> {
        &self.irradiance
    }

    /// The directions of shadow rays; none without shadows.
    #[cfg(feature = "gpu")]
    pub fn shadow_directions(&self) -> &[LightDirection] {
        self.shadows.as_ref().map_or(&[], Shadows::directions)
    }

    /// Irradiance at points that are close to each other, W/m²; without shadows once it is cancelled.
    pub fn irradiance(&self, points: &[&Hit]) -> Vec<Vec3> {
        let mut irradiance: Vec<Vec3> = points.iter().map(|point| self.unoccluded_at(point)).collect();
        let is_dark = irradiance.iter().all(|irradiance| *irradiance == Vec3::ZERO);
        if let Some(shadows) = self.shadows.as_ref().filter(|_| !is_dark && !self.progress.is_cancelled()) {
            let fractions = shadows.unoccluded_fractions(points, self.progress);
            irradiance.iter_mut().zip(fractions).for_each(|(value, fraction)| *value *= fraction);
        }
        self.add_near_light(points, &mut irradiance);
        irradiance
    }

    fn add_near_light(&self, points: &[&Hit], irradiance: &mut [Vec3]) {
        if !self.near_light.is_dark() && !self.progress.is_cancelled() {
            irradiance.iter_mut().zip(points).for_each(|(value, point)| *value += self.near_light.irradiance(point));
        }
    }

    /// The light of lamps and near emitters alone.
    pub fn near_light(&self) -> &DirectNearLight<'a> {
        &self.near_light
    }

    fn unoccluded_at(&self, point: &Hit) -> Vec3 {
        self.irradiance.fetch(self.light.light_from_world(point.normal), 0.0)
    }

    /// Irradiance at groups of points that are close to each other, W/m², in one list.
    pub async fn irradiance_of_groups(&self, groups: &[Vec<&Hit>]) -> Result<Vec<Vec3>, Error> {
        let Some((batches, shadows)) = self.batches.zip(self.shadows.as_ref()) else {
            return Ok(parallel::map(groups, &|group| self.irradiance(group)).concat());
        };
        let points = groups.concat();
        let fractions = batches.unoccluded_fractions(&points, shadows.directions()).await?;
        let unoccluded = points.iter().map(|point| self.unoccluded_at(point));
        let mut irradiance: Vec<Vec3> = unoccluded.zip(fractions).map(|(value, fraction)| fraction * value).collect();
        self.add_near_light(&points, &mut irradiance);
        Ok(irradiance)
    }

    /// Irradiance where camera rays hit wanted objects, W/m²; zero elsewhere. Every other pixel is computed, and those between
    /// where light changes from one to the next.
    pub async fn at_hits(&self, rays: &CameraRays, wanted: impl Fn(u32) -> bool) -> Result<Vec<Vec3>, Error> {
        let is_wanted = |hit: &Option<Hit>| hit.is_some_and(|hit| wanted(hit.object));
        let points = (0..rays.hits.len()).filter(|&index| is_wanted(&rays.hits[index]));
        let mut light = AdaptiveLight::new(rays, rays.hits.len(), points, &[]);
        let most = (rays.width as usize / MIN_BLOCKS).max(1);
        let mut edge = most.min(STEP * BLOCK);
        while let Some(open) = light.next_open() {
            let groups = by_block_and_object(rays, &open, edge);
            let hit = |index: &usize| rays.hits[*index].as_ref();
            let points: Vec<Vec<&Hit>> = groups.iter().map(|group| group.iter().filter_map(hit).collect()).collect();
            let irradiance = self.irradiance_of_groups(&points).await?;
            check_wanted(self.progress)?;
            light.set(groups.into_iter().flatten().zip(irradiance.into_iter().map(|value| value.extend(0.0))));
            edge = most.min(BLOCK);
        }
        Ok(light.finish().iter().map(|light| Vec3::from_slice(light)).collect())
    }
}

/// Camera rays that hit the same object in the same block of the picture.
fn by_block_and_object(rays: &CameraRays, indices: &[usize], edge: usize) -> Vec<Vec<usize>> {
    let mut groups: BTreeMap<(usize, usize, u32), Vec<usize>> = BTreeMap::new();
    for &index in indices {
        let (column, row) = rays.pixel(index);
        if let Some(hit) = &rays.hits[index] {
            groups.entry((row / edge, column / edge, hit.object)).or_default().push(index);
        }
    }
    groups.into_values().collect()
}

#[cfg(test)]
mod tests {
    use std::pin::pin;
    use std::task::{Context, Poll, Waker};

    use super::*;
    use crate::NoProgress;
    use crate::environment::CubeSize;
    use crate::scene::load;
    use crate::stages::View;

    /// Nothing is waited for on the CPU.
    fn ready<T>(future: impl Future<Output = T>) -> T {
        match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(value) => value,
            Poll::Pending => panic!("pending"),
        }
    }

    /// What the points of a block agree on is what each of them finds alone.
    #[test]
    fn blocks_find_the_shadows_of_their_points() {
        let scene = load::<toml::Table>("columns").unwrap().scene;
        let tracer = Tracer::new(&scene);
        let view = View { camera: scene.camera, size: [128, 128], pixel_samples: 1, first_row: 0, rows: 128 };
        let rays = CameraRays::trace(|ray| tracer.camera_hit(ray), view);
        let mut stages = LightStages::new();
        let light = stages.prepare(&scene, None, CubeSize::default(), &NoProgress).unwrap();
        let made = DirectLight::new(&light, &mut stages, (&tracer, None), (Visibility::Full, &rays), &NoProgress);
        let direct = ready(made).unwrap();
        let together = ready(direct.at_hits(&rays, |_| true)).unwrap();
        let brightest = together.iter().map(|v| v.max_element()).fold(0.0, f32::max);
        let differences: Vec<f32> = (0..rays.hits.len())
            .step_by(7)
            .filter_map(|k| rays.hits[k].as_ref().map(|hit| (k, hit)))
            .map(|(k, hit)| together[k].distance(direct.irradiance(&[hit])[0]) / brightest)
            .collect();
        let mean = differences.iter().sum::<f32>() / differences.len() as f32;
        let wrong = differences.iter().filter(|&&d| d > 0.01).count();
        println!("{mean:.5} on average, {wrong} of {} off by more than .01", differences.len());
        assert!(differences.len() > 1500);
        assert!(mean < 1e-3, "{mean}");
        assert!(wrong * 200 < differences.len(), "{wrong} of {}", differences.len());
    }
}
