//! The parts of camera rays that lie in a medium, and how much of the light that is scattered there reaches the camera.

use glam::Vec3;

use crate::parallel;
use crate::scene::{Interfaces, Medium, Object, Ray, Scene};
use crate::stages::CameraRays;
use crate::tracing::{Hit, Tracer};

/// Stands for an object where a ray leaves the scene.
const NO_OBJECT: u32 = u32::MAX;
/// Parts are no smaller near the mirrors than if these were so far away, in half diagonals of the box around them.
const LEAST_DISTANCE: f32 = 0.5;

/// Camera rays in a medium.
pub(in crate::engine) struct MediumRays {
    /// With unit directions.
    rays: Vec<Ray>,
    medium: Medium,
    parts_per_ray: usize,
    /// The middle of what casts caustics, metres, and the distance from it within which parts are equally small.
    centre: (Vec3, f32),
    /// Where rays end, at surfaces or where nothing is seen any more; `None` where they are outside.
    ends: Vec<Option<Hit>>,
}

impl MediumRays {
    /// Camera rays with what they hit; each has so many parts. They are in the medium if the camera is.
    pub fn new(
        (scene, medium): (&Scene, Medium),
        is_within: bool,
        rays: Vec<Ray>,
        hits: &[Option<Hit>],
        parts_per_ray: usize,
    ) -> Self {
        let end = |index: usize| {
            let (ray, hit) = (&rays[index], hits[index]);
            let beyond = || {
                let position = ray.origin + medium.sight() * ray.direction;
                let (distance, normal) = (medium.sight(), -ray.direction);
                Hit { object: NO_OBJECT, position, distance, normal, face_normal: normal, front: true }
            };
            let hit = hit.filter(|hit| hit.distance < medium.sight());
            is_within.then(|| hit.unwrap_or_else(beyond))
        };
        let ends = parallel::collect(rays.len(), &end);
        Self { rays, medium, parts_per_ray, centre: casters(scene), ends }
    }

    /// Those of a picture.
    pub fn of_picture(
        (scene, medium): (&Scene, Medium),
        tracer: &Tracer,
        rays: &CameraRays,
        parts_per_ray: usize,
    ) -> Self {
        let is_within = contains(scene, tracer, scene.camera.position);
        let ray = |k: usize| {
            let Ray { origin, direction } = rays.view.ray(k as u32);
            Ray { origin, direction: direction.normalize() }
        };
        let all = parallel::collect(rays.hits.len(), &ray);
        Self::new((scene, medium), is_within, all, &rays.hits, parts_per_ray)
    }

    /// Number of camera rays.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// The rays that are in the medium, in ascending order.
    pub fn within(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.len()).filter(|&index| self.ends[index].is_some())
    }

    pub fn medium(&self) -> &Medium {
        &self.medium
    }

    pub fn parts_per_ray(&self) -> usize {
        self.parts_per_ray
    }

    /// A ray, with a unit direction.
    pub fn ray(&self, index: usize) -> Ray {
        self.rays[index]
    }

    /// Where a ray ends.
    pub fn end(&self, index: usize) -> Option<&Hit> {
        self.ends[index].as_ref()
    }

    /// The way of a ray through the medium, metres.
    pub fn length(&self, index: usize) -> f32 {
        self.end(index).map_or(0.0, |end| self.ray(index).origin.distance(end.position))
    }

    /// The ways of all rays through the medium, metres.
    pub fn lengths(&self) -> Vec<f32> {
        parallel::collect(self.len(), &|index| self.length(index))
    }

    /// Where the parts of a ray begin and end, metres from its origin: at equal angles as they are seen from the middle of the mirrors
    /// (equiangular sampling, Kulla and Fajardo 2012, Section 4), and evenly near to that.
    pub fn parts(&self, index: usize) -> impl Iterator<Item = [f32; 2]> + use<> {
        let (ray, length, count) = (self.ray(index), self.length(index), self.parts_per_ray as f32);
        let (centre, least) = self.centre;
        let nearest = (centre - ray.origin).dot(ray.direction);
        let off = (centre - ray.origin - nearest * ray.direction).length().hypot(least);
        let [first, last] = [0.0, length].map(|s| ((s - nearest) / off).atan());
        let place = move |k: f32| match k {
            0.0 => 0.0,
            k if k == count => length,
            k => (nearest + off * (first + (last - first) * k / count).tan()).clamp(0.0, length),
        };
        (0..self.parts_per_ray).map(move |k| [place(k as f32), place((k + 1) as f32)])
    }

    /// The integrals of the transmittance to the camera over the parts of a ray, metres.
    pub fn weights(&self, index: usize) -> impl Iterator<Item = Vec3> + '_ {
        self.parts(index).map(|part| seen_length(&self.medium, part))
    }
}

