//! How cells are halved: across the direction in which they are longest.

use glam::Vec3;

use crate::sampling::SurfacePoint;

/// Halves points by their area, first along creases, then across the longest side of their bounds. Either half may be empty
/// if there are fewer than two points.
pub(super) fn halves(points: &mut [SurfacePoint]) -> (&mut [SurfacePoint], &mut [SurfacePoint]) {
    if points.len() < 2 {
        return points.split_at_mut(points.len());
    }
    let axis = longest_axis(points.iter().map(|p| p.position));
    let middle = if is_mixed(points) { by_patches(points, axis) } else { by_median(points, axis) };
    points.split_at_mut(middle)
}

/// The coordinate axis along which points spread the most.
pub(super) fn longest_axis(points: impl Iterator<Item = Vec3> + Clone) -> usize {
    let low = points.clone().fold(Vec3::INFINITY, Vec3::min);
    let extent = points.fold(Vec3::NEG_INFINITY, Vec3::max) - low;
    extent.max_position()
}

/// Whether a crease or a sheet's thickness lies between some of the points.
pub(super) fn is_mixed(points: &[SurfacePoint]) -> bool {
    points.iter().any(|p| p.patch != points[0].patch)
}

/// The patch with the most points; the points may change their order.
pub(super) fn largest_patch(points: &mut [SurfacePoint]) -> &[SurfacePoint] {
    points.sort_unstable_by_key(|p| p.patch);
    let patches = points.chunk_by(|a, b| a.patch == b.patch);
    patches.max_by_key(|of_patch| of_patch.len()).expect("a cell has points")
}

fn by_median(points: &mut [SurfacePoint], axis: usize) -> usize {
    let middle = points.len() / 2;
    points.select_nth_unstable_by(middle, |a, b| a.position[axis].total_cmp(&b.position[axis]));
    middle
}

/// Orders patches along the axis and cuts between two of them, as near the middle of the area as that is.
fn by_patches(points: &mut [SurfacePoint], axis: usize) -> usize {
    points.sort_unstable_by_key(|p| p.patch);
    let mut patches: Vec<(f32, f32, &[SurfacePoint])> = points
        .chunk_by(|a, b| a.patch == b.patch)
        .map(|of_patch| {
            let area: f32 = of_patch.iter().map(|p| p.area).sum();
            (of_patch.iter().map(|p| p.area * p.position[axis]).sum::<f32>() / area, area, of_patch)
        })
        .collect();
    patches.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * patches.iter().map(|(_, area, _)| area).sum::<f32>();
    let (mut before, mut best, mut least) = (0.0, 1, f32::INFINITY);
    for (k, (_, area, _)) in patches[..patches.len() - 1].iter().enumerate() {
        before += area;
        let miss = (before - half).abs();
        if miss < least {
            (best, least) = (k + 1, miss);
        }
    }
    let middle = patches[..best].iter().map(|(_, _, of_patch)| of_patch.len()).sum();
    let ordered: Vec<SurfacePoint> = patches.iter().flat_map(|(_, _, of_patch)| of_patch.iter().copied()).collect();
    points.copy_from_slice(&ordered);
    middle
}
