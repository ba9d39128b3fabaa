//! Smooth vertex normals by angle weighting (Thürmer & Wüthrich 1998) with a crease angle.
//!
//! Corners of triangles that meet in one position share a normal if a chain of edges flatter than
//! the crease angle connects them. Positions are welded by value, so seams of texture
//! coordinates do not show.

use std::collections::HashMap;

use glam::Vec3;

use crate::disjoint_sets::DisjointSets;

/// Vertices split along creases: positions, normals, and triangles over them.
pub fn smooth_normals(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    crease_angle_rad: f32,
) -> (Vec<Vec3>, Vec<Vec3>, Vec<[u32; 3]>) {
    let welded = weld(positions);
    let face_normals: Vec<Vec3> = triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| positions[v as usize]);
            (b - a).cross(c - a).normalize_or_zero()
        })
        .collect();
    let mut corners = join_corners(&welded, triangles, &face_normals, crease_angle_rad.cos());

    let mut vertex_of_set: HashMap<u32, u32> = HashMap::new();
    let (mut out_positions, mut out_normals) = (Vec::new(), Vec::<Vec3>::new());
    let mut out_triangles = Vec::with_capacity(triangles.len());
    for (t, triangle) in triangles.iter().enumerate() {
        let p = triangle.map(|v| positions[v as usize]);
        out_triangles.push([0, 1, 2].map(|k| {
            let set = corners.find((3 * t + k) as u32);
            let vertex = *vertex_of_set.entry(set).or_insert_with(|| {
                out_positions.push(p[k]);
                out_normals.push(Vec3::ZERO);
                (out_positions.len() - 1) as u32
            });
            let (to_next, to_previous) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
            if to_next != Vec3::ZERO && to_previous != Vec3::ZERO {
                out_normals[vertex as usize] += face_normals[t] * to_next.angle_between(to_previous);
            }
            vertex
        }));
    }
    (out_positions, out_normals, out_triangles)
}

/// For each vertex the first vertex at exactly the same position.
fn weld(positions: &[Vec3]) -> Vec<u32> {
    let mut first = HashMap::with_capacity(positions.len());
    // Adding zero turns −0 into +0, so that both are the same position.
    let key = |p: &Vec3| (*p + Vec3::ZERO).to_array().map(f32::to_bits);
    positions.iter().enumerate().map(|(i, p)| *first.entry(key(p)).or_insert(i as u32)).collect()
}

/// A triangle at an edge, and its corners at the edge's ends.
#[derive(Clone, Copy)]
struct EdgeUse {
    triangle: usize,
    low: u32,
    high: u32,
}

/// Joins the corners on both sides of every edge that is flatter than the crease angle.
fn join_corners(welded: &[u32], triangles: &[[u32; 3]], face_normals: &[Vec3], cos_crease: f32) -> DisjointSets {
    let mut edges: HashMap<(u32, u32), Vec<EdgeUse>> = HashMap::new();
    for (triangle, vertices) in triangles.iter().enumerate() {
        let v = vertices.map(|v| welded[v as usize]);
        for k in 0..3 {
            let (a, b) = (v[k], v[(k + 1) % 3]);
            let (corner_a, corner_b) = ((3 * triangle + k) as u32, (3 * triangle + (k + 1) % 3) as u32);
            let (edge, low, high) = if a < b { ((a, b), corner_a, corner_b) } else { ((b, a), corner_b, corner_a) };
            edges.entry(edge).or_default().push(EdgeUse { triangle, low, high });
        }
    }
    let mut corners = DisjointSets::new(3 * triangles.len());
    for uses in edges.values_mut() {
        if uses.len() > 2 {
            sort_around(uses, face_normals);
        }
        // In this order, corners that are connected at all are connected through neighbours.
        for (k, one) in uses.iter().enumerate() {
            let other = uses[(k + 1) % uses.len()];
            if face_normals[one.triangle].dot(face_normals[other.triangle]) >= cos_crease {
                corners.merge(one.low, other.low);
                corners.merge(one.high, other.high);
            }
        }
    }
    corners
}

