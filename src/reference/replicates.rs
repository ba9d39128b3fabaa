//! Independent replicates of randomised quasi-random points: their mean, and from their spread its standard error.
//!
//! Owen-scrambled Sobol points (Burley 2020) from `sobol_burley`; every replicate of every point of every pass has its own
//! scrambling.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use glam::{DVec3, Vec3};

use super::cut::{Cut, Depth};
use super::domain::Domain;
use super::receivers::Receivers;
use super::{Density, Estimate, Options};

/// Where there are few points and little to find, a cut this fine still pays.
const LEAST_SPLITS: u32 = 512;
/// More would not fit into a core's cache.
pub(super) const MOST_SPLITS: u32 = 1 << 16;
/// The most points that `sobol_burley` has.
const MAX_POINTS: u32 = 1 << 16;

/// Mean and its standard error.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Moments {
    pub mean: DVec3,
    pub standard_error: DVec3,
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
    pub pass: u64,
    pub tally: &'a Tally,
}

/// Counts the work, over all threads.
#[derive(Default)]
pub(super) struct Tally {
    points: AtomicU64,
    receivers: AtomicU64,
}

impl Tally {
    fn add(&self, points: u32) {
        self.points.fetch_add(u64::from(points), Relaxed);
        self.receivers.fetch_add(1, Relaxed);
    }

    /// Points of all receivers, per replicate.
    pub fn points(&self) -> f64 {
        self.points.load(Relaxed) as f64
    }

    /// Mean points of a receiver, per replicate.
    pub fn points_per_receiver(&self) -> f64 {
        self.points() / (self.receivers.load(Relaxed) as f64).max(1.0)
    }
}

/// Points and splits are balanced where there are so many points, all replicates together, for each split: the points then
/// take about as long as the splits. Neither a finer cut nor more points would bring more.
const POINTS_PER_SPLIT: u32 = 4;

/// The fewest splits for a pixel of so many points per replicate.
fn least_splits(points: u32, options: &Options) -> u32 {
    (points.saturating_mul(options.replicates) / POINTS_PER_SPLIT).clamp(LEAST_SPLITS, MOST_SPLITS)
}

/// Points per replicate that a cut of so many splits is worth.
fn affordable_points(splits: u64, options: &Options) -> u32 {
    let points = (splits * u64::from(POINTS_PER_SPLIT) / u64::from(options.replicates)).clamp(1, u64::from(MAX_POINTS));
    1 << points.ilog2()
}

/// How many points each pixel gets in a pass: powers of two in proportion to the error that is known, around `points`.
/// A pass is unbiased whatever came before it, because its points are new ones.
pub(super) fn points_per_pixel(points: f64, known: &Estimate) -> Vec<u32> {
    let power = |wanted: f64| wanted.clamp(1.0, f64::from(MAX_POINTS)).log2().round().exp2() as u32;
    let error = |p: &Vec3| f64::from(p.element_sum());
    let errors = &known.standard_error.pixels;
    let square = errors.iter().map(|p| error(p).powi(2)).sum::<f64>() / errors.len() as f64;
    let typical = square.sqrt().max(f64::MIN_POSITIVE);
    errors.iter().map(|p| power(points * (error(p) / typical).clamp(1.0 / 16.0, 256.0))).collect()
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
    let least = least_splits(work.counts[pixel], work.options);
    let depth = Depth { least: least.min(work.most_splits), most: work.most_splits, negligible: work.negligible };
    for (k, receiver) in points.iter().enumerate() {
        let Some(receiver) = receiver else { continue };
        let splits = cut.splits;
        match work.options.density {
            Density::Bounded => {
                let is_limited = cut.refine(domain, receiver, &depth);
                is_fine &= work.most_splits == MOST_SPLITS || !is_limited && least <= work.most_splits;
            }
            Density::Uniform => cut.uniform(domain),
        }
        let splits = cut.splits - splits;
        let count = work.counts[pixel].max(affordable_points(splits, work.options));
        if cut.total() > 0.0 {
            let stream = (pixel * points.len() + k) as u64;
            add_replicates(domain, work, receiver, cut, stream, count, &mut means);
        }
        work.tally.add(count);
    }
    Moments { is_fine, ..moments(&means, points.len()) }
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
            let [e, f, g] = if domain.needs_all_numbers() { more(i, seed) } else { [0.0; 3] };
            [a, b, c, d, e, f, g]
        };
        let sum: DVec3 = (0..count).map(|i| cut.estimate(domain, receiver, numbers(i))).sum();
        *mean += sum / f64::from(count);
    }
}

/// Three more dimensions.
fn more(i: u32, seed: u32) -> [f64; 3] {
    let [a, b, c, _] = sobol_burley::sample_4d(i, 1, seed).map(f64::from);
    [a, b, c]
}

fn moments(means: &[DVec3], points: usize) -> Moments {
    let count = means.len() as f64;
    let mean = means.iter().sum::<DVec3>() / count;
    let squares: DVec3 = means.iter().map(|m| (*m - mean) * (*m - mean)).sum();
    let standard_error = (squares / (count * (count - 1.0))).map(f64::sqrt);
    Moments { mean: mean / points as f64, standard_error: standard_error / points as f64, is_fine: true }
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
