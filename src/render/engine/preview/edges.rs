//! Edges of what the camera sees directly. A pixel that several surfaces share is mixed from the colours that its neighbours have of
//! them, so that edges are anti-aliased without more light than one point a pixel.

use glam::{UVec2, Vec2, Vec3};

use crate::image::Image;
use crate::lanes::{ALL, LANES};
use crate::parallel;
use crate::pinhole::constants::{MIN_EVEN_COSINE, MIN_SAME_COSINE};
use crate::scene::{Camera, Ray};
use crate::tracing::{CameraTracer, Hit};

/// Points of a pixel, from its centre: no two in one row or column.
const POINTS: [Vec2; 4] =
    [Vec2::new(-0.125, -0.375), Vec2::new(0.375, -0.125), Vec2::new(0.125, 0.375), Vec2::new(-0.375, 0.125)];
/// Pixels whose points are traced together.
const PIXELS: usize = LANES / POINTS.len();

/// What the camera sees first at a pixel's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstSurface {
    /// The object and which of its sides; `None` where nothing is.
    side: Option<(u32, bool)>,
    normal: Vec3,
    /// From the camera, metres; infinite where nothing is.
    pub distance: f32,
}

impl FirstSurface {
    /// What a ray hit.
    pub fn of(ray: &Ray, hit: Option<&Hit>) -> Self {
        hit.map_or(Self { side: None, normal: Vec3::ZERO, distance: f32::INFINITY }, |hit| Self {
            side: Some((hit.object, hit.front)),
            normal: hit.normal,
            distance: hit.position.distance(ray.origin),
        })
    }

    fn is_like(&self, other: &Self, min_cosine: f32) -> bool {
        self.side == other.side && (self.side.is_none() || self.normal.dot(other.normal) >= min_cosine)
    }
}

/// Anti-aliases the edges in a picture of so many pixels, by what is seen at their centres.
pub fn smooth_edges(image: &mut Image, camera: &Camera, tracer: &CameraTracer, first: &[FirstSurface]) {
    let grid = Grid { first, width: image.width as usize };
    let edges = parallel::filter(first.len(), &|pixel| grid.is_edge(pixel));
    let ray = camera.rays(UVec2::new(image.width, image.height).as_vec2());
    let centre = |pixel: usize| Vec2::new((pixel % grid.width) as f32, (pixel / grid.width) as f32) + 0.5;
    let mix = |pixels: &[usize]| {
        let of_lane = |lane: usize| pixels[(lane / POINTS.len()).min(pixels.len() - 1)];
        let rays = std::array::from_fn(|lane| ray(centre(of_lane(lane)) + POINTS[lane % POINTS.len()]));
        let hits = tracer.hits(&rays, ALL);
        let mut colours = [Vec3::ZERO; PIXELS];
        for (lane, hit) in hits.iter().enumerate() {
            let pixel = of_lane(lane);
            let like =
                grid.pixel_with(pixel, POINTS[lane % POINTS.len()], &FirstSurface::of(&rays[lane], hit.as_ref()));
            colours[lane / POINTS.len()] += image.pixels[like.unwrap_or(pixel)] / POINTS.len() as f32;
        }
        colours
    };
    let mixed: Vec<[Vec3; PIXELS]> = parallel::map_chunks(&edges, PIXELS, &mix);
    for (pixel, colour) in edges.iter().zip(mixed.as_flattened()) {
        image.pixels[*pixel] = *colour;
    }
}

struct Grid<'a> {
    first: &'a [FirstSurface],
    width: usize,
}

