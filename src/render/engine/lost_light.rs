//! What sums leave out: light that mirrors and glass send to each other, where it is not followed. Told from a few rays.

use glam::{Mat3, Vec2, Vec3};
use sobol_burley::sample_4d;

use super::paths::mirrors;
use crate::environment::LightSampler;
use crate::parallel;
use crate::scene::{Chain, Object, Ray, Scene};
use crate::stages::{PreparedLight, PreparedScene, divided};
use crate::tracing::Hit;

/// Points on mirrors and interfaces.
const POINTS: usize = 8192;
const SEED: u32 = 54;

/// Parts of the light that mirrors and interfaces cast.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LostLight {
    /// Meets another mirror or interface.
    pub meets_another: f32,
    /// Enters a closed object, through which it is not followed.
    pub enters: f32,
}

impl LostLight {
    /// Light of which less is lost is not worth a word.
    const NEGLIGIBLE: f32 = 0.03;

    /// What is missing, one sentence each.
    pub fn warnings(self, scene: &Scene) -> Vec<String> {
        let per_cent = |share: f32| format!("{:.0} %", 100.0 * share);
        let solid = scene.objects.iter().find(|object| object.casts(Chain::TT));
        let enters = solid.filter(|_| self.enters > Self::NEGLIGIBLE).map(|solid| {
            format!(
                "{} of the light that falls on mirrors and glass passes through '{}' and is not computed; the technique image-space and \
                 the ground truth know its caustics (pinspot reference --chains TT)",
                per_cent(self.enters),
                solid.name
            )
        });
        let meets_another = (self.meets_another > Self::NEGLIGIBLE).then(|| {
            format!(
                "{} of the light that mirrors and glass cast meets another mirror or glass, or the same one again, where neither technique \
                 follows it",
                per_cent(self.meets_another)
            )
        });
        enters.into_iter().chain(meets_another).collect()
    }
}

/// Light that is cast, and what of it is lost, W.
#[derive(Clone, Copy, Default)]
struct Sums {
    cast: f32,
    meets_another: f32,
    enters: f32,
}

/// Where light comes from and what it meets.
struct Rays<'a> {
    scene: &'a Scene,
    prepared: &'a PreparedScene,
    light: &'a PreparedLight,
    sampler: LightSampler,
    /// Corners of the triangles that cast, their objects, and the sums of their areas up to and including each, m².
    triangles: Vec<([Vec3; 3], u32, f32)>,
    /// From so far before a point light is followed to it, m.
    start: f32,
}

impl LostLight {
    /// Of sums that follow one reflection, or one refraction.
    pub fn new(scene: &Scene, prepared: &PreparedScene, light: &PreparedLight) -> Self {
        let sampler = LightSampler::of_frame(&light.environment.cube);
        let triangles = casting_triangles(scene);
        if triangles.is_empty() {
            return Self::default();
        }
        let start = small_part(&triangles);
        let rays = Rays { scene, prepared, light, sampler, triangles, start };
        let of_point = |k: usize| rays.through_point(k);
        let sum = parallel::collect(POINTS, &of_point).into_iter().fold(Sums::default(), |sum, other| Sums {
            cast: sum.cast + other.cast,
            meets_another: sum.meets_another + other.meets_another,
            enters: sum.enters + other.enters,
        });
        let part = |lost: f32| if sum.cast > 0.0 { lost / sum.cast } else { 0.0 };
        Self { meets_another: part(sum.meets_another), enters: part(sum.enters) }
    }
}

fn casting_triangles(scene: &Scene) -> Vec<([Vec3; 3], u32, f32)> {
    let mut area = 0.0;
    let mut triangles = Vec::new();
    for (object, description) in (0u32..).zip(&scene.objects).filter(|(_, object)| object.specular().is_some()) {
        let mesh = description.mesh_in_world();
        for corners in (0..mesh.triangles().len()).map(|index| mesh.corners(index)) {
            let [a, b, c] = corners;
            area += 0.5 * (b - a).cross(c - a).length();
            triangles.push((corners, object, area));
        }
    }
    triangles
}

