//! FLIP's separable filters. Weights have one component a channel.

use std::f32::consts::PI;

use glam::{Vec3, Vec4};

use crate::parallel;

/// Four channels, row by row.
pub(super) struct Grid {
    width: usize,
    pub values: Vec<Vec4>,
}

impl Grid {
    pub fn new(width: u32, values: Vec<Vec4>) -> Self {
        Self { width: width as usize, values }
    }

    /// Correlates rows with one kernel and columns with the other. The border's pixels continue outside.
    pub fn convolved(&self, horizontal: &[Vec4], vertical: &[Vec4]) -> Self {
        let height = self.values.len() / self.width.max(1);
        let rows = self.drawn(|x, y| weighted(horizontal, x, self.width, |x| self.at(x, y)));
        rows.drawn(|x, y| weighted(vertical, y, height, |y| rows.at(x, y)))
    }

    fn at(&self, x: usize, y: usize) -> Vec4 {
        self.values[y * self.width + x]
    }

    /// A grid of the same size, of a function of column and row.
    fn drawn(&self, value: impl Fn(usize, usize) -> Vec4 + Sync) -> Self {
        let mut values = vec![Vec4::ZERO; self.values.len()];
        parallel::for_each_chunk(&mut values, self.width.max(1), &|y, row| {
            row.iter_mut().enumerate().for_each(|(x, v)| *v = value(x, y));
        });
        Self { width: self.width, values }
    }
}

/// The sum of the values around `centre`, times the kernel.
fn weighted(kernel: &[Vec4], centre: usize, length: usize, value: impl Fn(usize) -> Vec4) -> Vec4 {
    let radius = kernel.len() / 2;
    let position = |i: usize| (centre + i).saturating_sub(radius).min(length - 1);
    kernel.iter().enumerate().map(|(i, weight)| *weight * value(position(i))).sum()
}

/// The detail that the eye resolves in Y, Cx and Cz, as Gaussians of the visual angle.
pub(super) struct ContrastSensitivity {
    /// For Y, Cx and, twice, Cz, whose filter is a sum of two Gaussians. Each sums to 1.
    pub kernel: Vec<Vec4>,
    /// Share of the first of Cz's Gaussians.
    first_share: f32,
}

impl ContrastSensitivity {
    /// a and b of `a √(π/b) exp(-π²x²/b)`, where x is in degrees.
    const AMPLITUDES: Vec4 = Vec4::new(1.0, 1.0, 34.1, 13.5);
    const SPREADS: Vec4 = Vec4::new(0.0047, 0.0053, 0.04, 0.025);

    pub fn new(pixels_per_degree: f32) -> Self {
        // Three standard deviations of the widest.
        let radius = 3.0 * (Self::SPREADS.max_element() / (2.0 * PI * PI)).sqrt() * pixels_per_degree;
        let squares = offsets(radius).map(|i| (i / pixels_per_degree).powi(2));
        let gaussians: Vec<Vec4> = squares.map(|x2| (-PI * PI * x2 / Self::SPREADS).exp()).collect();
        let sums: Vec4 = gaussians.iter().sum();
        // In two dimensions a Gaussian's sum is the square of that in one.
        let volumes = Self::AMPLITUDES * (PI / Self::SPREADS).map(f32::sqrt) * sums * sums;
        Self {
            kernel: gaussians.into_iter().map(|g| g / sums).collect(),
            first_share: volumes.z / (volumes.z + volumes.w),
        }
    }

    /// YCxCz of the filtered channels.
    pub fn merged(&self, filtered: Vec4) -> Vec3 {
        let cz = filtered.z * self.first_share + filtered.w * (1.0 - self.first_share);
        filtered.truncate().with_z(cz)
    }
}

/// Detectors of edges (x, y) and of points (z, w): first and second derivatives of a Gaussian along rows (x, z) and
/// columns (y, w), smoothed across.
pub(super) struct FeatureDetectors {
    pub horizontal: Vec<Vec4>,
    pub vertical: Vec<Vec4>,
}

impl FeatureDetectors {
    /// Width of what the eye takes for an edge: two standard deviations.
    const EDGE_WIDTH_DEG: f32 = 0.082;

    pub fn new(pixels_per_degree: f32) -> Self {
        let deviation = 0.5 * Self::EDGE_WIDTH_DEG * pixels_per_degree;
        let smooth = gaussian_times(deviation, |_| 1.0);
        let first = gaussian_times(deviation, |x| -x);
        let second = gaussian_times(deviation, |x| x * x - 1.0);
        let weights = || smooth.iter().zip(&first).zip(&second);
        Self {
            horizontal: weights().map(|((smooth, d), dd)| Vec4::new(*d, *smooth, *dd, *smooth)).collect(),
            vertical: weights().map(|((smooth, d), dd)| Vec4::new(*smooth, *d, *smooth, *dd)).collect(),
        }
    }
}

/// A Gaussian times a polynomial of x in standard deviations. Positive weights sum to 1, negative ones to -1.
fn gaussian_times(deviation: f32, polynomial: impl Fn(f32) -> f32) -> Vec<f32> {
    let positions = offsets(3.0 * deviation).map(|x| x / deviation);
    let weights: Vec<f32> = positions.map(|x| polynomial(x) * (-0.5 * x * x).exp()).collect();
    let positive: f32 = weights.iter().map(|w| w.max(0.0)).sum();
    let negative: f32 = weights.iter().map(|w| (-w).max(0.0)).sum();
    weights.into_iter().map(|w| if w > 0.0 { w / positive } else { w / negative }).collect()
}

/// Pixels from the centre of a kernel of at least this radius.
fn offsets(radius: f32) -> impl Iterator<Item = f32> {
    let radius = radius.ceil() as i32;
    (-radius..=radius).map(|i| i as f32)
}
