//! Emitters that are too near for their light to be the environment's: parts of them, from which receivers get their direct light, and what
//! rays meet of them.

use std::f32::consts::{FRAC_1_PI, PI};
use std::sync::Arc;

use glam::Vec3;

use super::emitter_parts::{MeshPart, divide};
use crate::scene::{Lamp, Mesh, Object, is_closed};
use crate::tracing::{SeenBy, Tracer};

/// Parts of an emitter, for direct light and for what is seen in mirrors.
const PARTS: usize = 64;
const FEW_PARTS: usize = 16;
/// Normals of a flat emitter have this cosine at least.
const FLAT_COSINE: f32 = 0.9999;
/// The cosine at which the plane of a flat emitter is met, at least.
const MIN_COSINE: f32 = 0.1;
/// Spheres are seen as lamps where the sine of their angular radius is at most this: parts of larger ones may be below a mirror's horizon.
const MAX_LAMP_SINE: f32 = 0.25;
/// Emitters that are nearer to mirrors than this, metres, are taken to be that near.
const MIN_DISTANCE: f32 = 1e-4;
/// A mesh is a sphere if the distances of its vertices from the middle differ from the radius of a sphere of its area by this part at most.
const ROUNDNESS: f32 = 0.03;

/// All near emitters of a scene.
#[derive(Debug)]
pub(crate) struct NearEmitters {
    /// In the order of the objects.
    pub emitters: Vec<NearEmitter>,
    /// What rays meet of them.
    pub tracer: Arc<Tracer>,
}

/// A near emitter.
#[derive(Debug)]
pub(crate) struct NearEmitter {
    /// W/(m²·sr).
    pub radiance: Vec3,
    /// In world space.
    pub mesh: Arc<Mesh>,
    /// The mean of its parts.
    middle: Vec3,
    /// The normal, if it is flat.
    flat_normal: Option<Vec3>,
    /// The sphere that it is, if it is one.
    sphere: Option<Sphere>,
    /// Whether only its front is seen.
    pub is_closed: bool,
    parts: Vec<MeshPart>,
    few_parts: Vec<MeshPart>,
}

/// Its centre and radius, metres.
#[derive(Clone, Copy, Debug)]
struct Sphere {
    centre: Vec3,
    radius: f32,
}

/// A part of an emitter, as it is seen from a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EmitterPart {
    /// Unit direction towards it.
    pub direction: Vec3,
    /// Metres.
    pub distance: f32,
    /// Of a disc of its area, sr.
    pub solid_angle: f32,
}

impl NearEmitters {
    /// From all objects, and their meshes in world space.
    pub fn new(meshes: &[Arc<Mesh>], objects: &[Object]) -> Self {
        let is_near = |object: &Object| object.emitter.filter(|emitter| emitter.is_near);
        let emitters = meshes.iter().zip(objects).filter_map(|(mesh, object)| {
            let radiance = is_near(object)?.radiance;
            let is_closed = is_closed(&object.mesh);
            let (parts, few_parts) = (divide(mesh, PARTS, is_closed), divide(mesh, FEW_PARTS, is_closed));
            let middle = parts.iter().map(|part| part.position).sum::<Vec3>() / parts.len().max(1) as f32;
            let normals = || parts.iter().map(|part| part.area.normalize_or_zero());
            let flat_normal = normals().next().filter(|n| normals().all(|other| n.dot(other).abs() > FLAT_COSINE));
            let sphere = Sphere::of(mesh).filter(|_| is_closed);
            Some(NearEmitter { radiance, mesh: mesh.clone(), middle, flat_normal, sphere, is_closed, parts, few_parts })
        });
        let seen_by = |object: &Object| SeenBy::all_but_camera(object.is_near_light());
        let seen = meshes.iter().zip(objects).map(|(mesh, object)| (&**mesh, seen_by(object)));
        Self { emitters: emitters.collect(), tracer: Arc::new(Tracer::of_meshes(seen)) }
    }
}