impl Rays<'_> {
    /// Light that falls on a random point of a mirror or an interface.
    fn through_point(&self, index: usize) -> Sums {
        let [at, u, v, _] = sample_4d(index as u32, 0, SEED);
        let [x, y, ..] = sample_4d(index as u32, 1, SEED);
        let (_, _, area) = self.triangles[self.triangles.len() - 1];
        let chosen = self.triangles.partition_point(|(.., sum)| *sum <= at * area).min(self.triangles.len() - 1);
        let (corners, object, _) = self.triangles[chosen];
        let root = u.sqrt();
        let point = corners[0] * (1.0 - root) + corners[1] * (root * (1.0 - v)) + corners[2] * (root * v);
        let mut sums = Sums::default();
        let (direction, density) = self.sampler.sample(Vec2::new(x, y));
        let radiance = self.light.environment.cube.fetch(direction, 0.0);
        let towards = Mat3::from_rotation_y(self.light.rotation_rad) * direction;
        self.follow((point, object), towards, f32::INFINITY, radiance.element_sum() / density, &mut sums);
        for lamp in self.light.lamps.iter() {
            let to = lamp.position - point;
            self.follow(
                (point, object),
                to.normalize_or(Vec3::Y),
                to.length(),
                lamp.irradiance_at(point).element_sum(),
                &mut sums,
            );
        }
        sums
    }

    /// Follows light from a direction and a distance that brings so much to what faces it.
    fn follow(&self, (point, object): (Vec3, u32), towards: Vec3, distance: f32, irradiance: f32, sums: &mut Sums) {
        let tracer = &self.prepared.tracer;
        // Back along its way, so that the tracer itself says how the point is met.
        let blocker = tracer.secondary_hit(Ray { origin: point, direction: towards });
        if irradiance <= 0.0 || blocker.is_some_and(|hit| hit.distance < distance) {
            return;
        }
        let start = distance.min(self.start);
        let ray = Ray { origin: point + start * towards, direction: -towards };
        let Some(met) = tracer.secondary_hit(ray).filter(|hit| hit.object == object) else { return };
        let flux = irradiance * towards.dot(met.face_normal).abs();
        for (part, direction) in self.cast(&met, &ray, flux, sums) {
            sums.cast += part;
            let next = tracer.secondary_hit(Ray { origin: met.position, direction });
            let only_casts = |hit: Hit| {
                let object = self.object(hit.object);
                object.specular().is_some() && object.receiver.is_none()
            };
            sums.meets_another += if next.is_some_and(only_casts) { part } else { 0.0 };
        }
    }

    /// What a surface casts of a flux, and where.
    fn cast(&self, met: &Hit, ray: &Ray, flux: f32, sums: &mut Sums) -> Vec<(f32, Vec3)> {
        let object = self.object(met.object);
        let mirrored = ray.direction.reflect(met.normal).normalize();
        if let Some(refractor) = &object.refractor {
            let (reflectance, refracted) = divided(refractor, refractor.eta.y, (met, ray));
            let passes = refracted.filter(|_| met.front);
            if object.casts(Chain::TT) {
                let entering = if passes.is_some() { (1.0 - reflectance) * flux } else { 0.0 };
                sums.cast += entering;
                sums.enters += entering;
                return vec![(reflectance * flux, mirrored)];
            }
            let passed = passes.map(|refracted| ((1.0 - reflectance) * flux, refracted.direction));
            return passed.into_iter().chain([(reflectance * flux, mirrored)]).collect();
        }
        if mirrors(object, met.front) { vec![(flux, mirrored)] } else { Vec::new() }
    }

    fn object(&self, object: u32) -> &Object {
        &self.scene.objects[object as usize]
    }
}

/// A small part of the extent of triangles, m.
fn small_part(triangles: &[([Vec3; 3], u32, f32)]) -> f32 {
    let around = |(low, high): (Vec3, Vec3), p: &Vec3| (low.min(*p), high.max(*p));
    let corners = triangles.iter().flat_map(|(corners, ..)| corners);
    let (low, high) = corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), around);
    1e-3 * low.distance(high)
}
