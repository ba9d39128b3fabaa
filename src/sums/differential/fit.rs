//! The fit of one cell: area moments and the linear regression of the normal (Wand & Straßer, Section 3.3).

use std::ops::Deref;

use glam::{Vec2, Vec3};

use super::symmetric::Symmetric2;
use super::{Cell, DifferentialSample, PointTree, SurfacePoint, tangent_frame};

/// Fewer members than these give no stable regression; the nearest candidates stand in.
const MIN_REGRESSION: usize = 8;

/// Fits a sample's cell; `None` where no candidate is nearest to it, so that it stands for nothing.
pub(super) fn fit(
    point: &SurfacePoint,
    members: &[u32],
    candidates: &[SurfacePoint],
    tree: &impl Deref<Target = PointTree>,
) -> Option<DifferentialSample> {
    let area: f32 = members.iter().map(|&m| candidates[m as usize].area).sum();
    if area <= 0.0 {
        return None;
    }
    // Members across a crease lend their area but do not enter the fit.
    let own: Vec<&SurfacePoint> =
        members.iter().map(|&m| &candidates[m as usize]).filter(|m| belongs(m, point)).collect();
    let own = if own.is_empty() { vec![point] } else { own };
    let moments = Moments::of(&own);
    let gradient = if own.len() >= MIN_REGRESSION {
        moments.normal_gradient(&own)
    } else {
        let near: Vec<&SurfacePoint> =
            tree.nearest(point.position, 24).map(|(_, k)| &candidates[k]).filter(|c| belongs(c, point)).collect();
        if near.len() >= 3 { moments.normal_gradient(&near) } else { None }
    }
    .unwrap_or_default();

    let (curvatures, direction) = gradient.eigen();
    let covariance = moments.covariance_with_pieces(&own, area);
    // A paraboloid's mean height over the cell is ½ tr(∇n·C) below its apex: lift the centroid back.
    let lift = 0.5 * (gradient.xx * covariance.xx + 2.0 * gradient.xy * covariance.xy + gradient.yy * covariance.yy);
    let (variances, axis) = covariance.eigen();
    let sides = [(variances[0], axis), (variances[1], axis.perp())]
        .map(|(variance, axis)| moments.in_world((12.0 * variance.max(0.0)).sqrt() * axis));
    Some(DifferentialSample {
        position: point.position,
        normal: point.normal,
        area: point.area,
        object: point.object,
        cell: Cell { area, centroid: moments.centroid + lift * moments.normal, normal: moments.normal, sides },
        curvatures,
        directions: [moments.in_world(direction), moments.in_world(direction.perp())],
    })
}

/// Whether a candidate lies on the same smooth piece of surface.
fn belongs(candidate: &SurfacePoint, point: &SurfacePoint) -> bool {
    candidate.patch == point.patch && candidate.normal.dot(point.normal) > 0.0
}

/// Centroid and tangent plane of a set of weighted points.
struct Moments {
    centroid: Vec3,
    normal: Vec3,
    frame: [Vec3; 2],
}

impl Moments {
    fn of(points: &[&SurfacePoint]) -> Self {
        let area: f32 = points.iter().map(|p| p.area).sum::<f32>().max(f32::MIN_POSITIVE);
        // Relative to the first point, so that nothing cancels far from the origin.
        let origin = points[0].position;
        let centroid = origin + points.iter().map(|p| p.area * (p.position - origin)).sum::<Vec3>() / area;
        let normal = points.iter().map(|p| p.area * p.normal).sum::<Vec3>().try_normalize().unwrap_or(points[0].normal);
        Self { centroid, normal, frame: tangent_frame(normal) }
    }

    fn in_plane(&self, v: Vec3) -> Vec2 {
        Vec2::new(v.dot(self.frame[0]), v.dot(self.frame[1]))
    }

    fn in_world(&self, v: Vec2) -> Vec3 {
        v.x * self.frame[0] + v.y * self.frame[1]
    }

    /// Linear regression of the normals' tangential part over the tangent plane, symmetrised; `None` where the points
    /// lie on a line.
    fn normal_gradient(&self, points: &[&SurfacePoint]) -> Option<Symmetric2> {
        let weight: f32 = points.iter().map(|p| p.area).sum();
        let at = |p: &SurfacePoint| self.in_plane(p.position - self.centroid);
        let mean = points.iter().map(|p| p.area * at(p)).sum::<Vec2>() / weight;
        let mean_normal = points.iter().map(|p| p.area * self.in_plane(p.normal)).sum::<Vec2>() / weight;
        let mut spread = Symmetric2::default();
        let (mut along_x, mut along_y) = (Vec2::ZERO, Vec2::ZERO);
        for p in points {
            let (u, n) = (at(p) - mean, self.in_plane(p.normal) - mean_normal);
            spread.xx += p.area * u.x * u.x;
            spread.xy += p.area * u.x * u.y;
            spread.yy += p.area * u.y * u.y;
            along_x += p.area * u.x * n;
            along_y += p.area * u.y * n;
        }
        let determinant = spread.determinant();
        if determinant <= 1e-4 * (spread.xx + spread.yy).powi(2) {
            return None;
        }
        let by_u = (spread.yy * along_x - spread.xy * along_y) / determinant;
        let by_v = (spread.xx * along_y - spread.xy * along_x) / determinant;
        Some(Symmetric2 { xx: by_u.x, xy: 0.5 * (by_u.y + by_v.x), yy: by_v.y })
    }

    /// Covariance of the cell's area: that of its points plus that of the piece each stands for (a square of its area).
    fn covariance_with_pieces(&self, points: &[&SurfacePoint], cell_area: f32) -> Symmetric2 {
        if points.len() < 4 {
            // Too few to have a shape: a square.
            return Symmetric2 { xx: cell_area / 12.0, xy: 0.0, yy: cell_area / 12.0 };
        }
        let area: f32 = points.iter().map(|p| p.area).sum();
        let mut c = Symmetric2::default();
        for p in points {
            let (u, w) = (self.in_plane(p.position - self.centroid), p.area / area);
            c.xx += w * (u.x * u.x + p.area / 12.0);
            c.xy += w * u.x * u.y;
            c.yy += w * (u.y * u.y + p.area / 12.0);
        }
        c
    }
}
