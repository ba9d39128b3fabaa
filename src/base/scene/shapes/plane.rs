//! The rectangle.

use glam::Vec3;

use super::{Parts, Plane};

pub(super) fn plane(plane: &Plane) -> Parts {
    let [x, z] = plane.size.map(|s| 0.5 * s);
    let mut parts = Parts::default();
    let corners = [(-x, z), (x, z), (x, -z), (-x, -z)].map(|(x, z)| parts.vertex(Vec3::new(x, 0.0, z), Vec3::Y));
    parts.quad(corners);
    parts
}