impl Grid<'_> {
    fn neighbour(&self, pixel: usize, [right, down]: [isize; 2]) -> Option<usize> {
        let x = (pixel % self.width).checked_add_signed(right).filter(|x| *x < self.width)?;
        let y = (pixel / self.width).checked_add_signed(down).filter(|y| *y < self.first.len() / self.width)?;
        Some(y * self.width + x)
    }

    fn is_edge(&self, pixel: usize) -> bool {
        let differs = |offset| {
            self.neighbour(pixel, offset)
                .is_some_and(|other| !self.first[pixel].is_like(&self.first[other], MIN_EVEN_COSINE))
        };
        [[1, 0], [-1, 0], [0, 1], [0, -1]].into_iter().any(differs)
    }

    /// The pixel nearest to a point of a pixel that shows the same surface: itself, or one of those around it.
    fn pixel_with(&self, pixel: usize, point: Vec2, surface: &FirstSurface) -> Option<usize> {
        if self.first[pixel].is_like(surface, MIN_EVEN_COSINE) {
            return Some(pixel);
        }
        let is_like = |other: &usize| self.first[*other].is_like(surface, MIN_SAME_COSINE);
        let around = (0..9).map(|k| [k % 3 - 1, k / 3 - 1]);
        let found = around.filter_map(|offset| Some((offset, self.neighbour(pixel, offset).filter(is_like)?)));
        // Of those on the same side of a crease, the nearest.
        let mismatch = |([x, y], other): ([isize; 2], usize)| {
            let away = Vec2::new(x as f32, y as f32).distance(point);
            away - 4.0 * self.first[other].normal.dot(surface.normal)
        };
        found.min_by(|a, b| mismatch(*a).total_cmp(&mismatch(*b))).map(|(_, other)| other)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::scene::shapes::{Plane, Shape};
    use crate::scene::{Object, Projection, Transform};
    use crate::tracing::{SeenBy, Tracer};

    /// A slanted edge between a bright plate and a dark ground: pixels along it have the part of the plate in their area, and all
    /// others stay.
    #[test]
    fn pixels_on_edges_have_the_colours_of_both_sides() {
        let mut plate = Object::new("plate", Shape::Plane(Plane { size: [4.0, 4.0] }).mesh().unwrap());
        plate.placement = Transform {
            rotate_rad: Vec3::new(0.0, 0.3, 0.0),
            translate: Vec3::new(2.1, 0.0, 0.0),
            ..Default::default()
        };
        let mesh = plate.mesh_in_world();
        let camera =
            Camera::look_at(Vec3::Y, Vec3::ZERO, Vec3::NEG_Z, Projection::Orthographic { height: 2.0 }).unwrap();
        let meshes = || [(&mesh, SeenBy::ALL)].into_iter();
        let tracer = CameraTracer::new(Arc::new(Tracer::of_meshes(meshes())), None, None);
        let size = Vec2::splat(40.0);
        let first: Vec<FirstSurface> = (0..1600u32)
            .map(|k| {
                let at = Vec2::new((k % 40) as f32, (k / 40) as f32) + 0.5;
                let ray = camera.ray(at, size);
                FirstSurface::of(&ray, tracer.hit(ray).as_ref())
            })
            .collect();
        let pixels: Vec<Vec3> = first.iter().map(|f| if f.side.is_some() { Vec3::ONE } else { Vec3::ZERO }).collect();
        let mut image = Image { width: 40, height: 40, pixels: pixels.clone() };
        smooth_edges(&mut image, &camera, &tracer, &first);
        let mixed = image.pixels.iter().filter(|p| p.x > 0.0 && p.x < 1.0).count();
        assert!((20..100).contains(&mixed), "{mixed}");
        // The edge passes through the middle of the picture, at tan 0.3 from the vertical.
        for (k, pixel) in image.pixels.iter().enumerate() {
            let at = Vec2::new((k % 40) as f32, (k / 40) as f32) + 0.5;
            let part = (0..64).filter(|s| {
                let point = at - 0.5 + (Vec2::new((s % 8) as f32, (s / 8) as f32) + 0.5) / 8.0;
                tracer.hit(camera.ray(point, size)).is_some()
            });
            let part = part.count() as f32 / 64.0;
            assert!((pixel.x - part).abs() <= 0.3, "{at}: {} for {part}", pixel.x);
        }
    }
}
