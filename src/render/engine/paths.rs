//! Paths from the camera, via visible mirrors and interfaces, to the environment or to a lit surface.
//!
//! Every pixel is shaded from one point, or from 4×4 at edges and on mirrors. A path holds its end point, not the light
//! there: that is computed for all paths together, and can change while the paths stay. Points of one pixel whose paths
//! meet the same objects and end on the same surface share the light of one end point.

mod lamps;
mod tracer;

use glam::Vec3;

pub(super) use self::tracer::PathTracer;
use super::escapes::{Escape, footprints};
use crate::parallel;
use crate::pinhole::constants::MIN_HEIGHT;
use crate::scene::{Object, Ray, Sides};
use crate::stages::PreparedScene;
use crate::tracing::Hit;

/// Points of a pixel share light if one lies in the plane of the other, up to this part of the ray's length.
const MAX_STEP_OFF_PLANE: f32 = 0.01;
/// Cosine between their normals, at least.
const MIN_SHARED_COSINE: f32 = 0.9;
/// Albedo of surfaces that neither reflect, refract nor receive on the visible side.
const PLAIN_ALBEDO: f32 = 0.2;
/// Albedo of everything in the plain diffuse view.
const DIFFUSE_VIEW_ALBEDO: f32 = 0.6;

/// The paths of a band of pixels.
#[derive(Debug)]
pub(super) struct Paths {
    pub pixels: Vec<PixelPaths>,
    /// End points of paths, other than the hits of camera rays.
    pub ends: Vec<EndPoint>,
}

/// A surface point at which a path ends, or which reflects differently in different directions.
#[derive(Clone, Debug)]
pub(super) struct EndPoint {
    pub hit: Hit,
    /// Whether it receives caustics.
    pub receives: bool,
    /// Unit direction towards the viewer.
    pub view: Vec3,
    /// Index of its pixel, row by row.
    pub pixel: u32,
    /// Hash of the objects along its path.
    pub key: u64,
    /// From here to the ends of the same path one pixel to the right and one pixel down, metres; zero if they are unknown.
    pub steps: [Vec3; 2],
    /// How far apart the ends of the same path are by way of different microfacets of a rough mirror, metres; 0 after smooth
    /// ones, and on glossy receivers.
    pub blur: f32,
}

impl EndPoint {
    /// Whether it is the end of the same path through another point of the pixel.
    fn shares_light_with(&self, other: &Self) -> bool {
        self.key == other.key && share_light(&self.hit, &other.hit)
    }
}

/// Whether two hits of rays through one pixel lie on the same part of a surface.
pub(super) fn share_light(one: &Hit, other: &Hit) -> bool {
    let off_plane = (other.position - one.position).dot(one.normal).abs();
    one.object == other.object
        && one.front == other.front
        && one.normal.dot(other.normal) >= MIN_SHARED_COSINE
        && off_plane <= MAX_STEP_OFF_PLANE * one.distance
}

/// The source of a path's light.
#[derive(Clone, Copy, Debug)]
pub(super) enum Source {
    /// The environment in a unit direction of the world, blurred for a rough mirror of width `alpha`, or averaged over a
    /// footprint with these sides, radians.
    Environment { direction: Vec3, alpha: f32, sides: [Vec3; 2] },
    /// An emitter or a lamp, of this radiance.
    Emitter(Vec3),
    /// The surface that the camera ray of this index hits.
    CameraRay(u32),
    /// The end point of this index.
    EndPoint(u32),
}

/// The contribution of one path to its point.
#[derive(Debug)]
pub(super) struct Term {
    /// Which of the pixel's points it belongs to.
    pub point: u16,
    /// Whether this is the environment as the camera sees it directly, which has its own exposure.
    pub is_background: bool,
    /// Factor on the source's radiance, or on its irradiance (then it includes albedo / π).
    pub factor: Vec3,
    pub source: Source,
}

