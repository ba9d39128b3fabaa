//! Caustics of small lights by beams: parts of the mirrors' triangles are divided until light from their corners maps them to the receivers
//! almost affinely; then their flux is spread over exactly the parts of pixels that they reach. Without noise, where points on the mirrors would
//! seldom find the light.
//!
//! Parts follow the meshes' edges, where interpolated normals have kinks. What is left where light is torn, at the edges of shadows, of
//! mirrors and of receivers, are very small parts, which count as points.

use glam::{DVec2, DVec3};

use super::beam_origins::Origin;
use super::geometry::{Geometry, Hit, Triangle};
use super::lamps::{Lamps, Source};
use super::picture_plane::PicturePlane;
use super::reflectance::Reflectance;
use super::refraction::{Interface, refract};
use crate::parallel;
use crate::scene::{Chain, Chains, Scene, Sides, Specular};

/// Parts are divided until the middles of their sides lie so near to where they should, pixels.
const MAX_BEND: f64 = 0.01;
/// Where light is torn, parts are points when they are smaller than this, pixels,
const POINT: f64 = 0.05;
/// or when they have been divided so often.
const MAX_DEPTH: u32 = 14;
/// Parts of which no corner sends light to a receiver are divided so often, to find what lies between.
const SEARCH_DEPTH: u32 = 2;
/// Parts that have been divided so often are left out if what is known of them is beside the picture or unseen, even where light is torn.
const DEPTH_OF_TORN: u32 = 4;
/// Rays start so far off the triangle that they leave, in its extent and its distance from the origin.
const TOUCHING: f64 = 1e-9;

/// How an object casts light.
pub(super) enum Caster {
    Mirror(Box<Reflectance>, Sides),
    Interface(Interface),
}

/// What beams are followed through.
pub(super) struct Beams<'a> {
    scene: &'a Scene,
    pub(super) geometry: &'a Geometry,
    lamps: &'a Lamps,
    plane: PicturePlane,
    chains: Chains,
    /// By object.
    pub(super) casters: Vec<Option<Caster>>,
    /// Divides more finely, to tell the error.
    max_bend: f64,
}

/// Where a corner's light arrives.
#[derive(Clone, Copy)]
struct Landing {
    /// In pixels.
    place: DVec2,
    receiver: u32,
    /// The camera sees it.
    is_seen: bool,
    /// The part of the flux that is not lost on the way, for each channel, over the area of a pixel where it arrives, 1/m².
    per_area: DVec3,
}

/// A kind of way: by its chain, and by the channel of colours that are refracted differently.
#[derive(Clone, Copy)]
struct Way {
    chain: Chain,
    channel: Option<usize>,
}

/// A point of a triangle by its weights, and where its light arrives.
type Corner = ([f64; 3], Option<Landing>);

impl<'a> Beams<'a> {
    pub fn new(scene: &'a Scene, (geometry, lamps): (&'a Geometry, &'a Lamps), size: [u32; 2], chains: Chains) -> Self {
        let caster = |specular: Specular| match specular {
            Specular::Reflector(reflector) => {
                Caster::Mirror(Box::new(Reflectance::new(&reflector.finish)), reflector.sides)
            }
            Specular::Refractor(refractor) => Caster::Interface(Interface::new(&refractor)),
        };
        let casters = scene.objects.iter().map(|object| object.specular().map(caster)).collect();
        let plane = PicturePlane::new(&scene.camera, size);
        Self { scene, geometry, lamps, plane, chains, casters, max_bend: MAX_BEND }
    }

    /// The same with parts that may bend so many times as much.
    pub fn coarser(self, factor: f64) -> Self {
        Self { max_bend: factor * self.max_bend, ..self }
    }

    /// The mean irradiance over every pixel, W/m², of light from one origin.
    pub fn irradiance(&self, origin: &Origin, is_over: &(dyn Fn() -> bool + Sync)) -> Vec<DVec3> {
        let count = self.plane.pixel_count();
        let triangles: Vec<u32> = (0..self.geometry.triangles.len() as u32)
            .filter(|id| self.casters[self.geometry.triangles[*id as usize].object as usize].is_some())
            .collect();
        // In a fixed number of parts, each in its own order, so that sums are the same every time.
        let part = triangles.len().div_ceil(64).max(1);
        let of_part = |ids: &[u32]| {
            let mut pixels = vec![DVec3::ZERO; count];
            for id in ids.iter().filter(|_| !is_over()) {
                self.add_triangle(*id, origin, &mut pixels);
            }
            pixels
        };
        let parts: Vec<Vec<DVec3>> = parallel::map_chunks(&triangles, part, &of_part);
        let mut sum = vec![DVec3::ZERO; count];
        for pixels in parts {
            sum.iter_mut().zip(pixels).for_each(|(sum, pixel)| *sum += pixel);
        }
        sum
    }

