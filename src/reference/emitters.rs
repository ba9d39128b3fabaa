//! Surfaces that shine, where they are: what a ray meets first of them, bounds of it, and points on those that are near, for their light on
//! other surfaces. Of each other and of the environment they hide what is behind them, of other light nothing.

use glam::DVec3;

use super::bright_spheres::{BrightSphere, brightest, brightest_within};
use super::cone::Cone;
use super::geometry::{Geometry, Hit, Triangle};
use super::medium::transmittance;
use crate::scene::{Object, Scene};

/// All objects that shine.
#[derive(Debug)]
pub(super) struct Emitters {
    geometry: Geometry,
    /// By object.
    radiances: Vec<DVec3>,
    camera_visible: Vec<bool>,
    are_near: Vec<bool>,
    spheres: Vec<BrightSphere>,
    /// Of what their light passes through, 1/m.
    extinction: DVec3,
    near: Choice,
    distant: Choice,
}

/// Triangles, and the sums of area × brightness up to and including each, m² W/(m²·sr).
type Choice = Vec<(u32, f64)>;

/// A point on an emitter.
pub(super) struct Sample {
    pub position: DVec3,
    /// Unit direction towards it.
    pub direction: DVec3,
    /// Radiance × solid angle over the probability, W/m².
    pub irradiance: DVec3,
}

/// What a ray meets.
pub(super) struct Met {
    pub position: DVec3,
    /// W/(m²·sr); what a medium leaves of it.
    pub radiance: DVec3,
}

impl Emitters {
    /// In a medium of this extinction, 1/m.
    pub fn of_scene(scene: &Scene, extinction: DVec3) -> Self {
        let geometry = Geometry::of_objects(scene, |object| object.emitter.is_some());
        let radiance = |object: &Object| object.emitter.map_or(DVec3::ZERO, |e| e.radiance.as_dvec3());
        let radiances: Vec<DVec3> = scene.objects.iter().map(radiance).collect();
        let shining = (0u32..).zip(&radiances).filter(|(_, radiance)| **radiance != DVec3::ZERO);
        let spheres = shining.filter_map(|(object, radiance)| {
            let own: Vec<&Triangle> = geometry.triangles.iter().filter(|triangle| triangle.object == object).collect();
            BrightSphere::around(&own, radiance.element_sum())
        });
        let spheres = spheres.collect();
        let are_near: Vec<bool> = scene.objects.iter().map(Object::is_near_light).collect();
        let choice = |near: bool| -> Choice {
            let triangles = (0u32..).zip(&geometry.triangles).filter(|(_, t)| are_near[t.object as usize] == near);
            let summed = triangles.scan(0.0, |sum, (id, triangle)| {
                *sum += area_and_normal(triangle).0 * radiances[triangle.object as usize].element_sum();
                Some((id, *sum))
            });
            summed.collect()
        };
        let (near, distant) = (choice(true), choice(false));
        let camera_visible = scene.objects.iter().map(|object| object.camera_visible).collect();
        Self { geometry, radiances, camera_visible, are_near, spheres, extinction, near, distant }
    }

    /// A point on near emitters, seen from a point: an unbiased estimate of what arrives of them, if the two numbers are uniform in [0, 1).
    pub fn sample(&self, from: DVec3, numbers: [f64; 2]) -> Option<Sample> {
        self.chosen(&self.near, from, numbers)
    }

    /// The same on distant ones.
    pub fn sample_distant(&self, from: DVec3, numbers: [f64; 2]) -> Option<Sample> {
        self.chosen(&self.distant, from, numbers)
    }

    fn chosen(&self, choice: &Choice, from: DVec3, [u, v]: [f64; 2]) -> Option<Sample> {
        let total = choice.last().filter(|(_, sum)| *sum > 0.0)?.1;
        let index = choice.partition_point(|(_, sum)| *sum <= u * total).min(choice.len() - 1);
        let before = if index == 0 { 0.0 } else { choice[index - 1].1 };
        let (id, sum) = choice[index];
        let triangle = &self.geometry.triangles[id as usize];
        let root = ((u * total - before) / (sum - before)).clamp(0.0, 1.0).sqrt();
        let position = triangle.position([1.0 - root, root * (1.0 - v), root * v]);
        let to = position - from;
        let direction = to.normalize();
        let (area, normal) = area_and_normal(triangle);
        let radiance = self.radiances[triangle.object as usize];
        let density = (sum - before) / total / area;
        let passed = self.transmittance(triangle.object, to.length());
        let irradiance = passed * radiance * (normal.dot(direction).abs() / to.length_squared() / density);
        Some(Sample { position, direction, irradiance })
    }

