//! What a point of a mirror or an interface sends to a receiver: reflected or refracted light of the environment, of lamps and of surfaces
//! in their light.

use glam::DVec3;

use super::gloss;
use super::reflectors::{Mirror, Reflectors, reflect};
use super::refraction::{Interface, refract};
use crate::scene::Visibility;

/// A point of a mirror or an interface.
pub(super) struct Point {
    /// Its triangle.
    pub id: u32,
    pub position: DVec3,
    pub normal: DVec3,
    /// The unit direction from the receiver, and its cosine to the normal.
    pub towards: DVec3,
    pub cosine: f64,
}

/// Uniform in [0, 1).
#[derive(Clone, Copy)]
pub(super) struct Numbers {
    /// They choose a microfacet, and a direction to each lamp.
    pub facet: [f64; 2],
    /// They choose what lights a surface that is seen.
    pub surface: [f64; 2],
}

impl Reflectors<'_> {
    /// What a point of a mirror reflects to a receiver, W/(m²·sr).
    pub(super) fn light_mirrored_at(&self, mirror: &Mirror, point: &Point, numbers: Numbers) -> DVec3 {
        let Point { normal, towards, cosine, .. } = *point;
        let reflectance = &self.reflectances[mirror.reflectance];
        if mirror.alpha == 0.0 {
            return reflectance.at(cosine.abs()) * self.light_from(point, reflect(towards, normal), numbers);
        }
        let seen_side = if cosine > 0.0 { -normal } else { normal };
        let lamps = self.lamps.samples(point.position, numbers.facet).map(|lamp| {
            let Some(facets) = gloss::facets_towards(seen_side, -towards, mirror.alpha, lamp.direction) else {
                return DVec3::ZERO;
            };
            if self.is_hidden(point, lamp.position) {
                return DVec3::ZERO;
            }
            facets.weight * lamp.solid_angle * reflectance.at(facets.cosine) * lamp.radiance
        });
        let lamps: DVec3 = lamps.sum();
        let Some(facet) = gloss::facet(seen_side, -towards, mirror.alpha, numbers.facet) else { return lamps };
        let light = self.environment_from(point, facet.towards_light)
            + self.surfaces.radiance((point.position, point.id), facet.towards_light, numbers.surface);
        lamps + facet.weight * reflectance.at(facet.cosine) * light
    }

    /// What a point of an interface reflects to a receiver in front of it, or refracts to one behind it or, through a closed object, in front
    /// of it, W/(m²·sr).
    pub(super) fn light_through(&self, interface: &Interface, point: &Point, numbers: Numbers) -> DVec3 {
        let Point { normal, towards, cosine, .. } = *point;
        if cosine < 0.0 {
            let through =
                if interface.is_closed { self.light_through_solid(interface, point, numbers) } else { DVec3::ZERO };
            if !self.chains.reflected || !interface.reflects() {
                return through;
            }
            return through
                + interface.reflectance(-cosine) * self.light_from(point, reflect(towards, normal), numbers);
        }
        if !self.chains.refracted || interface.is_closed {
            return DVec3::ZERO;
        }
        let refracted = |eta: f64| match interface.factor(cosine, eta) {
            0.0 => DVec3::ZERO,
            factor => factor * self.light_from(point, refract(towards, normal, eta), numbers),
        };
        match interface.indices() {
            [eta] => refracted(*eta),
            indices => DVec3::from_array([0, 1, 2].map(|channel| refracted(indices[channel])[channel])),
        }
    }

    /// What arrives at a point from a direction, W/(m²·sr).
    pub(super) fn light_from(&self, point: &Point, direction: DVec3, numbers: Numbers) -> DVec3 {
        let lamps = self.lamps.met(point.position, direction).filter(|(position, _)| !self.is_hidden(point, *position));
        lamps.map(|(_, radiance)| radiance).sum::<DVec3>()
            + self.surfaces.radiance((point.position, point.id), direction, numbers.surface)
            + self.environment_from(point, direction)
    }

    /// Whether a lamp or an emitter at a position is hidden from a point.
    fn is_hidden(&self, point: &Point, position: DVec3) -> bool {
        self.visibility == Visibility::Full && self.geometry.blocks_segment(point.position, position, [point.id; 2])
    }

    /// What arrives of emitters or, behind these, of the environment.
    fn environment_from(&self, point: &Point, direction: DVec3) -> DVec3 {
        if let Some(met) = self.emitters.met(point.position, direction) {
            return if self.is_hidden(point, met.position) { DVec3::ZERO } else { met.radiance };
        }
        if self.visibility == Visibility::Full && self.geometry.blocks_ray(point.position, direction, point.id) {
            return DVec3::ZERO;
        }
        self.light.radiance(direction)
    }
}