/// Sorts the triangles at an edge by the angle of their normals, all of which are perpendicular to it.
fn sort_around(uses: &mut [EdgeUse], face_normals: &[Vec3]) {
    let normal = |edge_use: &EdgeUse| face_normals[edge_use.triangle];
    let first = normal(&uses[0]);
    // The edge's direction: perpendicular to the two normals that are furthest from parallel.
    let across = |edge_use: &EdgeUse| first.cross(normal(edge_use));
    let axis = uses.iter().map(across).max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    let beside = axis.unwrap_or_default().cross(first);
    let angle = |edge_use: &EdgeUse| normal(edge_use).dot(beside).atan2(normal(edge_use).dot(first));
    uses.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two unit squares that share an edge, folded by `fold_rad`; the second has its own copies of the shared vertices.
    fn folded(fold_rad: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let far = Vec3::new(fold_rad.cos(), fold_rad.sin(), 0.0);
        let positions =
            vec![-Vec3::X, Vec3::ZERO, -Vec3::Z, -Vec3::X - Vec3::Z, Vec3::ZERO, far, far - Vec3::Z, -Vec3::Z];
        (positions, vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    }

    #[test]
    fn a_flat_fold_is_smooth_across_split_vertices() {
        let (positions, triangles) = folded(0.2);
        let (positions, normals, _) = smooth_normals(&positions, &triangles, 0.5);
        assert_eq!(positions.len(), 6);
        let shared = positions.iter().position(|p| *p == Vec3::ZERO).unwrap();
        let expected = Vec3::new(-(0.1f32.sin()), 0.1f32.cos(), 0.0);
        assert!(normals[shared].normalize().abs_diff_eq(expected, 0.02), "{:?}", normals[shared]);
    }

    #[test]
    fn a_sharp_fold_is_a_crease() {
        let (positions, triangles) = folded(1.0);
        let (positions, _, _) = smooth_normals(&positions, &triangles, 0.5);
        assert_eq!(positions.len(), 8);
    }

    /// A book of triangles on one edge: pages 10° apart, and a second book at right angles to the first.
    #[test]
    fn fans_around_an_edge_are_smooth_where_neighbours_are() {
        let page = |degrees: f32| Vec3::new(degrees.to_radians().cos(), degrees.to_radians().sin(), 0.5);
        let angles = [20.0, 0.0, 110.0, 10.0, 90.0, 100.0f32];
        let positions: Vec<Vec3> = [Vec3::ZERO, Vec3::Z].into_iter().chain(angles.map(page)).collect();
        let triangles: Vec<[u32; 3]> = (0..6).map(|k| [0, 1, 2 + k]).collect();
        let (positions, _, triangles) = smooth_normals(&positions, &triangles, 0.2);
        assert_eq!(positions.len(), 2 + 2 + 6, "two books share no vertex on the edge");
        assert!(triangles[0][0] == triangles[1][0] && triangles[0][0] == triangles[3][0]);
        assert!(triangles[2][0] == triangles[4][0] && triangles[2][0] != triangles[0][0]);
    }

    #[test]
    fn many_triangles_on_one_edge_take_no_longer_than_others() {
        let count = 30_000;
        let page = |k: u32| Vec3::new((k as f32 * 1e-3).cos(), (k as f32 * 1e-3).sin(), 0.5);
        let positions: Vec<Vec3> = [Vec3::ZERO, Vec3::Z].into_iter().chain((0..count).map(page)).collect();
        let triangles: Vec<[u32; 3]> = (0..count).map(|k| [0, 1, 2 + k]).collect();
        let start = std::time::Instant::now();
        let (positions, ..) = smooth_normals(&positions, &triangles, 0.2);
        assert_eq!(positions.len(), 2 + count as usize);
        assert!(start.elapsed().as_secs_f32() < 2.0, "{:?}", start.elapsed());
    }
}
