//! Surfaces in the light of lamps and near emitters, as mirrors show them: radiance = albedo / π × irradiance, one point of each lamp, and one
//! of all emitters, at a time.

use std::f64::consts::{FRAC_1_PI, PI, TAU};

use glam::DVec3;

use super::bright_spheres::{BrightSphere, brightest, brightest_within};
use super::cone::Cone;
use super::emitters::Emitters;
use super::geometry::{Geometry, Triangle};
use super::lamps::{Lamps, Source};
use super::medium::{Medium, transmittance};
use crate::scene::{Scene, Visibility};

/// All surfaces that receive light.
pub(super) struct LitSurfaces<'a> {
    geometry: &'a Geometry,
    lamps: &'a Lamps,
    emitters: &'a Emitters,
    visibility: Visibility,
    /// Between surfaces and mirrors, 1/m.
    extinction: DVec3,
    /// By object; zero where nothing is received.
    albedos: Vec<DVec3>,
    /// By object: whether it receives light. Without occlusion nothing else is in the way.
    receives: Vec<bool>,
    objects: Vec<BrightSphere>,
    /// At least the largest sum of the channels of any radiance.
    pub brightest: f64,
}

impl<'a> LitSurfaces<'a> {
    pub fn new(
        scene: &Scene,
        geometry: &'a Geometry,
        (lamps, emitters): (&'a Lamps, &'a Emitters),
        visibility: Visibility,
    ) -> Self {
        let extinction = Medium::of_scene(scene).map_or(DVec3::ZERO, |medium| medium.extinction_before_surfaces());
        let albedo =
            |object: &crate::scene::Object| object.receiver.as_ref().map_or(DVec3::ZERO, |r| r.albedo.as_dvec3());
        let albedos: Vec<DVec3> = scene.objects.iter().map(albedo).collect();
        let lit = |object: u32| -> Vec<&Triangle> {
            geometry.triangles.iter().filter(|triangle| triangle.object == object).collect()
        };
        let objects: Vec<BrightSphere> = (0u32..)
            .zip(&albedos)
            .filter(|(_, albedo)| **albedo != DVec3::ZERO)
            .filter_map(|(object, albedo)| lit_object(&lit(object), *albedo, (lamps, emitters)))
            .collect();
        let brightest = brightest(&objects);
        let receives = scene.objects.iter().map(|object| object.receiver.is_some()).collect();
        Self { geometry, lamps, emitters, visibility, extinction, albedos, receives, objects, brightest }
    }

    /// At least the largest sum of the channels of the radiance that arrives at any point of a sphere in a cone of directions.
    pub fn bound(&self, region: (DVec3, f64), cone: &Cone) -> f64 {
        brightest_within(&self.objects, region, cone)
    }

    /// Radiance that arrives at a point of a triangle from a unit direction, W/(m²·sr); its mean, if the two numbers are uniform in [0, 1).
    pub fn radiance(&self, (from, triangle): (DVec3, u32), direction: DVec3, numbers: [f64; 2]) -> DVec3 {
        if self.brightest == 0.0 {
            return DVec3::ZERO;
        }
        let is_in_the_way = |object: u32| self.visibility == Visibility::Full || self.receives[object as usize];
        let sees = |id: u32| id != triangle && is_in_the_way(self.geometry.triangles[id as usize].object);
        let Some(hit) = self.geometry.first_hit_of(from, direction, sees) else { return DVec3::ZERO };
        let surface = &self.geometry.triangles[hit.triangle as usize];
        let albedo = self.albedos[surface.object as usize];
        if albedo == DVec3::ZERO {
            return DVec3::ZERO;
        }
        let (place, normal) = (surface.position(hit.barycentric), surface.normal(hit.barycentric));
        let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
        let arriving = |lamp: super::lamps::Sample| {
            let cosine = lamp.direction.dot(normal);
            let is_hidden = cosine <= 0.0
                || self.visibility == Visibility::Full
                    && self.geometry.blocks_segment(place, lamp.position, [hit.triangle; 2]);
            if is_hidden { DVec3::ZERO } else { lamp.radiance * lamp.solid_angle.min(TAU) * cosine }
        };
        let of_lamps: DVec3 = self.lamps.samples(place, numbers).map(arriving).sum();
        let of_emitters = self.emitters.sample(place, numbers).map_or(DVec3::ZERO, |point| {
            let cosine = point.direction.dot(normal);
            let is_hidden = cosine <= 0.0
                || !self.emitters.shows(place, &point)
                || self.visibility == Visibility::Full
                    && self.geometry.blocks_segment(place, point.position, [hit.triangle; 2]);
            if is_hidden { DVec3::ZERO } else { point.irradiance * cosine }
        });
        let irradiance = of_lamps + of_emitters;
        albedo * FRAC_1_PI * irradiance * transmittance(self.extinction, place.distance(from))
    }
}

/// An object, as bounds see it; `None` where no light falls.
fn lit_object(triangles: &[&Triangle], albedo: DVec3, (lamps, emitters): (&Lamps, &Emitters)) -> Option<BrightSphere> {
    let irradiance = |lamp: &Source| {
        let distance = triangles.iter().map(|t| distance(t, lamp.position)).fold(f64::INFINITY, f64::min);
        lamp.most_irradiance(distance)
    };
    let of_lamps: f64 = lamps.sources().iter().map(irradiance).sum();
    // As if they were all around; single points may bring more where a surface is next to an emitter.
    let irradiance = of_lamps + PI * emitters.brightest_near();
    let brightest = albedo.max_element() * FRAC_1_PI * irradiance;
    BrightSphere::around(triangles, brightest).filter(|sphere| sphere.brightest > 0.0)
}

/// From a point to the nearest one of a triangle.
fn distance(triangle: &Triangle, point: DVec3) -> f64 {
    let [a, b, c] = triangle.corners.map(|corner| corner - point);
    let normal = (b - a).cross(c - a);
    let to_edge = |from: DVec3, to: DVec3| {
        let edge = to - from;
        let along = (-from.dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
        (from + along * edge).length()
    };
    let is_inside = [(a, b), (b, c), (c, a)].into_iter().all(|(from, to)| normal.cross(to - from).dot(from) <= 0.0);
    let edges = to_edge(a, b).min(to_edge(b, c)).min(to_edge(c, a));
    if is_inside { a.dot(normal).abs() / normal.length() } else { edges }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_the_nearest_points() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Z];
        let triangle = Triangle { corners, normals: [DVec3::Y; 3], object: 0 };
        let cases = [
            (DVec3::new(0.2, 0.5, 0.2), 0.5),
            (DVec3::new(-1.0, 0.0, 0.5), 1.0),
            (DVec3::new(0.5, 0.0, -2.0), 2.0),
            (DVec3::new(1.0, 0.0, 1.0), 0.5f64.sqrt()),
        ];
        for (point, expected) in cases {
            assert!((distance(&triangle, point) - expected).abs() < 1e-12, "{point}");
        }
    }
}
