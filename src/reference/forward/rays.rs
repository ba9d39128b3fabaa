//! Rays of light that leave a mirror or an interface: which ways they can take, what is left of the light, and where they arrive in the
//! picture. It knows no light.

use glam::{DVec2, DVec3};

use crate::emitters::Emitters;
use crate::geometry::{Geometry, Hit};
use crate::gloss;
use crate::medium::Medium;
use crate::picture_plane::PicturePlane;
use crate::reflectance::Reflectance;
use crate::refraction::{Interface, refract};
use crate::scene::{Chain, Chains, Object, Scene, Sides, Specular};

/// Rays start so far off the triangle that they leave, in its extent and its distance from the origin.
const TOUCHING: f64 = 1e-9;

/// How an object casts light.
pub(crate) enum Caster {
    Mirror {
        reflectance: Box<Reflectance>,
        sides: Sides,
        /// GGX's α; 0 where it is smooth.
        alpha: f64,
    },
    Interface(Interface),
}

/// What rays are followed through.
pub(crate) struct Rays<'a> {
    scene: &'a Scene,
    pub geometry: &'a Geometry,
    emitters: &'a Emitters,
    pub plane: PicturePlane,
    chains: Chains,
    /// By object.
    pub casters: Vec<Option<Caster>>,
    medium: Option<Medium>,
}

/// A kind of way: by its chain, and by the channel of colours that are refracted differently.
#[derive(Clone, Copy)]
pub(crate) struct Way {
    chain: Chain,
    channel: Option<usize>,
}

/// Light where it meets a caster.
pub(crate) struct Start {
    /// The triangle.
    pub id: u32,
    pub position: DVec3,
    /// Interpolated, on the side of the light.
    pub normal: DVec3,
    /// The direction in which the light travels.
    pub arriving: DVec3,
    pub cosine: f64,
    /// Whether it meets the front.
    pub is_front: bool,
}

/// A ray from a triangle.
#[derive(Clone, Copy)]
pub(crate) struct Leaving {
    pub id: u32,
    pub position: DVec3,
    pub direction: DVec3,
}

/// Where light arrives.
#[derive(Clone, Copy)]
pub(crate) struct Landing {
    /// In pixels.
    pub place: DVec2,
    pub receiver: u32,
    /// The camera sees it.
    pub is_seen: bool,
    /// The part of the flux that is not lost on the way, for each channel, over the area of a pixel where it arrives, 1/m².
    pub per_area: DVec3,
}

impl<'a> Rays<'a> {
    pub fn new(
        scene: &'a Scene,
        (geometry, emitters): (&'a Geometry, &'a Emitters),
        size: [u32; 2],
        chains: Chains,
    ) -> Self {
        let casters = scene.objects.iter().map(|object| object.specular().map(caster)).collect();
        let plane = PicturePlane::new(&scene.camera, size);
        Self { scene, geometry, emitters, plane, chains, casters, medium: Medium::of_scene(scene) }
    }

    /// The triangles of everything that casts caustics.
    pub fn casting_triangles(&self) -> Vec<u32> {
        let casts = |id: &u32| self.casters[self.geometry.triangles[*id as usize].object as usize].is_some();
        (0..self.geometry.triangles.len() as u32).filter(casts).collect()
    }

    /// The ways that light from an object can take.
    pub fn ways_of(&self, object: u32) -> Vec<Way> {
        let object = &self.scene.objects[object as usize];
        let is_dispersive = self.scene.objects.iter().any(|o| o.refractor.is_some_and(|r| r.is_dispersive()));
        let chains = Chain::ALL.into_iter().filter(|chain| self.chains.contains(*chain) && object.casts(*chain));
        let of_chain = |chain: Chain| {
            let is_divided = is_dispersive && chain != Chain::R;
            let channels = if is_divided { vec![Some(0), Some(1), Some(2)] } else { vec![None] };
            channels.into_iter().map(move |channel| Way { chain, channel })
        };
        chains.flat_map(of_chain).collect()
    }

