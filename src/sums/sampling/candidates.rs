//! Candidates: a dense set of points that covers the surface evenly, each with the area that it stands for.
//!
//! Coarse triangles are split into pieces whose centroids and exact areas are the candidates. Fine ones, of which
//! only some become candidates, are drawn at even strides of area along a space-filling order. So the number of
//! candidates follows from the number of samples, not from the mesh.

use bytemuck::Zeroable;
use glam::Vec3;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, seq::SliceRandom};
use rayon::slice::ParallelSliceMut;

use super::morton;
use super::surface::SurfaceTriangle;
use super::{Surface, SurfacePoint};
use crate::parallel;

/// Candidates per sample: 40, fewer where the memory for them would be gigabytes.
pub(super) fn per_sample(samples: u32) -> f32 {
    (8e6 / samples as f32).clamp(10.0, 40.0)
}

/// Points that cover a surface.
pub(super) struct Candidates {
    /// Pieces of triangles first, then points that were drawn.
    pub points: Vec<SurfacePoint>,
    /// Of each piece.
    pub origins: Vec<Origin>,
}

/// The piece of a triangle that a candidate stands for.
#[derive(Clone, Copy, Debug, Zeroable)]
pub struct Origin {
    triangle: u32,
    /// The way to it through the halvings of the triangle: a leading one, then a bit for each half.
    path: u32,
}

/// Points that stand for at most `stride` m² each, in an order that neighbours share.
pub(super) fn cover(surface: &Surface, stride: f32, rng: &mut ChaCha8Rng) -> Candidates {
    cover_where(surface, |_| true, stride, rng)
}

/// The same for those triangles that are too fine to be candidates at some `coarser` stride.
pub(super) fn cover_fine(surface: &Surface, coarser: f32, stride: f32, rng: &mut ChaCha8Rng) -> Vec<SurfacePoint> {
    cover_where(surface, |area| is_fine(area, coarser), stride, rng).points
}

/// Whether a triangle is too small to be a candidate of its own. One of a third of the stride or more is: that is exact, and three
/// times as many at worst.
fn is_fine(area: f32, stride: f32) -> bool {
    area < stride / 3.0
}

fn cover_where(
    surface: &Surface,
    is_wanted: impl Fn(f32) -> bool + Sync,
    stride: f32,
    rng: &mut ChaCha8Rng,
) -> Candidates {
    let mut candidates = pieces(surface, |area| is_wanted(area) && !is_fine(area, stride), stride);
    let triangles = surface.triangles().iter().zip(surface.areas());
    let fine = triangles.filter(|(_, area)| is_wanted(**area) && is_fine(**area, stride));
    draw_along_order(fine.map(|(t, area)| (t, *area)).collect(), stride, rng, &mut candidates.points);
    candidates
}

/// All numbers below one, in random order.
pub(super) fn in_random_order(count: usize, rng: &mut ChaCha8Rng) -> Vec<u32> {
    let mut order: Vec<u32> = (0..count as u32).collect();
    order.shuffle(rng);
    order
}

/// Triangles that one thread takes in a row.
const RUN: usize = 1024;

/// Pieces of some triangles, of at most `stride` m² each. How many there are is known beforehand, so that every thread can put its
/// own where they belong.
fn pieces(surface: &Surface, is_wanted: impl Fn(f32) -> bool + Sync, stride: f32) -> Candidates {
    let in_triangle = |area: &f32| if is_wanted(*area) { pieces_of(*area, stride) } else { 0 };
    let in_run = |run: &[f32]| run.iter().map(in_triangle).sum::<usize>();
    let counts: Vec<usize> = parallel::map_chunks(surface.areas(), RUN, &in_run);
    let total = counts.iter().sum();
    let (mut points, mut origins) = (bytemuck::zeroed_vec(total), bytemuck::zeroed_vec(total));
    let mut rest: (&mut [SurfacePoint], &mut [Origin]) = (&mut points, &mut origins);
    let mut runs = Vec::with_capacity(counts.len());
    for (k, count) in counts.into_iter().enumerate() {
        let ((own_points, other_points), (own_origins, other_origins)) =
            (rest.0.split_at_mut(count), rest.1.split_at_mut(count));
        runs.push((k * RUN, own_points, own_origins));
        rest = (other_points, other_origins);
    }
    parallel::for_each_mut(&mut runs, &|_, (first, points, origins)| {
        let first = *first;
        let mut places = points.iter_mut().zip(origins.iter_mut());
        let run = surface.triangles()[first..].iter().zip(&surface.areas()[first..]).take(RUN).zip(first as u32..);
        for ((triangle, &area), number) in run.filter(|((_, area), _)| is_wanted(**area)) {
            split(Piece::whole(triangle), 1, area, stride, &mut |piece, path, area| {
                let (point, origin) = places.next().expect("pieces were counted");
                (*point, *origin) = (piece.point(triangle, area), Origin { triangle: number, path });
            });
        }
    });
    Candidates { points, origins }
}

