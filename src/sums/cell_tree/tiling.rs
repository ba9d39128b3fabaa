//! Which part of the surface belongs to which sample: the candidates of a point set, divided where cells meet.

use std::borrow::Cow;

use glam::Vec3;

use super::point::CellPoint;
use crate::differential::{Cells, NearestSample, nearest_samples};
use crate::parallel;
use crate::sampling::{Origin, PointSet, Surface, SurfacePiece, SurfacePoint};

/// The cells of a set's samples. What lies inside a cell is kept as pieces of triangles, which become points when they are needed.
pub(super) struct Tiling<'a> {
    surface: &'a Surface,
    /// A point stands for about so much, m².
    stride: f32,
    pieces: Vec<(Origin, f32)>,
    pieces_of: Cells,
    points: Vec<CellPoint>,
    points_of: Cells,
}

/// Parts of cells, and the samples that they belong to.
#[derive(Default)]
struct Parts {
    /// Pieces and their areas, m².
    pieces: Vec<(Origin, f32)>,
    piece_samples: Vec<u32>,
    points: Vec<CellPoint>,
    point_samples: Vec<u32>,
    /// Points whose cells are not known yet.
    loose: Vec<SurfacePoint>,
}

/// Pieces with fewer points are not divided further to see whether one cell holds them.
const FEW_POINTS: f32 = 5.0;
/// Candidates that one thread takes in a row.
const RUN: usize = 4096;

impl<'a> Tiling<'a> {
    /// Divides a surface among the samples of a set.
    pub fn new(surface: &'a Surface, set: &PointSet, stride: f32, seed: u64) -> Self {
        let samples = NearestSample::new(&set.points);
        let nearest: Cow<[u32]> = match set.nearest_samples.as_slice() {
            [] => nearest_samples(&samples, &set.candidates).into(),
            nearest => nearest.into(),
        };
        let divider = Divider { set, samples: &samples, stride };
        let starts: Vec<usize> = (0..set.candidates.len()).step_by(RUN).collect();
        let of_run = |&first: &usize| {
            let mut parts = Parts::default();
            for candidate in first..(first + RUN).min(set.candidates.len()) {
                divider.add(surface, candidate, nearest[candidate], &mut parts);
            }
            parts
        };
        let runs: Vec<Parts> = parallel::map(&starts, &of_run);
        let mut parts = runs.into_iter().fold(Parts::default(), Parts::join);
        parts.loose.extend(set.on_fine_triangles(surface, stride, seed));
        parts.point_samples.extend(nearest_samples(&samples, &parts.loose));
        parts.points.extend(parts.loose.iter().map(CellPoint::from));
        Self {
            surface,
            stride,
            pieces_of: Cells::new(set.points.len(), &parts.piece_samples),
            pieces: parts.pieces,
            points_of: Cells::new(set.points.len(), &parts.point_samples),
            points: parts.points,
        }
    }

    /// The samples whose cells are not empty.
    pub fn samples(&self) -> Vec<u32> {
        let cells = self.pieces_of.iter().zip(self.points_of.iter());
        cells.zip(0..).filter(|((a, b), _)| !a.is_empty() || !b.is_empty()).map(|(_, sample)| sample).collect()
    }

    /// Puts the points of a sample's cell in place of those that are there.
    pub fn collect(&self, sample: u32, points: &mut Vec<CellPoint>) {
        points.clear();
        for &k in self.pieces_of.of(sample) {
            let (origin, area) = self.pieces[k as usize];
            let piece = SurfacePiece::at(self.surface, origin, area);
            piece.divide(self.stride, |point| points.push(CellPoint::from(&point)));
        }
        points.extend(self.points_of.of(sample).iter().map(|&k| self.points[k as usize]));
    }
}

impl Parts {
    fn join(mut self, other: Self) -> Self {
        self.pieces.extend(other.pieces);
        self.piece_samples.extend(other.piece_samples);
        self.points.extend(other.points);
        self.point_samples.extend(other.point_samples);
        self.loose.extend(other.loose);
        self
    }

    fn add_piece(&mut self, piece: &SurfacePiece, sample: u32) {
        self.pieces.push((piece.origin, piece.area));
        self.piece_samples.push(sample);
    }
}

/// Divides candidates among cells.
struct Divider<'a> {
    set: &'a PointSet,
    samples: &'a NearestSample<'a>,
    stride: f32,
}

