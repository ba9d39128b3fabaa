//! Ends of paths of every other pixel, in columns and in rows, and between them: mirrors mostly show light that changes little from
//! pixel to pixel.

use glam::{Vec2, Vec3};

use super::interpolation::{MAX_DEVIATION, bilinear, is_smooth};
use super::paths::EndPoint;
use super::reprojection::MIN_NORMAL_COSINE;

/// Pixels from one to the next.
const STEP: usize = 2;

/// End points by pixel.
#[derive(Debug)]
pub(super) struct EndGrid<'a> {
    /// In the order of their pixels.
    points: &'a [EndPoint],
    width: usize,
}

impl<'a> EndGrid<'a> {
    /// `points` are those of a picture of this width, in the order of their pixels.
    pub fn new(points: &'a [EndPoint], width: u32) -> Self {
        Self { points, width: width as usize }
    }

    /// Whether a point belongs to one of the pixels between which the others lie.
    pub fn is_node(&self, index: usize) -> bool {
        let (x, y) = self.pixel(index);
        x % STEP == 0 && y % STEP == 0
    }

    fn pixel(&self, index: usize) -> (usize, usize) {
        let pixel = self.points[index].pixel as usize;
        (pixel % self.width, pixel / self.width)
    }

    /// The end of the same kind of path in another pixel.
    fn find(&self, x: usize, y: usize, key: u64) -> Option<usize> {
        let pixel = (y * self.width + x) as u32;
        let first = self.points.partition_point(|point| point.pixel < pixel);
        let own = self.points[first..].iter().take_while(|point| point.pixel == pixel);
        own.enumerate().find(|(_, point)| point.key == key).map(|(offset, _)| first + offset)
    }

    /// The light at a point from the sixteen nodes around it, if they are all known, lie on the same smooth surface and are lit
    /// smoothly.
    pub fn interpolated(&self, index: usize, light: impl Fn(usize) -> Option<Vec3>) -> Option<Vec3> {
        let own = &self.points[index];
        let (x, y) = self.pixel(index);
        let first = (x / STEP * STEP).checked_sub(STEP).zip((y / STEP * STEP).checked_sub(STEP))?;
        if first.0 + 3 * STEP >= self.width {
            return None;
        }
        let (mut around, mut inner) = ([[Vec3::ZERO; 4]; 4], [Vec3::ZERO; 4]);
        for (k, value) in around.iter_mut().flatten().enumerate() {
            let (i, j) = (k % 4, k / 4);
            let node = self.find(first.0 + i * STEP, first.1 + j * STEP, own.key)?;
            *value = light(node)?;
            let hit = &self.points[node].hit;
            if hit.normal.dot(own.hit.normal) < MIN_NORMAL_COSINE {
                return None;
            }
            if (1..3).contains(&i) && (1..3).contains(&j) {
                inner[2 * (j - 1) + i - 1] = hit.position;
            }
        }
        let part = Vec2::new((x % STEP) as f32, (y % STEP) as f32) / STEP as f32;
        let spacing = inner[0].distance(inner[1]).min(inner[0].distance(inner[2]));
        let is_near = bilinear(inner, part).distance(own.hit.position) <= MAX_DEVIATION * spacing;
        let corners = [around[1][1], around[1][2], around[2][1], around[2][2]];
        (is_near && is_smooth(&around)).then(|| bilinear(corners, part))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracing::Hit;

    /// One end point in each pixel of a picture of 10×10, on a plane.
    fn ends(lift: impl Fn(f32, f32) -> f32) -> Vec<EndPoint> {
        let end = |pixel: u32| {
            let (x, z) = ((pixel % 10) as f32, (pixel / 10) as f32);
            let position = Vec3::new(x, lift(x, z), z);
            let hit = Hit { object: 0, position, distance: 1.0, normal: Vec3::Y, face_normal: Vec3::Y, front: true };
            EndPoint { hit, receives: true, view: Vec3::Y, pixel, key: 7, steps: [Vec3::X, Vec3::Z], blur: 0.0 }
        };
        (0..100).map(end).collect()
    }

    #[test]
    fn smooth_light_is_interpolated_on_smooth_surfaces() {
        let light = |index: usize| Some(Vec3::splat(20.0 + (index % 10) as f32 - 0.5 * (index / 10) as f32));
        let plane = ends(|_, _| 0.0);
        let grid = EndGrid::new(&plane, 10);
        assert!(grid.is_node(44) && !grid.is_node(45) && !grid.is_node(54));
        assert_eq!(grid.interpolated(55, light), light(55));
        assert_eq!(grid.interpolated(1, light), None, "nodes would lie outside");
        assert_eq!(grid.interpolated(55, |index| light(index).filter(|_| index != 44)), None, "a node is not known");
        let ridge = |index: usize| Some(Vec3::splat(if index % 10 == 4 { 2.0 } else { 1.0 }));
        assert_eq!(grid.interpolated(55, ridge), None);
        let step = ends(|x, z| if x == 5.0 && z == 5.0 { 3.0 } else { 0.0 });
        assert_eq!(EndGrid::new(&step, 10).interpolated(55, light), None, "off the surface of its neighbours");
    }
}
