//! A rectangle of tiles with gaps between them.

use glam::Vec3;

use super::{Parts, Tiles};

pub(super) fn tiles(tiles: &Tiles) -> Parts {
    let mut parts = Parts::default();
    let [columns, rows] = tiles.count;
    let pitch = [0, 1].map(|axis| tiles.size[axis] / tiles.count[axis] as f32);
    for row in 0..rows {
        for column in 0..columns {
            let first = [column as f32 * pitch[0] - 0.5 * tiles.size[0], row as f32 * pitch[1] - 0.5 * tiles.size[1]];
            let [x, z] =
                [0, 1].map(|axis| [first[axis] + 0.5 * tiles.gap, first[axis] + pitch[axis] - 0.5 * tiles.gap]);
            let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
            let corners = [corner(x[0], z[0]), corner(x[0], z[1]), corner(x[1], z[1]), corner(x[1], z[0])];
            let corners = corners.map(|corner| parts.vertex(corner, Vec3::Y));
            parts.quad(corners);
        }
    }
    parts
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
        assert!(Shape::Tiles(Tiles { gap: 1.0, ..Tiles::default() }).mesh().unwrap_err().contains("gap"));
        assert!(Shape::Tiles(Tiles { count: [0, 3], ..Tiles::default() }).mesh().unwrap_err().contains("count"));
    }
}
