//! Camera moves: orbit, pan and dolly about a point. Knows cameras and vectors only.

use glam::{Quat, Vec2, Vec3};

use crate::scene::{Camera, Projection};

/// The camera turns by half a circle for a drag over the window's height.
const RADIANS_PER_HEIGHT: f32 = std::f32::consts::PI;
/// The camera comes no nearer to the point that it circles, metres.
const LEAST_DISTANCE: f32 = 1e-3;
/// It stays this far from straight up and straight down, as the cosine of the angle between its up and the world's.
const LEAST_UPRIGHT: f32 = 1e-3;

/// Turns the camera about a point by a drag, as a fraction of the window's height; to the right and down are positive.
pub fn orbit(camera: &mut Camera, target: Vec3, drag: Vec2) {
    let angles = -RADIANS_PER_HEIGHT * drag;
    let yaw = Quat::from_rotation_y(angles.x);
    let turned = rotated(camera, target, yaw);
    let pitched = rotated(&turned, target, Quat::from_axis_angle(turned.right, angles.y));
    // Beyond the poles the picture would be upside down.
    let is_upright = pitched.up.y >= LEAST_UPRIGHT || pitched.up.y > turned.up.y;
    *camera = if is_upright { pitched } else { turned };
}

fn rotated(camera: &Camera, target: Vec3, rotation: Quat) -> Camera {
    let (forward, up) = (rotation * camera.forward, rotation * camera.up);
    let forward = forward.normalize();
    let right = forward.cross(up).normalize();
    let position = target + rotation * (camera.position - target);
    Camera { position, forward, right, up: right.cross(forward), ..*camera }
}

/// Moves the camera and its point by a drag, as fractions of the window's height, so that what lies there follows the pointer.
pub fn pan(camera: &mut Camera, target: &mut Vec3, drag: Vec2) {
    let height = match camera.projection {
        Projection::Orthographic { height } => height,
        Projection::Perspective { fov_y_rad } => {
            let depth = (*target - camera.position).dot(camera.forward).max(0.0);
            2.0 * depth * (0.5 * fov_y_rad).tan()
        }
    };
    let step = height * (drag.y * camera.up - drag.x * camera.right);
    camera.position += step;
    *target += step;
}

/// Brings the camera nearer to its point (a factor below 1) or moves it away.
pub fn dolly(camera: &mut Camera, target: Vec3, factor: f32) {
    match &mut camera.projection {
        Projection::Orthographic { height } => *height = (*height * factor).clamp(1e-6, 1e9),
        Projection::Perspective { .. } => {
            let offset = camera.position - target;
            let length = (offset.length() * factor).clamp(LEAST_DISTANCE, 1e6);
            if let Some(direction) = offset.try_normalize() {
                camera.position = target + length * direction;
            }
        }
    }
}

/// The point on the camera's axis that is nearest to the middle of a scene, if it lies in front of the camera.
pub fn point_of_interest(camera: &Camera, middle: Vec3) -> Vec3 {
    let depth = (middle - camera.position).dot(camera.forward);
    let depth = if depth > LEAST_DISTANCE { depth } else { 1.0 };
    camera.position + depth * camera.forward
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let projection = Projection::Perspective { fov_y_rad: 0.7 };
        Camera::look_at(Vec3::new(0.0, 2.0, 4.0), Vec3::ZERO, Vec3::Y, projection).unwrap()
    }

    #[test]
    fn orbiting_keeps_the_distance_the_target_and_the_horizon() {
        let mut moved = camera();
        for k in 0..50 {
            orbit(&mut moved, Vec3::ZERO, Vec2::new(0.13, if k % 3 == 0 { -0.2 } else { 0.11 }));
            assert!((moved.position.length() - camera().position.length()).abs() < 1e-3);
            assert!(moved.forward.dot(-moved.position.normalize()) > 0.9999);
            assert!(moved.right.y.abs() < 1e-3 && moved.up.y >= 0.0, "{moved:?}");
        }
        let mut over = camera();
        (0..40).for_each(|_| orbit(&mut over, Vec3::ZERO, Vec2::new(0.0, 0.1)));
        assert!(over.up.y >= 0.0 && over.position.y > 4.0, "it stops at the pole: {over:?}");
    }

    #[test]
    fn panning_moves_points_with_the_pointer() {
        let (mut moved, mut target) = (camera(), Vec3::ZERO);
        let size = Vec2::new(400.0, 300.0);
        let before = moved.project(Vec3::ZERO, size).0;
        pan(&mut moved, &mut target, Vec2::new(0.1, -0.05));
        let after = moved.project(Vec3::ZERO, size).0;
        assert!((after - before - 300.0 * Vec2::new(0.1, -0.05)).length() < 0.1, "{before} {after}");
    }

    #[test]
    fn the_camera_comes_nearer_but_never_through() {
        let mut moved = camera();
        dolly(&mut moved, Vec3::ZERO, 0.5);
        assert!((moved.position.length() - 0.5 * camera().position.length()).abs() < 1e-4);
        (0..100).for_each(|_| dolly(&mut moved, Vec3::ZERO, 0.5));
        assert!(moved.position.length() >= 0.99 * LEAST_DISTANCE && moved.forward.dot(-moved.position) > 0.0);
        let mut parallel = Camera { projection: Projection::Orthographic { height: 3.0 }, ..camera() };
        dolly(&mut parallel, Vec3::ZERO, 2.0);
        assert_eq!(parallel.projection, Projection::Orthographic { height: 6.0 });
    }
}
