//! Square texels of a picture plane: what lights and cameras see, from parallel rays or from a point.
//!
//! Coordinates are texels: (0, 0) is the corner of the first texel, whose centre is (½, ½).

use glam::{DVec2, DVec3, Vec3};

use crate::scene::{Camera, Projection as CameraProjection, Ray};

/// Parallel rays start so much before a box, in its diagonals.
const START: f64 = 0.01;

/// A box along the axes, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Its lowest and its highest corner.
    pub corners: [Vec3; 2],
}

impl Bounds {
    /// Around points; `None` without any.
    pub fn around(points: impl Iterator<Item = Vec3>) -> Option<Self> {
        points.fold(None, |bounds: Option<Self>, p| {
            let [low, high] = bounds.map_or([p, p], |bounds| bounds.corners);
            Some(Self { corners: [low.min(p), high.max(p)] })
        })
    }

    /// All eight corners.
    pub fn corners(&self) -> impl Iterator<Item = Vec3> + Clone + use<> {
        let [low, high] = self.corners;
        (0..8).map(move |k| {
            Vec3::from_array([0, 1, 2].map(|axis| if k >> axis & 1 == 0 { low[axis] } else { high[axis] }))
        })
    }

    /// The middle.
    pub fn centre(&self) -> Vec3 {
        0.5 * self.corners[0] + 0.5 * self.corners[1]
    }

    /// From corner to corner, metres.
    pub fn diagonal(&self) -> f64 {
        f64::from(self.corners[0].distance(self.corners[1]))
    }
}

/// A picture plane in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// The point that central rays leave, or the origin of the plane that parallel rays leave.
    pub origin: DVec3,
    /// Unit vectors along the rows and columns of texels, and along the view axis.
    pub axes: [DVec3; 3],
    /// Whether all rays are parallel to the view axis.
    pub is_parallel: bool,
    /// The corner of the first texel in the plane; metres of parallel projections, tangents of central ones.
    pub low: DVec2,
    /// The edge of a texel in the same unit.
    pub texel: f64,
    /// Columns and rows.
    pub size: [u32; 2],
}

impl Projection {
    /// Parallel rays in a direction, in a square window of `size`² texels around all of these points. They start before a box.
    pub fn parallel(direction: Vec3, points: impl Iterator<Item = Vec3>, before: &Bounds, size: u32) -> Self {
        let axes = frame(direction.as_dvec3());
        let plane =
            Self { origin: DVec3::ZERO, axes, is_parallel: true, low: DVec2::ZERO, texel: 1.0, size: [size; 2] };
        let foremost = before.corners().map(|corner| plane.local(corner).z).fold(f64::INFINITY, f64::min);
        let plane = Self { origin: (foremost - START * before.diagonal()) * axes[2], ..plane };
        plane.around(points.map(|p| plane.local(p).truncate()))
    }

    /// Rays from a point in a square window of `size`² texels around all of these points; `None` unless they all lie within 60° of one
    /// direction.
    pub fn central(origin: Vec3, points: impl Iterator<Item = Vec3> + Clone, size: u32) -> Option<Self> {
        let directions = points.map(|p| (p - origin).as_dvec3().normalize_or_zero());
        let axis = directions.clone().sum::<DVec3>().try_normalize()?;
        if directions.clone().any(|d| d.dot(axis) < 0.5) {
            return None;
        }
        let view = Self::from_point(origin, axis, size);
        Some(
            view.around(directions.map(|d| DVec2::new(d.dot(view.axes[0]), d.dot(view.axes[1])) / d.dot(view.axes[2]))),
        )
    }

    /// The six faces of a cube around a point, `size`² texels each, with `border` more at every edge, which see what belongs to other faces.
    pub fn cube(origin: Vec3, size: u32, border: u32) -> [Self; 6] {
        let texel = 2.0 / f64::from(size);
        [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z].map(|axis| {
            let low = DVec2::splat(-1.0 - texel * f64::from(border));
            Self { low, texel, ..Self::from_point(origin, axis, size + 2 * border) }
        })
    }

