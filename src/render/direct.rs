//! Light that reaches receivers without a mirror, shadowed: the unoccluded irradiance, which is known exactly, times the
//! part of it that rays find unblocked (Heitz, Hill, McGuire 2018, *Combining Analytic Direct Illumination and Stochastic
//! Shadows*). Where nothing is hidden, and where everything is, there is no noise.

use std::f32::consts::{FRAC_1_PI, TAU};

use glam::{Vec2, Vec3};
use sobol_burley::sample_4d;

use crate::environment::{Environment, LightSampler};
use crate::scene::{Ray, Visibility};
use crate::tracing::Tracer;

/// Rays a point towards the light, and as many by the receiver's cosine.
const RAYS: u32 = 64;

/// The environment as receivers see it.
#[derive(Debug)]
pub(super) struct DirectLight {
    /// `None`: nothing is shadowed.
    sampler: Option<LightSampler>,
}

impl DirectLight {
    pub fn new(environment: &Environment, visibility: Visibility) -> Self {
        Self { sampler: (visibility == Visibility::Full).then(|| LightSampler::new(&environment.cube)) }
    }

    /// Irradiance at a point with a unit normal, W/m².
    pub fn irradiance(&self, environment: &Environment, tracer: &Tracer, position: Vec3, normal: Vec3) -> Vec3 {
        let open = environment.irradiance(normal);
        let Some(sampler) = &self.sampler else { return open };
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
        let (t, b) = normal.any_orthonormal_pair();
        for k in 0..RAYS {
            let [u, v, x, y] = sample_4d(k, 0, seed);
            add(sampler.sample(Vec2::new(u, v)).0);
            let (radius, angle) = (x.sqrt(), TAU * y);
            add(radius * (angle.cos() * t + angle.sin() * b) + (1.0 - x).max(0.0).sqrt() * normal);
        }
        // Channel by channel; what sends no light has no shadow.
        let part = |seen: f32, all: f32| if all > 0.0 { seen / all } else { 1.0 };
        open * Vec3::new(part(seen.x, all.x), part(seen.y, all.y), part(seen.z, all.z))
    }
}

/// Another set of directions for every point; the same for the same point.
fn seed_of(position: Vec3) -> u32 {
    position
        .to_array()
        .iter()
        .fold(0x9E37_79B9, |seed: u32, c| (seed ^ c.to_bits()).wrapping_mul(0x85EB_CA6B).rotate_left(13))
}
