//! Candidates: a dense set of points that covers the surface evenly, each with the area that it stands for.
//!
//! Coarse triangles are split into pieces whose centroids and exact areas are the candidates. Fine ones, of which
//! only some become candidates, are drawn at even strides of area along a space-filling order. So the number of
//! candidates follows from the number of samples, not from the mesh (WS-15).

use glam::Vec3;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, seq::SliceRandom};
use rayon::prelude::*;

use super::morton;
use super::surface::SurfaceTriangle;
use super::{Surface, SurfacePoint};

/// Candidates per sample: 40, fewer where the memory for them would be gigabytes.
pub(super) fn per_sample(samples: u32) -> f32 {
    (8e6 / samples as f32).clamp(10.0, 40.0)
}

/// Candidates that stand for at most `stride` m² each, in random order.
pub(super) fn stratified(surface: &Surface, stride: f32, rng: &mut ChaCha8Rng) -> Vec<SurfacePoint> {
    let mut candidates = cover(surface, stride, rng);
    candidates.shuffle(rng);
    candidates
}

/// The same in an order that neighbours share.
pub(super) fn cover(surface: &Surface, stride: f32, rng: &mut ChaCha8Rng) -> Vec<SurfacePoint> {
    // A triangle of a third of the stride or more is a candidate of its own: exact, and three times as many at worst.
    let (coarse, fine): (Vec<_>, Vec<_>) = surface.triangles().iter().partition(|t| t.area() >= stride / 3.0);
    let pieces = |triangles: &[&SurfaceTriangle]| {
        let mut pieces = Vec::with_capacity(triangles.len());
        for triangle in triangles {
            split(triangle, [Vec3::X, Vec3::Y, Vec3::Z], triangle.area(), stride, &mut pieces);
        }
        pieces
    };
    let mut candidates: Vec<SurfacePoint> = coarse.par_chunks(1024).flat_map_iter(pieces).collect();
    draw_along_order(fine, stride, rng, &mut candidates);
    candidates
}

/// Halves a piece of a triangle across its longest edge until it is small enough; `piece` in barycentric coordinates.
fn split(triangle: &SurfaceTriangle, piece: [Vec3; 3], area: f32, stride: f32, out: &mut Vec<SurfacePoint>) {
    if area <= stride {
        out.push(triangle.point((piece[0] + piece[1] + piece[2]) / 3.0, area));
        return;
    }
    let place = |b: Vec3| b.x * triangle.corners[0] + b.y * triangle.corners[1] + b.z * triangle.corners[2];
    let length = |k: usize| place(piece[k]).distance_squared(place(piece[(k + 1) % 3]));
    let longest = (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b))).expect("three edges");
    let [a, b, c] = [piece[longest], piece[(longest + 1) % 3], piece[(longest + 2) % 3]];
    let middle = 0.5 * (a + b);
    split(triangle, [a, middle, c], 0.5 * area, stride, out);
    split(triangle, [middle, b, c], 0.5 * area, stride, out);
}

/// Systematic sampling: one random point in the triangle at every `stride` of accumulated area.
fn draw_along_order(fine: Vec<&SurfaceTriangle>, stride: f32, rng: &mut ChaCha8Rng, out: &mut Vec<SurfacePoint>) {
    let total: f64 = fine.iter().map(|t| f64::from(t.area())).sum();
    if fine.is_empty() || total <= 0.0 {
        return;
    }
    let count = (total / f64::from(stride)).ceil().max(1.0);
    let step = total / count;
    let (mut accumulated, mut next) = (0.0, rng.random::<f64>() * step);
    for triangle in in_space_filling_order(fine) {
        accumulated += f64::from(triangle.area());
        while next < accumulated {
            out.push(triangle.point(random_barycentric(rng), step as f32));
            next += step;
        }
    }
}

fn in_space_filling_order(triangles: Vec<&SurfaceTriangle>) -> impl Iterator<Item = &SurfaceTriangle> {
    let low = triangles.iter().flat_map(|t| t.corners).fold(Vec3::INFINITY, Vec3::min);
    let high = triangles.iter().flat_map(|t| t.corners).fold(Vec3::NEG_INFINITY, Vec3::max);
    let extent = (high - low).max_element();
    let key = |t: &SurfaceTriangle| {
        let normal = t.normals[0] + t.normals[1] + t.normals[2];
        morton::key((t.corners[0] + t.corners[1] + t.corners[2]) / 3.0, normal, low, extent)
    };
    let mut keyed: Vec<(u64, &SurfaceTriangle)> = triangles.into_par_iter().map(|t| (key(t), t)).collect();
    keyed.par_sort_by_key(|(key, _)| *key);
    keyed.into_iter().map(|(_, t)| t)
}

/// Uniform in a triangle.
pub(super) fn random_barycentric(rng: &mut ChaCha8Rng) -> Vec3 {
    let (s, t) = (rng.random::<f32>().sqrt(), rng.random::<f32>());
    Vec3::new(1.0 - s, s * (1.0 - t), s * t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shapes::{Plane, Shape, Sphere};
    use rand::SeedableRng;

    fn surface(shape: Shape) -> Surface {
        let mut surface = Surface::default();
        surface.append(&shape.mesh().unwrap(), 0, false);
        surface
    }

    #[test]
    fn candidates_cover_coarse_and_fine_meshes_with_their_area() {
        for (shape, stride) in
            [(Shape::Plane(Plane { size: [2.0, 1.0] }), 1e-3), (Shape::Sphere(Sphere { radius: 1.0 }), 5e-3)]
        {
            let surface = surface(shape);
            let candidates = stratified(&surface, stride, &mut ChaCha8Rng::seed_from_u64(1));
            let area: f64 = candidates.iter().map(|c| f64::from(c.area)).sum();
            assert!((area / surface.area() - 1.0).abs() < 1e-4);
            let expected = surface.area() / f64::from(stride);
            assert!(
                candidates.len() as f64 >= expected && candidates.len() as f64 <= 4.0 * expected,
                "{}",
                candidates.len()
            );
        }
    }

    #[test]
    fn their_number_does_not_follow_the_mesh() {
        // 46 080 triangles, 1 000 candidates.
        let surface = surface(Shape::Sphere(Sphere { radius: 1.0 }));
        let candidates = stratified(&surface, surface.area() as f32 / 1000.0, &mut ChaCha8Rng::seed_from_u64(1));
        assert!(candidates.len().abs_diff(1000) <= 1, "{}", candidates.len());
    }
}
