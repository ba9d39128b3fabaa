//! Independent replicates of randomised quasi-random points: their mean, and from their spread its standard error.
//!
//! Owen-scrambled Sobol points (Burley 2020) from `sobol_burley`; every replicate of every point of every pass has its own
//! scrambling.

use glam::{DVec3, Vec3};

use super::cut::Cut;
use super::domain::{Domain, Receiver};
use super::receivers::Receivers;
use super::{Density, Estimate, Options};
use crate::Progress;

/// Where there are few points, a cut this fine still pays.
const LEAST_SPLITS: u32 = 512;
/// More would not fit into a core's cache.
const MOST_SPLITS: u32 = 1 << 16;
/// The most points that `sobol_burley` has.
const MAX_POINTS: u32 = 1 << 16;

/// Mean and its standard error.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Moments {
    pub mean: DVec3,
    pub standard_error: DVec3,
}

/// What all pixels of a pass share.
pub(super) struct Work<'a> {
    pub receivers: &'a Receivers,
    pub options: &'a Options,
    /// Points per replicate, for each pixel.
    pub counts: &'a [u32],
    pub pass: u64,
    pub progress: &'a dyn Progress,
}

/// How many points each pixel gets in a pass: powers of two in proportion to the error that is known, around `points`.
/// A pass is unbiased whatever came before it, because its points are new ones.
pub(super) fn points_per_pixel(points: f64, known: Option<&Estimate>, size: [u32; 2]) -> Vec<u32> {
    let power = |wanted: f64| wanted.clamp(1.0, f64::from(MAX_POINTS)).log2().round().exp2() as u32;
    let Some(known) = known else {
        return vec![power(points); size[0] as usize * size[1] as usize];
    };
    let error = |p: &Vec3| f64::from(p.element_sum());
    let errors = &known.standard_error.pixels;
    let square = errors.iter().map(|p| error(p).powi(2)).sum::<f64>() / errors.len() as f64;
    let typical = square.sqrt().max(f64::MIN_POSITIVE);
    errors.iter().map(|p| power(points * (error(p) / typical).clamp(1.0 / 16.0, 256.0))).collect()
}

/// Integrates for the points of one pixel.
pub(super) fn pixel<D: Domain>(domain: &D, work: &Work, pixel: usize, cut: &mut Cut<D::Region>) -> Moments {
    work.progress.advance(1);
    let points = work.receivers.of_pixel(pixel);
    let mut means = vec![DVec3::ZERO; work.options.replicates as usize];
    // A split takes about four points' time; half of the time for each is near the best, whatever the light.
    let splits = (work.counts[pixel] * work.options.replicates / 2).clamp(LEAST_SPLITS, MOST_SPLITS);
    for (k, receiver) in points.iter().enumerate() {
        let Some(receiver) = receiver else { continue };
        match work.options.density {
            Density::Bounded => cut.refine(domain, receiver, splits),
            Density::Uniform => cut.uniform(domain),
        }
        if cut.total() > 0.0 {
            let stream = (pixel * points.len() + k) as u64;
            add_replicates(domain, work, receiver, cut, stream, work.counts[pixel], &mut means);
        }
    }
    moments(&means, points.len())
}

fn add_replicates<D: Domain>(
    domain: &D,
    work: &Work,
    receiver: &Receiver,
    cut: &Cut<D::Region>,
    stream: u64,
    count: u32,
    means: &mut [DVec3],
) {
    for (replicate, mean) in means.iter_mut().enumerate() {
        let seed = hash([work.options.seed, work.pass, stream, replicate as u64]);
        let sum: DVec3 = (0..count)
            .map(|i| cut.estimate(domain, receiver, sobol_burley::sample_4d(i, 0, seed).map(f64::from)))
            .sum();
        *mean += sum / f64::from(count);
    }
}

fn moments(means: &[DVec3], points: usize) -> Moments {
    let count = means.len() as f64;
    let mean = means.iter().sum::<DVec3>() / count;
    let squares: DVec3 = means.iter().map(|m| (*m - mean) * (*m - mean)).sum();
    let standard_error = (squares / (count * (count - 1.0))).map(f64::sqrt);
    Moments { mean: mean / points as f64, standard_error: standard_error / points as f64 }
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
