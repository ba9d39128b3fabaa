//! An object's placement: scale first, then rotations about x, y and z, then translation.

use glam::{EulerRot, Mat3, Vec3};

/// Places an object in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// Uniform scale; not zero. A negative scale mirrors the object, and keeps its front side the front side.
    pub scale: f32,
    /// Counter-clockwise rotations about x, then y, then z, radians.
    pub rotate_rad: Vec3,
    /// Translation, metres.
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

    /// The same placement, turned about an axis of the world through its origin, counter-clockwise.
    #[must_use]
    pub fn turned(&self, axis: Vec3, angle_rad: f32) -> Self {
        let rotation = Mat3::from_axis_angle(axis, angle_rad) * self.rotation();
        let (z, y, x) = rotation.to_euler(EulerRot::ZYX);
        Self { rotate_rad: Vec3::new(x, y, z), ..*self }
    }

    /// A point from object to world space.
    pub fn point_in_world(&self, point_in_object: Vec3) -> Vec3 {
        self.rotation() * (self.scale * point_in_object) + self.translate
    }

    /// A unit normal from object to world space.
    pub fn normal_in_world(&self, normal_in_object: Vec3) -> Vec3 {
        self.rotation() * (normal_in_object * self.scale.signum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::FRAC_PI_2;

    #[test]
    fn turns_are_counter_clockwise_and_x_comes_first() {
        let turn = Transform { rotate_rad: Vec3::new(FRAC_PI_2, FRAC_PI_2, 0.0), ..Default::default() };
        // The rotation about x takes +Y to +Z, and that about y takes +Z to +X.
        assert!(turn.point_in_world(Vec3::Y).abs_diff_eq(Vec3::X, 1e-6));
    }

    #[test]
    fn placements_are_turned_about_the_worlds_axes() {
        let placement = Transform { rotate_rad: Vec3::new(0.4, -1.1, 2.0), translate: Vec3::X, scale: 2.0 };
        for axis in Vec3::AXES {
            let turned = placement.turned(axis, 0.3);
            for point in Vec3::AXES {
                let offset = placement.point_in_world(point) - Vec3::X;
                let expected = Vec3::X + Mat3::from_axis_angle(axis, 0.3) * offset;
                assert!(turned.point_in_world(point).abs_diff_eq(expected, 1e-5));
            }
        }
    }

    #[test]
    fn scale_comes_before_the_move() {
        let place = Transform { scale: 2.0, translate: Vec3::X, ..Default::default() };
        assert!(place.point_in_world(Vec3::Y).abs_diff_eq(Vec3::new(1.0, 2.0, 0.0), 1e-6));
    }
}
