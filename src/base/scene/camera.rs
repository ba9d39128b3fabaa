//! Cameras: from pixels to rays, and from points to pixels. Independent of objects.

use glam::{Vec2, Vec3};

use crate::vectors::direction;

/// A camera's projection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// A pinhole; full vertical field of view, radians, in (0, π).
    Perspective {
        /// Full vertical angle.
        fov_y_rad: f32,
    },
    /// Parallel rays; full height of the picture, metres.
    Orthographic {
        /// Metres from the lower to the upper edge.
        height: f32,
    },
}

/// A camera with an orthonormal frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Position, metres.
    pub position: Vec3,
    /// Unit view axis.
    pub forward: Vec3,
    /// Unit vector to the picture's right.
    pub right: Vec3,
    /// Unit vector to the picture's top.
    pub up: Vec3,
    /// Projection.
    pub projection: Projection,
}

/// A half-line with a unit direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Origin.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
}

impl Camera {
    /// A camera at `position` that looks at `target`; `None` if the frame is degenerate
    /// (target at the position, or `up` along the view axis).
    ///
    /// ```
    /// use pinspot::glam::{Vec2, Vec3};
    /// use pinspot::scene::{Camera, Projection};
    ///
    /// let projection = Projection::Perspective { fov_y_rad: 0.7 };
    /// let camera = Camera::look_at(Vec3::new(0.0, 2.0, 5.0), Vec3::ZERO, Vec3::Y, projection).unwrap();
    /// let (pixel, depth) = camera.project(Vec3::ZERO, Vec2::new(640.0, 480.0));
    /// assert!(pixel.abs_diff_eq(Vec2::new(320.0, 240.0), 1e-3) && depth > 5.0);
    /// ```
    pub fn look_at(position: Vec3, target: Vec3, up: Vec3, projection: Projection) -> Option<Self> {
        let forward = direction(target - position)?;
        let right = forward.cross(direction(up)?);
        if right.length() < 1e-5 {
            return None;
        }
        let right = right.normalize();
        Some(Self { position, forward, right, up: right.cross(forward), projection })
    }

    /// The ray through `pixel`, in pixels from the top left corner ((0.5, 0.5) is the first
    /// pixel's centre) of a picture of `size` pixels.
    pub fn ray(&self, pixel: Vec2, size: Vec2) -> Ray {
        self.rays(size)(pixel)
    }

    /// The rays through pixels as [`Self::ray`] returns them, for many pixels of one picture.
    pub fn rays(&self, size: Vec2) -> impl Fn(Vec2) -> Ray + Send + Sync + use<> {
        let Self { position, forward, right, up, projection } = *self;
        let half_height = self.half_height();
        move |pixel: Vec2| {
            // Picture coordinates: the vertical extent is [−1, 1], x to the right, y up.
            let p = Vec2::new(2.0 * pixel.x - size.x, size.y - 2.0 * pixel.y) / size.y;
            let offset = half_height * (p.x * right + p.y * up);
            match projection {
                Projection::Perspective { .. } => Ray { origin: position, direction: (forward + offset).normalize() },
                Projection::Orthographic { .. } => Ray { origin: position + offset, direction: forward },
            }
        }
    }

    /// Half of the picture's height, metres; in perspective, one metre away along the view axis.
    fn half_height(&self) -> f32 {
        match self.projection {
            Projection::Perspective { fov_y_rad } => (0.5 * fov_y_rad).tan(),
            Projection::Orthographic { height } => 0.5 * height,
        }
    }

    /// The pixel at which a world point appears, and its depth along the view axis in metres
    /// (negative: behind the camera).
    pub fn project(&self, point_in_world: Vec3, size: Vec2) -> (Vec2, f32) {
        self.projected(size)(point_in_world)
    }

    /// Pixels and depths as [`Self::project`] returns them, for many points in one picture.
    pub fn projected(&self, size: Vec2) -> impl Fn(Vec3) -> (Vec2, f32) + Send + Sync + use<> {
        let Self { position, forward, right, up, projection } = *self;
        let half_height = self.half_height();
        move |point_in_world: Vec3| {
            let to_point = point_in_world - position;
            let depth = to_point.dot(forward);
            let offset = Vec2::new(to_point.dot(right), to_point.dot(up));
            let p = match projection {
                Projection::Perspective { .. } => offset / (depth * half_height),
                Projection::Orthographic { .. } => offset / half_height,
            };
            (0.5 * Vec2::new(p.x * size.y + size.x, size.y - p.y * size.y), depth)
        }
    }

    /// The heights of pixels of a picture of so many rows, at depths along the view axis; metres.
    pub fn pixel_heights(&self, rows: f32) -> impl Fn(f32) -> f32 + Send + Sync + use<> {
        let height = 2.0 * self.half_height() / rows;
        let is_perspective = matches!(self.projection, Projection::Perspective { .. });
        move |depth| if is_perspective { depth * height } else { height }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projecting_a_ray_gives_its_pixel_back() {
        let size = Vec2::new(320.0, 200.0);
        for projection in [Projection::Perspective { fov_y_rad: 0.7 }, Projection::Orthographic { height: 3.0 }] {
            let camera = Camera::look_at(Vec3::new(1.0, 2.0, 3.0), Vec3::ZERO, Vec3::Y, projection).unwrap();
            let pixel = Vec2::new(17.5, 150.5);
            let ray = camera.ray(pixel, size);
            let (back, depth) = camera.project(ray.origin + 2.5 * ray.direction, size);
            assert!(back.abs_diff_eq(pixel, 1e-3), "{back}");
            assert!(depth > 0.0);
        }
    }

    #[test]
    fn a_degenerate_frame_is_none() {
        let projection = Projection::Orthographic { height: 1.0 };
        assert!(Camera::look_at(Vec3::Y, Vec3::ZERO, Vec3::Y, projection).is_none());
        assert!(Camera::look_at(Vec3::Y, Vec3::Y, Vec3::X, projection).is_none());
    }
}
