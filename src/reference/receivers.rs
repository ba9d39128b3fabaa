//! What the camera sees at every point of every pixel, by rays in f64.

use glam::DVec3;

use super::domain::{Place, Receiver};
use super::emitters::Emitters;
use super::geometry::Geometry;
use crate::parallel;
use crate::scene::{Camera, Projection, Scene};

/// The receivers of a picture: points, or lines of sight.
#[derive(Debug)]
pub(super) struct Receivers<R> {
    per_edge: usize,
    points: Vec<Option<R>>,
}

impl Receivers<Receiver> {
    /// The points that the camera sees, none where an emitter is before them.
    pub fn find(scene: &Scene, (geometry, emitters): (&Geometry, &Emitters), size: [u32; 2], per_edge: u32) -> Self {
        Self::at_all_points(&scene.camera, size, per_edge, |(origin, direction)| {
            let hit = geometry.first_hit(origin, direction, |o| scene.objects[o as usize].camera_visible)?;
            let triangle = &geometry.triangles[hit.triangle as usize];
            scene.objects[triangle.object as usize].receiver.as_ref()?;
            let normal = triangle.normal(hit.barycentric);
            let [a, b, c] = triangle.corners;
            let face = (b - a).cross(c - a);
            // The side of the facet decides, not the interpolated normal.
            let seen_from_front = face.dot(direction) * face.dot(normal) <= 0.0;
            let normal = if seen_from_front { normal } else { -normal };
            let position = triangle.position(hit.barycentric);
            if emitters.hide((origin, direction), position.distance(origin)) {
                return None;
            }
            Some(Receiver { position, view: -direction, place: Place::Surface { normal, triangle: hit.triangle } })
        })
    }
}

impl<R: Send> Receivers<R> {
    /// What there is on the rays through all points of all pixels: a point and a unit direction each.
    pub fn at_all_points(
        camera: &Camera,
        [width, height]: [u32; 2],
        per_edge: u32,
        receiver: impl Fn((DVec3, DVec3)) -> Option<R> + Sync,
    ) -> Self {
        let size = [f64::from(width), f64::from(height)];
        let point = |index: u64| {
            let (pixel, sub) = (index / u64::from(per_edge * per_edge), index % u64::from(per_edge * per_edge));
            let within = |k: u64| ((k % u64::from(per_edge)) as f64 + 0.5) / f64::from(per_edge);
            let x = (pixel % u64::from(width)) as f64 + within(sub);
            let y = (pixel / u64::from(width)) as f64 + within(sub / u64::from(per_edge));
            receiver(ray(camera, [x, y], size))
        };
        let count = u64::from(width) * u64::from(height) * u64::from(per_edge * per_edge);
        Self { per_edge: per_edge as usize, points: parallel::collect(count as usize, &|index| point(index as u64)) }
    }
}

impl<R> Receivers<R> {
    /// Those of a pixel; `None` where nothing receives.
    pub fn of_pixel(&self, pixel: usize) -> &[Option<R>] {
        let count = self.per_edge * self.per_edge;
        &self.points[pixel * count..(pixel + 1) * count]
    }
}

/// The ray through a point of a picture, in pixels from its top left corner.
fn ray(camera: &Camera, [x, y]: [f64; 2], [width, height]: [f64; 2]) -> (DVec3, DVec3) {
    let (right, up) = (camera.right.as_dvec3(), camera.up.as_dvec3());
    let (position, forward) = (camera.position.as_dvec3(), camera.forward.as_dvec3());
    let (across, upwards) = ((2.0 * x - width) / height, 1.0 - 2.0 * y / height);
    match camera.projection {
        Projection::Perspective { fov_y_rad } => {
            let half = (0.5 * f64::from(fov_y_rad)).tan();
            (position, (forward + half * (across * right + upwards * up)).normalize())
        }
        Projection::Orthographic { height } => {
            (position + 0.5 * f64::from(height) * (across * right + upwards * up), forward)
        }
    }
}
