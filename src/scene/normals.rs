//! Smooth vertex normals by angle weighting (Thürmer & Wüthrich 1998) with a crease angle.
//!
//! Corners of triangles that meet in one position share a normal if a chain of edges flatter than
//! the crease angle connects them. Positions are welded by value, so seams of texture
//! coordinates do not show.

use std::collections::HashMap;

use glam::Vec3;

/// Sets of things that are merged two at a time, with path halving.
pub struct DisjointSets(Vec<u32>);

impl DisjointSets {
    /// `count` sets of one.
    pub fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    /// The representative of `item`'s set.
    pub fn find(&mut self, mut item: u32) -> u32 {
        while self.0[item as usize] != item {
            self.0[item as usize] = self.0[self.0[item as usize] as usize];
            item = self.0[item as usize];
        }
        item
    }

    /// Merges two sets; the smaller representative stays, so results do not depend on the order.
    pub fn merge(&mut self, a: u32, b: u32) {
        if self.0[a as usize] == self.0[b as usize] {
            return;
        }
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

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
    // Adding zero turns −0 into +0, which is the same place.
    let key = |p: &Vec3| (*p + Vec3::ZERO).to_array().map(f32::to_bits);
    positions.iter().enumerate().map(|(i, p)| *first.entry(key(p)).or_insert(i as u32)).collect()
}

/// A triangle at an edge, and its corners at the edge's ends.
type EdgeUse = (u32, u32, u32);

/// Joins the corners on both sides of every edge that is flatter than the crease angle.
fn join_corners(welded: &[u32], triangles: &[[u32; 3]], face_normals: &[Vec3], cos_crease: f32) -> DisjointSets {
    let mut corners = DisjointSets::new(3 * triangles.len());
    let mut edges: HashMap<(u32, u32), Vec<EdgeUse>> = HashMap::new();
    for (t, triangle) in triangles.iter().enumerate() {
        for k in 0..3 {
            let (corner_a, corner_b) = (3 * t + k, 3 * t + (k + 1) % 3);
            let (a, b) = (welded[triangle[k] as usize], welded[triangle[(k + 1) % 3] as usize]);
            let (edge, low, high) = if a < b { ((a, b), corner_a, corner_b) } else { ((b, a), corner_b, corner_a) };
            let sharing = edges.entry(edge).or_default();
            for &(other, other_low, other_high) in sharing.iter() {
                if face_normals[t].dot(face_normals[other as usize]) >= cos_crease {
                    corners.merge(low as u32, other_low);
                    corners.merge(high as u32, other_high);
                }
            }
            sharing.push((t as u32, low as u32, high as u32));
        }
    }
    corners
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
}
