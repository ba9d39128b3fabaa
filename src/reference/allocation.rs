//! How the points of a pass are shared out among pixels: by what is known of their neighbours.
//!
//! A pixel's own value does not decide about its points, which the weights of its passes come from: else passes that happen to have found
//! little would count for too much. It has a part in the mean over the image, and in what its neighbours' later points find.

use super::estimate::Estimate;
use super::replicates::MAX_POINTS;

/// The fewest and the most points of a pixel, in means of all.
const FEWEST: f64 = 0.25;
const MOST: f64 = 64.0;

/// Points of a pass for each pixel, around a mean: powers of two in proportion to the deviation of a point's estimate, as far as the
/// pixel's neighbours know.
pub(super) fn points_per_pixel(mean: f64, size: [u32; 2], (known, receives): (&Estimate, &[bool])) -> Vec<u32> {
    let errors = known.standard_error.pixels.iter().map(|error| f64::from(error.element_sum()).powi(2));
    let variances: Vec<f64> = errors.zip(known.points()).map(|(square, points)| square * points).collect();
    let deviations = of_neighbours(&variances, size);
    let of_receiving =
        || deviations.iter().zip(receives).filter(|(_, receives)| **receives).map(|(deviation, _)| *deviation);
    let typical = of_receiving().sum::<f64>() / of_receiving().count().max(1) as f64;
    let points = |deviation: f64| {
        // Where nothing differs, all get alike.
        let share = if typical > 0.0 { (deviation / typical).clamp(FEWEST, MOST) } else { 1.0 };
        (mean * share).clamp(1.0, f64::from(MAX_POINTS)).log2().round().exp2() as u32
    };
    deviations.iter().copied().map(points).collect()
}

/// The root of the mean over the pixels around each one, without itself.
fn of_neighbours(values: &[f64], [width, height]: [u32; 2]) -> Vec<f64> {
    let (width, height) = (width as usize, height as usize);
    let around = |k: usize, end: usize| k.saturating_sub(1)..(k + 2).min(end);
    let of_pixel = |i: usize, j: usize| {
        let pixels = around(j, height).flat_map(|y| around(i, width).map(move |x| (x, y))).filter(|p| *p != (i, j));
        let (sum, count) = pixels.fold((0.0, 0.0), |(sum, count), (x, y)| (sum + values[y * width + x], count + 1.0));
        (sum / f64::max(count, 1.0)).sqrt()
    };
    (0..height).flat_map(|j| (0..width).map(move |i| (i, j))).map(|(i, j)| of_pixel(i, j)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pixel that found much by chance gets no more for it, its neighbours do.
    #[test]
    fn a_pixel_does_not_decide_about_its_own_points() {
        let mut known = Estimate::unknown([5, 5]);
        known.weights.fill(1.0);
        known.standard_error.pixels.fill(glam::Vec3::ONE);
        let before = points_per_pixel(64.0, [5, 5], (&known, &[true; 25]));
        known.standard_error.pixels[12] = glam::Vec3::splat(30.0);
        let after = points_per_pixel(64.0, [5, 5], (&known, &[true; 25]));
        assert!(after[12] <= before[12] && after[11] > before[11], "{before:?} {after:?}");
    }
}
