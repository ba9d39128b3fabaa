//! Caustics of small lights by beams: parts of the mirrors' triangles are divided until light from their corners maps them to the receivers
//! almost affinely; then their flux is spread over exactly the parts of pixels that they reach. Without noise, where points on the mirrors would
//! seldom find the light.
//!
//! Parts follow the meshes' edges, where interpolated normals have kinks. What is left where light is torn, at the edges of shadows, of
//! mirrors and of receivers, are very small parts, which count as points.

use glam::{DVec2, DVec3};

use super::origins::Origin;
use super::rays::{Landing, Rays, Way};
use crate::geometry::Triangle;
use crate::lamps::{Lamps, Source};
use crate::parallel;

/// Parts are divided until the middles of their sides lie so near to where they should, pixels.
const MAX_BEND: f64 = 0.01;
/// Where light is torn, parts are points when they are smaller than this, pixels,
const POINT: f64 = 0.05;
/// and, of a triangle that is no negligible part of all, have been divided so often, because a focus is small, too;
const LEAST_DEPTH_OF_POINTS: u32 = 5;
/// negligible is this part of the area of all triangles;
const NEGLIGIBLE: f64 = 1e-6;
/// or they are points when they have been divided so often.
const MAX_DEPTH: u32 = 14;
/// Parts of which no corner sends light to a receiver are divided so often, to find what lies between,
const SEARCH_DEPTH: u32 = 2;
/// and further while their light spreads over more than this part of the smallest receiver,
const SEARCHED: f64 = 0.25;
/// but not more often than this.
const MOST_SEARCH_DEPTH: u32 = 6;
/// Parts that have been divided so often are left out if what is known of them is beside the picture or unseen, even where light is torn.
const DEPTH_OF_TORN: u32 = 4;
/// The intensity of a lamp may differ by this part of its largest within a part.
const MAX_UNEVENNESS: f64 = 0.02;

/// What beams are followed through.
pub(super) struct Beams<'a> {
    rays: &'a Rays<'a>,
    lamps: &'a Lamps,
    triangles: Vec<u32>,
    /// Divides more finely, to tell the error.
    max_bend: f64,
    /// So much deeper than else parts are divided where light is torn or not found.
    more_depth: u32,
    /// The extent of the smallest receiver, and of the whole scene, m.
    smallest_receiver: f64,
    scene_extent: f64,
    negligible_area: f64,
}

/// A point of a triangle by its weights, and where its light arrives.
type Corner = ([f64; 3], Option<Landing>);

impl<'a> Beams<'a> {
    pub fn new(rays: &'a Rays<'a>, lamps: &'a Lamps) -> Self {
        let triangles = rays.casting_triangles();
        let area: f64 = triangles.iter().map(|id| area(&rays.geometry.triangles[*id as usize])).sum();
        let extent = |receiver| extent_of(rays.geometry.triangles.iter().filter(move |t| t.object == receiver));
        Self {
            rays,
            lamps,
            triangles,
            max_bend: MAX_BEND,
            more_depth: 0,
            smallest_receiver: rays.receivers().map(extent).fold(f64::INFINITY, f64::min),
            scene_extent: extent_of(rays.geometry.triangles.iter()),
            negligible_area: NEGLIGIBLE * area,
        }
    }

    /// The same with parts that may bend so many times as much.
    pub fn coarser(self, factor: f64) -> Self {
        Self { max_bend: factor * self.max_bend, ..self }
    }

    /// The same with a deeper search for light, and smaller points where it is torn.
    pub fn deeper(self, more_depth: u32) -> Self {
        Self { more_depth, ..self }
    }

    /// The mean irradiance over every pixel, W/m², of light from one origin.
    pub fn irradiance(&self, origin: &Origin, is_over: &(dyn Fn() -> bool + Sync)) -> Vec<DVec3> {
        let count = self.rays.plane.pixel_count();
        // In a fixed number of parts, each in its own order, so that sums are the same every time.
        let part = self.triangles.len().div_ceil(64).max(1);
        let of_part = |ids: &[u32]| {
            let mut pixels = vec![DVec3::ZERO; count];
            for id in ids.iter().filter(|_| !is_over()) {
                self.add_triangle(*id, origin, &mut pixels);
            }
            pixels
        };
        let parts: Vec<Vec<DVec3>> = parallel::map_chunks(&self.triangles, part, &of_part);
        let mut sum = vec![DVec3::ZERO; count];
        for pixels in parts {
            sum.iter_mut().zip(pixels).for_each(|(sum, pixel)| *sum += pixel);
        }
        sum
    }

