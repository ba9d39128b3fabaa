//! The pixels of a picture in f64: where points appear, and the parts of pixels that triangles cover.

use glam::{DVec2, DVec3, Vec3};

use crate::scene::{Camera, Projection};

/// A camera's picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct PicturePlane {
    camera: Camera,
    width: u32,
    height: u32,
}

/// How a point is seen.
pub(super) struct View {
    pub origin: DVec3,
    pub direction: DVec3,
    /// The area of a pixel around it, perpendicular to the ray, m².
    pub pixel_area: f64,
}

impl PicturePlane {
    pub fn new(camera: &Camera, [width, height]: [u32; 2]) -> Self {
        Self { camera: *camera, width, height }
    }

    pub fn pixel_count(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Columns and rows.
    pub fn size(&self) -> DVec2 {
        DVec2::new(self.width.into(), self.height.into())
    }

    /// The pixel at a place.
    pub fn pixel(&self, place: DVec2) -> Option<usize> {
        let (x, y) = (place.x.floor(), place.y.floor());
        let is_inside = x >= 0.0 && y >= 0.0 && x < f64::from(self.width) && y < f64::from(self.height);
        is_inside.then(|| y as usize * self.width as usize + x as usize)
    }

    /// Where a point appears, in pixels from the top left corner, and how; `None` behind the camera.
    pub fn project(&self, point: DVec3) -> Option<(DVec2, View)> {
        let Camera { position, forward, right, up, projection } = self.camera;
        let [position, forward, right, up] = [position, forward, right, up].map(Vec3::as_dvec3);
        let offset = point - position;
        let (across, upwards, depth) = (offset.dot(right), offset.dot(up), offset.dot(forward));
        let (w, h) = (f64::from(self.width), f64::from(self.height));
        match projection {
            Projection::Orthographic { height } => {
                let pixel = f64::from(height) / h;
                let place = DVec2::new(0.5 * w + across / pixel, 0.5 * h - upwards / pixel);
                let origin = position + across * right + upwards * up;
                Some((place, View { origin, direction: forward, pixel_area: pixel * pixel }))
            }
            Projection::Perspective { fov_y_rad } => {
                if depth <= 0.0 {
                    return None;
                }
                let pixel = 2.0 * (0.5 * f64::from(fov_y_rad)).tan() / h;
                let place = DVec2::new(0.5 * w + across / depth / pixel, 0.5 * h - upwards / depth / pixel);
                let direction = offset.normalize();
                let pixel_area = (pixel * depth).powi(2) * direction.dot(forward);
                Some((place, View { origin: position, direction, pixel_area }))
            }
        }
    }

    /// Calls with every pixel that a triangle covers and the part of the triangle in it.
    pub fn spread(&self, triangle: [DVec2; 3], mut call: impl FnMut(usize, f64)) {
        let [a, b, c] = triangle;
        let area = 0.5 * (b - a).perp_dot(c - a).abs();
        let (low, high) = (a.min(b).min(c).floor(), a.max(b).max(c).floor());
        if low == high || area < 1e-14 {
            if let Some(pixel) = self.pixel((a + b + c) / 3.0) {
                call(pixel, 1.0);
            }
            return;
        }
        let last = high.min(DVec2::new(f64::from(self.width), f64::from(self.height)) - 1.0);
        let low = low.max(DVec2::ZERO);
        let mut y = low.y;
        while y <= last.y {
            let row = cut(&cut(&triangle, DVec2::Y, y), DVec2::NEG_Y, -y - 1.0);
            let mut x = low.x;
            while x <= last.x && row.len() >= 3 {
                let piece = cut(&cut(&row, DVec2::X, x), DVec2::NEG_X, -x - 1.0);
                let covered = polygon_area(&piece);
                if covered > 0.0 {
                    call(y as usize * self.width as usize + x as usize, covered / area);
                }
                x += 1.0;
            }
            y += 1.0;
        }
    }
}

/// The part of a convex polygon where p · axis ≥ least.
fn cut(polygon: &[DVec2], axis: DVec2, least: f64) -> Vec<DVec2> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    let height = |p: DVec2| p.dot(axis) - least;
    for k in 0..polygon.len() {
        let (from, to) = (polygon[k], polygon[(k + 1) % polygon.len()]);
        let (near, far) = (height(from), height(to));
        if near >= 0.0 {
            kept.push(from);
        }
        if near * far < 0.0 {
            kept.push(from + (to - from) * (near / (near - far)));
        }
    }
    kept
}

/// The area by the shoelace formula.
fn polygon_area(polygon: &[DVec2]) -> f64 {
    let crossed = (0..polygon.len()).map(|k| polygon[k].perp_dot(polygon[(k + 1) % polygon.len()]));
    0.5 * crossed.sum::<f64>().abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_triangle_add_up() {
        let camera = Camera::look_at(Vec3::Y, Vec3::ZERO, Vec3::Z, Projection::Orthographic { height: 1.0 }).unwrap();
        let plane = PicturePlane::new(&camera, [16, 16]);
        for k in 0..100 {
            let at =
                |j: i32| 8.0 + 7.9 * DVec2::from_angle(f64::from(k * j) * 0.7 + f64::from(j)) / f64::from(1 + j % 2);
            let mut sum = 0.0;
            plane.spread([at(1), at(2), at(3)], |_, part| sum += part);
            assert!((sum - 1.0).abs() < 1e-9, "{k}: {sum}");
        }
    }
}
