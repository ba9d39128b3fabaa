//! Light by beams: which lights are left to them, what they can be asked for, and the sum over all of them.

use glam::DVec3;

use super::beams::Beams;
use super::origins::{Origin, of_lamp, of_spot};
use super::rays::Rays;
use crate::estimate::Estimate;
use crate::geometry::Geometry;
use crate::image::Image;
use crate::lamps::{Lamps, Source};
use crate::scene::{Light, Object, Scene, Visibility};
use crate::{Estimator, OptionError, Options, Progress, Quantity, ReferenceError, Stage, StoppingCriterion};

/// Lights that look smaller than this from every mirror, radians in radius, are hard to find by points.
const SMALL_RAD: f64 = 3e-3;
/// Origins in each small light, unless more are asked for.
const LEAST_ORIGINS: u32 = 64;

/// The lights that are left to beams.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shares {
    /// The environment, which is a spot.
    pub spot: bool,
    /// Lamps, by their numbers.
    pub lamps: Vec<usize>,
    origins: u32,
}

/// What beams bring to every pixel.
#[derive(Clone, Debug)]
pub struct ByBeams {
    mean: Vec<DVec3>,
    variance: Vec<DVec3>,
}

/// Says what beams cannot compute.
pub fn check_beams(scene: &Scene, options: &Options) -> Result<(), OptionError> {
    let is_dark = scene.lamps.is_empty() && !matches!(scene.environment.light, Light::Spot { .. });
    let obstacle =
        is_dark.then_some("is for the light of spots and lamps: give the scene one").or(obstacle(scene, options));
    match obstacle {
        Some(reason) => Err(OptionError::invalid("estimator", format!("is beams, which {reason}"))),
        None => Ok(()),
    }
}

fn obstacle(scene: &Scene, options: &Options) -> Option<&'static str> {
    let has = |is_such: fn(&Object) -> bool| scene.objects.iter().any(is_such);
    let obstacles = [
        (options.quantity != Quantity::Caustic, "compute caustics alone"),
        (options.visibility == Visibility::None, "meet every object: choose visibility full"),
        (!options.attenuation, "are attenuated by their width: choose attenuation on"),
        (has(|o| o.reflector.is_some_and(|r| r.finish.roughness > 0.0)), "do not know rough mirrors"),
    ];
    obstacles.into_iter().find(|(stands, _)| *stands).map(|(_, reason)| reason)
}

impl Shares {
    /// Those of a scene: all that beams can, if they are asked for, else the lights that points would seldom find.
    pub fn of_scene(scene: &Scene, (geometry, lamps): (&Geometry, &Lamps), options: &Options) -> Self {
        let is_beams = options.estimator == Estimator::Beams;
        if options.estimator == Estimator::Points || obstacle(scene, options).is_some() {
            return Self::default();
        }
        let casts = |object: u32| scene.objects[object as usize].specular().is_some();
        let corners = || geometry.triangles.iter().filter(|t| casts(t.object)).flat_map(|t| t.corners);
        let is_small = |lamp: &Source| {
            let nearest = corners().map(|corner| corner.distance(lamp.position)).fold(f64::INFINITY, f64::min);
            lamp.radius < SMALL_RAD * nearest
        };
        let is_left = |(_, lamp): &(usize, &Source)| is_beams || is_small(lamp);
        let lamps = lamps.sources().iter().enumerate().filter(is_left).map(|(k, _)| k).collect();
        let spot = match scene.environment.light {
            Light::Spot { sigma_rad, .. } => is_beams || f64::from(sigma_rad) < SMALL_RAD,
            _ => false,
        };
        let origins = if is_beams { options.replicates } else { options.replicates.max(LEAST_ORIGINS) };
        Self { spot, lamps, origins }
    }

    pub fn is_empty(&self) -> bool {
        !self.spot && self.lamps.is_empty()
    }

