//! Meshes of closed parametric surfaces, their normals by central differences in f64.

use glam::{DVec3, Vec3};

use super::Parts;

/// A surface that is closed like a sphere: `u` in [0, 1] runs from one pole to the other, `v` in [0, 1] around.
/// The front is the side of ∂p/∂v × ∂p/∂u.
pub(super) fn closed_surface(point: impl Fn(f64, f64) -> DVec3, rows: u32, columns: u32) -> Parts {
    let mut parts = Parts::default();
    let normal = |u: f64, v: f64| -> Vec3 {
        const H: f64 = 1e-5;
        // At a pole ∂p/∂v vanishes; the normal is taken just beside it.
        let u = u.clamp(1e-4, 1.0 - 1e-4);
        let du = point(u + H, v) - point(u - H, v);
        let dv = point(u, v + H) - point(u, v - H);
        dv.cross(du).normalize().as_vec3()
    };
    let pole = |u: f64| -> Vec3 { (0..4).map(|k| normal(u, f64::from(k) / 4.0)).sum::<Vec3>().normalize() };

    let first = parts.vertex(point(0.0, 0.0).as_vec3(), pole(0.0));
    for row in 1..rows {
        let u = f64::from(row) / f64::from(rows);
        for column in 0..columns {
            let v = f64::from(column) / f64::from(columns);
            parts.vertex(point(u, v).as_vec3(), normal(u, v));
        }
    }
    let last = parts.vertex(point(1.0, 0.0).as_vec3(), pole(1.0));

    let index = |row: u32, column: u32| first + 1 + (row - 1) * columns + column % columns;
    for column in 0..columns {
        parts.triangles.push([first, index(1, column + 1), index(1, column)]);
        for row in 1..rows - 1 {
            parts.quad([
                index(row, column),
                index(row, column + 1),
                index(row + 1, column + 1),
                index(row + 1, column),
            ]);
        }
        parts.triangles.push([last, index(rows - 1, column), index(rows - 1, column + 1)]);
    }
    parts
}