impl Divider<'_> {
    /// Adds what a candidate whose nearest sample is `sample` stands for, unless it was drawn on fine triangles.
    fn add(&self, surface: &Surface, candidate: usize, sample: u32, parts: &mut Parts) {
        let Some(piece) = self.set.piece(surface, candidate) else { return };
        let candidate = &self.set.candidates[candidate];
        match self.samples.around(candidate, sample, piece.ball().1) {
            Some(competitors) => self.divide(&piece, &competitors, parts),
            None => piece.divide(self.stride, |point| {
                parts.loose.push(SurfacePoint { group: candidate.group, ..point });
            }),
        }
    }

    /// Adds a piece to the cell that holds it, or divides it among those of these samples.
    fn divide(&self, piece: &SurfacePiece, competitors: &[u32], parts: &mut Parts) {
        let (centre, radius) = piece.ball();
        let nearest = self.nearest(centre, competitors);
        let reach = centre.distance(self.position(nearest)) + 2.0 * radius;
        let is_near = |k: &u32| centre.distance_squared(self.position(*k)) < reach * reach;
        let competitors: Vec<u32> = competitors.iter().copied().filter(is_near).collect();
        if competitors.len() < 2 {
            parts.add_piece(piece, nearest);
        } else if piece.area > FEW_POINTS * self.stride {
            piece.halves().iter().for_each(|half| self.divide(half, &competitors, parts));
        } else {
            piece.divide(self.stride, |point| {
                parts.points.push(CellPoint::from(&point));
                parts.point_samples.push(self.nearest(point.position, &competitors));
            });
        }
    }

    fn position(&self, sample: u32) -> Vec3 {
        self.set.points[sample as usize].position
    }

    fn nearest(&self, place: Vec3, among: &[u32]) -> u32 {
        let distance2 = |k: &u32| place.distance_squared(self.position(*k));
        let nearer = |a: &&u32, b: &&u32| distance2(a).total_cmp(&distance2(b));
        *among.iter().min_by(nearer).expect("every piece has a nearest sample")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Options, Strategy, sample};
    use crate::scene::shapes::{Ring, Shape, Sphere, Spoon};

    /// Coarse triangles, some as large as candidates, and ones that are finer than those; from strategies that know their cells and
    /// one that does not.
    #[test]
    fn cells_hold_what_is_nearest_to_their_samples() {
        let shapes = [
            Shape::Ring(Ring::default()),
            Shape::Sphere(Sphere::of_radius(1.0)),
            Shape::Spoon(Spoon { thickness: 0.004, ..Default::default() }),
        ];
        for (shape, samples, strategy) in [
            (&shapes[0], 300, Strategy::Neighbourhood),
            (&shapes[1], 1000, Strategy::Neighbourhood),
            (&shapes[1], 100, Strategy::Neighbourhood),
            (&shapes[2], 500, Strategy::Neighbourhood),
            (&shapes[0], 300, Strategy::Random),
        ] {
            let mut surface = Surface::default();
            surface.append(&shape.mesh().unwrap(), 0, false);
            let set = sample(&surface, &Options { samples, strategy, seed: 1 }).unwrap();
            let stride = (surface.area() / f64::from(1000 * samples)) as f32;
            let tiling = Tiling::new(&surface, &set, stride, 1);
            let (mut area, mut count, mut nearer, mut points) = (0.0, 0, 0, Vec::new());
            for sample in tiling.samples() {
                tiling.collect(sample, &mut points);
                area += points.iter().map(|p| f64::from(p.area)).sum::<f64>();
                for p in points.iter().step_by(17) {
                    let own = p.position().distance(set.points[sample as usize].position);
                    let is_nearer = |other: &&SurfacePoint| {
                        other.normal.dot(p.normal()) > 0.0 && other.position.distance(p.position()) < 0.999 * own
                    };
                    count += 1;
                    nearer += usize::from(set.points.iter().any(|other| is_nearer(&other)));
                }
            }
            let name = shape.name();
            assert!((area / surface.area() - 1.0).abs() < 1e-3, "{name} {samples}: {area}");
            // Samples across a crease or with little in common in their normals may be nearer.
            assert!(nearer * 50 <= count, "{name} {samples}: {nearer} of {count}");
        }
    }
}