    /// Whether a place of a face of a cube belongs to another face.
    pub fn is_in_border(&self, place: DVec2) -> bool {
        (self.low + self.texel * place).abs().max_element() > 1.0
    }

    /// The pixels of a camera's picture.
    pub fn of_camera(camera: &Camera, [width, height]: [u32; 2]) -> Self {
        let (w, h) = (f64::from(width), f64::from(height));
        let half_height = match camera.projection {
            CameraProjection::Perspective { fov_y_rad } => f64::from(0.5 * fov_y_rad).tan(),
            CameraProjection::Orthographic { height } => 0.5 * f64::from(height),
        };
        Self {
            origin: camera.position.as_dvec3(),
            axes: [camera.right, -camera.up, camera.forward].map(Vec3::as_dvec3),
            is_parallel: matches!(camera.projection, CameraProjection::Orthographic { .. }),
            low: -half_height * DVec2::new(w / h, 1.0),
            texel: 2.0 * half_height / h,
            size: [width, height],
        }
    }

    fn from_point(origin: Vec3, axis: DVec3, size: u32) -> Self {
        let (origin, axes) = (origin.as_dvec3(), frame(axis));
        Self { origin, axes, is_parallel: false, low: DVec2::ZERO, texel: 1.0, size: [size; 2] }
    }

    /// The same with the smallest square window around places in the plane, and a hundredth of it at every edge.
    fn around(self, places: impl Iterator<Item = DVec2>) -> Self {
        let (low, high) = places.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        let (middle, extent) = (0.5 * (low + high), (high - low).max_element());
        if !(extent.is_finite() && extent > 0.0) {
            return self;
        }
        let half = 0.51 * extent;
        Self { low: middle - half, texel: 2.0 * half / f64::from(self.size[0]), ..self }
    }

    /// The same with a wider window: by so much at every edge, in the plane's unit.
    #[must_use]
    pub fn widened(self, by: f64) -> Self {
        let size = f64::from(self.size[0]);
        Self { low: self.low - by, texel: self.texel + 2.0 * by / size, ..self }
    }

    /// The same window with `size`² texels.
    #[must_use]
    pub fn resized(self, size: u32) -> Self {
        let factor = f64::from(self.size[0]) / f64::from(size);
        Self { texel: self.texel * factor, size: [size; 2], ..self }
    }

