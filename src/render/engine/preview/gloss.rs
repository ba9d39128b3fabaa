//! What glossy receivers reflect of the environment and of near light in previews: from sixteen microfacets at each node, with shadows. GPU twin:
//! `shaders/shared/preview_gloss.wgsl`. Lobes of caustics, and of what mirrors show, are left to whole pictures.

use glam::Vec3;

use super::views::SurfacePoint;
use crate::brdf::Materials;
use crate::engine::gloss::{blurred_radiance, likely_facet};
use crate::lanes::LANES;
use crate::scene::{Camera, Projection, Ray};
use crate::stages::{DirectNearLight, PreparedLight, PreparedScene};
use crate::tracing::Hit;

/// Microfacets along both coordinates of a lobe.
const ALONG: usize = 4;

/// The light that glossy receivers are seen in.
pub(super) struct GlossyReceivers<'a> {
    pub camera: &'a Camera,
    pub prepared: &'a PreparedScene,
    pub light: &'a PreparedLight,
    pub near_light: &'a DirectNearLight<'a>,
    pub is_shadowed: bool,
}

impl GlossyReceivers<'_> {
    fn materials(&self) -> &Materials {
        &self.prepared.materials.receivers
    }

    /// Radiance towards the camera of a point with this irradiance, W/(m²·sr).
    pub fn radiance(&self, point: &SurfacePoint, irradiance: Vec3) -> Vec3 {
        let hit = &point.hit;
        let view = self.view(hit);
        let diffuse = self.materials().mean_diffuse(hit.object, hit.normal.dot(view));
        // Of near light, the irradiance has the diffuse part.
        let lobe = if self.near_light.is_dark() {
            Vec3::ZERO
        } else {
            (self.near_light.reflected(self.materials(), hit, view) - diffuse * self.near_light.irradiance(hit))
                .max(Vec3::ZERO)
        };
        diffuse * irradiance + self.of_environment(hit, view) + lobe
    }

    fn view(&self, hit: &Hit) -> Vec3 {
        match self.camera.projection {
            Projection::Perspective { .. } => (self.camera.position - hit.position).normalize(),
            Projection::Orthographic { .. } => -self.camera.forward,
        }
    }

    fn of_environment(&self, hit: &Hit, view: Vec3) -> Vec3 {
        let alpha = self.materials().lobe_alpha(hit.object).unwrap_or(1.0);
        let facets = facets().map(|at| likely_facet(hit.normal, view, alpha, at));
        let rays = facets
            .map(|facet| Ray { origin: hit.position, direction: (2.0 * view.dot(facet) * facet - view).normalize() });
        let weight =
            |k: usize| self.materials().lobe_weight(hit.object, [hit.normal, facets[k], view], rays[k].direction);
        let weights: [Vec3; LANES] = std::array::from_fn(weight);
        let lanes = (0..LANES).filter(|k| weights[*k] != Vec3::ZERO).fold(0, |lanes, k| lanes | 1 << k);
        let blocked = if self.is_shadowed {
            self.prepared.tracer.secondary_hits(&rays, lanes).map(|hit| hit.is_some())
        } else {
            [false; LANES]
        };
        let arriving = |k: &usize| lanes & 1 << k != 0 && !blocked[*k];
        let radiance = |k: usize| {
            let direction = self.light.light_from_world(rays[k].direction);
            weights[k] * blurred_radiance(&self.light.environment.cube, direction, alpha)
        };
        (0..LANES).filter(arriving).map(radiance).sum::<Vec3>() / LANES as f32
    }
}

/// Places in the square from which microfacets are drawn: no two in one row of either coordinate.
fn facets() -> [[f32; 2]; LANES] {
    std::array::from_fn(|k| {
        let (i, j) = (k % ALONG, k / ALONG);
        [(k as f32 + 0.5) / LANES as f32, ((ALONG * i + j) as f32 + 0.5) / LANES as f32]
    })
}