    fn add_triangle(&self, id: u32, origin: &Origin, pixels: &mut [DVec3]) {
        let light = self.light_on(id, origin);
        let triangle = &self.rays.geometry.triangles[id as usize];
        let is_negligible = area(triangle) < self.negligible_area;
        for way in self.rays.ways_of(triangle.object) {
            let least_depth_of_points = if is_negligible { 0 } else { LEAST_DEPTH_OF_POINTS + self.more_depth };
            let beam = TriangleBeam { beams: self, id, light, way, least_depth_of_points };
            let corners = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|weights| beam.corner(weights));
            beam.add(corners, f64::INFINITY, 0, pixels);
        }
    }

    fn light_on(&self, id: u32, origin: &Origin) -> PointLight<'_> {
        match *origin {
            Origin::Direction(towards, irradiance) => PointLight::Far { towards, irradiance },
            Origin::Lamp(number, place, part) => {
                let lamp = &self.lamps.sources()[number];
                let middle = self.rays.geometry.triangles[id as usize].corners.iter().sum::<DVec3>() / 3.0;
                let (u, v) = (middle - lamp.position).normalize_or(DVec3::Y).any_orthonormal_pair();
                let position = lamp.position + lamp.radius * (place.x * u + place.y * v);
                PointLight::Near { position, lamp, part }
            }
        }
    }
}

/// Light without extent on a triangle.
#[derive(Clone, Copy)]
enum PointLight<'a> {
    Far { towards: DVec3, irradiance: DVec3 },
    Near { position: DVec3, lamp: &'a Source, part: f64 },
}

/// The beam of a triangle of a mirror.
struct TriangleBeam<'a> {
    beams: &'a Beams<'a>,
    id: u32,
    light: PointLight<'a>,
    way: Way,
    least_depth_of_points: u32,
}

