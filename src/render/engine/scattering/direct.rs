//! Direct light that the medium scatters along camera rays, with shafts and shadows.
//!
//! Of the environment the unoccluded light is known for every direction of view; shadow rays from the parts of a ray tell how much of it
//! arrives. All rays of a picture take the same directions, each part a few of them, from places of its own: neighbouring pixels
//! differ smoothly and without noise.

use glam::{Vec2, Vec3};
use sobol_burley::sample_4d;
use std::f32::consts::TAU;
use std::sync::Arc;

use super::rays::{MediumRays, seen_length};
use crate::environment::{CubeMap, LightSampler, face_direction, texel_solid_angle_sr};
use crate::lanes::LANES;
use crate::parallel;
use crate::progress::Progress;
use crate::scene::{Lamp, Medium, Ray};
use crate::stages::{EmitterPart, NearEmitter, PreparedLight};
use crate::tracing::{RayPacket, Tracer};

/// The next part of an emitter that a ray goes to is so many parts on; prime to their number.
const FAR_PART: usize = 23;
/// Scrambles the sequence of directions.
const SEED: u32 = 0x27D4_EB2F;
/// The environment is summed in texels of faces of this size at most.
const SUMMED_SIZE: u32 = 64;
/// Edges of the map of scattered light, by how narrowly the medium scatters.
const MAP_SIZES: [(f32, u32); 3] = [(0.0, 1), (0.6, 16), (1.0, 32)];

/// Finds the direct light along camera rays.
pub(in crate::engine) struct DirectScattering<'a> {
    light: &'a PreparedLight,
    medium: Medium,
    /// As [`unoccluded`].
    unoccluded: Arc<CubeMap>,
    /// Unit directions to the environment in the world, and radiance over their density.
    directions: Vec<(Vec3, f32)>,
    /// Shadow rays from each part of a ray, to the environment and to each light.
    rays_per_part: usize,
    /// What throws shadows, if anything does.
    tracer: Option<&'a Tracer>,
}

impl<'a> DirectScattering<'a> {
    /// For rays of so many parts, from each of which so many shadow rays go to the environment and to each light. The map is that of the light and the medium, see [`unoccluded`].
    pub fn new(
        light: &'a PreparedLight,
        (medium, unoccluded): (Medium, Arc<CubeMap>),
        sampler: &LightSampler,
        tracer: Option<&'a Tracer>,
        [parts_per_ray, rays_per_part]: [usize; 2],
    ) -> Self {
        let world_from_light = light.world_from_light();
        let direction = |k: usize| {
            let [u, v, ..] = sample_4d(k as u32, 0, SEED);
            let (in_light, density) = sampler.sample(Vec2::new(u, v));
            let radiance = light.environment.radiance.radiance(in_light) / density;
            (world_from_light * in_light, radiance.element_sum())
        };
        let directions = (0..parts_per_ray * rays_per_part).map(direction).collect();
        Self { light, medium, unoccluded, directions, rays_per_part, tracer }
    }

    /// Light along some rays, W/(m²·sr); black once it is cancelled.
    pub fn along(&self, rays: &MediumRays, which: &[usize], progress: &dyn Progress) -> Vec<Vec3> {
        let of_packet = |which: &[usize]| {
            if progress.is_cancelled() { vec![Vec3::ZERO; which.len()] } else { self.along_packet(rays, which) }
        };
        parallel::map_chunks(which, LANES, &of_packet).concat()
    }

    /// Light along up to sixteen rays.
    fn along_packet(&self, rays: &MediumRays, which: &[usize]) -> Vec<Vec3> {
        let of_rays: Vec<Ray> = which.iter().map(|&index| rays.ray(index)).collect();
        let parts: Vec<Vec<[f32; 2]>> = which.iter().map(|&index| rays.parts(index).collect()).collect();
        let mut light = vec![Vec3::ZERO; which.len()];
        for part in 0..rays.parts_per_ray() {
            let of_part: Vec<[f32; 2]> = parts.iter().map(|parts| parts[part]).collect();
            self.add_environment(&of_rays, &of_part, part, &mut light);
            for lamp in self.light.lamps.iter() {
                self.add_lamp(lamp, &of_rays, &of_part, &mut light);
            }
            if let Some((near, factor)) = &self.light.near_emitters {
                for emitter in &near.emitters {
                    self.add_emitter((emitter, *factor), part, (&of_rays, &of_part), &mut light);
                }
            }
        }
        light.into_iter().map(|light| self.medium.sigma_s * light).collect()
    }