    fn add_triangle(&self, id: u32, origin: &Origin, pixels: &mut [DVec3]) {
        let light = self.light_on(id, origin);
        for way in self.ways_of(self.geometry.triangles[id as usize].object) {
            let beam = TriangleBeam { beams: self, id, light, way };
            let corners = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|weights| beam.corner(weights));
            beam.add(corners, 0, pixels);
        }
    }

    fn light_on(&self, id: u32, origin: &Origin) -> PointLight<'_> {
        match *origin {
            Origin::Direction(towards, irradiance) => PointLight::Far { towards, irradiance },
            Origin::Lamp(number, place, part) => {
                let lamp = &self.lamps.sources()[number];
                let middle = self.geometry.triangles[id as usize].corners.iter().sum::<DVec3>() / 3.0;
                let (u, v) = (middle - lamp.position).normalize_or(DVec3::Y).any_orthonormal_pair();
                let position = lamp.position + lamp.radius * (place.x * u + place.y * v);
                PointLight::Near { position, lamp, part }
            }
        }
    }

    fn ways_of(&self, object: u32) -> Vec<Way> {
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
}

/// Light without extent on a triangle.
#[derive(Clone, Copy)]
enum PointLight<'a> {
    Far { towards: DVec3, irradiance: DVec3 },
    Near { position: DVec3, lamp: &'a Source, part: f64 },
}

/// The beam of a triangle of a mirror.
pub(super) struct TriangleBeam<'a> {
    pub(super) beams: &'a Beams<'a>,
    id: u32,
    light: PointLight<'a>,
    way: Way,
}

