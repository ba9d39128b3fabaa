//! Rectangles whose height above y = 0 is given as a function.

use glam::DVec2;

use super::Parts;

/// A rectangle of this extent along X and Z, with so many quads along each edge. `surface` gives the height at a place and its gradient
/// along X and Z.
pub(super) fn height_field(size: [f32; 2], quads: u32, surface: impl Fn(DVec2) -> (f64, DVec2)) -> Parts {
    let mut parts = Parts::default();
    let size = DVec2::new(size[0].into(), size[1].into());
    for row in 0..=quads {
        for column in 0..=quads {
            let place = size * (DVec2::new(column.into(), row.into()) / f64::from(quads) - 0.5);
            let (height, slope) = surface(place);
            let normal = glam::DVec3::new(-slope.x, 1.0, -slope.y).normalize();
            parts.vertex(glam::DVec3::new(place.x, height, place.y).as_vec3(), normal.as_vec3());
        }
    }
    let index = |row: u32, column: u32| row * (quads + 1) + column;
    for row in 0..quads {
        for column in 0..quads {
            parts.quad([
                index(row, column),
                index(row + 1, column),
                index(row + 1, column + 1),
                index(row, column + 1),
            ]);
        }
    }
    parts
}
