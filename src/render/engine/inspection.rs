//! What lies behind a place of the picture: the samples' footprints on the environment, or what a sample of a mirror sees.

use std::f32::consts::{PI, TAU};

use glam::{UVec2, Vec2, Vec3};

use super::Engine;
use super::preview::PreviewStages;
use crate::image::{Image, exposed};
use crate::options::{EvaluationChoice, Options};
use crate::pinhole::SampleView;
use crate::pinhole::cpu::{Contribution, TakenCell};
use crate::progress::Progress;
use crate::scene::Chains;
use crate::stages::{LightStages, PreparedLight};
use crate::technique::{Inputs, Inspected, TechniqueStages};
use crate::tracing::Hit;
use crate::{Backend, Error};

/// What a place of the picture shows.
#[derive(Clone, Debug)]
pub struct Inspection {
    /// Index of the object that the camera sees there.
    pub object: usize,
    /// Where, in the world, metres.
    pub position: Vec3,
    /// Where light comes to a receiver from.
    pub receiver: Option<ReceiverInspection>,
    /// What the nearest sample of a mirror sees.
    pub view: Option<SampleView>,
}

/// The caustic at a receiver, sample by sample.
#[derive(Clone, Debug)]
pub struct ReceiverInspection {
    /// W/m².
    pub irradiance: Vec3,
    /// The number of samples that contribute to it,
    pub samples: usize,
    /// and of those, from the largest contribution on, that bring nine tenths of it.
    pub main_samples: usize,
    /// Footprints of the samples that contribute most, from the largest contribution on; at most [`MAX_FOOTPRINTS`].
    pub footprints: Vec<MapFootprint>,
}

/// A sample's footprint on the environment, as it is drawn on its equirectangular map.
#[derive(Clone, Debug)]
pub struct MapFootprint {
    /// An ellipse around it; fractions of the map's width and height. It may reach beyond the map's left and right edges.
    pub outline: Vec<Vec2>,
    /// Its part of the irradiance.
    pub part: f32,
}

/// Footprints of an inspection, at most.
pub const MAX_FOOTPRINTS: usize = 400;

/// Points of a footprint's outline.
const OUTLINE: u32 = 16;

impl Engine {
    /// Looks behind a place of the picture, as fractions of its width and height. `None` where the camera sees no object. Samples are
    /// taken one by one, whatever the evaluation, and on the CPU.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn inspect(&mut self, place: Vec2, progress: &dyn Progress) -> Result<Option<Inspection>, Error> {
        let options = self.options.clone().with_leaves(None).with_evaluation(EvaluationChoice::Flat);
        self.with_hit_at(&options, (place, progress), |technique, _, inputs, hit| {
            let object = &inputs.scene.objects[hit.object as usize];
            let mut inspection =
                Inspection { object: hit.object as usize, position: hit.position, receiver: None, view: None };
            if has_caustics(inputs) {
                let Inspected { contributions, view } = technique.inspect(inputs, hit)?;
                inspection.receiver =
                    object.receiver.is_some().then(|| receiver_inspection(&contributions, inputs.light));
                inspection.view = view.filter(|_| object.specular().is_some());
            }
            Ok(inspection)
        })
    }

    /// The cells of the mirrors that a hierarchical sum takes as one sample each for a place of the picture, as fractions of its width
    /// and height; `None` if sums are flat. There are no cells where the camera sees no receiver. On the CPU.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn cells_taken(&mut self, place: Vec2, progress: &dyn Progress) -> Result<Option<Vec<TakenCell>>, Error> {
        let options = self.options.clone();
        let taken = self.with_hit_at(&options, (place, progress), |technique, light, inputs, hit| {
            if !has_caustics(inputs) || inputs.scene.objects[hit.object as usize].receiver.is_none() {
                return Ok(Some(Vec::new()));
            }
            let mut cells = technique.cells_taken(inputs, light, hit)?;
            for cell in cells.iter_mut().flatten() {
                cell.irradiance *= inputs.light.intensity;
            }
            Ok(cells)
        })?;
        Ok(taken.unwrap_or_else(|| Some(Vec::new())))
    }

    /// Runs `f` with the stages of the inspection and what the camera sees at a place; `None` where it sees no object.
    fn with_hit_at<T>(
        &mut self,
        options: &Options,
        (place, progress): (Vec2, &dyn Progress),
        f: impl FnOnce(&mut dyn TechniqueStages, &mut LightStages, &Inputs, &Hit) -> Result<T, Error>,
    ) -> Result<Option<T>, Error> {
        options.check()?;
        let scene = self.scene_stages.prepare_for_frame(&self.scene, progress)?;
        let size = UVec2::from_array(options.size).as_vec2();
        let Some(hit) = scene.camera.hit(self.scene.camera.ray(place * size, size)) else { return Ok(None) };
        if self.inspection.technique.0 != options.technique {
            self.inspection = PreviewStages::new(options.technique);
        }
        let PreviewStages { technique: (_, technique), light: stages, .. } = &mut self.inspection;
        let geometry = scene.geometry_drawn_for_frame(false);
        let light = stages.prepare(&self.scene, geometry.as_ref(), options.cube_size, progress)?;
        let light = light.with_near(scene.near_emitters.as_ref());
        let inputs = Inputs {
            scene: &self.scene,
            prepared: &scene,
            light: &light,
            options,
            backend: &Backend::cpu(),
            chains: Chains::ALL,
            is_preview: true,
            progress,
        };
        f(&mut **technique, stages, &inputs, &hit).map(Some)
    }

    /// The environment as an equirectangular picture of so many rows, twice as wide, with the exposure of the background; an automatic
    /// one is metered on this picture.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn environment_map(&mut self, height: u32, progress: &dyn Progress) -> Result<Image, Error> {
        self.options.check()?;
        let scene = self.scene_stages.prepare_for_frame(&self.scene, progress)?;
        let (geometry, cube_size) = (scene.geometry_drawn_for_frame(false), self.options.cube_size);
        let light = self.inspection.light.prepare(&self.scene, geometry.as_ref(), cube_size, progress)?;
        let radiance = light.environment.radiance.equirectangular(height).map(|radiance| light.intensity * radiance);
        let metered = || crate::image::metered_ev(radiance.pixels.iter().copied());
        let stops = self.options.display.exposures(metered).background_exposure_ev;
        let tone_map = self.options.display.tone_map;
        Ok(radiance.map(|radiance| tone_map.apply(exposed(radiance, stops))))
    }
}