/// The paths of one pixel.
#[derive(Debug, Default)]
pub(super) struct PixelPaths {
    /// The number of points that the pixel averages.
    pub points: u16,
    pub terms: Vec<Term>,
    /// One for each set of objects along paths and each surface where these end.
    ends: Vec<EndPoint>,
    /// All points at which paths end, by their keys, while the pixel is traced.
    candidates: Vec<Vec<EndPoint>>,
    /// Index of the pixel.
    pixel: u32,
    /// In a medium, for each point: its pixel's camera ray, and how far it is to what the point's ray meets, metres.
    first_legs: Vec<(u32, f32)>,
}

impl PixelPaths {
    /// The end point of a path, which is chosen later from all of the pixel's that share its light.
    fn end_point(&mut self, point: EndPoint) -> Source {
        let is_same = |points: &Vec<EndPoint>| points[0].shares_light_with(&point);
        let index = self.candidates.iter().position(is_same).unwrap_or_else(|| {
            self.candidates.push(Vec::new());
            self.candidates.len() - 1
        });
        self.candidates[index].push(point);
        Source::EndPoint(index as u32)
    }

    /// Chooses the end points: of those that share light the most central one.
    fn choose_ends(&mut self) {
        self.ends = self.candidates.drain(..).filter_map(most_central).collect();
    }

    /// Where one of its paths ends like another one, before end points are chosen.
    fn end_like(&self, end: &EndPoint) -> Option<Hit> {
        self.candidates.iter().flatten().find(|other| end.shares_light_with(other)).map(|other| other.hit)
    }

    /// Sets the footprints of paths that left the scene, by the points of the pixel, `columns` a row.
    fn set_footprints(&mut self, points: &[Vec<Escape>], columns: u32) {
        for (term, footprint) in footprints(points, columns as usize) {
            if let Source::Environment { sides, .. } = &mut self.terms[term].source {
                *sides = footprint;
            }
        }
    }

    /// The camera ray whose light from the medium a point takes: of those next to its own, the one that ends most nearly as far away.
    /// `lengths` are those of all rays, `width` in a row.
    pub fn medium_ray(&self, point: usize, lengths: &[f32], width: usize) -> usize {
        let (own, length) = self.first_legs[point];
        let own = own as usize;
        let column = own % width;
        let beside = |index: &usize| *index < lengths.len() && (index % width).abs_diff(column) <= 1;
        let around = [own, own.wrapping_sub(1), own + 1, own.wrapping_sub(width), own + width];
        let off = |index: usize| (lengths[index] - length).abs();
        around.into_iter().filter(beside).min_by(|a, b| off(*a).total_cmp(&off(*b))).unwrap_or(own)
    }

    fn add(&mut self, point: u16, factor: Vec3, source: Source, is_background: bool) {
        self.terms.push(Term { point, is_background, factor, source });
    }
}

/// A surface's specular reflectance, if its visible side is a mirror.
pub(super) fn visible_reflectance(
    prepared: &PreparedScene,
    is_plain: bool,
    (found, object): (&Hit, &Object),
    ray: &Ray,
) -> Option<Vec3> {
    if is_plain || !mirrors(object, found.front) {
        return None;
    }
    let curve = prepared.materials.mirrors[found.object as usize].as_ref()?;
    Some(curve.at(ray.direction.dot(found.normal).abs().into()).as_vec3())
}

/// The albedo with which a surface is lit.
pub(super) fn surface_albedo(object: &Object, is_plain: bool, is_mirror: bool) -> Vec3 {
    match &object.receiver {
        _ if object.emitter.is_some() => Vec3::ZERO,
        _ if is_plain => Vec3::splat(DIFFUSE_VIEW_ALBEDO),
        Some(receiver) => receiver.albedo,
        None if is_mirror => Vec3::ZERO,
        None => Vec3::splat(PLAIN_ALBEDO),
    }
}