impl TriangleBeam<'_> {
    fn triangle(&self) -> &Triangle {
        &self.beams.rays.geometry.triangles[self.id as usize]
    }

    fn corner(&self, weights: [f64; 3]) -> Corner {
        (weights, self.land(weights))
    }

    fn middle(&self, (a, _): &Corner, (b, _): &Corner) -> Corner {
        self.corner([0, 1, 2].map(|k| 0.5 * (a[k] + b[k])))
    }

    /// Divides a part until it is flat, and adds it. Its light arrives within about `most_extent` pixels, by what is known of the part that
    /// it comes from.
    fn add(&self, corners: [Corner; 3], most_extent: f64, depth: u32, pixels: &mut [DVec3]) {
        let [a, b, c] = corners;
        let middles = [self.middle(&a, &b), self.middle(&b, &c), self.middle(&c, &a)];
        let [ab, bc, ca] = middles;
        let landed = corners.iter().chain(&middles).filter(|(_, landing)| landing.is_some()).count();
        if landed == 0 && self.is_searched(&corners, depth) || self.is_beside_picture(&corners, &middles, depth) {
            return;
        }
        let extent = match landed {
            6 => extent(&corners, &middles),
            // Other parts of it may arrive about as far away again.
            2.. => 2.0 * extent(&corners, &middles),
            _ => 0.5 * most_extent,
        };
        let is_point = landed > 0 && extent < POINT && depth >= self.least_depth_of_points;
        let parts = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]];
        match bend(corners, middles) {
            Some(bend) if bend <= self.beams.max_bend && self.is_even(&corners, &middles) => {
                for part in parts {
                    self.add_flat(part, pixels);
                }
            }
            _ if is_point || depth >= MAX_DEPTH => {
                for part in parts {
                    self.add_point(part, pixels);
                }
            }
            _ => {
                for part in parts {
                    self.add(part, extent, depth + 1, pixels);
                }
            }
        }
    }

    /// Whether nothing is left to be found in a part of which no corner sends light to a receiver.
    fn is_searched(&self, corners: &[Corner; 3], depth: u32) -> bool {
        let Beams { more_depth, smallest_receiver, scene_extent, .. } = *self.beams;
        if depth < SEARCH_DEPTH + more_depth {
            return false;
        }
        let [a, b, c] = corners.map(|(weights, _)| self.triangle().position(weights));
        let [m, n, o] = corners.map(|(weights, _)| self.triangle().normal(weights));
        let longest = |a: DVec3, b: DVec3, c: DVec3| a.distance(b).max(b.distance(c)).max(c.distance(a));
        // By twice the angle between normals mirrored light spreads.
        let spread = longest(a, b, c) + 2.0 * longest(m, n, o).min(1.0) * scene_extent;
        spread <= SEARCHED * smallest_receiver || depth >= MOST_SEARCH_DEPTH + more_depth
    }

    /// Whether the light of a lamp on a part is so even that its mean is that of its middle.
    fn is_even(&self, corners: &[Corner; 3], middles: &[Corner; 3]) -> bool {
        let PointLight::Near { lamp, .. } = self.light else { return true };
        if !lamp.has_beam() {
            return true;
        }
        let intensity = |(weights, _): &Corner| lamp.intensity_at(self.triangle().position(*weights));
        let around = |(low, high): (DVec3, DVec3), value: DVec3| (low.min(value), high.max(value));
        let (low, high) =
            corners.iter().chain(middles).map(intensity).fold((DVec3::INFINITY, DVec3::NEG_INFINITY), around);
        (high - low).max_element() <= MAX_UNEVENNESS * lamp.most_intensity()
    }

    /// Whether all light of a part arrives so far beside the picture, or so surely unseen, that none of it is in the picture.
    fn is_beside_picture(&self, corners: &[Corner; 3], middles: &[Corner; 3], depth: u32) -> bool {
        let landings = || corners.iter().chain(middles).filter_map(|(_, landing)| landing.as_ref());
        let landed = landings().count();
        if landed == 0 || landed < 6 && depth < DEPTH_OF_TORN + self.beams.more_depth {
            return false;
        }
        let (low, high) = range(landings());
        let margin = (high - low).max_element() + 1.0;
        let is_beside =
            (low - margin).cmpgt(self.beams.rays.plane.size()).any() || (high + margin).cmplt(DVec2::ZERO).any();
        is_beside || depth >= DEPTH_OF_TORN + self.beams.more_depth && landings().all(|landing| !landing.is_seen)
    }

    /// Spreads a part's flux over the pixels that it covers.
    fn add_flat(&self, part: [Corner; 3], pixels: &mut [DVec3]) {
        let Some(corners) = landings(&part).filter(|corners| corners[0].is_seen) else { return };
        let per_area = corners.iter().map(|corner| corner.per_area).sum::<DVec3>() / 3.0;
        let irradiance = self.flux(&part) * per_area;
        let plane = &self.beams.rays.plane;
        plane.spread(corners.map(|corner| corner.place), |pixel, covered| pixels[pixel] += irradiance * covered);
    }

    /// Adds a part's flux where its middle's light arrives.
    fn add_point(&self, part: [Corner; 3], pixels: &mut [DVec3]) {
        let middle = [0, 1, 2].map(|k| part.iter().map(|(weights, _)| weights[k]).sum::<f64>() / 3.0);
        let Some(landing) = self.land(middle).filter(|landing| landing.is_seen) else { return };
        if let Some(pixel) = self.beams.rays.plane.pixel(landing.place) {
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
                lamp.intensity_at((a + b + c) / 3.0) * (part * solid_angle)
            }
        }
    }

    /// Where the light of a point of the triangle arrives; `None` if it gets none or sends none to a receiver before the camera.
    fn land(&self, weights: [f64; 3]) -> Option<Landing> {
        let arriving = self.arriving(self.triangle().position(weights))?;
        let rays = self.beams.rays;
        let (landing, _) = rays.follow(&rays.start(self.id, weights, arriving), self.way, [0.0; 2])?;
        (!landing.place.is_nan()).then_some(landing)
    }

    /// The direction in which light arrives at a point of the triangle, if anything does.
    fn arriving(&self, position: DVec3) -> Option<DVec3> {
        let geometry = self.beams.rays.geometry;
        match self.light {
            PointLight::Far { towards, .. } => (!geometry.blocks_ray(position, towards, self.id)).then_some(-towards),
            PointLight::Near { position: lamp, .. } => {
                (!geometry.blocks_segment(position, lamp, [self.id; 2])).then(|| (position - lamp).normalize())
            }
        }
    }
}

fn area(triangle: &Triangle) -> f64 {
    let [a, b, c] = triangle.corners;
    0.5 * (b - a).cross(c - a).length()
}

/// The largest side of the box around triangles, m.
fn extent_of<'a>(triangles: impl Iterator<Item = &'a Triangle>) -> f64 {
    let around = |(low, high): (DVec3, DVec3), p: DVec3| (low.min(p), high.max(p));
    let (low, high) =
        triangles.flat_map(|triangle| triangle.corners).fold((DVec3::INFINITY, DVec3::NEG_INFINITY), around);
    (high - low).max_element()
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
