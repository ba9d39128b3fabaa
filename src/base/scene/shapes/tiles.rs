//! A rectangle of tiles with gaps between them, and what fills the gaps.

use glam::Vec3;

use super::{Parts, Tiles};

pub(super) fn tiles(tiles: &Tiles) -> Parts {
    cells(tiles, |column, row| column % 2 == 1 && row % 2 == 1)
}

/// What `tiles` leaves out of the rectangle.
pub(super) fn joints(tiles: &Tiles) -> Parts {
    cells(tiles, |column, row| column % 2 == 0 || row % 2 == 0)
}

/// Those that are wanted of the cells into which the edges of tiles divide the rectangle: gaps have even numbers.
fn cells(tiles: &Tiles, is_wanted: impl Fn(usize, usize) -> bool) -> Parts {
    let mut parts = Parts::default();
    let [x, z] = [0, 1].map(|axis| edges(tiles, axis));
    for (row, z) in z.windows(2).enumerate() {
        for (column, x) in x.windows(2).enumerate() {
            if is_wanted(column, row) {
                let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
                let corners = [corner(x[0], z[0]), corner(x[0], z[1]), corner(x[1], z[1]), corner(x[1], z[0])];
                let corners = corners.map(|corner| parts.vertex(corner, Vec3::Y));
                parts.quad(corners);
            }
        }
    }
    parts
}

/// The edges along an axis: those of the rectangle and of all tiles.
fn edges(tiles: &Tiles, axis: usize) -> Vec<f32> {
    let (size, count) = (tiles.size[axis], tiles.count[axis]);
    let pitch = size / count as f32;
    let of_tile = |tile: u32| {
        let first = tile as f32 * pitch - 0.5 * size;
        [first + 0.5 * tiles.gap, first + pitch - 0.5 * tiles.gap]
    };
    std::iter::once(-0.5 * size).chain((0..count).flat_map(of_tile)).chain([0.5 * size]).collect()
}

#[cfg(test)]
mod tests {
    use super::super::Shape;
    use super::*;

    #[test]
    fn gaps_are_left_out() {
        let mesh = Shape::Tiles(Tiles { size: [4.0, 2.0], count: [8, 4], gap: 0.1 }).mesh().unwrap();
        assert_eq!(mesh.triangles().len(), 2 * 8 * 4);
        assert!((mesh.area() - 32.0 * 0.16).abs() < 1e-5, "{}", mesh.area());
        let joints = Shape::Joints(Tiles { size: [4.0, 2.0], count: [8, 4], gap: 0.1 }).mesh().unwrap();
        assert!((mesh.area() + joints.area() - 8.0).abs() < 1e-5, "{}", joints.area());
        assert!(Shape::Tiles(Tiles { gap: 1.0, ..Tiles::default() }).mesh().unwrap_err().contains("gap"));
        assert!(Shape::Tiles(Tiles { count: [0, 3], ..Tiles::default() }).mesh().unwrap_err().contains("count"));
    }
}
