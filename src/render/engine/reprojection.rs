//! Surfaces that the camera sees directly and in mirrors, too: light that is known where camera rays hit is interpolated at the ends
//! of paths, so that it need not be computed again.

use glam::{Vec2, Vec3};

use super::interpolation::{MAX_DEVIATION, bilinear, is_smooth};
use super::paths::EndPoint;
use crate::parallel;
use crate::stages::CameraRays;
use crate::tracing::Hit;

/// Mirrors that magnify show more than the camera sees directly. In such a mirror, hits may be this many pixels apart.
const MAX_PIXELS: f32 = 1.5;
/// Cosine between the normals of points that share light, at least.
pub(super) const MIN_NORMAL_COSINE: f32 = 0.98;

/// A place among camera rays: the index of the upper left one of the four around it, and the part of the way to the others.
#[derive(Clone, Copy, Debug)]
struct Place {
    first: usize,
    part: Vec2,
    /// Whether the camera sees the surface as finely as the path does.
    is_resolved: bool,
}

/// The places of end points among the hits of camera rays.
#[derive(Debug)]
pub(super) struct Reprojection {
    width: usize,
    places: Vec<Option<Place>>,
}

impl Reprojection {
    /// Finds the points that the camera sees on known objects, where neighbouring rays hit the same smooth surface.
    pub fn new(rays: &CameraRays, points: &[EndPoint], is_known: impl Fn(u32) -> bool + Sync) -> Self {
        let place = |point: &EndPoint| is_known(point.hit.object).then(|| place(rays, point)).flatten();
        Self { width: rays.width as usize, places: parallel::map(points, &place) }
    }

    /// The light at an end point, if the camera sees it finely enough.
    pub fn light(&self, point: usize, at_hits: impl Fn(usize) -> Vec3) -> Option<Vec3> {
        interpolated(self.places[point]?, self.width, at_hits)
    }
}

/// The light at a point on a known object, which is none of a list, if the camera sees it finely enough.
pub(super) fn light_at(rays: &CameraRays, point: &EndPoint, at_hits: impl Fn(usize) -> Vec3) -> Option<Vec3> {
    interpolated(place(rays, point)?, rays.width as usize, at_hits)
}

fn interpolated(place: Place, width: usize, at_hits: impl Fn(usize) -> Vec3) -> Option<Vec3> {
    let Place { first, part, is_resolved } = place;
    let row = |row: usize| {
        let start = first + row * width - width - 1;
        std::array::from_fn::<_, 4, _>(|column| Some(at_hits(start + column)))
    };
    let is_enough = is_resolved || is_smooth(&std::array::from_fn(row), Vec3::ZERO, 1.0);
    is_enough.then(|| bilinear(corners(first, width).map(at_hits), part))
}

/// The indices of four neighbouring rays.
fn corners(first: usize, width: usize) -> [usize; 4] {
    [first, first + 1, first + width, first + width + 1]
}

fn place(rays: &CameraRays, end: &EndPoint) -> Option<Place> {
    let point = &end.hit;
    let view = &rays.view;
    let size = Vec2::new(view.size[0] as f32, view.size[1] as f32);
    let (pixel, depth) = view.camera.project(point.position, size);
    let per_edge = view.pixel_samples as f32;
    let at = per_edge * (pixel - Vec2::new(0.0, view.first_row as f32)) - 0.5;
    let width = rays.width as usize;
    let last = Vec2::new(rays.width as f32 - 2.0, (rays.hits.len() / width) as f32 - 2.0);
    if depth <= 0.0 || at.cmplt(Vec2::ZERO).any() || !at.floor().cmple(last).all() {
        return None;
    }
    let is_same = |hit: &&Hit| hit.object == point.object && hit.normal.dot(point.normal) >= MIN_NORMAL_COSINE;
    let hit = |index: usize| rays.hits[index].as_ref().filter(is_same);
    let (x, y) = (at.x as usize, at.y as usize);
    let first = y * width + x;
    let mut hits = [Vec3::ZERO; 4];
    for (position, index) in hits.iter_mut().zip(corners(first, width)) {
        *position = hit(index)?.position;
    }
    let [a, b, c, _] = hits;
    let part = at.fract();
    let deviation = bilinear(hits, part).distance(point.position);
    if deviation > MAX_DEVIATION * a.distance(b).min(a.distance(c)) {
        return None;
    }
    let is_resolved = is_resolved([b - a, c - a].map(|step| per_edge * step), end);
    let is_within = x > 0 && y > 0 && at.floor().cmplt(last).all();
    let is_surrounded =
        || is_within && (0..4).all(|j| (0..4).all(|i| hit(first + j * width + i - width - 1).is_some()));
    (is_resolved || is_surrounded()).then_some(Place { first, part, is_resolved })
}

/// Whether steps between hits are short for the eye that looks along the path. `steps` lead from pixel to pixel.
fn is_resolved(steps: [Vec3; 2], end: &EndPoint) -> bool {
    if steps.iter().all(|step| MAX_PIXELS * end.blur >= step.length()) {
        return true;
    }
    // The steps in pixels of the path's picture: least squares, by the normal equations.
    let [u, v] = end.steps;
    let (uu, uv, vv) = (u.length_squared(), u.dot(v), v.length_squared());
    let determinant = uu * vv - uv * uv;
    let pixels = |step: Vec3| Vec2::new(vv * u.dot(step) - uv * v.dot(step), uu * v.dot(step) - uv * u.dot(step));
    // Lengths of the images of an ellipse's conjugate diameters bound its longer axis.
    let squares: f32 = steps.iter().map(|step| pixels(*step).length_squared()).sum();
    squares <= 2.0 * MAX_PIXELS * MAX_PIXELS * determinant * determinant && determinant > 0.0
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
        let rays = CameraRays::trace(|ray| tracer.camera_hit(ray), view);
        let receives = |object: u32| scene.objects[object as usize].receiver.is_some();
        // Halfway between rays of a finer picture: light that is the position itself is interpolated to the position.
        let finer = CameraRays::trace(|ray| tracer.camera_hit(ray), View { size: [201, 151], rows: 151, ..view });
        let seen: Vec<EndPoint> = finer
            .hits
            .iter()
            .flatten()
            .filter(|hit| receives(hit.object))
            .map(|&hit| EndPoint {
                hit,
                receives: true,
                view: Vec3::Y,
                pixel: 0,
                key: 0,
                steps: [Vec3::X, Vec3::Z],
                blur: 0.0,
            })
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