/// Into how many pieces a triangle is split.
fn pieces_of(mut area: f32, stride: f32) -> usize {
    let mut count = 1;
    while area > stride {
        (area, count) = (0.5 * area, 2 * count);
    }
    count
}

/// A corner of a piece of a triangle; its normal is interpolated and no unit vector.
#[derive(Clone, Copy)]
struct Corner {
    position: Vec3,
    normal: Vec3,
}

/// A piece of a triangle, and the squares of its edges: first to second corner, second to third, third to first.
#[derive(Clone, Copy)]
struct Piece {
    corners: [Corner; 3],
    edges: [f32; 3],
}

impl Piece {
    fn whole(triangle: &SurfaceTriangle) -> Self {
        let corners = [0, 1, 2].map(|k| Corner { position: triangle.corners[k], normal: triangle.normals[k] });
        let edge = |k: usize| triangle.corners[k].distance_squared(triangle.corners[(k + 1) % 3]);
        Self { corners, edges: [edge(0), edge(1), edge(2)] }
    }

    /// The piece at the end of a path; see [`Origin`].
    fn at(triangle: &SurfaceTriangle, path: u32) -> Self {
        let bits = (0..path.ilog2()).rev().map(|k| path >> k & 1);
        bits.fold(Self::whole(triangle), |piece, bit| piece.halves()[bit as usize])
    }

    /// The candidate that stands for it.
    fn point(&self, triangle: &SurfaceTriangle, area: f32) -> SurfacePoint {
        let [a, b, c] = self.corners;
        let position = (a.position + b.position + c.position) / 3.0;
        triangle.piece(position, a.normal + b.normal + c.normal, area)
    }

    /// The same with its longest edge first.
    fn turned(self) -> Self {
        let Self { corners: [a, b, c], edges: [ab, bc, ca] } = self;
        if ab >= bc && ab >= ca {
            self
        } else if bc >= ca {
            Self { corners: [b, c, a], edges: [bc, ca, ab] }
        } else {
            Self { corners: [c, a, b], edges: [ca, ab, bc] }
        }
    }

    /// Both halves, cut across the longest edge.
    fn halves(self) -> [Self; 2] {
        let Self { corners: [a, b, c], edges: [ab, bc, ca] } = self.turned();
        let middle = Corner { position: 0.5 * (a.position + b.position), normal: 0.5 * (a.normal + b.normal) };
        let (half, cut) = (0.25 * ab, middle.position.distance_squared(c.position));
        [
            Self { corners: [a, middle, c], edges: [half, cut, ca] },
            Self { corners: [middle, b, c], edges: [half, bc, cut] },
        ]
    }
}

/// Halves a piece of a triangle until it is small enough.
fn split(piece: Piece, path: u32, area: f32, stride: f32, out: &mut impl FnMut(&Piece, u32, f32)) {
    if area <= stride {
        return out(&piece, path, area);
    }
    for (half, bit) in piece.halves().into_iter().zip(0..) {
        split(half, path << 1 | bit, 0.5 * area, stride, out);
    }
}

/// A piece of a triangle of the surface.
pub struct SurfacePiece<'a> {
    triangle: &'a SurfaceTriangle,
    piece: Piece,
    /// Which it is.
    pub origin: Origin,
    /// m².
    pub area: f32,
}

impl<'a> SurfacePiece<'a> {
    /// The piece with a known origin and area.
    pub fn at(surface: &'a Surface, origin: Origin, area: f32) -> Self {
        let triangle = &surface.triangles()[origin.triangle as usize];
        Self { triangle, piece: Piece::at(triangle, origin.path), origin, area }
    }