    /// The number of texels.
    pub fn texel_count(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Coordinates along the axes, metres.
    fn local(&self, point: Vec3) -> DVec3 {
        let offset = point.as_dvec3() - self.origin;
        DVec3::from_array(self.axes.map(|axis| offset.dot(axis)))
    }

    /// Where a point appears, in texels; it may be outside of the window. `None` behind the point that rays leave.
    pub fn project(&self, point: Vec3) -> Option<DVec2> {
        let local = self.local(point);
        let depth = if self.is_parallel { 1.0 } else { local.z };
        (depth > 0.0).then(|| (local.truncate() / depth - self.low) / self.texel)
    }

    /// How far a point lies along the view axis, metres.
    pub fn depth(&self, point: Vec3) -> f64 {
        self.local(point).z
    }

    /// The point at a place and a depth.
    pub fn point_at(&self, place: DVec2, depth: f64) -> Vec3 {
        let [right, down, forward] = self.axes;
        let at = (self.low + self.texel * place) * if self.is_parallel { 1.0 } else { depth };
        (self.origin + at.x * right + at.y * down + depth * forward).as_vec3()
    }

    /// The index of the texel at a place, if it is in the window.
    pub fn index(&self, place: DVec2) -> Option<usize> {
        let [width, height] = self.size;
        let is_inside = place.cmpge(DVec2::ZERO).all() && place.x < f64::from(width) && place.y < f64::from(height);
        is_inside.then(|| place.y as usize * width as usize + place.x as usize)
    }

    /// The ray through a place.
    pub fn ray(&self, place: DVec2) -> Ray {
        let [right, down, forward] = self.axes;
        let at = self.low + self.texel * place;
        let offset = at.x * right + at.y * down;
        let (origin, direction) = if self.is_parallel {
            (self.origin + offset, forward)
        } else {
            (self.origin, (forward + offset).normalize())
        };
        Ray { origin: origin.as_vec3(), direction: direction.as_vec3() }
    }

    /// The size of the texel that a place is in: its area, m², of parallel rays, and its solid angle, sr, of central ones.
    pub fn measure(&self, place: DVec2) -> f64 {
        if self.is_parallel {
            return self.texel * self.texel;
        }
        let low = self.low + self.texel * place.floor();
        solid_angle_sr(low, low + self.texel)
    }

    /// The area that a texel covers at a point, perpendicular to its ray; m².
    pub fn area_at(&self, point: Vec3) -> f64 {
        let texel = self.texel * self.texel;
        if self.is_parallel {
            return texel;
        }
        // A plane across the view axis shows texel² · z², which is seen at an angle.
        let local = self.local(point);
        texel * local.z * local.z * (local.z / local.length())
    }

    /// The unit direction of the ray through a point.
    pub fn direction_to(&self, point: Vec3) -> Vec3 {
        if self.is_parallel { self.axes[2].as_vec3() } else { (point.as_dvec3() - self.origin).normalize().as_vec3() }
    }
}

/// Right, down and forward of a view along a unit direction.
fn frame(forward: DVec3) -> [DVec3; 3] {
    let (right, down) = forward.any_orthonormal_pair();
    [right, down, forward]
}

/// The solid angle of a rectangle in the plane one unit away; its corners are tangents.
fn solid_angle_sr(low: DVec2, high: DVec2) -> f64 {
    let corner = |x: f64, y: f64| (x * y).atan2((1.0 + x * x + y * y).sqrt());
    corner(high.x, high.y) - corner(low.x, high.y) - corner(high.x, low.y) + corner(low.x, low.y)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    const BOX: Bounds = Bounds { corners: [Vec3::ZERO, Vec3::ONE] };

    fn corners() -> impl Iterator<Item = Vec3> + Clone {
        BOX.corners()
    }

    #[test]
    fn rays_pass_through_the_points_that_they_show() {
        let origin = Vec3::new(3.0, 4.0, 5.0);
        let camera = Camera::look_at(origin, Vec3::ONE, Vec3::Y, CameraProjection::Perspective { fov_y_rad: 0.9 });
        let views = [
            Projection::parallel(Vec3::new(0.6, -0.8, 0.0), corners(), &BOX, 64),
            Projection::central(origin, corners(), 64).unwrap(),
            Projection::of_camera(&camera.unwrap(), [48, 32]),
        ];
        for view in views {
            for point in corners() {
                let place = view.project(point).unwrap();
                assert!(view.index(place).is_some(), "{place}");
                let ray = view.ray(place);
                let along = (point - ray.origin).dot(ray.direction);
                assert!((ray.origin + along * ray.direction).distance(point) < 1e-5);
                assert!(ray.direction.abs_diff_eq(view.direction_to(point), 1e-6));
            }
        }
    }

    #[test]
    fn cubes_have_the_solid_angle_of_the_sphere() {
        let total: f64 = Projection::cube(Vec3::ZERO, 5, 0)
            .iter()
            .flat_map(|face| (0..25).map(|k| face.measure(DVec2::new(f64::from(k % 5), f64::from(k / 5)) + 0.5)))
            .sum();
        assert!((total - 4.0 * PI).abs() < 1e-12, "{total}");
    }

    /// The area at a distance is the solid angle times its square.
    #[test]
    fn areas_follow_from_solid_angles() {
        let view = Projection::central(Vec3::new(3.0, 4.0, 5.0), corners(), 512).unwrap();
        for point in corners() {
            let solid_angle = view.measure(view.project(point).unwrap());
            let distance = f64::from(point.distance(Vec3::new(3.0, 4.0, 5.0)));
            let expected = solid_angle * distance * distance;
            assert!((view.area_at(point) / expected - 1.0).abs() < 5e-3);
        }
    }

    #[test]
    fn points_all_around_need_a_cube() {
        assert!(Projection::central(Vec3::splat(0.5), corners(), 8).is_none());
    }
}
