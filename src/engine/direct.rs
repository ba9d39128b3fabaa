//! Direct light on diffuse surfaces: the unoccluded irradiance, which is known exactly, times the fraction of it that
//! shadow rays find unblocked (Heitz, Hill, McGuire 2018, *Combining Analytic Direct Illumination and Stochastic
//! Shadows*). Nothing is approximated where nothing is occluded, or everything.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::shadows::Shadows;
use crate::environment::CubeMap;
use crate::progress::Progress;
use crate::scene::Visibility;
use crate::stages::{CameraRays, LightStages, PreparedLight};
use crate::tracing::{Hit, Tracer};

/// Edge of the blocks of camera rays whose shadows are found together.
const BLOCK: usize = 32;

/// Irradiance of the environment on receivers, at an intensity of 1.
#[derive(Debug)]
pub(super) struct DirectLight<'a> {
    light: &'a PreparedLight,
    irradiance: Arc<CubeMap>,
    /// Where receivers may be occluded.
    shadows: Option<Shadows<'a>>,
}

impl<'a> DirectLight<'a> {
    pub fn new(
        light: &'a PreparedLight,
        stages: &mut LightStages,
        tracer: &'a Tracer,
        visibility: Visibility,
        progress: &dyn Progress,
    ) -> Self {
        let shadows =
            (visibility == Visibility::Full).then(|| Shadows::new(light, &stages.sampler(light, progress), tracer));
        Self { light, irradiance: stages.irradiance(light, progress), shadows }
    }

    /// Irradiance at points that are close to each other, W/m².
    pub fn irradiance(&self, points: &[&Hit]) -> Vec<Vec3> {
        let open = |point: &&Hit| self.irradiance.fetch(self.light.light_from_world(point.normal), 0.0);
        let mut irradiance: Vec<Vec3> = points.iter().map(open).collect();
        if let Some(shadows) = &self.shadows {
            let fractions = shadows.unoccluded_fractions(points);
            irradiance.iter_mut().zip(fractions).for_each(|(value, fraction)| *value *= fraction);
        }
        irradiance
    }

    /// Irradiance where camera rays hit wanted objects, W/m²; zero elsewhere.
    pub fn at_hits(&self, rays: &CameraRays, wanted: impl Fn(u32) -> bool + Sync) -> Vec<Vec3> {
        let width = rays.width as usize;
        let blocks: Vec<(usize, usize)> = (0..rays.hits.len() / width.max(1))
            .step_by(BLOCK)
            .flat_map(|y| (0..width).step_by(BLOCK).map(move |x| (x, y)))
            .collect();
        let of_block = |&block: &(usize, usize)| {
            let groups = by_object(rays, block).into_iter().filter(|(object, _)| wanted(*object));
            let irradiance = |indices: Vec<usize>| {
                let points: Vec<&Hit> = indices.iter().filter_map(|&index| rays.hits[index].as_ref()).collect();
                indices.into_iter().zip(self.irradiance(&points)).collect::<Vec<_>>()
            };
            groups.flat_map(|(_, indices)| irradiance(indices)).collect::<Vec<_>>()
        };
        let of_blocks: Vec<Vec<(usize, Vec3)>> = blocks.par_iter().map(of_block).collect();
        let mut all = vec![Vec3::ZERO; rays.hits.len()];
        of_blocks.into_iter().flatten().for_each(|(index, irradiance)| all[index] = irradiance);
        all
    }
}

/// The indices of a block's camera rays, by the object that they hit.
fn by_object(rays: &CameraRays, (x, y): (usize, usize)) -> Vec<(u32, Vec<usize>)> {
    let width = rays.width as usize;
    let height = rays.hits.len() / width;
    let mut groups: Vec<(u32, Vec<usize>)> = Vec::new();
    for index in (y..height.min(y + BLOCK)).flat_map(|y| (x..width.min(x + BLOCK)).map(move |x| y * width + x)) {
        let Some(hit) = &rays.hits[index] else { continue };
        match groups.iter_mut().find(|(object, _)| *object == hit.object) {
            Some((_, indices)) => indices.push(index),
            None => groups.push((hit.object, vec![index])),
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NoProgress;
    use crate::environment::CubeSize;
    use crate::scene::load;
    use crate::stages::View;

    /// What the points of a block agree on is what each of them finds alone.
    #[test]
    fn blocks_find_the_shadows_of_their_points() {
        let scene = load::<toml::Table>("columns").unwrap().scene;
        let tracer = Tracer::new(&scene);
        let view = View { camera: scene.camera, size: [128, 128], pixel_samples: 1, first_row: 0, rows: 128 };
        let rays = CameraRays::trace(&tracer, view);
        let mut stages = LightStages::new();
        let light = stages.prepare(&scene.environment, CubeSize::default(), &NoProgress).unwrap();
        let direct = DirectLight::new(&light, &mut stages, &tracer, Visibility::Full, &NoProgress);
        let together = direct.at_hits(&rays, |_| true);
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