    /// Its centroid, and how far its corners are from that at most.
    pub fn ball(&self) -> (Vec3, f32) {
        let [a, b, c] = self.piece.corners.map(|corner| corner.position);
        let centroid = (a + b + c) / 3.0;
        (centroid, [a, b, c].map(|p| p.distance_squared(centroid)).into_iter().fold(0.0, f32::max).sqrt())
    }

    /// Both halves.
    pub fn halves(&self) -> [Self; 2] {
        let [a, b] = self.piece.halves();
        [(a, 0), (b, 1)].map(|(piece, bit)| Self {
            triangle: self.triangle,
            piece,
            origin: Origin { triangle: self.origin.triangle, path: self.origin.path << 1 | bit },
            area: 0.5 * self.area,
        })
    }

    /// Calls `visit` with points that cover it, each for about `stride` m²: the centroids of congruent triangles, row by row.
    pub fn divide(&self, stride: f32, mut visit: impl FnMut(SurfacePoint)) {
        let rows = (self.area / stride).sqrt().round().max(1.0) as u32;
        let (step, area) = (1.0 / rows as f32, self.area / (rows * rows) as f32);
        let [a, b, c] = self.piece.corners;
        let mut centroid = |i: f32, j: f32| {
            let (s, t) = (i * step, j * step);
            let mix = |a: Vec3, b: Vec3, c: Vec3| a + s * (b - a) + t * (c - a);
            let position = mix(a.position, b.position, c.position);
            visit(self.triangle.piece(position, mix(a.normal, b.normal, c.normal), area));
        };
        for row in 0..rows {
            for column in 0..rows - row {
                centroid(column as f32 + 1.0 / 3.0, row as f32 + 1.0 / 3.0);
                if column + 1 < rows - row {
                    centroid(column as f32 + 2.0 / 3.0, row as f32 + 2.0 / 3.0);
                }
            }
        }
    }
}

/// A triangle and its area, m².
type WithArea<'a> = (&'a SurfaceTriangle, f32);

/// Systematic sampling: one random point in the triangle at every `stride` of accumulated area.
fn draw_along_order(fine: Vec<WithArea>, stride: f32, rng: &mut ChaCha8Rng, out: &mut Vec<SurfacePoint>) {
    let total: f64 = fine.iter().map(|(_, area)| f64::from(*area)).sum();
    if fine.is_empty() || total <= 0.0 {
        return;
    }
    let count = (total / f64::from(stride)).ceil().max(1.0);
    let step = total / count;
    let (mut accumulated, mut next) = (0.0, rng.random::<f64>() * step);
    for (triangle, area) in in_space_filling_order(fine) {
        accumulated += f64::from(area);
        while next < accumulated {
            out.push(triangle.point(random_barycentric(rng), step as f32));
            next += step;
        }
    }
}

fn in_space_filling_order(triangles: Vec<WithArea>) -> impl Iterator<Item = WithArea> {
    let corners = || triangles.iter().flat_map(|(t, _)| t.corners);
    let (low, high) = (corners().fold(Vec3::INFINITY, Vec3::min), corners().fold(Vec3::NEG_INFINITY, Vec3::max));
    let extent = (high - low).max_element();
    let key = |t: &SurfaceTriangle| {
        let normal = t.normals[0] + t.normals[1] + t.normals[2];
        morton::key((t.corners[0] + t.corners[1] + t.corners[2]) / 3.0, normal, low, extent)
    };
    let keys = parallel::map(&triangles, &|(triangle, _)| key(triangle));
    let mut keyed: Vec<(u64, WithArea)> = keys.into_iter().zip(triangles).collect();
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
            [(Shape::Plane(Plane { size: [2.0, 1.0] }), 1e-3), (Shape::Sphere(Sphere::of_radius(1.0)), 5e-3)]
        {
            let surface = surface(shape);
            let candidates = cover(&surface, stride, &mut ChaCha8Rng::seed_from_u64(1)).points;
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
        let surface = surface(Shape::Sphere(Sphere::of_radius(1.0)));
        let candidates = cover(&surface, surface.area() as f32 / 1000.0, &mut ChaCha8Rng::seed_from_u64(1)).points;
        assert!(candidates.len().abs_diff(1000) <= 1, "{}", candidates.len());
    }
}