/// The integral of the transmittance over a part of a ray, metres, channel by channel.
pub fn seen_length(medium: &Medium, [start, end]: [f32; 2]) -> Vec3 {
    let of_channel = |extinction: f32| {
        let depth = extinction * (end - start);
        // (1 − e^−x) / x, without cancellation.
        let mean = if depth > 1e-4 { -(-depth).exp_m1() / depth } else { 1.0 - 0.5 * depth };
        (end - start) * (-extinction * start).exp() * mean
    };
    medium.extinction().map(of_channel)
}

/// Whether a point lies in the medium: anywhere in a scene without refractors, else behind the one that is met on the way to their
/// middle.
pub(in crate::engine) fn contains(scene: &Scene, tracer: &Tracer, point: Vec3) -> bool {
    let largest = scene.objects.iter().filter(|object| object.has_interfaces(Interfaces::One)).filter_map(|object| {
        let mesh = object.mesh_in_world();
        let corners = |triangle: &[u32; 3]| triangle.map(|k| mesh.positions()[k as usize]);
        let area = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a).length();
        let largest = mesh.triangles().iter().map(corners).max_by(|a, b| area(*a).total_cmp(&area(*b)))?;
        Some((area(largest), largest))
    });
    let Some((_, [a, b, c])) = largest.max_by(|(a, _), (b, _)| a.total_cmp(b)) else { return true };
    let mut ray = Ray { origin: point, direction: ((a + b + c) / 3.0 - point).normalize_or(Vec3::Y) };
    while let Some(hit) = tracer.secondary_hit(ray) {
        if scene.objects[hit.object as usize].has_interfaces(Interfaces::One) {
            return !hit.front;
        }
        ray.origin = hit.position;
    }
    false
}

/// The middle of what casts caustics, and how far it reaches, metres.
fn casters(scene: &Scene) -> (Vec3, f32) {
    let meshes = scene.objects.iter().filter(|object| object.specular().is_some()).map(Object::mesh_in_world);
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for mesh in meshes {
        mesh.positions().iter().for_each(|p| (low, high) = (low.min(*p), high.max(*p)));
    }
    if low.x > high.x {
        return (Vec3::ZERO, 1.0);
    }
    (0.5 * (low + high), (LEAST_DISTANCE * 0.5 * low.distance(high)).max(f32::MIN_POSITIVE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transmittance_is_integrated_exactly() {
        let medium = Medium { sigma_s: Vec3::new(0.5, 1e-6, 0.0), sigma_a: Vec3::new(0.2, 0.0, 3.0), g: 0.0 };
        let part = [0.3f32, 1.9];
        let expected = medium.extinction().map(|sigma| {
            let steps = 4096;
            let step = (part[1] - part[0]) / steps as f32;
            (0..steps).map(|k| step * (-sigma * (part[0] + (k as f32 + 0.5) * step)).exp()).sum()
        });
        assert!(seen_length(&medium, part).abs_diff_eq(expected, 1e-4), "{}", seen_length(&medium, part));
    }
}