fn has_caustics(inputs: &Inputs) -> bool {
    inputs.options.shows_caustic() && inputs.scene.objects.iter().any(|object| object.specular().is_some())
}

fn receiver_inspection(contributions: &[Contribution], light: &PreparedLight) -> ReceiverInspection {
    let irradiance: Vec3 = contributions.iter().map(|c| c.irradiance).sum();
    let whole = irradiance.element_sum();
    let mut lit: Vec<&Contribution> = contributions.iter().filter(|c| c.irradiance.element_sum() > 0.0).collect();
    lit.sort_by(|a, b| b.irradiance.element_sum().total_cmp(&a.irradiance.element_sum()));
    let part = |c: &Contribution| c.irradiance.element_sum() / whole;
    let mut sum = 0.0;
    let main_samples = lit.iter().take_while(|c| {
        let is_needed = sum < 0.9;
        sum += part(c);
        is_needed
    });
    let main_samples = main_samples.count();
    let footprint = |c: &&Contribution| MapFootprint {
        outline: outline([c.direction, c.sides[0], c.sides[1]].map(|v| light.light_from_world(v))),
        part: part(c),
    };
    ReceiverInspection {
        irradiance: light.intensity * irradiance,
        samples: lit.len(),
        main_samples,
        footprints: lit.iter().take(MAX_FOOTPRINTS).map(footprint).collect(),
    }
}

/// An ellipse in the parallelogram around a direction, on an equirectangular map.
fn outline([direction, u, v]: [Vec3; 3]) -> Vec<Vec2> {
    let centre = place_on_map(direction).x;
    let point = |k: u32| {
        let (sin, cos) = (TAU * k as f32 / OUTLINE as f32).sin_cos();
        let place = place_on_map((direction + 0.5 * (cos * u + sin * v)).normalize());
        // On the same turn as the centre.
        Vec2::new(centre + (place.x - centre + 0.5).rem_euclid(1.0) - 0.5, place.y)
    };
    (0..OUTLINE).map(point).collect()
}

/// Where an equirectangular map shows a unit direction: −Z at the left and right edges, +X at a quarter of the width, +Y at the top.
fn place_on_map(d: Vec3) -> Vec2 {
    Vec2::new((d.x.atan2(-d.z) / TAU).rem_euclid(1.0), d.y.clamp(-1.0, 1.0).acos() / PI)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Outlines lie around where the map shows their direction, across the map's edges, too.
    #[test]
    fn outlines_surround_their_direction() {
        for direction in
            [Vec3::X, Vec3::NEG_Z, Vec3::new(0.01, 0.2, -1.0).normalize(), Vec3::new(0.5, -0.7, 0.5).normalize()]
        {
            let (u, v) = direction.any_orthonormal_pair();
            let points = outline([direction, 0.02 * u, 0.02 * v]);
            let (middle, at) = (points.iter().sum::<Vec2>() / points.len() as f32, place_on_map(direction));
            assert!((middle - at).length() < 1e-3, "{direction}: {middle} {at}");
        }
    }
}
