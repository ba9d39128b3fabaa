//! A region of a mirror or an interface as a receiver sees it: bounds of what counts at both. It knows neither materials nor light.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::DVec3;

use super::cone::{Cone, angle};
use super::domain::{Place, Receiver};
use super::tree::Bounds;

/// The least distance that counts for bounds, in radii of the region: for receivers on surfaces, which touch others in creases only,
const LEAST_ON_SURFACES: f64 = 0.25;
/// and in the medium, where each line of sight to a mirror ends on it. Nearer to the region a point may exceed its bound; the smaller
/// this is, the finer is the cut there, and the rarer and smaller is what exceeds it.
const LEAST_IN_MEDIUM: f64 = 0.03;

#[derive(Clone, Copy)]
/// A corner of a region: from the receiver's position to it, and its unit normal.
pub(super) struct Corner {
    pub offset: DVec3,
    pub normal: DVec3,
}

/// A region as a receiver sees it: a point, or all points of a piece of a line of sight.
pub(super) struct Seen {
    pub bounds: Bounds,
    /// Directions from the receiver.
    pub towards: Cone,
    /// The largest part of the light that counts at the receiver: the cosine on a surface.
    pub received: f64,
    /// The least distance, m, and that of the centre.
    pub nearest: f64,
    pub distance: f64,
    /// By how much the direction from a point of the region to a point of the receiver may differ from that to the receiver's position,
    /// radians.
    pub swing: f64,
    /// Its triangle, if it is no more than that, and the corners of what it is of it.
    pub triangle: Option<u32>,
    pub corners: Option<[Corner; 3]>,
}

impl Seen {
    pub fn new(bounds: Bounds, receiver: &Receiver) -> Self {
        let to_centre = bounds.centre - receiver.position;
        let distance = receiver.distance(bounds.centre);
        // Within its own sphere a region has no direction; further out the distance is at least this.
        let least = if matches!(receiver.place, Place::Surface { .. }) { LEAST_ON_SURFACES } else { LEAST_IN_MEDIUM };
        let nearest = (distance - bounds.radius).max(least * bounds.radius);
        let inside = distance <= bounds.radius;
        let around = |to: DVec3| {
            let distance = to.length();
            Cone { axis: to / distance, half_angle: (bounds.radius / distance).asin() }
        };
        let half_length = receiver.half_length();
        let (towards, swing) = match receiver.place {
            Place::Surface { normal, .. } if inside => (Cone { axis: normal, half_angle: PI }, 0.0),
            Place::Medium { .. } if inside => (Cone::everything(), PI),
            Place::Medium { .. } if half_length > 0.0 => {
                let [near, far] = [half_length, -half_length].map(|along| around(to_centre - along * receiver.view));
                let both = near.union(far);
                // A cone that is narrower than a half-space holds all between two.
                let towards = if both.half_angle < FRAC_PI_2 { both } else { Cone::everything() };
                let sine = half_length * sine_to_line(to_centre, bounds.radius, receiver.view) / nearest;
                (towards, sine.min(1.0).asin().min(2.0 * towards.half_angle))
            }
            _ => (around(to_centre), 0.0),
        };
        let received = receiver.most_received(&towards);
        Self { bounds, towards, received, nearest, distance, swing, triangle: None, corners: None }
    }

    /// The least distance, m, even where that means little for directions.
    pub fn gap(&self) -> f64 {
        (self.distance - self.bounds.radius).max(0.0)
    }

    /// A bound of both cosines for a surface that lights one of its sides only.
    pub fn cosines_on_one_side(&self, facing: f64, receiver: &Receiver) -> f64 {
        let Place::Surface { normal, .. } = receiver.place else {
            return self.nearer_cosines(self.received * facing, false, receiver);
        };
        // Light can go between two sides of a surface only as far as their normals differ: d̂·n_p > 0 > d̂·n makes
        // both cosines at most |n_p − n|. That keeps a mirror that receives its own light from being singular.
        let normals = &self.bounds.normals;
        let apart = (angle(normals.axis, normal) + normals.half_angle).min(PI);
        let limit = 2.0 * (0.5 * apart).sin();
        self.nearer_cosines(self.received.min(limit) * facing.min(limit), false, receiver)
    }

    /// At most the bound of both cosines that is known already. Where the receiver is so near that directions say little: heights over
    /// its plane and under the surface's normals are (bi)linear, so their largest values are at corners, and at the ends of a piece.
    pub fn nearer_cosines(&self, known: f64, two_sided: bool, receiver: &Receiver) -> f64 {
        let Some(corners) = self.corners.as_ref().filter(|_| self.distance < 4.0 * self.bounds.radius) else {
            return known;
        };
        let half_length = receiver.half_length();
        let height = |n: DVec3| {
            let over_middle = corners.iter().map(|c| n.dot(c.offset)).fold(f64::NEG_INFINITY, f64::max);
            (over_middle + half_length * n.dot(receiver.view).abs()).max(0.0)
        };
        let mut under_surface = corners.iter().map(|c| height(-c.normal)).fold(0.0, f64::max);
        if two_sided {
            under_surface = corners.iter().map(|c| height(c.normal)).fold(under_surface, f64::max);
        }
        let shortest = self.bounds.normals.half_angle.cos().max(0.1);
        let nearer = match receiver.place {
            Place::Surface { normal, .. } => height(normal) * under_surface / shortest / (self.nearest * self.nearest),
            Place::Medium { .. } => self.received * under_surface / shortest / self.nearest,
        };
        known.min(nearer)
    }
}

/// At least the sine of the angle between a line and the direction from one of its points to any point of a sphere.
pub(super) fn sine_to_line(to_centre: DVec3, radius: f64, line: DVec3) -> f64 {
    let distance = to_centre.length();
    if distance <= radius { 1.0 } else { ((to_centre.cross(line).length() + radius) / distance).min(1.0) }
}
