//! Direct light that glossy surfaces reflect towards their viewers.

use std::f32::consts::{FRAC_1_PI, TAU};
use std::sync::Arc;

use glam::{Mat3, Vec2, Vec3};
use sobol_burley::sample_4d;

use super::gloss::{facet_of, tangents};
use super::paths::EndPoint;
use super::ray_batches::RayBatches;
use crate::Error;
use crate::brdf::{Materials, distribution};
use crate::environment::LightSampler;
use crate::parallel;
use crate::scene::{Ray, Visibility};
use crate::stages::PreparedLight;
use crate::tracing::Tracer;

/// Directions drawn from the light, as many from the receiver's cosine, and as many from its lobe.
const RAYS: u32 = 128;
/// Points whose rays make up a batch.
const POINTS_PER_BATCH: usize = 2048;
/// Scrambles the directions. All points draw the same, so that neighbouring points differ smoothly and without noise.
const SEED: u32 = 0x9E37_79B9;

/// The environment in directions that are drawn by its radiance, by the receiver's cosine and by its lobe, combined by
/// multiple importance sampling with the balance heuristic.
pub(super) struct GlossyLight<'a> {
    light: &'a PreparedLight,
    world_from_light: Mat3,
    sampler: Arc<LightSampler>,
    is_shadowed: bool,
    tracer: &'a Tracer,
    /// Where rays are traced in batches.
    batches: Option<&'a dyn RayBatches>,
}

impl<'a> GlossyLight<'a> {
    pub fn new(
        light: &'a PreparedLight,
        sampler: Arc<LightSampler>,
        (tracer, batches): (&'a Tracer, Option<&'a dyn RayBatches>),
        visibility: Visibility,
    ) -> Self {
        let is_shadowed = visibility == Visibility::Full;
        Self { light, world_from_light: light.world_from_light(), sampler, is_shadowed, tracer, batches }
    }

    /// Radiance that glossy receivers reflect towards their viewers, W/(m²·sr).
    pub async fn reflected(&self, materials: &Materials, points: &[&EndPoint]) -> Result<Vec<Vec3>, Error> {
        let Some(batches) = self.batches.filter(|_| self.is_shadowed) else {
            return Ok(parallel::map(points, &|point| self.reflected_at(materials, point)));
        };
        let mut all = Vec::with_capacity(points.len());
        for points in points.chunks(POINTS_PER_BATCH) {
            let terms: Vec<Vec<(Ray, Vec3)>> = parallel::map(points, &|point| self.terms(materials, point));
            let rays: Vec<Ray> = terms.iter().flatten().map(|(ray, _)| *ray).collect();
            let mut blocked = batches.blocked(&rays).await?.into_iter();
            let arriving = |of_point: &Vec<(Ray, Vec3)>| {
                let terms = of_point.iter().zip(blocked.by_ref());
                terms.filter(|(_, is_blocked)| !is_blocked).map(|((_, term), _)| *term).sum::<Vec3>()
            };
            all.extend(terms.iter().map(arriving));
        }
        Ok(all)
    }

    fn reflected_at(&self, materials: &Materials, point: &EndPoint) -> Vec3 {
        let terms = self.terms(materials, point).into_iter();
        terms.filter(|(ray, _)| !(self.is_shadowed && self.tracer.is_blocked(*ray))).map(|(_, term)| term).sum()
    }

    /// Shadow rays from a receiver, and what each adds to the radiance if it is not blocked.
    fn terms(&self, materials: &Materials, point: &EndPoint) -> Vec<(Ray, Vec3)> {
        let EndPoint { hit, view, .. } = *point;
        let normal = hit.normal;
        let lobe = Lobe { normal, view, alpha: materials.lobe_alpha(hit.object).unwrap_or(1.0).max(1e-3) };
        let mut terms = Vec::with_capacity(3 * RAYS as usize);
        let mut add = |direction: Vec3, in_light: Vec3| {
            let cosine = direction.dot(normal);
            let value = materials.value(hit.object, normal, direction, view, 0.0);
            if cosine > 0.0 && value != Vec3::ZERO {
                let density = self.sampler.pdf(in_light) + cosine * FRAC_1_PI + lobe.pdf(direction);
                let radiance = self.light.environment.radiance.radiance(in_light);
                let term = value * radiance * cosine / (density * RAYS as f32);
                terms.push((Ray { origin: hit.position, direction }, term));
            }
        };
        for k in 0..RAYS {
            let [u, v, x, y] = sample_4d(k, 0, SEED);
            let towards_light = self.sampler.sample(Vec2::new(u, v)).0;
            add(self.world_from_light * towards_light, towards_light);
            let by_cosine = by_cosine(normal, view, x, y);
            add(by_cosine, self.light.light_from_world(by_cosine));
            let [u, v, ..] = sample_4d(k, 1, SEED);
            let by_lobe = lobe.sample(u, v);
            add(by_lobe, self.light.light_from_world(by_lobe));
        }
        terms
    }
}

/// A cosine-distributed direction; it turns smoothly with the surface and the view.
fn by_cosine(normal: Vec3, view: Vec3, x: f32, y: f32) -> Vec3 {
    let [t, b] = tangents(normal, view);
    let (radius, angle) = (x.sqrt(), TAU * y);
    radius * (angle.cos() * t + angle.sin() * b) + (1.0 - x).max(0.0).sqrt() * normal
}

/// Samples directions in proportion to a GGX lobe.
struct Lobe {
    normal: Vec3,
    view: Vec3,
    alpha: f32,
}

impl Lobe {
    /// The direction reflected by a sampled microfacet (Walter et al. 2007, Equations 35 to 38).
    fn sample(&self, u: f32, v: f32) -> Vec3 {
        let facet = facet_of(self.normal, self.view, self.alpha, [u, v]);
        2.0 * self.view.dot(facet) * facet - self.view
    }

    fn pdf(&self, direction: Vec3) -> f32 {
        let facet = (direction + self.view).normalize();
        let cosine = facet.dot(self.normal);
        distribution(cosine, self.alpha) * cosine.max(0.0) / (4.0 * self.view.dot(facet)).max(1e-6)
    }
}