impl Sphere {
    /// The sphere of the area of a mesh all whose vertices are about equally far from its middle.
    fn of(mesh: &Mesh) -> Option<Self> {
        let positions = mesh.positions();
        let bounds = |(low, high): (Vec3, Vec3), p: &Vec3| (low.min(*p), high.max(*p));
        let (low, high) = positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), bounds);
        let centre = 0.5 * (low + high);
        let radius = (mesh.area() as f32 * 0.25 * FRAC_1_PI).sqrt();
        let is_round = |p: &Vec3| (p.distance(centre) - radius).abs() <= ROUNDNESS * radius;
        (radius > 0.0 && positions.iter().all(is_round)).then_some(Self { centre, radius })
    }
}

impl NearEmitter {
    /// The lamp that shines like it, if it is a sphere that is small as it is seen from all of these points. Its radiance is scaled by a
    /// factor.
    pub fn as_lamp(&self, factor: f32, points: &[Vec3]) -> Option<Lamp> {
        let Sphere { centre, radius } = self.sphere?;
        let radius = radius.max(Lamp::MIN_RADIUS);
        let is_small = |point: &Vec3| point.distance(centre) * MAX_LAMP_SINE >= radius;
        points.iter().all(is_small).then(|| Lamp {
            name: String::new(),
            position: centre,
            radius,
            intensity: PI * radius * radius * factor * self.radiance,
            beam: None,
            is_distant: false,
        })
    }

    /// All its parts, as they are seen from a point; or fewer and larger ones.
    pub fn parts_from(&self, from: Vec3, few: bool) -> impl Iterator<Item = EmitterPart> {
        let parts = if few { &self.few_parts } else { &self.parts };
        parts.iter().map(move |part| self.seen(part, from))
    }

    /// The middles of its parts, and the integral of the unit normal over each, m².
    #[cfg(feature = "gpu")]
    pub fn parts(&self) -> impl Iterator<Item = (Vec3, Vec3)> {
        self.parts.iter().map(|part| (part.position, part.area))
    }

    /// One of them, by any number.
    pub fn part_from(&self, from: Vec3, index: usize) -> Option<EmitterPart> {
        let part = self.parts.get(index % self.parts.len().max(1))?;
        Some(self.seen(part, from))
    }

    /// How many they are.
    pub fn part_count(&self) -> usize {
        self.parts.len()
    }

    /// The plane in which others see it, relative to a viewpoint, as the unit normal over the distance, 1/m: its own one if it is flat, else
    /// through its middle towards the viewpoint.
    pub fn plane_from(&self, viewpoint: Vec3) -> Vec3 {
        let to = self.middle - viewpoint;
        let squared = to.length_squared().max(f32::MIN_POSITIVE);
        let height = self.flat_normal.map_or(0.0, |normal| normal.dot(to));
        match self.flat_normal {
            // At grazing angles a plane passes too closely.
            Some(normal) if height * height > MIN_COSINE * MIN_COSINE * squared => normal / height,
            _ => to / squared,
        }
    }

    /// From a point to the nearest of its vertices or points, metres.
    pub fn distance_from(&self, from: Vec3) -> f32 {
        let places = self.mesh.positions().iter().chain(self.parts.iter().map(|part| &part.position));
        places.map(|place| place.distance(from)).fold(f32::INFINITY, f32::min).max(MIN_DISTANCE)
    }

    /// The sine of its angular radius, about, as it is seen from a point.
    pub fn angular_sine(&self, from: Vec3) -> f32 {
        let to_middle = |p: &Vec3| p.distance(self.middle);
        let radius = self.mesh.positions().iter().map(to_middle).fold(0.0, f32::max);
        radius / from.distance(self.middle).max(MIN_DISTANCE)
    }

    fn seen(&self, part: &MeshPart, from: Vec3) -> EmitterPart {
        let to = part.position - from;
        let distance = to.length();
        let direction = to / distance.max(f32::MIN_POSITIVE);
        let facing = -part.area.dot(direction);
        let facing = if self.is_closed { facing.max(0.0) } else { facing.abs() };
        // Close by as that of a disc seen from its axis, which stays finite.
        let solid_angle = facing / (distance * distance + FRAC_1_PI * part.area.length());
        EmitterPart { direction, distance, solid_angle }
    }
}