    /// Whether no emitter, nor another part of the same one, hides a point from a place.
    pub fn shows(&self, from: DVec3, point: &Sample) -> bool {
        let distance = point.position.distance(from);
        self.met(from, point.direction).is_none_or(|met| met.position.distance(from) > distance * (1.0 - 1e-9))
    }

    /// The largest sum of the channels of any near emitter's radiance.
    pub fn brightest_near(&self) -> f64 {
        let near = self.near.iter().map(|(id, _)| self.geometry.triangles[*id as usize].object);
        near.map(|object| self.radiances[object as usize].element_sum()).fold(0.0, f64::max)
    }

    /// The first one along a ray.
    pub fn met(&self, from: DVec3, direction: DVec3) -> Option<Met> {
        let hit = self.geometry.first_hit(from, direction, |_| true)?;
        let triangle = &self.geometry.triangles[hit.triangle as usize];
        let position = triangle.position(hit.barycentric);
        let passed = self.transmittance(triangle.object, position.distance(from));
        Some(Met { position, radiance: passed * self.radiances[triangle.object as usize] })
    }

    /// Of the way from an emitter; the light of distant ones comes from without the medium.
    fn transmittance(&self, object: u32, distance: f64) -> DVec3 {
        let extinction = if self.are_near[object as usize] { self.extinction } else { DVec3::ZERO };
        transmittance(extinction, distance)
    }

    /// Whether the camera sees one of them before what it would see at a distance, m, from it.
    pub fn hide(&self, (camera, direction): (DVec3, DVec3), distance: f64) -> bool {
        let hit = self.geometry.first_hit(camera, direction, |object| self.camera_visible[object as usize]);
        let position = |hit: Hit| self.geometry.triangles[hit.triangle as usize].position(hit.barycentric);
        hit.is_some_and(|hit| position(hit).distance(camera) < distance)
    }

    /// At least the largest sum of the channels of the radiance that arrives at any point of a sphere in a cone of directions.
    pub fn bound(&self, region: (DVec3, f64), cone: &Cone) -> f64 {
        brightest_within(&self.spheres, region, cone)
    }

    /// The largest sum of the channels of any radiance.
    pub fn brightest(&self) -> f64 {
        brightest(&self.spheres)
    }
}

fn area_and_normal(triangle: &Triangle) -> (f64, DVec3) {
    let [a, b, c] = triangle.corners;
    let across = (b - a).cross(c - a);
    (0.5 * across.length(), across.normalize_or_zero())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use rand::{RngExt, SeedableRng};

    /// No ray that begins in a sphere and lies in a cone meets anything brighter than their bound.
    #[test]
    fn bounds_hold() {
        let scene = crate::scene::load::<toml::Table>("dance-floor").unwrap().scene;
        let emitters = Emitters::of_scene(&scene, DVec3::ZERO);
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(3);
        let mut random = |most: f64| {
            let p = DVec3::from_array([0; 3].map(|_| rng.random_range(-1.0..1.0)));
            (most * p, rng.random_range(0.0f64..1.0))
        };
        let mut met = 0;
        for _ in 0..20_000 {
            let ((centre, size), (aside, width)) = (random(4.0), random(0.3));
            // Towards one of them, or past it.
            let to = emitters.spheres[(size * emitters.spheres.len() as f64) as usize].centre - centre;
            let axis = (to.normalize() + aside).normalize();
            let (radius, cone) = (width * width, Cone { axis, half_angle: PI * width.powi(4) });
            let ((offset, _), (across, off)) = (random(1.0), random(1.0));
            let from = centre + radius * offset.normalize() * off;
            let across = across.cross(cone.axis).normalize();
            let turn = off * cone.half_angle;
            let direction = cone.axis * turn.cos() + across * turn.sin();
            let Some(found) = emitters.met(from, direction) else { continue };
            assert!(found.radiance.element_sum() <= emitters.bound((centre, radius), &cone));
            met += 1;
        }
        assert!(met > 100, "{met}");
    }
}
