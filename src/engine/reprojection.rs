//! Surfaces that the camera sees directly and in mirrors, too: light that is known where camera rays hit is interpolated at the ends
//! of paths, so that it need not be computed again.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::paths::EndPoint;
use crate::stages::CameraRays;

/// A point may lie this far from where four hits around it lead one to expect it, in distances between them.
const MAX_DEVIATION: f32 = 0.3;
/// Mirrors that magnify show more than the camera sees directly. Ends of paths in neighbouring pixels must be apart at least this part
/// of the distance between hits.
const MIN_SPACING: f32 = 0.7;
/// Cosine between the normals of points that share light, at least.
pub(super) const MIN_NORMAL_COSINE: f32 = 0.98;

/// A place among camera rays: the index of the upper left one of the four around it, and the part of the way to the others.
#[derive(Clone, Copy, Debug)]
struct Place {
    first: usize,
    part: Vec2,
}

/// The places of end points among the hits of camera rays.
#[derive(Debug)]
pub(super) struct Reprojection {
    width: usize,
    places: Vec<Option<Place>>,
}

impl Reprojection {
    /// Finds the points that the camera sees on known objects, where four neighbouring rays hit the same smooth surface.
    pub fn new(rays: &CameraRays, points: &[EndPoint], is_known: impl Fn(u32) -> bool + Sync) -> Self {
        let place = |point: &EndPoint| is_known(point.hit.object).then(|| place(rays, point)).flatten();
        Self { width: rays.width as usize, places: points.par_iter().map(place).collect() }
    }

    /// The light at an end point, if the camera sees it.
    pub fn light(&self, point: usize, at_hits: impl Fn(usize) -> Vec3) -> Option<Vec3> {
        let Place { first, part } = self.places[point]?;
        Some(bilinear(corners(first, self.width).map(at_hits), part))
    }
}

/// The indices of four neighbouring rays.
fn corners(first: usize, width: usize) -> [usize; 4] {
    [first, first + 1, first + width, first + width + 1]
}

fn bilinear([a, b, c, d]: [Vec3; 4], part: Vec2) -> Vec3 {
    a.lerp(b, part.x).lerp(c.lerp(d, part.x), part.y)
}

fn place(rays: &CameraRays, end: &EndPoint) -> Option<Place> {
    let point = &end.hit;
    let view = &rays.view;
    let size = Vec2::new(view.size[0] as f32, view.size[1] as f32);
    let (pixel, depth) = view.camera.project(point.position, size);
    let per_edge = view.pixel_samples as f32;
    let at = per_edge * (pixel - Vec2::new(0.0, view.first_row as f32)) - 0.5;
    let height = rays.hits.len() / rays.width as usize;
    let last = Vec2::new(rays.width as f32 - 2.0, height as f32 - 2.0);
    if depth <= 0.0 || at.cmplt(Vec2::ZERO).any() || !at.floor().cmple(last).all() {
        return None;
    }
    let place = Place { first: at.y as usize * rays.width as usize + at.x as usize, part: at.fract() };
    let mut hits = [Vec3::ZERO; 4];
    for (position, index) in hits.iter_mut().zip(corners(place.first, rays.width as usize)) {
        let hit = rays.hits[index].as_ref().filter(|hit| hit.object == point.object)?;
        if hit.normal.dot(point.normal) < MIN_NORMAL_COSINE {
            return None;
        }
        *position = hit.position;
    }
    let spacing = [hits[0].distance(hits[1]), hits[0].distance(hits[2])];
    let deviation = bilinear(hits, place.part).distance(point.position);
    let is_near = deviation <= MAX_DEVIATION * spacing[0].min(spacing[1]);
    let is_resolved = end.spacing.max(end.blur) >= MIN_SPACING * per_edge * spacing[0].max(spacing[1]);
    (is_near && is_resolved).then_some(place)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::load;
    use crate::stages::View;
    use crate::tracing::Tracer;

    /// A table with a ball on it: what the camera sees of the table is found, what the ball hides is not.
    #[test]
    fn points_are_found_where_the_camera_sees_them() {
        let scene = load::<toml::Table>("mirror-sphere").unwrap().scene;
        let tracer = Tracer::new(&scene);
        let view = View { camera: scene.camera, size: [64, 48], pixel_samples: 1, first_row: 0, rows: 48 };
        let rays = CameraRays::trace(&tracer, view);
        let receives = |object: u32| scene.objects[object as usize].receiver.is_some();
        // Halfway between rays of a finer picture: light that is the position itself is interpolated to the position.
        let finer = CameraRays::trace(&tracer, View { size: [201, 151], rows: 151, ..view });
        let seen: Vec<EndPoint> = finer
            .hits
            .iter()
            .flatten()
            .filter(|hit| receives(hit.object))
            .map(|&hit| EndPoint { hit, receives: true, view: Vec3::Y, spacing: f32::INFINITY, blur: 0.0 })
            .collect();
        let found = Reprojection::new(&rays, &seen, receives);
        let light = |k: usize| found.light(k, |index| rays.hits[index].unwrap().position);
        let count = (0..seen.len()).filter(|&k| light(k).is_some()).count();
        assert!(count * 10 > seen.len() * 8, "{count} of {}", seen.len());
        for (k, point) in seen.iter().enumerate() {
            if let Some(light) = light(k) {
                assert!(light.distance(point.hit.position) < 0.1, "{light} {}", point.hit.position);
            }
        }
        // The same points, moved to where they are behind what is seen.
        let hidden: Vec<EndPoint> = seen
            .iter()
            .map(|point| {
                let mut point = point.clone();
                point.hit.position -= 0.5 * point.hit.normal;
                point
            })
            .collect();
        let found = Reprojection::new(&rays, &hidden, receives);
        let count = (0..hidden.len()).filter(|&k| found.light(k, |_| Vec3::ONE).is_some()).count();
        assert!(count * 100 < hidden.len(), "{count} of {}", hidden.len());
    }
}