impl TriangleBeam<'_> {
    fn triangle(&self) -> &Triangle {
        &self.beams.geometry.triangles[self.id as usize]
    }

    fn corner(&self, weights: [f64; 3]) -> Corner {
        (weights, self.land(weights))
    }

    /// Of dispersed light, or any.
    pub(super) fn channel(&self) -> usize {
        self.way.channel.unwrap_or(0)
    }

    fn middle(&self, (a, _): &Corner, (b, _): &Corner) -> Corner {
        self.corner([0, 1, 2].map(|k| 0.5 * (a[k] + b[k])))
    }

    /// Divides a part until it is flat, and adds it.
    fn add(&self, corners: [Corner; 3], depth: u32, pixels: &mut [DVec3]) {
        let [a, b, c] = corners;
        let middles = [self.middle(&a, &b), self.middle(&b, &c), self.middle(&c, &a)];
        let [ab, bc, ca] = middles;
        let landed = corners.iter().chain(&middles).filter(|(_, landing)| landing.is_some()).count();
        if landed == 0 && depth >= SEARCH_DEPTH || self.is_beside_picture(&corners, &middles, depth) {
            return;
        }
        let parts = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]];
        match bend(corners, middles) {
            Some(bend) if bend <= self.beams.max_bend => {
                for part in parts {
                    self.add_flat(part, pixels);
                }
            }
            _ if depth >= MAX_DEPTH || landed > 0 && extent(&corners, &middles) < POINT => {
                for part in parts {
                    self.add_point(part, pixels);
                }
            }
            _ => {
                for part in parts {
                    self.add(part, depth + 1, pixels);
                }
            }
        }
    }

    /// Whether all light of a part arrives so far beside the picture, or so surely unseen, that none of it is in the picture.
    fn is_beside_picture(&self, corners: &[Corner; 3], middles: &[Corner; 3], depth: u32) -> bool {
        let landings = || corners.iter().chain(middles).filter_map(|(_, landing)| landing.as_ref());
        let landed = landings().count();
        if landed == 0 || landed < 6 && depth < DEPTH_OF_TORN {
            return false;
        }
        let (low, high) = range(landings());
        let margin = (high - low).max_element() + 1.0;
        let is_beside = (low - margin).cmpgt(self.beams.plane.size()).any() || (high + margin).cmplt(DVec2::ZERO).any();
        is_beside || depth >= DEPTH_OF_TORN && landings().all(|landing| !landing.is_seen)
    }

    /// Spreads a part's flux over the pixels that it covers.
    fn add_flat(&self, part: [Corner; 3], pixels: &mut [DVec3]) {
        let Some(corners) = landings(&part).filter(|corners| corners[0].is_seen) else { return };
        let per_area = corners.iter().map(|corner| corner.per_area).sum::<DVec3>() / 3.0;
        let irradiance = self.flux(&part) * per_area;
        self.beams
            .plane
            .spread(corners.map(|corner| corner.place), |pixel, covered| pixels[pixel] += irradiance * covered);
    }

    /// Adds a part's flux where its middle's light arrives.
    fn add_point(&self, part: [Corner; 3], pixels: &mut [DVec3]) {
        let middle = [0, 1, 2].map(|k| part.iter().map(|(weights, _)| weights[k]).sum::<f64>() / 3.0);
        let Some(landing) = self.land(middle).filter(|landing| landing.is_seen) else { return };
        if let Some(pixel) = self.beams.plane.pixel(landing.place) {
            pixels[pixel] += self.flux(&part) * landing.per_area;
        }
    }

    /// The flux on a part of the triangle, W.
    fn flux(&self, part: &[Corner; 3]) -> DVec3 {
        let [a, b, c] = part.map(|(weights, _)| self.triangle().position(weights));
        match self.light {
            PointLight::Far { towards, irradiance } => irradiance * (0.5 * (b - a).cross(c - a).dot(towards)).abs(),
            PointLight::Near { position, lamp, part } => {
                let solid_angle = solid_angle_sr([a, b, c].map(|corner| corner - position));
                lamp.intensity_towards((a + b + c) / 3.0) * (part * solid_angle)
            }
        }
    }

    /// Where the light of a point of the triangle arrives; `None` if it gets none or sends none to a receiver.
    fn land(&self, weights: [f64; 3]) -> Option<Landing> {
        let triangle = self.triangle();
        let (position, normal) = (triangle.position(weights), triangle.normal(weights));
        let arriving = self.arriving(position)?;
        let [a, b, c] = triangle.corners;
        let face = (b - a).cross(c - a);
        let face = if face.dot(normal) >= 0.0 { face } else { -face };
        let is_front = face.dot(arriving) < 0.0;
        let normal = if is_front { normal } else { -normal };
        let cosine = (-arriving.dot(normal)).clamp(0.0, 1.0);
        let start = Start { id: self.id, position, normal, arriving, cosine, is_front };
        let (leaving, passed) = self.scatter(&start)?;
        let hit = self.next_hit(&leaving)?;
        let mut landing = self.receive(&hit, leaving.direction)?;
        landing.per_area *= passed;
        Some(landing)
    }

    /// The direction in which light arrives at a point of the triangle, if anything does.
    fn arriving(&self, position: DVec3) -> Option<DVec3> {
        let geometry = self.beams.geometry;
        match self.light {
            PointLight::Far { towards, .. } => (!geometry.blocks_ray(position, towards, self.id)).then_some(-towards),
            PointLight::Near { position: lamp, .. } => {
                (!geometry.blocks_segment(position, lamp, [self.id; 2])).then(|| (position - lamp).normalize())
            }
        }
    }

    /// The ray that leaves the caster, and the part of the light that it has.
    fn scatter(&self, start: &Start) -> Option<(Leaving, DVec3)> {
        let object = self.triangle().object;
        let reflected = start.arriving + 2.0 * start.cosine * start.normal;
        let leaving = |direction| Leaving { id: start.id, position: start.position, direction };
        match (self.beams.casters[object as usize].as_ref()?, self.way.chain) {
            (Caster::Mirror(reflectance, sides), Chain::R) => {
                let is_lit = *sides == Sides::Both || (*sides == Sides::Front) == start.is_front;
                is_lit.then(|| (leaving(reflected), reflectance.at(start.cosine)))
            }
            (Caster::Interface(interface), Chain::R) if start.is_front => {
                Some((leaving(reflected), interface.reflectance(start.cosine)))
            }
            (Caster::Interface(interface), chain) if start.is_front => {
                let eta = interface.index(self.channel());
                let passed = interface.passed_from_front(start.cosine, eta);
                let inside = refract(start.arriving, -start.normal, 1.0 / eta);
                let mask = self.way.channel.map_or(DVec3::ONE, |channel| DVec3::AXES[channel]);
                let entered = leaving(inside);
                if passed == 0.0 {
                    return None;
                }
                if chain == Chain::T {
                    return Some((entered, mask * passed));
                }
                let (left, part) = self.leave((object, interface), &entered)?;
                if chain == Chain::TT {
                    return Some((left, mask * (passed * part)));
                }
                let (left, second) = self.pass_another(&left)?;
                Some((left, mask * (passed * part * second)))
            }
            _ => None,
        }
    }

    /// What a ray from a triangle meets. It starts a little off, as the triangles beside it touch it in its corners.
    pub(super) fn next_hit(&self, ray: &Leaving) -> Option<Hit> {
        let [a, b, c] = self.triangle().corners;
        let extent = ray.position.length() + (b - a).length() + (c - a).length();
        let start = ray.position + TOUCHING * extent * ray.direction;
        self.beams.geometry.first_hit_of(start, ray.direction, |id| id != ray.id)
    }

    /// What a ray meets, if that is a receiver.
    fn receive(&self, hit: &Hit, direction: DVec3) -> Option<Landing> {
        let beams = self.beams;
        let triangle = &beams.geometry.triangles[hit.triangle as usize];
        beams.scene.objects[triangle.object as usize].receiver.as_ref()?;
        let position = triangle.position(hit.barycentric);
        let (place, view) = beams.plane.project(position)?;
        let [a, b, c] = triangle.corners;
        let face = (b - a).cross(c - a).normalize();
        // Light counts on the side that the camera sees.
        let is_same_side = face.dot(direction) * face.dot(view.direction) > 0.0;
        let is_visible = |object: u32| beams.scene.objects[object as usize].camera_visible;
        let first = || beams.geometry.first_hit(view.origin, view.direction, is_visible);
        let is_first = |first: Hit| {
            let seen = &beams.geometry.triangles[first.triangle as usize];
            let distance = seen.position(first.barycentric).distance(view.origin);
            first.triangle == hit.triangle || distance >= position.distance(view.origin) * (1.0 - 1e-9)
        };
        let is_seen = is_same_side && is_visible(triangle.object) && first().is_some_and(is_first);
        let per_area = DVec3::splat(face.dot(view.direction).abs() / view.pixel_area);
        Some(Landing { place, receiver: triangle.object, is_seen, per_area })
    }
}

