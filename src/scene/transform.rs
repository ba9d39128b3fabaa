//! An object's placement: scale first, then turns about x, y and z, then the move.

use glam::{Mat3, Vec3};

/// Places an object in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// Uniform scale; not zero. A negative scale mirrors and keeps the front side in front.
    pub scale: f32,
    /// Counter-clockwise turns about x, then y, then z, radians.
    pub rotate_rad: Vec3,
    /// Metres.
    pub translate: Vec3,
}

impl Default for Transform {
    fn default() -> Self {
        Self { scale: 1.0, rotate_rad: Vec3::ZERO, translate: Vec3::ZERO }
    }
}

impl Transform {
    /// The rotation alone.
    pub fn rotation(&self) -> Mat3 {
        Mat3::from_rotation_z(self.rotate_rad.z)
            * Mat3::from_rotation_y(self.rotate_rad.y)
            * Mat3::from_rotation_x(self.rotate_rad.x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Mesh;
    use std::f32::consts::FRAC_PI_2;

    /// A triangle's first corner and its normal, placed.
    fn placed(place: &Transform, corner: Vec3, normal: Vec3) -> (Vec3, Vec3) {
        let positions = vec![corner, corner + Vec3::new(0.1, 0.2, 0.3), corner - Vec3::new(0.2, 0.1, 0.3)];
        let (mesh, _) = Mesh::new("m", positions, vec![normal; 3], vec![[0, 1, 2]]).unwrap();
        let (mesh, _) = mesh.placed(place, "m").unwrap();
        (mesh.positions()[0], mesh.normals()[0])
    }

    #[test]
    fn turns_are_counter_clockwise_and_x_comes_first() {
        let turn = Transform { rotate_rad: Vec3::new(FRAC_PI_2, FRAC_PI_2, 0.0), ..Default::default() };
        // +Y goes to +Z by the turn about x, and +Z to +X by the turn about y.
        let (position, normal) = placed(&turn, Vec3::Y, Vec3::Y);
        assert!(position.abs_diff_eq(Vec3::X, 1e-6) && normal.abs_diff_eq(Vec3::X, 1e-6));
    }

    #[test]
    fn scale_comes_before_the_move() {
        let place = Transform { scale: 2.0, translate: Vec3::X, ..Default::default() };
        assert!(placed(&place, Vec3::Y, Vec3::Y).0.abs_diff_eq(Vec3::new(1.0, 2.0, 0.0), 1e-6));
    }
}
