//! How cells are halved: across the direction in which they widen their footprints the most, be it by their length or by the
//! turning of their normals.

use std::cmp::Ordering;

use super::point::CellPoint;

/// Halves points by their number, first along creases, then across the longest axis. Either half may be empty if there are
/// fewer than two points.
pub(super) fn halves(points: &mut [CellPoint], is_mixed: bool, reach: f32) -> (&mut [CellPoint], &mut [CellPoint]) {
    if points.len() < 2 {
        return points.split_at_mut(points.len());
    }
    let axes = longest_axes(points.iter().map(|p| p.axes), reach);
    let middle = if is_mixed { by_patches(points, axes[0]) } else { by_median(points, axes) };
    points.split_at_mut(middle)
}

/// The axis of position and normal along which footprints spread the most, and the next one: seen from `reach` metres away, a step
/// of d metres turns reflected directions by d/reach, and a turn of the normal by twice as much.
pub(super) fn longest_axes(points: impl Iterator<Item = [f32; 6]>, reach: f32) -> [usize; 2] {
    let (mut low, mut high) = ([f32::INFINITY; 6], [f32::NEG_INFINITY; 6]);
    for point in points {
        for axis in 0..6 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    let extent = |axis: usize| (high[axis] - low[axis]) * if axis < 3 { 1.0 / reach } else { 2.0 };
    let longest = |but: usize| {
        let axes = (0..6).filter(|&axis| axis != but);
        axes.max_by(|&a, &b| extent(a).total_cmp(&extent(b))).expect("six axes")
    };
    let first = longest(6);
    [first, longest(first)]
}

/// Whether a crease or a sheet's thickness lies between some of the points.
pub(super) fn is_mixed(points: &[CellPoint]) -> bool {
    points.iter().any(|p| p.patch != points[0].patch)
}

/// The patch with the most points; the points may change their order.
pub(super) fn largest_patch(points: &mut [CellPoint]) -> &[CellPoint] {
    points.sort_unstable_by_key(|p| p.patch);
    let patches = points.chunk_by(|a, b| a.patch == b.patch);
    patches.max_by_key(|of_patch| of_patch.len()).expect("a cell has points")
}

fn by_median(points: &mut [CellPoint], axes: [usize; 2]) -> usize {
    let middle = points.len() / 2;
    points.select_nth_unstable_by(middle, |a, b| in_order(&a.axes, &b.axes, axes));
    middle
}

/// The order along two axes: of points in rows, as the pieces of triangles are, many share the first coordinate.
pub(super) fn in_order(a: &[f32; 6], b: &[f32; 6], [first, second]: [usize; 2]) -> Ordering {
    a[first].total_cmp(&b[first]).then_with(|| a[second].total_cmp(&b[second]))
}

/// Orders patches along the axis and cuts between two of them, as near the middle of the area as that is.
fn by_patches(points: &mut [CellPoint], axis: usize) -> usize {
    points.sort_unstable_by_key(|p| p.patch);
    let mut patches: Vec<(f32, f32, &[CellPoint])> = points
        .chunk_by(|a, b| a.patch == b.patch)
        .map(|of_patch| {
            let area: f32 = of_patch.iter().map(|p| p.area).sum();
            (of_patch.iter().map(|p| p.area * p.axes[axis]).sum::<f32>() / area, area, of_patch)
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
    let ordered: Vec<CellPoint> = patches.iter().flat_map(|(_, _, of_patch)| of_patch.iter().copied()).collect();
    points.copy_from_slice(&ordered);
    middle
}
