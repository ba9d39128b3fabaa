//! The moments of a cell up to second order, which add up from part to whole, and the differential sample that they lead to.

use glam::{Mat3, Vec2, Vec3};

use super::point::CellPoint;
use crate::differential::{Symmetric2, tangent_frame};

/// Area-weighted moments of positions and normals about their means.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moments {
    area: f32,
    position: Vec3,
    normal: Vec3,
    /// Σ a (p − p̄)(p − p̄)ᵀ.
    positions: Mat3,
    /// Σ a (p − p̄)(n − n̄)ᵀ.
    normals: Mat3,
    /// Σ a²/12: the extent of the pieces that the points stand for, as squares.
    pieces: f32,
    /// Number of points.
    count: u32,
}

/// A node's surface, in the frame of its normal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit {
    pub centroid: Vec3,
    pub normal: Vec3,
    pub area: f32,
    pub sides: [Vec2; 2],
    pub curvature: Symmetric2,
}

/// Fewer points than these say nothing about curvature.
const LEAST_FOR_CURVATURE: u32 = 4;

/// a bᵀ.
fn outer(a: Vec3, b: Vec3) -> Mat3 {
    Mat3::from_cols(a * b.x, a * b.y, a * b.z)
}

impl Moments {
    /// Of points that are not empty.
    pub fn of<'a>(points: impl Iterator<Item = &'a CellPoint> + Clone) -> Self {
        let area: f32 = points.clone().map(|p| p.area).sum();
        // Relative to the first point, so that nothing cancels far from the origin.
        let origin = points.clone().next().expect("a cell has points").position();
        let mean = |of: &dyn Fn(&CellPoint) -> Vec3| points.clone().map(|p| p.area * of(p)).sum::<Vec3>() / area;
        let position = origin + mean(&|p| p.position() - origin);
        let normal = mean(&|p| p.normal());
        let (positions, normals) = (Mat3::ZERO, Mat3::ZERO);
        let mut moments = Self { area, position, normal, positions, normals, pieces: 0.0, count: 0 };
        for p in points {
            let x = p.area * (p.position() - position);
            moments.positions += outer(x, p.position() - position);
            moments.normals += outer(x, p.normal() - normal);
            moments.pieces += p.area * p.area / 12.0;
            moments.count += 1;
        }
        moments
    }

    /// Of two cells together.
    pub fn join(self, other: Self) -> Self {
        let area = self.area + other.area;
        let (f, part) = (self.area * other.area / area, other.area / area);
        let (x, n) = (other.position - self.position, other.normal - self.normal);
        Self {
            area,
            position: self.position + part * x,
            normal: self.normal + part * n,
            positions: self.positions + other.positions + outer(f * x, x),
            normals: self.normals + other.normals + outer(f * x, n),
            pieces: self.pieces + other.pieces,
            count: self.count + other.count,
        }
    }

    /// The same cell, standing for another area.
    #[must_use]
    pub fn with_area(self, area: f32) -> Self {
        let scale = area / self.area;
        Self {
            area,
            positions: self.positions * scale,
            normals: self.normals * scale,
            pieces: self.pieces * scale * scale,
            ..self
        }
    }

    /// The differential sample with these moments (see `differential::fit`).
    pub fn fit(&self) -> Fit {
        let normal = self.normal.try_normalize().unwrap_or(Vec3::Y);
        let [u, v] = tangent_frame(normal);
        let spread =
            Symmetric2 { xx: u.dot(self.positions * u), xy: u.dot(self.positions * v), yy: v.dot(self.positions * v) };
        let curvature = self.curvature(spread, u, v);
        let own = self.pieces / self.area;
        let variance = |sum: f32, own: f32| sum / self.area + own;
        let c = Symmetric2 { xx: variance(spread.xx, own), xy: variance(spread.xy, 0.0), yy: variance(spread.yy, own) };
        // A paraboloid's mean height over the cell is ½ tr(∇n·C) below its apex: lift the centroid back.
        let lift = 0.5 * (curvature.xx * c.xx + 2.0 * curvature.xy * c.xy + curvature.yy * c.yy);
        // Cholesky's factor of the sides' moments.
        let e11 = (12.0 * c.xx).max(1e-20).sqrt();
        let e21 = 12.0 * c.xy / e11;
        let e22 = (12.0 * c.yy - e21 * e21).max(0.0).sqrt();
        Fit {
            centroid: self.position + lift * normal,
            normal,
            area: self.area,
            sides: [Vec2::new(e11, e21), Vec2::new(0.0, e22)],
            curvature,
        }
    }

    /// Linear regression of the normals' tangential part, symmetrised; none where the points lie on a line.
    fn curvature(&self, spread: Symmetric2, u: Vec3, v: Vec3) -> Symmetric2 {
        let trace = spread.xx + spread.yy;
        let determinant = spread.determinant();
        if self.count < LEAST_FOR_CURVATURE || determinant <= 1e-4 * trace * trace {
            return Symmetric2::default();
        }
        let along = |t: Vec3| {
            let n = self.normals.transpose() * t;
            Vec2::new(n.dot(u), n.dot(v))
        };
        let (along_x, along_y) = (along(u), along(v));
        let by_u = (spread.yy * along_x - spread.xy * along_y) / determinant;
        let by_v = (spread.xx * along_y - spread.xy * along_x) / determinant;
        Symmetric2 { xx: by_u.x, xy: 0.5 * (by_u.y + by_v.x), yy: by_v.y }
    }
}
