//! The stages of scattered light, which are made again when one of their inputs changes.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::Vec3;

use super::{DirectScattering, MediumRays, PictureRays, Scattered, scattered_caustic, scattered_direct, unoccluded};
use crate::Error;
use crate::engine::frame::{FrameInputs, LightId, LightKey, id_of};
use crate::engine::shading::SurfaceLight;
use crate::image::Aov;
use crate::options::Options;
use crate::parallel;
use crate::progress::Stage;
use crate::scene::{Medium, Object, Specular, Visibility};
use crate::stages::{CameraRays, Id, LightStages, Memo, StageCounts, SurfaceMaterials};
use crate::technique::Sum;

/// Shadow rays from each part of a camera ray.
const RAYS_PER_PART: usize = 2;

/// What scattered light is made from; direct light has no sum.
#[derive(Clone, PartialEq)]
struct ScatteringKey {
    rays: Id<CameraRays>,
    sum: Option<Id<dyn Sum>>,
    light: LightKey,
    medium: Medium,
    /// Of each object: they tell where the medium is, and where parts of rays lie.
    speculars: Vec<Option<Specular>>,
    steps: u32,
    tolerance: f32,
    /// Light from surfaces, which hides differences, and what they reflect of it.
    beside: Option<(LightId, Id<SurfaceMaterials>)>,
}

/// What a medium scatters along the camera rays of a band.
#[derive(Debug)]
pub(in crate::engine) struct ScatteringStages {
    caustic: Memo<ScatteringKey, Vec<[f32; 4]>>,
    direct: Memo<ScatteringKey, Vec<[f32; 4]>>,
}

impl ScatteringStages {
    pub fn new() -> Self {
        Self { caustic: Memo::new(Stage::Scattering), direct: Memo::new(Stage::Scattering) }
    }

    /// Makes again what changed; nothing where no picture shows it. `surfaces` is the light where camera rays hit.
    pub async fn make(
        &mut self,
        inputs: &FrameInputs<'_>,
        light: &mut LightStages,
        camera_rays: &Arc<CameraRays>,
        surfaces: &SurfaceLight,
    ) -> Result<Scattered, Error> {
        let FrameInputs { scene, prepared, options, progress, .. } = *inputs;
        let Some(medium) = scene.medium.filter(|medium| medium.scatters() && shows_any(options)) else {
            return Ok(Scattered::default());
        };
        let steps = options.medium_steps as usize;
        let rays = MediumRays::of_picture((scene, medium), &prepared.tracer, camera_rays, steps);
        let picture = PictureRays::new(camera_rays, rays);
        let rays = &picture.rays;
        let is_layer = [Aov::Scattered, Aov::ScatteredDirect].iter().any(|aov| options.aovs.contains(aov));
        let beside = (!is_layer).then(|| (id_of(surfaces), Id::of(&prepared.materials)));
        let hiding = || if is_layer { Vec::new() } else { seen_radiance(inputs, &picture, surfaces) };
        let of_direct = ScatteringKey {
            rays: Id::of(camera_rays),
            sum: None,
            light: inputs.light_key(),
            medium,
            speculars: scene.objects.iter().map(Object::specular).collect(),
            steps: options.medium_steps,
            tolerance: options.tolerance,
            beside,
        };
        let mut scattered = Scattered { lengths: rays.lengths(), ..Scattered::default() };
        if shows(options, Aov::Scattered)
            && let Some(sum) = inputs.sum
        {
            let key = ScatteringKey { sum: Some(Id::of(sum)), ..of_direct.clone() };
            let make = async || scattered_caustic(inputs, sum, &picture, &hiding()).await;
            scattered.caustic = Some(self.caustic.wait_for(key, (rays.len() as u64, progress), make).await?);
        }
        if shows(options, Aov::ScatteredDirect) {
            let tracer = (options.visibility == Visibility::Full).then_some(&*prepared.tracer);
            let sampler = light.sampler(inputs.light, progress);
            let make = async || {
                let unoccluded = Arc::new(unoccluded(&inputs.light.environment.cube, &medium));
                let direct =
                    DirectScattering::new(inputs.light, (medium, unoccluded), &sampler, tracer, [steps, RAYS_PER_PART]);
                scattered_direct(inputs, &direct, &picture, &hiding()).await
            };
            scattered.direct = Some(self.direct.wait_for(of_direct, (1, progress), make).await?);
        }
        Ok(scattered)
    }

    pub fn count(&self, counts: &mut StageCounts) {
        counts.add_memo(&self.caustic);
        counts.add_memo(&self.direct);
    }
}

/// Whether a picture shows a kind of scattered light.
fn shows(options: &Options, aov: Aov) -> bool {
    options.aovs.iter().any(|shown| *shown == aov || *shown == Aov::Beauty && !options.plain_diffuse)
}

fn shows_any(options: &Options) -> bool {
    shows(options, Aov::Scattered) || shows(options, Aov::ScatteredDirect)
}

/// What surfaces send through the medium to the camera, as far as it is known.
fn seen_radiance(inputs: &FrameInputs, picture: &PictureRays, light: &SurfaceLight) -> Vec<Vec3> {
    let rays = &picture.rays;
    let radiance = |index: usize| {
        let Some(hit) = picture.camera_rays.hits[index] else { return Vec3::ZERO };
        let receiver = inputs.scene.objects[hit.object as usize].receiver.as_ref();
        let albedo = receiver.map_or(Vec3::ZERO, |receiver| receiver.albedo);
        let arriving = light.direct_at(index) + light.caustic_at(index);
        rays.medium().transmittance(rays.length(index)) * albedo * arriving / PI
    };
    parallel::collect(rays.len(), &radiance)
}