/// The unit direction in which a microfacet of a mirror reflects a ray, outwards.
pub(super) fn mirrored_direction(found: &Hit, ray: &Ray, facet: Vec3) -> Vec3 {
    let mirrored = ray.direction.reflect(facet);
    // A microfacet may reflect into the surface; the smooth mirror replaces it then.
    let outwards = mirrored.dot(found.normal) * ray.direction.dot(found.normal) < 0.0;
    let direction = if outwards { mirrored } else { ray.direction.reflect(found.normal) }.normalize();
    // An interpolated normal may reflect into the triangle, at grazing angles.
    let height = direction.dot(found.face_normal);
    (direction + (MIN_HEIGHT - height).max(0.0) * found.face_normal).normalize()
}

/// The point that is nearest to the mean of all.
fn most_central(points: Vec<EndPoint>) -> Option<EndPoint> {
    let centre = points.iter().map(|point| point.hit.position).sum::<Vec3>() / points.len() as f32;
    let distance = |point: &EndPoint| point.hit.position.distance_squared(centre);
    points.into_iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// Whether a side of an object is a mirror.
pub(super) fn mirrors(object: &Object, front: bool) -> bool {
    object.reflector.is_some_and(|r| match r.sides {
        Sides::Front => front,
        Sides::Back => !front,
        Sides::Both => true,
    })
}

/// Sets the steps of all end points.
fn measure_steps(pixels: &mut [PixelPaths], width: usize) {
    let of_pixel = |index: usize| steps(pixels, width, index);
    let steps: Vec<Vec<[Vec3; 2]>> = parallel::collect(pixels.len(), &of_pixel);
    for (pixel, steps) in pixels.iter_mut().zip(steps) {
        pixel.ends.iter_mut().zip(steps).for_each(|(end, steps)| end.steps = steps);
    }
}

/// From a pixel's end points to those of the same paths in neighbouring pixels.
fn steps(pixels: &[PixelPaths], width: usize, index: usize) -> Vec<[Vec3; 2]> {
    let (x, pixel) = (index % width, &pixels[index]);
    let left = index.checked_sub(1).filter(|_| x > 0);
    let right = Some(index + 1).filter(|_| x + 1 < width);
    let (above, below) = (index.checked_sub(width), Some(index + width).filter(|k| *k < pixels.len()));
    let of_end = |end: &EndPoint| {
        let step = |neighbour: Option<usize>| {
            let same_path = pixels[neighbour?].ends.iter().filter(|other| other.key == end.key);
            let steps = same_path.map(|other| other.hit.position - end.hit.position);
            steps.min_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))
        };
        let between = |next, previous| step(next).or_else(|| step(previous).map(|back| -back)).unwrap_or(Vec3::ZERO);
        [between(right, left), between(below, above)]
    };
    pixel.ends.iter().map(of_end).collect()
}

/// Moves the pixels' end points into one list and adjusts their indices.
fn collect_ends(pixels: &mut [PixelPaths]) -> Vec<EndPoint> {
    let mut all = Vec::new();
    for pixel in pixels {
        let first = all.len() as u32;
        all.append(&mut pixel.ends);
        for term in &mut pixel.terms {
            if let Source::EndPoint(index) = &mut term.source {
                *index += first;
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_pixel_share_light_on_one_surface_only() {
        let hit = |height: f32, normal: Vec3| {
            let position = height * Vec3::Y;
            Hit { object: 0, position, distance: 1.0, normal, face_normal: normal, front: true }
        };
        let own = hit(0.0, Vec3::Y);
        assert!(share_light(&own, &hit(0.005, Vec3::Y)));
        assert!(!share_light(&own, &hit(0.05, Vec3::Y)), "a step between them");
        assert!(!share_light(&own, &hit(0.0, Vec3::X)), "an edge between them");
        assert!(!share_light(&own, &Hit { object: 1, ..own }));
        assert!(!share_light(&own, &Hit { front: false, ..own }));
    }
}
