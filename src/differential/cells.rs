//! Cells: every candidate belongs to the nearest sample on its own side of creases and sheets.

use rayon::prelude::*;

use super::{PointTree, SurfacePoint};

/// Each sample's candidates, as indices.
pub(crate) fn assign(points: &[SurfacePoint], candidates: &[SurfacePoint]) -> Vec<Vec<u32>> {
    let tree = PointTree::new(points);
    let owner: Vec<u32> = candidates.par_iter().map(|c| nearest_owner(c, points, &tree)).collect();
    let mut cells = vec![Vec::new(); points.len()];
    for (candidate, owner) in owner.into_iter().enumerate() {
        cells[owner as usize].push(candidate as u32);
    }
    cells
}

fn nearest_owner(candidate: &SurfacePoint, points: &[SurfacePoint], tree: &PointTree) -> u32 {
    let nearest = tree.nearest_one(candidate.position);
    if points[nearest].same_side(candidate) {
        return nearest as u32;
    }
    let near: Vec<usize> = tree.nearest(candidate.position, 32).map(|(_, k)| k).collect();
    // A patch without a sample nearby lends its area to the nearest face that looks the same way.
    let same_side = near.iter().find(|&&k| points[k].same_side(candidate));
    let same_way = || near.iter().find(|&&k| points[k].normal.dot(candidate.normal) > 0.0);
    *same_side.or_else(same_way).unwrap_or(&nearest) as u32
}
