//! The sphere: an icosahedron whose faces are split into triangular grids and projected onto the sphere. Scaled, it is the ellipsoid.

use glam::Vec3;

use super::{Ellipsoid, Parts, Sphere};

pub(super) fn sphere(sphere: &Sphere) -> Parts {
    let (corners, faces) = icosahedron();
    let divisions = sphere.divisions;
    let mut parts = Parts::default();
    for [a, b, c] in faces.map(|f| f.map(|v| corners[v])) {
        let grid_point = |i: u32, j: u32| {
            let (s, t) = (i as f32 / divisions as f32, j as f32 / divisions as f32);
            (a + s * (b - a) + t * (c - a)).normalize()
        };
        let base = parts.positions.len() as u32;
        // Row i holds divisions + 1 − i points.
        let index = |i: u32, j: u32| base + i * (divisions + 1) - i * i.saturating_sub(1) / 2 + j;
        for i in 0..=divisions {
            for j in 0..=divisions - i {
                let normal = grid_point(i, j);
                parts.vertex(sphere.radius * normal, normal);
            }
        }
        for i in 0..divisions {
            for j in 0..divisions - i {
                parts.triangles.push([index(i, j), index(i + 1, j), index(i, j + 1)]);
                if i + j + 1 < divisions {
                    parts.triangles.push([index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)]);
                }
            }
        }
    }
    parts
}

pub(super) fn ellipsoid(ellipsoid: &Ellipsoid) -> Parts {
    let mut parts = sphere(&Sphere { radius: 1.0, divisions: ellipsoid.divisions });
    let radii = Vec3::from_array(ellipsoid.radii);
    for (position, normal) in parts.positions.iter_mut().zip(&mut parts.normals) {
        (*position, *normal) = (*position * radii, (*normal / radii).normalize());
    }
    parts
}

fn icosahedron() -> ([Vec3; 12], [[usize; 3]; 20]) {
    let g = 0.5 * (1.0 + 5.0f32.sqrt());
    let corners = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ];
    let faces = [
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    (corners.map(Vec3::from), faces)
}
