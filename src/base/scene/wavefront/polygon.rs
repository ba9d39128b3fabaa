//! Triangulation of polygons.

use earcut::Earcut;
use earcut::utils3d::project3d_to_2d;
use glam::{DVec3, Vec3};

/// Triangulates a polygon; returns indices of its corners. Uses a fan around the first corner where that covers the
/// polygon, else ear clipping in the plane of its Newell normal.
pub(super) fn triangles(corners: &[Vec3]) -> Vec<[usize; 3]> {
    let fan: Vec<[usize; 3]> = (2..corners.len()).map(|k| [0, k - 1, k]).collect();
    if fan.len() < 2 {
        return fan;
    }
    let origin = corners[0].as_dvec3();
    let corners: Vec<DVec3> = corners.iter().map(|corner| corner.as_dvec3() - origin).collect();
    let vector_area = |[a, b, c]: &[usize; 3]| (corners[*b] - corners[*a]).cross(corners[*c] - corners[*a]);
    let normal: DVec3 = fan.iter().map(vector_area).sum();
    if fan.iter().all(|triangle| vector_area(triangle).dot(normal) >= 0.0) {
        return fan;
    }
    // Normalised to the order of 1.
    let size = corners.iter().map(|corner| corner.abs().max_element()).fold(0.0, f64::max);
    let corners: Vec<[f64; 3]> = corners.iter().map(|corner| (corner / size).to_array()).collect();
    let (mut flat, mut indices) = (Vec::new(), Vec::<usize>::new());
    if project3d_to_2d(&corners, corners.len(), &mut flat) {
        Earcut::new().earcut(flat, &[], &mut indices);
    }
    if indices.is_empty() { fan } else { indices.as_chunks::<3>().0.to_vec() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each polygon in several planes: the area is right, and every triangle faces the same way as the polygon.
    fn check(outline: &[[f32; 2]], area: f32) {
        for [u, v] in [[Vec3::X, Vec3::Y], [Vec3::Y, Vec3::X], [Vec3::NEG_Z, Vec3::new(0.6, 0.8, 0.0)]] {
            for scale in [1.0, 1e-6, 1e6] {
                let corners: Vec<Vec3> = outline.iter().map(|[x, y]| scale * (*x * u + *y * v)).collect();
                let found = triangles(&corners).into_iter().map(|[a, b, c]| {
                    0.5 * (corners[b] - corners[a]).cross(corners[c] - corners[a]).dot(u.cross(v)) / (scale * scale)
                });
                let found: Vec<f32> = found.collect();
                assert!(found.iter().all(|a| *a > 0.0) && (found.iter().sum::<f32>() - area).abs() < 1e-5, "{found:?}");
            }
        }
    }

    #[test]
    fn convex_and_concave_polygons_keep_their_area() {
        check(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], 1.0);
        check(&[[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [1.0, 0.5], [0.0, 2.0]], 2.5);
        check(&[[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [2.0, 3.0], [2.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]], 7.0);
        check(&[[1.0, 0.5], [0.0, 2.0], [0.0, 0.0], [2.0, 0.0], [2.0, 2.0]], 2.5);
    }

    #[test]
    fn degenerate_polygons_are_left_to_the_mesh() {
        assert_eq!(triangles(&[Vec3::ZERO; 5]).len(), 3);
        assert_eq!(triangles(&[Vec3::ZERO, Vec3::X]).len(), 0);
    }
}
