//! The box.

use glam::Vec3;

use super::{Cuboid, Parts};

pub(super) fn cuboid(cuboid: &Cuboid) -> Parts {
    let half = 0.5 * Vec3::from_array(cuboid.size);
    let mut parts = Parts::default();
    for axis in Vec3::AXES {
        for normal in [axis, -axis] {
            let u = if axis == Vec3::X { Vec3::Y } else { Vec3::X };
            // Counter-clockwise seen from outside.
            let v = normal.cross(u);
            let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
            let corners = corners.map(|(s, t)| parts.vertex((normal + s * u + t * v) * half, normal));
            parts.quad(corners);
        }
    }
    parts
}
