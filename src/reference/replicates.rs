//! Independent replicates of randomised quasi-random points: their mean, and from their spread its standard error.
//!
//! Owen-scrambled Sobol points (Burley 2020) from `sobol_burley`; every replicate of every point of every pass has its own
//! scrambling.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use glam::DVec3;

use super::cut::{Cut, Depth};
use super::domain::Domain;
use super::receivers::Receivers;
use super::{Density, Options};

/// More would not fit into a core's cache.
pub(super) const MOST_SPLITS: u32 = 1 << 16;
/// The most points that `sobol_burley` has.
pub(super) const MAX_POINTS: u32 = 1 << 16;

/// Mean and its standard error.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Moments {
    pub mean: DVec3,
    pub standard_error: DVec3,
    /// Points of a replicate, the mean over the pixel's receivers; 1 if it has none.
    pub points: f64,
    /// Whether all cuts were as fine as pays.
    pub is_fine: bool,
}

/// What all pixels of a pass share.
pub(super) struct Work<'a, R> {
    pub receivers: &'a Receivers<R>,
    pub options: &'a Options,
    /// Points per replicate, for each pixel: at least.
    pub counts: &'a [u32],
    /// Of a cut.
    pub most_splits: u32,
    /// Where no more than this can arrive, W/m², no finer cut is needed.
    pub negligible: f64,
    /// Where more could arrive, W/m², a finer cut is.
    pub refined_above: f64,
    pub pass: u64,
    pub tally: &'a Tally,
}

/// Counts the work, over all threads.
#[derive(Default)]
pub(super) struct Tally {
    points: AtomicU64,
    splits: AtomicU64,
}

impl Tally {
    fn add(&self, points: u32, splits: u64) {
        self.points.fetch_add(u64::from(points), Relaxed);
        self.splits.fetch_add(splits, Relaxed);
    }

    /// What has been done, as the number of points that takes as long.
    pub fn work(&self, options: &Options) -> f64 {
        self.points() * f64::from(options.replicates) + work_of_splits(self.splits.load(Relaxed) as f64)
    }

    /// Points of all receivers, per replicate.
    pub fn points(&self) -> f64 {
        self.points.load(Relaxed) as f64
    }
}

/// Points and splits are balanced where there are so many points, all replicates together, for each split: the points then
/// take about as long as the splits. Neither a finer cut nor more points would bring more.
const POINTS_PER_SPLIT: u32 = 4;

/// The fewest splits for a pixel of so many points per replicate.
fn least_splits<D: Domain>(domain: &D, points: u32, options: &Options) -> u32 {
    (points.saturating_mul(options.replicates) / POINTS_PER_SPLIT).clamp(domain.fineness().least_splits, MOST_SPLITS)
}

/// The points that take as long as so many splits.
pub(super) fn work_of_splits(splits: f64) -> f64 {
    splits * f64::from(POINTS_PER_SPLIT)
}

/// Points per replicate that a cut of so many splits is worth.
fn affordable_points(splits: u64, options: &Options) -> u32 {
    let points = (splits * u64::from(POINTS_PER_SPLIT) / u64::from(options.replicates)).clamp(1, u64::from(MAX_POINTS));
    1 << points.ilog2()
}

/// Integrates for the points of one pixel.
pub(super) fn pixel<D: Domain>(
    domain: &D,
    work: &Work<D::Receiver>,
    pixel: usize,
    cut: &mut Cut<D::Region>,
) -> Moments {
    let points = work.receivers.of_pixel(pixel);
    let mut means = vec![DVec3::ZERO; work.options.replicates as usize];
    let mut is_fine = true;
    let least = least_splits(domain, work.counts[pixel], work.options);
    let Work { most_splits: most, negligible, refined_above, .. } = *work;
    let depth = Depth { least: least.min(most), most, negligible, refined_above };
    let (mut all_points, mut receiving) = (0.0, 0.0);
    for (k, receiver) in points.iter().enumerate() {
        let Some(receiver) = receiver else { continue };
        let splits = cut.splits;
        let mut is_limited = false;
        match work.options.density {
            Density::Bounded => {
                is_limited = (cut.refine(domain, receiver, &depth) || least > most) && most < MOST_SPLITS;
            }
            Density::Uniform => cut.uniform(domain),
        }
        let splits = cut.splits - splits;
        is_fine &= !is_limited;
        let worth =
            affordable_points(if is_limited { splits / domain.fineness().fewer_points } else { splits }, work.options);
        let count = work.counts[pixel].max(worth);
        if cut.total() > 0.0 {
            let stream = (pixel * points.len() + k) as u64;
            add_replicates(domain, work, receiver, cut, stream, count, &mut means);
        }
        work.tally.add(count, splits);
        all_points += f64::from(count);
        receiving += 1.0;
    }
    let points_of_one = f64::max(all_points / f64::max(receiving, 1.0), 1.0);
    Moments { is_fine, points: points_of_one, ..moments(&means, points.len()) }
}

fn add_replicates<D: Domain>(
    domain: &D,
    work: &Work<D::Receiver>,
    receiver: &D::Receiver,
    cut: &Cut<D::Region>,
    stream: u64,
    count: u32,
    means: &mut [DVec3],
) {
    for (replicate, mean) in means.iter_mut().enumerate() {
        let seed = hash([work.options.seed, work.pass, stream, replicate as u64]);
        let numbers = |i| {
            let [a, b, c, d] = sobol_burley::sample_4d(i, 0, seed).map(f64::from);
            let [e, f, g, h, j] = if domain.needs_all_numbers() { more(i, seed) } else { [0.0; 5] };
            [a, b, c, d, e, f, g, h, j]
        };
        let sum: DVec3 = (0..count).map(|i| cut.estimate(domain, receiver, numbers(i))).sum();
        *mean += sum / f64::from(count);
    }
}

/// Five more dimensions.
fn more(i: u32, seed: u32) -> [f64; 5] {
    let [a, b, c, d] = sobol_burley::sample_4d(i, 1, seed).map(f64::from);
    let [e, ..] = sobol_burley::sample_4d(i, 2, seed).map(f64::from);
    [a, b, c, d, e]
}

fn moments(means: &[DVec3], points: usize) -> Moments {
    let count = means.len() as f64;
    let mean = means.iter().sum::<DVec3>() / count;
    let squares: DVec3 = means.iter().map(|m| (*m - mean) * (*m - mean)).sum();
    let standard_error = (squares / (count * (count - 1.0))).map(f64::sqrt);
    Moments { mean: mean / points as f64, standard_error: standard_error / points as f64, ..Moments::default() }
}

/// Numbers to an unrelated seed (the finaliser of SplitMix64 over each).
fn hash(numbers: [u64; 4]) -> u32 {
    let mut state = 0u64;
    for number in numbers {
        state = (state ^ number).wrapping_add(0x9E37_79B9_7F4A_7C15);
        state = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        state = (state ^ (state >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        state ^= state >> 31;
    }
    (state >> 32) as u32
}