    fn add_environment(&self, rays: &[Ray], parts: &[[f32; 2]], part: usize, light: &mut [Vec3]) {
        let (mut open, mut all) = ([0.0; LANES], [0.0; LANES]);
        for k in 0..self.rays_per_part {
            let (direction, power) = self.directions[part * self.rays_per_part + k];
            let along = (k as f32 + 0.5) / self.rays_per_part as f32;
            let origins = |lane: usize| at(&rays[lane], parts[lane], along);
            let hidden = self.hidden(rays.len(), origins, |_| (direction, f32::INFINITY));
            for (lane, ray) in rays.iter().enumerate() {
                let scattered = power * self.medium.phase(direction.dot(ray.direction));
                all[lane] += scattered;
                open[lane] += if hidden >> lane & 1 == 0 { scattered } else { 0.0 };
            }
        }
        for (lane, ray) in rays.iter().enumerate().filter(|(lane, _)| open[*lane] > 0.0) {
            let unoccluded = self.unoccluded.fetch(self.light.light_from_world(-ray.direction), 0.0);
            light[lane] += open[lane] / all[lane] * unoccluded * seen_length(&self.medium, parts[lane]);
        }
    }

    fn add_lamp(&self, lamp: &Lamp, rays: &[Ray], parts: &[[f32; 2]], light: &mut [Vec3]) {
        for k in 0..self.rays_per_part {
            let along = (k as f32 + 0.5) / self.rays_per_part as f32;
            let origin = |lane: usize| at(&rays[lane], parts[lane], along);
            let towards = |lane: usize| {
                let to = lamp.position - origin(lane);
                let distance = to.length().max(lamp.radius);
                // Different places of its disc, along Vogel's spiral.
                let (across, around) = to.normalize_or(Vec3::Y).any_orthonormal_pair();
                let place = lamp.radius * along.sqrt() * Vec2::from_angle(TAU * (k as f32 * 0.381_966).fract());
                let to = to + place.x * across + place.y * around;
                (to.normalize_or(Vec3::Y), distance)
            };
            let hidden = self.hidden(rays.len(), origin, towards);
            for (lane, ray) in rays.iter().enumerate().filter(|(lane, _)| hidden >> lane & 1 == 0) {
                let from = origin(lane) - lamp.position;
                let distance = from.length();
                let away = from / distance.max(f32::MIN_POSITIVE);
                let scattered = self.medium.phase(-away.dot(ray.direction)) * lamp.intensity_towards(away);
                let [start, end] = parts[lane];
                if end <= start {
                    continue;
                }
                let passed =
                    self.medium.transmittance(distance) * seen_length(&self.medium, parts[lane]) / (end - start);
                light[lane] += nearness(lamp, ray, parts[lane]) / self.rays_per_part as f32 * passed * scattered;
            }
        }
    }

    /// Each ray that is traced goes to another part of the emitter, from another place.
    fn add_emitter(
        &self,
        (emitter, factor): (&NearEmitter, f32),
        part: usize,
        (rays, parts): (&[Ray], &[[f32; 2]]),
        light: &mut [Vec3],
    ) {
        for k in 0..self.rays_per_part {
            let along = (k as f32 + 0.5) / self.rays_per_part as f32;
            let origin = |lane: usize| at(&rays[lane], parts[lane], along);
            // Parts far from each other.
            let index = (part * self.rays_per_part + k) * FAR_PART;
            let seen = (0..rays.len()).map_while(|lane| emitter.part_from(origin(lane), index));
            let seen: Vec<EmitterPart> = seen.collect();
            if seen.is_empty() {
                return;
            }
            let hidden = self.hidden(rays.len(), origin, |lane| (seen[lane].direction, seen[lane].distance));
            for (lane, ray) in rays.iter().enumerate().filter(|(lane, _)| hidden >> lane & 1 == 0) {
                let EmitterPart { direction, distance, solid_angle } = seen[lane];
                let passed = self.medium.transmittance(distance) * seen_length(&self.medium, parts[lane]);
                let all = emitter.part_count() as f32 / self.rays_per_part as f32;
                let scattered = self.medium.phase(direction.dot(ray.direction)) * solid_angle * all;
                light[lane] += factor * scattered * passed * emitter.radiance;
            }
        }
    }