/// Light where it meets a caster.
struct Start {
    id: u32,
    position: DVec3,
    /// On the side of the light.
    normal: DVec3,
    arriving: DVec3,
    cosine: f64,
    is_front: bool,
}

/// A ray from a triangle.
pub(super) struct Leaving {
    pub(super) id: u32,
    pub(super) position: DVec3,
    pub(super) direction: DVec3,
}

/// How far the middles of a part's sides are from where they would be if it were mapped affinely, pixels; `None` where light is torn.
fn bend(corners: [Corner; 3], middles: [Corner; 3]) -> Option<f64> {
    let [a, b, c] = landings(&corners)?;
    let among = landings(&middles)?;
    let all = [a, b, c, among[0], among[1], among[2]];
    let is_whole = all.iter().all(|other| other.receiver == a.receiver && other.is_seen == a.is_seen);
    let expected = [a.place.midpoint(b.place), b.place.midpoint(c.place), c.place.midpoint(a.place)];
    let bends = among.iter().zip(expected).map(|(found, expected)| found.place.distance(expected));
    is_whole.then(|| bends.fold(0.0, f64::max))
}

fn landings(corners: &[Corner; 3]) -> Option<[Landing; 3]> {
    let [(_, Some(a)), (_, Some(b)), (_, Some(c))] = corners else { return None };
    Some([*a, *b, *c])
}

/// The largest distance between the places where a part's light arrives, pixels.
fn extent(corners: &[Corner; 3], middles: &[Corner; 3]) -> f64 {
    let (low, high) = range(corners.iter().chain(middles).filter_map(|(_, landing)| landing.as_ref()));
    (high - low).max_element()
}

/// The box around places, pixels.
fn range<'a>(landings: impl Iterator<Item = &'a Landing>) -> (DVec2, DVec2) {
    let around = |(low, high): (DVec2, DVec2), landing: &Landing| (low.min(landing.place), high.max(landing.place));
    landings.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), around)
}

/// The solid angle of a triangle seen from the origin (van Oosterom and Strackee 1983).
fn solid_angle_sr([a, b, c]: [DVec3; 3]) -> f64 {
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    // By edges: of small and distant triangles, the product of the corners would lose all digits.
    2.0 * a.dot((b - a).cross(c - a)).abs().atan2(below)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From so far away that light is parallel, too.
    #[test]
    fn small_triangles_have_their_solid_angles() {
        for (distance, side) in [(1.0, 1e-3), (1e5, 1e-6), (1e5, 1.0)] {
            let corners = [DVec3::ZERO, DVec3::new(side, 0.0, 0.3 * side), DVec3::new(0.0, 0.0, side)];
            let seen = corners.map(|corner| corner - DVec3::new(0.6 * distance, -0.8 * distance, 0.0));
            let expected = 0.5 * side * side * 0.8 / (distance * distance);
            let found = solid_angle_sr(seen);
            assert!((found / expected - 1.0).abs() < 1e-2, "{distance} {side}: {found} {expected}");
        }
    }
}
