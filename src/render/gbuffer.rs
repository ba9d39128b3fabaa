//! The G-buffer: what the camera sees at every point of a band of pixels.

use glam::{UVec2, Vec2};
use rayon::prelude::*;

use super::Options;
use crate::pinhole::{NO_RECEIVER, Receivers};
use crate::scene::Scene;
use crate::tracing::{Hit, Tracer};

/// A band of rows of the picture, `pixel_samples`² points a pixel.
pub(super) struct GBuffer {
    pub first_row: u32,
    pub rows: u32,
    /// Points along a pixel's edge.
    pub per_edge: u32,
    /// Points in a row.
    pub width: u32,
    /// What the camera sees at every point.
    pub hits: Vec<Option<Hit>>,
    /// The same as the gather takes it; only objects that receive.
    pub receivers: Receivers,
}

/// The receivers that a scene's camera sees at the centres of a picture's pixels.
pub fn visible_receivers(scene: &Scene, tracer: &Tracer, size: [u32; 2]) -> Receivers {
    let options = Options { size, pixel_samples: 1, ..Options::default() };
    GBuffer::trace(tracer, scene, &options, 0, size[1]).receivers
}

impl GBuffer {
    pub fn trace(tracer: &Tracer, scene: &Scene, options: &Options, first_row: u32, rows: u32) -> Self {
        let per_edge = options.pixel_samples;
        let (width, height) = (options.size[0] * per_edge, rows * per_edge);
        let size = UVec2::from_array(options.size).as_vec2();
        let hits: Vec<Option<Hit>> = (0..width * height)
            .into_par_iter()
            .map(|k| {
                let point = Vec2::new((k % width) as f32, (k / width + first_row * per_edge) as f32) + 0.5;
                tracer.camera_hit(scene.camera.ray(point / per_edge as f32, size))
            })
            .collect();
        let mut receivers = Receivers::empty(width, height);
        for (index, hit) in hits.iter().enumerate() {
            if let Some(hit) = hit.filter(|h| scene.objects[h.object as usize].receiver.is_some()) {
                receivers.set(index, hit.position, hit.normal, hit.object);
            }
        }
        Self { first_row, rows, per_edge, width, hits, receivers }
    }

    /// Takes the objects that are not wanted out of the gather.
    pub fn keep_receivers(&mut self, wanted: impl Fn(u32) -> bool) {
        for (position, hit) in self.receivers.positions.iter_mut().zip(&self.hits) {
            if hit.as_ref().is_some_and(|hit| !wanted(hit.object)) {
                position[3] = NO_RECEIVER;
            }
        }
    }

    /// Index of a point: pixel (`x`, `row` of the band), point (`i`, `j`) of the pixel.
    pub fn index(&self, x: u32, row: u32, i: u32, j: u32) -> usize {
        ((row * self.per_edge + j) * self.width + x * self.per_edge + i) as usize
    }
}
