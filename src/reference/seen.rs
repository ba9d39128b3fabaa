//! A region of a mirror or an interface as a receiver sees it: bounds of the cosines at both. It knows neither materials nor light.

use std::f64::consts::PI;

use glam::DVec3;

use super::cone::{Cone, angle};
use super::domain::Receiver;
use super::tree::Bounds;

#[derive(Clone, Copy)]
/// A corner of a region: from the receiver to it, and its unit normal.
pub(super) struct Corner {
    pub offset: DVec3,
    pub normal: DVec3,
}

/// A region as a receiver sees it.
pub(super) struct Seen {
    pub bounds: Bounds,
    /// Directions from the receiver.
    pub towards: Cone,
    /// The largest cosine at the receiver.
    pub received: f64,
    /// The least distance, m, and that of the centre.
    pub nearest: f64,
    pub distance: f64,
    /// Of a triangle, or of a part of one.
    pub corners: Option<[Corner; 3]>,
}

impl Seen {
    /// A bound of both cosines for a surface that lights one of its sides only.
    pub fn cosines_on_one_side(&self, facing: f64, receiver: &Receiver) -> f64 {
        // Light can go between two sides of a surface only as far as their normals differ: d̂·n_p > 0 > d̂·n makes
        // both cosines at most |n_p − n|. That keeps a mirror that receives its own light from being singular.
        let normals = &self.bounds.normals;
        let apart = (angle(normals.axis, receiver.normal) + normals.half_angle).min(PI);
        let limit = 2.0 * (0.5 * apart).sin();
        self.nearer_cosines(self.received.min(limit) * facing.min(limit), false, receiver)
    }

    /// At most the bound of both cosines that is known already. Where the receiver is so near that directions say little: heights over
    /// its plane and under the surface's normals are (bi)linear, so their largest values are at corners.
    pub fn nearer_cosines(&self, known: f64, two_sided: bool, receiver: &Receiver) -> f64 {
        let Some(corners) = self.corners.as_ref().filter(|_| self.distance < 4.0 * self.bounds.radius) else {
            return known;
        };
        let height = |n: DVec3| corners.iter().map(|c| n.dot(c.offset)).fold(0.0, f64::max);
        let over_receiver = height(receiver.normal);
        let mut under_surface = corners.iter().map(|c| height(-c.normal)).fold(0.0, f64::max);
        if two_sided {
            under_surface = corners.iter().map(|c| height(c.normal)).fold(under_surface, f64::max);
        }
        let shortest = self.bounds.normals.half_angle.cos().max(0.1);
        known.min(over_receiver * under_surface / shortest / (self.nearest * self.nearest))
    }
}