    /// The receivers among the objects.
    pub fn receivers(&self) -> impl Iterator<Item = u32> + '_ {
        let receives = |object: &Object| object.receiver.is_some();
        (0u32..).zip(&self.scene.objects).filter(move |(_, object)| receives(object)).map(|(id, _)| id)
    }

    /// Light that travels in a unit direction and meets a point of a triangle.
    pub fn start(&self, id: u32, barycentric: [f64; 3], arriving: DVec3) -> Start {
        let triangle = &self.geometry.triangles[id as usize];
        let (position, normal) = (triangle.position(barycentric), triangle.normal(barycentric));
        let [a, b, c] = triangle.corners;
        let face = (b - a).cross(c - a);
        let face = if face.dot(normal) >= 0.0 { face } else { -face };
        let is_front = face.dot(arriving) < 0.0;
        let normal = if is_front { normal } else { -normal };
        let cosine = (-arriving.dot(normal)).clamp(0.0, 1.0);
        Start { id, position, normal, arriving, cosine, is_front }
    }

    /// Follows light to a receiver, on which it is seen or not; `None` if it gets to none. With the part of the flux that is not lost on the way,
    /// for each channel. The numbers choose a facet of a rough mirror.
    pub fn follow(&self, start: &Start, way: Way, numbers: [f64; 2]) -> Option<(Landing, DVec3)> {
        let (leaving, passed) = self.scatter(start, way, numbers)?;
        let hit = self.next_hit(&leaving)?;
        let mut landing = self.receive(&hit, leaving.direction)?;
        let distance = self.geometry.triangles[hit.triangle as usize].position(hit.barycentric);
        let passed = passed * self.transmittance(start, way, leaving.position.distance(distance));
        landing.per_area *= passed;
        Some((landing, passed))
    }

    /// The ray that leaves the caster, and the part of the light that it has.
    fn scatter(&self, start: &Start, way: Way, numbers: [f64; 2]) -> Option<(Leaving, DVec3)> {
        let object = self.geometry.triangles[start.id as usize].object;
        let reflected = start.arriving + 2.0 * start.cosine * start.normal;
        let leaving = |direction| Leaving { id: start.id, position: start.position, direction };
        match (self.casters[object as usize].as_ref()?, way.chain) {
            (Caster::Mirror { reflectance, sides, alpha }, Chain::R) => {
                let is_lit = *sides == Sides::Both || (*sides == Sides::Front) == start.is_front;
                if !is_lit || *alpha == 0.0 {
                    return is_lit.then(|| (leaving(reflected), reflectance.at(start.cosine)));
                }
                // Reciprocal: what is drawn is where light goes to.
                let facet = gloss::facet(start.normal, -start.arriving, *alpha, numbers)?;
                Some((leaving(facet.towards_light), facet.weight * reflectance.at(facet.cosine)))
            }
            (Caster::Interface(interface), Chain::R) if start.is_front => {
                Some((leaving(reflected), interface.reflectance(start.cosine)))
            }
            (Caster::Interface(interface), _) if start.is_front => {
                let channel = way.channel.unwrap_or(0);
                let mask = way.channel.map_or(DVec3::ONE, |channel| DVec3::AXES[channel]);
                let (left, passed) = self.refracted(start, way.chain, (object, interface), channel)?;
                Some((left, mask * passed))
            }
            _ => None,
        }
    }

    /// The ray that has been refracted as often as a chain says.
    fn refracted(
        &self,
        start: &Start,
        chain: Chain,
        (object, interface): (u32, &Interface),
        channel: usize,
    ) -> Option<(Leaving, f64)> {
        let eta = interface.index(channel);
        let passed = interface.passed_from_front(start.cosine, eta);
        if passed == 0.0 {
            return None;
        }
        let direction = refract(start.arriving, -start.normal, 1.0 / eta);
        let entered = Leaving { id: start.id, position: start.position, direction };
        if chain == Chain::T {
            return Some((entered, passed));
        }
        let (left, part) = self.leave((object, interface), &entered, channel)?;
        if chain == Chain::TT {
            return Some((left, passed * part));
        }
        let (left, second) = self.pass_another(&left, channel)?;
        Some((left, passed * part * second))
    }

    /// Of the last way, m: a medium is behind interfaces, unless these enclose an object.
    fn transmittance(&self, start: &Start, way: Way, distance: f64) -> DVec3 {
        let Some(medium) = &self.medium else { return DVec3::ONE };
        let object = self.geometry.triangles[start.id as usize].object;
        match &self.casters[object as usize] {
            Some(Caster::Interface(interface)) if !interface.is_closed && way.chain == Chain::R => DVec3::ONE,
            _ => medium.transmittance(distance),
        }
    }

    /// What a ray from a triangle meets. It starts a little off, as the triangles beside it touch it in its corners.
    pub fn next_hit(&self, ray: &Leaving) -> Option<Hit> {
        let [a, b, c] = self.geometry.triangles[ray.id as usize].corners;
        let extent = ray.position.length() + (b - a).length() + (c - a).length();
        let start = ray.position + TOUCHING * extent * ray.direction;
        self.geometry.first_hit_of(start, ray.direction, |id| id != ray.id)
    }

    /// What a ray meets, if that is a receiver.
    fn receive(&self, hit: &Hit, direction: DVec3) -> Option<Landing> {
        let triangle = &self.geometry.triangles[hit.triangle as usize];
        self.scene.objects[triangle.object as usize].receiver.as_ref()?;
        let position = triangle.position(hit.barycentric);
        let unseen = Landing { place: DVec2::NAN, receiver: triangle.object, is_seen: false, per_area: DVec3::ZERO };
        let Some((place, view)) = self.plane.project(position) else { return Some(unseen) };
        let [a, b, c] = triangle.corners;
        let face = (b - a).cross(c - a).normalize();
        // Light counts on the side that the camera sees.
        let is_same_side = face.dot(direction) * face.dot(view.direction) > 0.0;
        let is_visible = |object: u32| self.scene.objects[object as usize].camera_visible;
        let distance = position.distance(view.origin);
        let first = || self.geometry.first_hit(view.origin, view.direction, is_visible);
        let is_first = |first: Hit| {
            let seen = &self.geometry.triangles[first.triangle as usize];
            first.triangle == hit.triangle
                || seen.position(first.barycentric).distance(view.origin) >= distance * (1.0 - 1e-9)
        };
        let is_seen = is_same_side
            && is_visible(triangle.object)
            && first().is_some_and(is_first)
            && !self.emitters.hide((view.origin, view.direction), distance);
        let per_area = DVec3::splat(face.dot(view.direction).abs() / view.pixel_area);
        Some(Landing { place, is_seen, per_area, ..unseen })
    }
}

fn caster(specular: Specular) -> Caster {
    match specular {
        Specular::Reflector(reflector) => Caster::Mirror {
            reflectance: Box::new(Reflectance::new(&reflector.finish)),
            sides: reflector.sides,
            // α = roughness² (Burley 2012, Section 5.4).
            alpha: reflector.finish.roughness.powi(2),
        },
        Specular::Refractor(refractor) => Caster::Interface(Interface::new(&refractor)),
    }
}
