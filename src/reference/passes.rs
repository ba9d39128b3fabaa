//! Passes over the image until a stopping criterion is met: how many points each takes, and their combination.
//!
//! A pass can end after any pixel. Each pixel keeps the weight of the passes that reached it, so its mean stays unbiased and
//! its standard error honest: whether a pass reaches a pixel depends on the time that others took, not on its own value.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use super::cut::Cut;
use super::domain::Domain;
use super::estimate::Estimate;
use super::receivers::Receivers;
use super::replicates::{self, MOST_SPLITS, Moments, Tally, Work};
use super::{Options, StoppingCriterion};
use crate::image::Image;
use crate::{Error, Progress, Stage};

/// The most splits of a cut, pass by pass: the first is over soon, whatever the scene. Each of the next ones is about the
/// pixels only whose cuts the one before left too coarse, so all of them together cost little more than the last.
pub(super) const SPLIT_LIMITS: [u32; 5] = [32, 256, 2048, 16_384, MOST_SPLITS];
/// Points per replicate, at least, until cuts are as fine as they get.
const PILOT_POINTS: f64 = 8.0;
/// Where no more than this part of the typical irradiance can arrive, no finer cut is needed.
const NEGLIGIBLE: f64 = 0.1;
/// Pixels that are computed between two checkpoints.
const PIXELS_PER_CHUNK: usize = 4096;

/// The work on one reference.
pub(super) struct Passes<'a, D: Domain> {
    pub domain: &'a D,
    pub receivers: &'a Receivers<D::Receiver>,
    pub options: &'a Options,
    pub progress: &'a dyn Progress,
}

/// What a pass is to do.
struct Plan {
    /// Points per replicate, for each pixel: at least.
    counts: Vec<u32>,
    /// In [`SPLIT_LIMITS`].
    level: usize,
    typical_irradiance: f64,
    /// The pixels, in the order in which they are computed, in parts that are spread over the image.
    chunks: Vec<Vec<usize>>,
}

/// Told of the estimate between chunks.
pub(super) type Checkpoint<'a> = dyn FnMut(&Estimate) -> Result<(), Error> + 'a;

impl<D: Domain> Passes<'_, D> {
    /// Adds passes to `known` (or starts) until the criterion is met, and shows what it has in between to `checkpoint`.
    pub fn solve(
        &self,
        criterion: &StoppingCriterion,
        known: Option<Estimate>,
        checkpoint: &mut Checkpoint,
    ) -> Result<Estimate, Error> {
        let mut estimate = known.unwrap_or_else(|| Estimate::unknown(self.options.size));
        while estimate.rel_error() > criterion.rel_error || may_have_missed_all(&estimate) {
            let Some(plan) = self.next_plan(criterion, &estimate) else { break };
            let (next, is_complete) = self.pass(&plan, &estimate, criterion, checkpoint)?;
            estimate = next;
            if !is_complete {
                break;
            }
        }
        Ok(estimate)
    }

    fn pixels(&self) -> usize {
        self.options.size.iter().map(|s| *s as usize).product()
    }

    /// `None` if there are points enough.
    fn next_plan(&self, criterion: &StoppingCriterion, known: &Estimate) -> Option<Plan> {
        let level = known.level;
        if known.coverage() < 1.0 {
            let counts = vec![PILOT_POINTS as u32; self.pixels()];
            let chunks = chunks(self.options.size, |pixel| known.weights[pixel] == 0.0);
            return Some(Plan { counts, level, typical_irradiance: 0.0, chunks });
        }
        let typical_irradiance = typical_irradiance(known);
        if known.is_fine.contains(&false) {
            let counts = replicates::points_per_pixel(PILOT_POINTS, known);
            let chunks = chunks(self.options.size, |pixel| !known.is_fine[pixel]);
            return Some(Plan { counts, level, typical_irradiance, chunks });
        }
        let used = known.statistics.points_per_pixel;
        let allowed = criterion.max_points.map_or(f64::INFINITY, |most| most - used);
        if allowed <= 0.1 * used {
            return None;
        }
        // Weights of fine pixels are squares of points.
        let typical = known.weights.iter().map(|w| f64::from(*w).sqrt()).sum::<f64>() / known.weights.len() as f64;
        let wanted = typical * growth(known.rel_error(), criterion.rel_error);
        let points = wanted.min(allowed / f64::from(self.options.replicates)).max(2.0);
        let counts = replicates::points_per_pixel(points, known);
        Some(Plan { counts, level, typical_irradiance, chunks: chunks(self.options.size, |_| true) })
    }

    /// One independent pass added to what is known, and whether it reached all of its pixels.
    fn pass(
        &self,
        plan: &Plan,
        known: &Estimate,
        criterion: &StoppingCriterion,
        checkpoint: &mut Checkpoint,
    ) -> Result<(Estimate, bool), Error> {
        self.progress.begin(Stage::Reference, plan.chunks.iter().map(|c| c.len() as u64).sum());
        let passed = self.pass_over_chunks(plan, known, criterion, checkpoint);
        self.progress.end(Stage::Reference);
        passed
    }

    fn pass_over_chunks(
        &self,
        plan: &Plan,
        known: &Estimate,
        criterion: &StoppingCriterion,
        checkpoint: &mut Checkpoint,
    ) -> Result<(Estimate, bool), Error> {
        let tally = Tally::default();
        let work = self.work(plan, u64::from(known.statistics.passes), &tally);
        let is_stopped = AtomicBool::new(false);
        let mut found: Vec<Option<Moments>> = vec![None; self.pixels()];
        let mut estimate = known.clone();
        for chunk in &plan.chunks {
            let moments = self.some_pixels(chunk, &work, &|| {
                is_stopped.fetch_or((criterion.should_stop)(), Relaxed) || is_stopped.load(Relaxed)
            });
            chunk.iter().zip(moments).for_each(|(pixel, moments)| found[*pixel] = moments);
            if found.iter().any(Option::is_some) {
                estimate = self.combined(known, &found, plan.level, &tally);
            }
            if is_stopped.load(Relaxed) {
                return Ok((estimate, false));
            }
            checkpoint(&estimate)?;
        }
        estimate.level = if estimate.is_fine.contains(&false) { plan.level + 1 } else { SPLIT_LIMITS.len() - 1 };
        Ok((estimate, true))
    }

    /// `None` for those that were not begun any more.
    fn some_pixels(
        &self,
        pixels: &[usize],
        work: &Work<D::Receiver>,
        stops: &(dyn Fn() -> bool + Sync),
    ) -> Vec<Option<Moments>> {
        let pixel = |cut: &mut _, pixel: &usize| {
            if stops() {
                return None;
            }
            self.progress.advance(1);
            Some(replicates::pixel(self.domain, work, *pixel, cut))
        };
        pixels.par_iter().with_min_len(16).map_init(Cut::new, pixel).collect()
    }

    fn work<'b>(&'b self, plan: &'b Plan, pass: u64, tally: &'b Tally) -> Work<'b, D::Receiver> {
        let Self { receivers, options, .. } = self;
        let negligible = NEGLIGIBLE * plan.typical_irradiance;
        let most_splits = SPLIT_LIMITS[plan.level];
        Work { receivers, options, counts: &plan.counts, most_splits, negligible, pass, tally }
    }

    /// What was known, and what a pass has found so far.
    fn combined(&self, known: &Estimate, found: &[Option<Moments>], level: usize, tally: &Tally) -> Estimate {
        let mut estimate = known.clone();
        estimate.add(
            found,
            tally.points_per_receiver().max(1.0),
            f64::from(SPLIT_LIMITS[level]) / f64::from(MOST_SPLITS),
        );
        estimate.statistics.passes += 1;
        estimate.statistics.points_per_pixel +=
            tally.points() * f64::from(self.options.replicates) / self.pixels() as f64;
        estimate
    }
}