    /// The lanes from whose places something lies in the way of a unit direction, up to a distance.
    fn hidden(&self, count: usize, origin: impl Fn(usize) -> Vec3, towards: impl Fn(usize) -> (Vec3, f32)) -> u32 {
        let Some(tracer) = self.tracer else { return 0 };
        let (mut origins, mut directions, mut ends) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3], [0.0; LANES]);
        for lane in 0..count {
            let (from, (direction, distance)) = (origin(lane), towards(lane));
            for axis in 0..3 {
                (origins[axis][lane], directions[axis][lane]) = (from[axis], direction[axis]);
            }
            ends[lane] = distance;
        }
        let lanes = u32::MAX >> (32 - count);
        tracer.occluded_lanes(&RayPacket { origins, directions, ends, lanes })
    }
}

/// A place in a part of a ray.
fn at(ray: &Ray, [start, end]: [f32; 2], along: f32) -> Vec3 {
    ray.origin + (start + (end - start) * along) * ray.direction
}

/// The integral of 1/r² along a part of a ray, with the distance r to a lamp, 1/m.
fn nearness(lamp: &Lamp, ray: &Ray, [start, end]: [f32; 2]) -> f32 {
    let to = lamp.position - ray.origin;
    let nearest = to.dot(ray.direction);
    let off = (to - nearest * ray.direction).length().max(lamp.radius);
    (((end - nearest) / off).atan() - ((start - nearest) / off).atan()) / off
}

/// The light of an environment that a medium scatters per metre and σ_s where nothing hides it: ∫ L p dω by the direction towards the
/// viewer, in the environment's frame, W/(m²·sr).
pub(in crate::engine) fn unoccluded(environment: &CubeMap, medium: &Medium) -> CubeMap {
    let level = (0..environment.level_count()).find(|l| environment.size() >> l <= SUMMED_SIZE).unwrap_or(0);
    let size = environment.size() >> level;
    let texels: Vec<(Vec3, f32, Vec3)> = environment
        .rows(level)
        .enumerate()
        .flat_map(|(row, texels)| texels.iter().enumerate().map(move |(x, texel)| (row, x, texel)))
        .map(|(row, x, texel)| {
            let (face, y) = (row / size as usize, row as u32 % size);
            let place = |k: u32| (2 * k + 1) as f32 / size as f32 - 1.0;
            let solid_angle = texel_solid_angle_sr(size, x as u32, y) as f32;
            (face_direction(face, place(x as u32), place(y)).normalize(), solid_angle, texel.truncate())
        })
        .collect();
    let narrow = MAP_SIZES.iter().find(|(g, _)| medium.g.abs() <= *g).map_or(32, |(_, size)| *size);
    CubeMap::from_radiance(narrow, None, |towards_viewer| {
        // Normalised, as a narrow phase function falls between texels.
        let (mut light, mut weights) = (Vec3::ZERO, 0.0);
        for (direction, solid_angle, radiance) in &texels {
            let weight = solid_angle * medium.phase(-direction.dot(towards_viewer));
            (light, weights) = (light + weight * *radiance, weights + weight);
        }
        light / weights
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In an even environment the light is the same from everywhere: phase functions are normalised.
    #[test]
    fn even_light_is_scattered_evenly() {
        let cube = CubeMap::from_radiance(16, None, |_| Vec3::new(1.0, 2.0, 3.0));
        for g in [0.0, -0.4, 0.5, 0.8, 0.99] {
            let medium = Medium { sigma_s: Vec3::ONE, sigma_a: Vec3::ZERO, g };
            let map = unoccluded(&cube, &medium);
            for view in [Vec3::X, Vec3::NEG_Y, Vec3::new(0.6, 0.0, 0.8), Vec3::ONE.normalize()] {
                let light = map.fetch(view, 0.0);
                assert!(light.abs_diff_eq(Vec3::new(1.0, 2.0, 3.0), 0.03), "{g}: {light}");
            }
        }
    }

    #[test]
    fn nearness_is_the_integral_of_the_inverse_square() {
        let lamp = Lamp {
            name: String::new(),
            position: Vec3::new(0.3, 0.5, -1.0),
            radius: 1e-4,
            intensity: Vec3::ONE,
            beam: None,
            is_distant: false,
        };
        let ray = Ray { origin: Vec3::new(0.1, 0.0, 1.0), direction: Vec3::new(0.0, 0.6, -0.8) };
        let (start, end, steps) = (0.2f32, 3.0, 4096);
        let step = (end - start) / steps as f32;
        let sum: f32 = (0..steps)
            .map(|k| {
                let point = ray.origin + (start + (k as f32 + 0.5) * step) * ray.direction;
                step / point.distance_squared(lamp.position)
            })
            .sum();
        assert!((nearness(&lamp, &ray, [start, end]) / sum - 1.0).abs() < 1e-3);
    }
}
