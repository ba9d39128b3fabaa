//! References by beams: what they can be asked for, and the sum over all lights. Following beams is left to [`super::beams`].

use glam::DVec3;

use super::beam_origins::origins;
use super::beams::Beams;
use super::{Estimate, Options, Quantity, Reference, ReferenceError, Statistics, StoppingCriterion};
use crate::scene::{Light as Source, Object, Scene, Visibility};
use crate::{OptionError, Progress, Stage};

/// Says what beams cannot compute.
pub(super) fn check_beams(scene: &Scene, options: &Options) -> Result<(), OptionError> {
    let has = |is_such: fn(&Object) -> bool| scene.objects.iter().any(is_such);
    let is_spot_or_dark = match &scene.environment.light {
        Source::Spot { .. } => true,
        Source::Constant(radiance) => radiance.max_element() * scene.environment.intensity == 0.0,
        _ => false,
    };
    let obstacles = [
        (options.quantity != Quantity::Caustic, "compute caustics alone"),
        (!is_spot_or_dark, "need an environment that is a spot, or dark beside lamps"),
        (options.visibility == Visibility::None, "meet every object: choose visibility full"),
        (!options.attenuation, "are attenuated by their width: choose attenuation on"),
        (scene.medium.is_some(), "do not know media"),
        (has(|o| o.emitter.is_some()), "do not know emitters"),
        (has(|o| o.reflector.is_some_and(|r| r.finish.roughness > 0.0)), "do not know rough mirrors"),
    ];
    match obstacles.into_iter().find(|(stands, _)| *stands) {
        Some((_, reason)) => Err(OptionError::invalid("estimator", format!("is beams, which {reason}"))),
        None => Ok(()),
    }
}

impl Reference {
    /// Adds up the beams of all lights. The standard error is half the difference between two halves of the origins in extended lights, each of
    /// which covers the light evenly, and, of others, the difference to beams of a fourth of the accuracy.
    pub(super) fn solve_by_beams(
        &self,
        criterion: &StoppingCriterion,
        known: Option<Estimate>,
        progress: &dyn Progress,
    ) -> Result<Estimate, ReferenceError> {
        if let Some(known) = known.filter(|known| known.coverage() == 1.0) {
            return Ok(known);
        }
        let Options { size, chains, replicates, .. } = self.options;
        let lights = origins(&self.scene, &self.lamps, replicates).unwrap_or_default();
        let beams = || Beams::new(&self.scene, (&self.geometry, &self.lamps), size, chains);
        let (fine, coarse) = (beams(), beams().coarser(4.0));
        let is_over = || criterion.is_over() || progress.is_cancelled();
        let mut estimate = Estimate::unknown(size);
        let count = estimate.irradiance.pixels.len();
        let (mut mean, mut variance) = (vec![DVec3::ZERO; count], vec![DVec3::ZERO; count]);
        progress.begin(Stage::Reference, lights.iter().map(Vec::len).sum::<usize>() as u64);
        for origins in &lights {
            let mut parts = Vec::new();
            for origin in origins {
                parts.push(fine.irradiance(origin, &is_over));
                progress.advance(1);
            }
            let other = (origins.len() == 1).then(|| coarse.irradiance(&origins[0], &is_over));
            for pixel in 0..count {
                let of_light: DVec3 = parts.iter().map(|part| part[pixel]).sum();
                mean[pixel] += of_light;
                variance[pixel] += if let Some(other) = &other {
                    (other[pixel] - of_light).powf(2.0)
                } else {
                    let of_half: DVec3 = parts.iter().step_by(2).map(|part| part[pixel]).sum();
                    let share = origins.len().div_ceil(2) as f64 / origins.len() as f64;
                    // The halves, each as an estimate of the whole, differ by twice this.
                    (0.5 * (of_half / share - (of_light - of_half) / (1.0 - share))).powf(2.0)
                };
            }
        }
        progress.end(Stage::Reference);
        if progress.is_cancelled() {
            return Err(ReferenceError::Cancelled);
        }
        if is_over() {
            return Err(ReferenceError::Incomplete { coverage: 0.0 });
        }
        estimate.irradiance.pixels = mean.into_iter().map(DVec3::as_vec3).collect();
        let root = |variance: DVec3| DVec3::from_array(variance.to_array().map(f64::sqrt)).as_vec3();
        estimate.standard_error.pixels = variance.into_iter().map(root).collect();
        estimate.weights.fill(1.0);
        estimate.is_fine.fill(true);
        estimate.statistics = Statistics { passes: 1, points_per_pixel: 0.0 };
        Ok(estimate)
    }
}
