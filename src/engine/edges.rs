//! Anti-aliasing of caustics: where light differs from one pixel to the next on one surface, several points of the pixel share in it.

use glam::{UVec2, Vec2, Vec3};
use rayon::prelude::*;

use super::ends::POINTS_IN_A_ROW;
use super::every_other::PixelGrid;
use crate::pinhole::Receivers;
use crate::stages::CameraRays;
use crate::tracing::{Hit, Tracer};

/// A pixel is divided if its caustic differs from a neighbour's by more than this part of all light there,
const MIN_CONTRAST: f32 = 0.1;
/// and by more than this many times what the tolerance alone may make of it.
const MIN_TOLERANCES: f32 = 10.0;
/// Neighbours lie on one surface if the cosine between their normals is this, at least.
const MIN_NORMAL_COSINE: f32 = 0.9;
/// Points of a divided pixel, from its centre, in pixels: no two share a row or a column.
const POINTS: [Vec2; 4] =
    [Vec2::new(-0.125, -0.375), Vec2::new(0.375, -0.125), Vec2::new(0.125, 0.375), Vec2::new(-0.375, 0.125)];

/// Pixels that are divided, and their points.
#[derive(Debug)]
pub(super) struct DividedPixels {
    /// Indices of the camera rays.
    pixels: Vec<usize>,
    /// As many for each pixel as there are [`POINTS`], one pixel after the other.
    points: Vec<Hit>,
}

impl DividedPixels {
    /// Finds pixels whose caustic, of this relative tolerance, differs from that of their neighbours beside this direct light, and all of
    /// whose points lie on one surface. The camera has one ray for each pixel.
    pub fn find(tracer: &Tracer, rays: &CameraRays, direct: &[Vec3], (caustic, tolerance): (&[[f32; 4]], f32)) -> Self {
        let min_contrast = MIN_CONTRAST.max(MIN_TOLERANCES * tolerance);
        let differs = |one: usize, other: usize| {
            let light = |index: usize| Vec3::from_slice(&caustic[index]);
            let all = (direct[one] + light(one)).max(direct[other] + light(other));
            (light(one) - light(other)).abs().max_element() > min_contrast * all.max_element()
        };
        let of_pixel = |index: usize| {
            let own = rays.hits[index].as_ref().filter(|_| differs_from_neighbour(rays, index, differs))?;
            let points = points_of(tracer, rays, index, own);
            (points.len() == POINTS.len()).then_some((index, points))
        };
        let mut found: Vec<(usize, Vec<Hit>)> = (0..rays.hits.len()).into_par_iter().filter_map(of_pixel).collect();
        found.sort_by_cached_key(|(index, _)| rays.place_on_curve(*index));
        let pixels = found.iter().map(|(index, _)| *index).collect();
        Self { pixels, points: found.into_iter().flat_map(|(_, points)| points).collect() }
    }

    /// The points as receivers.
    pub fn receivers(&self) -> Receivers {
        let points: Vec<_> = self.points.iter().map(|hit| (hit.position, hit.normal, hit.object)).collect();
        Receivers::from_points(&points, POINTS_IN_A_ROW)
    }

    /// The error that may be made at each point beyond the accuracy of the sum.
    pub fn tolerate(&self, receivers: &mut Receivers, error: impl Fn(usize) -> f32) {
        let of_points = self.pixels.iter().flat_map(|&index| [index; POINTS.len()]);
        of_points.enumerate().for_each(|(place, index)| receivers.tolerate(place, error(index)));
    }

    /// Replaces the light of the divided pixels by the mean of that of their points. Fetches add up.
    pub fn average(&self, of_points: &[[f32; 4]], caustic: &mut [[f32; 4]]) {
        for (&index, own) in self.pixels.iter().zip(of_points.chunks(POINTS.len())) {
            let fetches = caustic[index][3] + own.iter().map(|sum| sum[3]).sum::<f32>();
            let mean = own.iter().map(|sum| Vec3::from_slice(sum)).sum::<Vec3>() / own.len() as f32;
            caustic[index] = mean.extend(fetches).to_array();
        }
    }

    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }
}

/// Whether a pixel differs from any neighbour on the same surface.
fn differs_from_neighbour(rays: &CameraRays, index: usize, differs: impl Fn(usize, usize) -> bool) -> bool {
    let width = rays.width as usize;
    let x = index % width;
    let neighbours = [
        (x > 0).then(|| index - 1),
        (x + 1 < width).then_some(index + 1),
        index.checked_sub(width),
        Some(index + width).filter(|k| *k < rays.hits.len()),
    ];
    let own = rays.hits[index].as_ref();
    let is_same = |other: &Hit| {
        own.is_some_and(|own| other.object == own.object && other.normal.dot(own.normal) > MIN_NORMAL_COSINE)
    };
    let on_same = |other: usize| rays.hits[other].as_ref().is_some_and(is_same);
    neighbours.into_iter().flatten().any(|other| on_same(other) && differs(index, other))
}

/// Points of a pixel on the surface that its centre shows.
fn points_of(tracer: &Tracer, rays: &CameraRays, index: usize, own: &Hit) -> Vec<Hit> {
    let (view, width) = (&rays.view, rays.width as usize);
    let centre = Vec2::new((index % width) as f32, (index / width + view.first_row as usize) as f32) + 0.5;
    let size = UVec2::from_array(view.size).as_vec2();
    let hit = |offset: Vec2| tracer.camera_hit(view.camera.ray(centre + offset, size));
    POINTS.iter().filter_map(|offset| hit(*offset)).filter(|hit| hit.object == own.object).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::load;
    use crate::stages::View;

    #[test]
    fn pixels_at_an_edge_of_light_are_divided() {
        let scene = load::<toml::Table>("mirror-sphere").unwrap().scene;
        let tracer = Tracer::new(&scene);
        let view = View { camera: scene.camera, size: [32, 32], pixel_samples: 1, first_row: 0, rows: 32 };
        let rays = CameraRays::trace(&tracer, view);
        let direct = vec![Vec3::ONE; rays.hits.len()];
        // Light on one side of a column.
        let caustic: Vec<[f32; 4]> = (0..1024).map(|k| [if k % 32 < 5 { 0.5 } else { 0.0 }; 4]).collect();
        let divided = DividedPixels::find(&tracer, &rays, &direct, (&caustic, 0.01));
        assert!(!divided.is_empty());
        assert!(divided.pixels.iter().all(|index| [4, 5].contains(&(index % 32))));
        let half: Vec<[f32; 4]> = (0..divided.points.len()).map(|k| [(k % 2) as f32, 0.0, 0.0, 1.0]).collect();
        let mut averaged = caustic.clone();
        divided.average(&half, &mut averaged);
        let index = divided.pixels[0];
        assert_eq!(averaged[index], [0.5, 0.0, 0.0, caustic[index][3] + 4.0]);
        // Beside much more light nothing is seen of it.
        let bright = vec![Vec3::splat(100.0); rays.hits.len()];
        assert!(DividedPixels::find(&tracer, &rays, &bright, (&caustic, 0.01)).is_empty());
        // Coarse sums differ by themselves.
        assert!(DividedPixels::find(&tracer, &rays, &direct, (&caustic, 0.05)).is_empty());
    }
}