/// Whether coarse cuts found no light, which may be too small for them.
fn may_have_missed_all(estimate: &Estimate) -> bool {
    estimate.rel_error() == 0.0 && estimate.is_fine.contains(&false) && estimate.level + 1 < SPLIT_LIMITS.len()
}

/// The pixels that are `wanted`, in runs of rows from all over the image, so that an interrupted pass has been everywhere.
fn chunks([width, height]: [u32; 2], wanted: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
    let (width, height) = (width as usize, height as usize);
    let count = (width * height).div_ceil(PIXELS_PER_CHUNK).clamp(1, height);
    let chunk = |first: usize| {
        let rows = (first..height).step_by(count);
        rows.flat_map(|j| j * width..(j + 1) * width).filter(|pixel| wanted(*pixel)).collect()
    };
    (0..count).map(chunk).filter(|chunk: &Vec<usize>| !chunk.is_empty()).collect()
}

/// Root mean square over the image, less what noise adds to it.
fn typical_irradiance(known: &Estimate) -> f64 {
    let sums = |image: &Image| image.pixels.iter().map(|p| p.as_dvec3().element_sum()).collect::<Vec<f64>>();
    let (means, errors) = (sums(&known.irradiance), sums(&known.standard_error));
    let count = means.len() as f64;
    let mean = means.iter().sum::<f64>() / count;
    let squares = means.iter().zip(&errors).map(|(mean, error)| mean * mean - error * error).sum::<f64>() / count;
    squares.max(mean * mean).sqrt()
}

/// By which factor the points must grow to bring an error down, if quasi-random points converge as n^-¾.
fn growth(error: f64, goal: f64) -> f64 {
    (1.1 * error / goal).powf(4.0 / 3.0).clamp(2.0, 8.0)
}

impl Estimate {
    /// Adds what an independent pass of so many points found; pixels that it did not reach stay as they are. `fineness`: the
    /// part of the finest cuts' splits that it was allowed.
    ///
    /// Passes weigh as the square of their points: better than as their number, because the error of quasi-random points falls
    /// faster than 1/√n. Cuts that are too coarse are far worse than their points say. Weights that depend on no value keep the
    /// mean unbiased.
    fn add(&mut self, found: &[Option<Moments>], points: f64, fineness: f64) {
        for (pixel, moments) in found.iter().enumerate() {
            let Some(Moments { mean, standard_error, is_fine }) = *moments else { continue };
            let weight = (if is_fine { points } else { points * fineness }).powi(2);
            let before = f64::from(self.weights[pixel]);
            let (a, b) = (before / (before + weight), weight / (before + weight));
            let known = |image: &Image| if before > 0.0 { image.pixels[pixel].as_dvec3() } else { DVec3::ZERO };
            let mean = a * known(&self.irradiance) + b * mean;
            let (known_error, new_error) = (a * known(&self.standard_error), b * standard_error);
            let standard_error = (known_error * known_error + new_error * new_error).map(f64::sqrt);
            self.irradiance.pixels[pixel] = mean.as_vec3();
            self.standard_error.pixels[pixel] = standard_error.as_vec3();
            self.weights[pixel] = (before + weight) as f32;
            self.is_fine[pixel] |= is_fine;
        }
    }
}