    /// The origins of all of their light.
    fn origins(&self, scene: &Scene, lamps: &Lamps) -> Vec<Vec<Origin>> {
        let spot = self.spot.then(|| of_spot(&scene.environment, self.origins));
        let of_lamps = self.lamps.iter().map(|k| of_lamp(*k, &lamps.sources()[*k], self.origins));
        spot.into_iter().chain(of_lamps).collect()
    }
}

impl ByBeams {
    /// Adds up the beams of all lights. The standard error is half the difference between two halves of the origins in extended lights, each of
    /// which covers the light evenly, and, of others, the difference to beams of a fourth of the accuracy.
    pub fn solve(
        rays: &Rays,
        (scene, lamps, shares): (&Scene, &Lamps, &Shares),
        depth: u32,
        criterion: &StoppingCriterion,
        progress: &dyn Progress,
    ) -> Result<Self, ReferenceError> {
        let lights = shares.origins(scene, lamps);
        let beams = || Beams::new(rays, lamps).deeper(depth);
        let (fine, coarse) = (beams(), beams().coarser(4.0));
        let is_over = || criterion.is_over() || progress.is_cancelled();
        let count = rays.plane.pixel_count();
        let mut sum = Self { mean: vec![DVec3::ZERO; count], variance: vec![DVec3::ZERO; count] };
        progress.begin(Stage::Reference, lights.iter().map(Vec::len).sum::<usize>() as u64);
        for origins in &lights {
            let mut parts = Vec::new();
            for origin in origins {
                parts.push(fine.irradiance(origin, &is_over));
                progress.advance(1);
            }
            let other = (origins.len() == 1).then(|| coarse.irradiance(&origins[0], &is_over));
            sum.add(&parts, other.as_deref());
        }
        progress.end(Stage::Reference);
        if progress.is_cancelled() {
            return Err(ReferenceError::Cancelled);
        }
        if is_over() {
            return Err(ReferenceError::Incomplete { coverage: 0.0 });
        }
        Ok(sum)
    }

    /// Adds a light, by its origins or, if it has but one, with a coarser estimate.
    fn add(&mut self, parts: &[Vec<DVec3>], coarser: Option<&[DVec3]>) {
        for (pixel, (mean, variance)) in self.mean.iter_mut().zip(&mut self.variance).enumerate() {
            let of_light: DVec3 = parts.iter().map(|part| part[pixel]).sum();
            *mean += of_light;
            *variance += if let Some(coarser) = coarser {
                (coarser[pixel] - of_light).powf(2.0)
            } else {
                let of_half: DVec3 = parts.iter().step_by(2).map(|part| part[pixel]).sum();
                let share = parts.len().div_ceil(2) as f64 / parts.len() as f64;
                // The halves, each as an estimate of the whole, differ by twice this.
                (0.5 * (of_half / share - (of_light - of_half) / (1.0 - share))).powf(2.0)
            };
        }
    }

    /// The irradiance by beams alone.
    pub fn image(&self, [width, height]: [u32; 2]) -> Image {
        Image { width, height, pixels: self.mean.iter().map(|mean| mean.as_vec3()).collect() }
    }

    /// An estimate of other light together with this.
    pub fn joined(&self, other: &Estimate) -> Estimate {
        self.changed(other, |known, own| known + own)
    }

    /// An estimate without this light.
    pub fn without(&self, joined: &Estimate) -> Estimate {
        self.changed(joined, |known, own| (known - own).max(DVec3::ZERO))
    }

    /// Means and variances with others in their place.
    fn changed(&self, estimate: &Estimate, change: impl Fn(DVec3, DVec3) -> DVec3) -> Estimate {
        let mut changed = estimate.clone();
        for (pixel, (mean, variance)) in self.mean.iter().zip(&self.variance).enumerate() {
            let known = estimate.irradiance.pixels[pixel].as_dvec3();
            changed.irradiance.pixels[pixel] = change(known, *mean).as_vec3();
            let squared = estimate.standard_error.pixels[pixel].as_dvec3().powf(2.0);
            changed.standard_error.pixels[pixel] = change(squared, *variance).map(f64::sqrt).as_vec3();
        }
        changed
    }
}
