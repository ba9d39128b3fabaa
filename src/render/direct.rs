//! Light that reaches receivers without a mirror, shadowed: the unoccluded irradiance, which is known exactly, times the
//! part of it that rays find unblocked (Heitz, Hill, McGuire 2018, *Combining Analytic Direct Illumination and Stochastic
//! Shadows*). Where nothing is hidden, and where everything is, there is no noise.

use std::f32::consts::{FRAC_1_PI, TAU};

use glam::{Vec2, Vec3};
use sobol_burley::sample_4d;

use crate::brdf::{Materials, distribution};
use crate::environment::{Environment, LightSampler};
use crate::scene::{Ray, Visibility};
use crate::tracing::{Hit, Tracer};

/// Rays a point towards the light, and as many by the receiver's cosine.
const RAYS: u32 = 64;

/// The environment as receivers see it.
#[derive(Debug)]
pub(super) struct DirectLight {
    sampler: LightSampler,
    /// Whether anything is shadowed.
    shadowed: bool,
}

impl DirectLight {
    pub fn new(environment: &Environment, visibility: Visibility) -> Self {
        Self { sampler: LightSampler::new(&environment.cube), shadowed: visibility == Visibility::Full }
    }

    /// Irradiance at a point with a unit normal, W/m².
    pub fn irradiance(&self, environment: &Environment, tracer: &Tracer, position: Vec3, normal: Vec3) -> Vec3 {
        let open = environment.irradiance(normal);
        if !self.shadowed {
            return open;
        }
        let sampler = &self.sampler;
        let (mut seen, mut all) = (Vec3::ZERO, Vec3::ZERO);
        let mut add = |direction: Vec3| {
            let cosine = direction.dot(normal);
            if cosine > 0.0 {
                // Both ways of drawing together: the balance heuristic.
                let density = sampler.pdf(direction) + cosine * FRAC_1_PI;
                let part = environment.field.radiance(direction) * cosine / density;
                all += part;
                if !tracer.is_blocked(Ray { origin: position, direction }) {
                    seen += part;
                }
            }
        };
        let seed = seed_of(position);
        for k in 0..RAYS {
            let [u, v, x, y] = sample_4d(k, 0, seed);
            add(sampler.sample(Vec2::new(u, v)).0);
            add(by_cosine(normal, x, y));
        }
        // Channel by channel; what sends no light has no shadow.
        let part = |seen: f32, all: f32| if all > 0.0 { seen / all } else { 1.0 };
        open * Vec3::new(part(seen.x, all.x), part(seen.y, all.y), part(seen.z, all.z))
    }

    /// Radiance that a glossy receiver reflects to its viewer: directions drawn by the light, by the cosine and by the lobe.
    pub fn reflected(
        &self,
        environment: &Environment,
        tracer: &Tracer,
        materials: &Materials,
        hit: &Hit,
        view: Vec3,
    ) -> Vec3 {
        let normal = hit.normal;
        let lobe = Lobe { normal, view, alpha: materials.lobe_alpha(hit.object).unwrap_or(1.0).max(1e-3) };
        let mut sum = Vec3::ZERO;
        let mut add = |direction: Vec3| {
            let cosine = direction.dot(normal);
            let value = materials.value(hit.object, normal, direction, view, 0.0);
            if cosine > 0.0 && value != Vec3::ZERO {
                let density = self.sampler.pdf(direction) + cosine * FRAC_1_PI + lobe.pdf(direction);
                if !(self.shadowed && tracer.is_blocked(Ray { origin: hit.position, direction })) {
                    sum += value * environment.field.radiance(direction) * cosine / density;
                }
            }
        };
        let seed = seed_of(hit.position);
        for k in 0..RAYS {
            let [u, v, x, y] = sample_4d(k, 0, seed);
            add(self.sampler.sample(Vec2::new(u, v)).0);
            add(by_cosine(normal, x, y));
            let [u, v, ..] = sample_4d(k, 1, seed);
            add(lobe.sample(u, v));
        }
        sum / RAYS as f32
    }
}

/// A direction drawn by its cosine.
fn by_cosine(normal: Vec3, x: f32, y: f32) -> Vec3 {
    let (t, b) = normal.any_orthonormal_pair();
    let (radius, angle) = (x.sqrt(), TAU * y);
    radius * (angle.cos() * t + angle.sin() * b) + (1.0 - x).max(0.0).sqrt() * normal
}

/// Draws directions in proportion to a GGX lobe.
struct Lobe {
    normal: Vec3,
    view: Vec3,
    alpha: f32,
}

impl Lobe {
    /// The mirrored direction on a facet (Walter et al. 2007, Equations 35 to 38).
    fn sample(&self, u: f32, v: f32) -> Vec3 {
        let tan = self.alpha * (u / (1.0 - u)).sqrt();
        let (t, b) = self.normal.any_orthonormal_pair();
        let (sin, cos) = (TAU * v).sin_cos();
        let facet = (self.normal + tan * (cos * t + sin * b)).normalize();
        2.0 * self.view.dot(facet) * facet - self.view
    }

    fn pdf(&self, direction: Vec3) -> f32 {
        let facet = (direction + self.view).normalize();
        let cosine = facet.dot(self.normal);
        distribution(cosine, self.alpha) * cosine.max(0.0) / (4.0 * self.view.dot(facet)).max(1e-6)
    }
}

/// Another set of directions for every point; the same for the same point.
fn seed_of(position: Vec3) -> u32 {
    position
        .to_array()
        .iter()
        .fold(0x9E37_79B9, |seed: u32, c| (seed ^ c.to_bits()).wrapping_mul(0x85EB_CA6B).rotate_left(13))
}
