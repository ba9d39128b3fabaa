//! Camera rays: the first hit for every point of a band of rows, and the receivers among the hits.

use glam::{UVec2, Vec2};

use super::refraction::{Refracted, divided};
use crate::parallel;
use crate::pinhole::Receivers;
use crate::scene::{Camera, Ray, Scene};
use crate::tracing::{Hit, Tracer};

/// Interfaces that a camera ray passes at most on its way to a receiver.
const MAX_INTERFACES: usize = 4;

/// A band of rows of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    pub(crate) camera: Camera,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// Points along a pixel's edge.
    pub pixel_samples: u32,
    /// The band's first row, and its number of rows.
    pub first_row: u32,
    pub(crate) rows: u32,
}

impl View {
    /// All camera rays, row by row.
    pub fn rays(&self) -> Vec<Ray> {
        (0..self.ray_count()).map(|k| self.ray(k)).collect()
    }

    fn width(&self) -> u32 {
        self.size[0] * self.pixel_samples
    }

    fn ray_count(&self) -> u32 {
        self.width() * self.rows * self.pixel_samples
    }

    /// A camera ray by its index.
    pub fn ray(&self, k: u32) -> Ray {
        let (width, per_edge) = (self.width(), self.pixel_samples);
        let point = Vec2::new((k % width) as f32, (k / width + self.first_row * per_edge) as f32) + 0.5;
        self.camera.ray(point / per_edge as f32, UVec2::from_array(self.size).as_vec2())
    }
}

/// The first hits of the camera rays of a band of rows, `pixel_samples`² per pixel.
#[derive(Debug)]
pub struct CameraRays {
    pub(crate) view: View,
    /// Points in a row.
    pub width: u32,
    /// The first hit at every point.
    pub hits: Vec<Option<Hit>>,
}

impl CameraRays {
    pub(crate) fn trace(camera_hit: impl Fn(Ray) -> Option<Hit> + Sync, view: View) -> Self {
        let hits = parallel::collect(view.ray_count() as usize, &|k| camera_hit(view.ray(k as u32)));
        Self::of_hits(view, hits)
    }

    /// What the rays of a view hit.
    pub fn of_hits(view: View, hits: Vec<Option<Hit>>) -> Self {
        Self { view, width: view.width(), hits }
    }

    /// The hits on wanted objects, as receivers.
    pub fn receivers(&self, wanted: impl Fn(u32) -> bool) -> Receivers {
        self.receivers_of_every(1, wanted)
    }

    /// The hits on wanted objects at every n-th point, along rows and columns, as receivers.
    pub fn receivers_of_every(&self, n: u32, wanted: impl Fn(u32) -> bool) -> Receivers {
        let height = self.view.rows * self.view.pixel_samples;
        let mut receivers = Receivers::empty(self.width.div_ceil(n), height.div_ceil(n));
        for index in 0..receivers.positions.len() {
            let (x, y) = (index as u32 % receivers.width * n, index as u32 / receivers.width * n);
            if let Some(hit) = self.hits[(y * self.width + x) as usize].filter(|h| wanted(h.object)) {
                receivers.set(index, hit.position, hit.normal, hit.object);
            }
        }
        receivers
    }

    /// Index of point (`i`, `j`) of pixel (`x`, `row` of the band).
    pub fn index(&self, x: u32, row: u32, i: u32, j: u32) -> usize {
        let per_edge = self.view.pixel_samples;
        ((row * per_edge + j) * self.width + x * per_edge + i) as usize
    }
}

/// The receivers that the scene's camera sees at the pixels' centres.
pub fn visible_receivers(scene: &Scene, tracer: &Tracer, size: [u32; 2]) -> Receivers {
    receivers_at_ends(scene, size, |ray| tracer.camera_hit(ray))
}

/// The receivers that the scene's camera sees at the pixels' centres directly or through interfaces, whose reflections do not count.
pub fn receivers_through_interfaces(scene: &Scene, tracer: &Tracer, size: [u32; 2]) -> Receivers {
    receivers_at_ends(scene, size, |ray| {
        let (mut ray, mut hit) = (ray, tracer.camera_hit(ray)?);
        for _ in 0..MAX_INTERFACES {
            let Some(refractor) = &scene.objects[hit.object as usize].refractor else { break };
            let Refracted { direction, .. } = divided(refractor, refractor.eta.y, (&hit, &ray)).1?;
            ray = Ray { origin: hit.position, direction };
            hit = tracer.secondary_hit(ray)?;
        }
        Some(hit)
    })
}

fn receivers_at_ends(scene: &Scene, size: [u32; 2], end: impl Fn(Ray) -> Option<Hit> + Sync) -> Receivers {
    let view = View { camera: scene.camera, size, pixel_samples: 1, first_row: 0, rows: size[1] };
    let rays = CameraRays::trace(end, view);
    rays.receivers(|object| scene.objects[object as usize].receiver.is_some())
}
