//! Passes over the image until a stopping criterion is met, and their combination. What each is to do, `schedule` says.
//!
//! A pass can end after any pixel. Each pixel keeps the weight of the passes that reached it, so its mean stays unbiased and
//! its standard error honest: whether a pass reaches a pixel depends on the time that others took, not on its own value.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::cut::Cut;
use super::domain::Domain;
use super::estimate::Estimate;
use super::receivers::Receivers;
use super::replicates::{self, MOST_SPLITS, Moments, Tally, Work};
use super::schedule::{self, Pace, Plan, SPLIT_LIMITS, next_plan};
use super::{Options, ReferenceError, StoppingCriterion};
use crate::image::Image;
use crate::{Progress, Stage};

/// Where no more than this part of the typical irradiance can arrive, no finer cut is needed.
const NEGLIGIBLE: f64 = 0.1;
/// Standard errors are not to be relied on before the passes of so many levels, unless cuts are as fine as pays.
const TRUSTED_LEVEL: usize = 2;

/// The work on one reference.
pub(super) struct Passes<'a, D: Domain> {
    pub domain: &'a D,
    pub receivers: &'a Receivers<D::Receiver>,
    pub options: &'a Options,
    pub progress: &'a dyn Progress,
}

/// Told of the estimate between chunks, and whether a pass has ended.
pub(super) type Checkpoint<'a> = dyn FnMut(&Estimate, bool) -> Result<(), ReferenceError> + 'a;

impl<D: Domain> Passes<'_, D> {
    /// Adds passes to `known` (or starts) until the criterion is met, and shows what it has in between to `checkpoint`.
    pub fn solve(
        &self,
        criterion: &StoppingCriterion,
        known: Option<Estimate>,
        checkpoint: &mut Checkpoint,
    ) -> Result<Estimate, ReferenceError> {
        let mut estimate = known.unwrap_or_else(|| Estimate::unknown(self.options.size));
        let receives = self.receiving_pixels();
        let mut pace = None;
        while estimate.rel_error() > criterion.rel_error || is_known_too_little(&estimate) {
            let Some(plan) = next_plan((self.options, criterion), (&estimate, &receives), pace) else { break };
            let left = criterion.seconds_left();
            let tally = Tally::default();
            let (next, is_complete) = self.pass(&plan, &estimate, criterion, (&tally, checkpoint))?;
            estimate = next;
            if !is_complete {
                break;
            }
            let seconds = left - criterion.seconds_left();
            let work_per_second = tally.work(self.options) / seconds;
            pace = Some(Pace { work_per_second, most_splits: plan.most_splits });
            checkpoint(&estimate, true)?;
        }
        Ok(estimate)
    }

    /// Which pixels see a surface that receives, or have a line of sight through the medium.
    fn receiving_pixels(&self) -> Vec<bool> {
        (0..self.pixels()).map(|pixel| self.receivers.of_pixel(pixel).iter().any(Option::is_some)).collect()
    }

    fn pixels(&self) -> usize {
        self.options.size.iter().map(|s| *s as usize).product()
    }

    /// One independent pass added to what is known, and whether it reached all of its pixels.
    fn pass(
        &self,
        plan: &Plan,
        known: &Estimate,
        criterion: &StoppingCriterion,
        (tally, checkpoint): (&Tally, &mut Checkpoint),
    ) -> Result<(Estimate, bool), ReferenceError> {
        self.progress.begin(Stage::Reference, plan.chunks.iter().map(|c| c.len() as u64).sum());
        let passed = self.pass_over_chunks(plan, known, criterion, (tally, checkpoint));
        self.progress.end(Stage::Reference);
        passed
    }

    fn pass_over_chunks(
        &self,
        plan: &Plan,
        known: &Estimate,
        criterion: &StoppingCriterion,
        (tally, checkpoint): (&Tally, &mut Checkpoint),
    ) -> Result<(Estimate, bool), ReferenceError> {
        let work = self.work(plan, u64::from(known.statistics.passes), tally);
        let is_stopped = AtomicBool::new(false);
        let mut found: Vec<Option<Moments>> = vec![None; self.pixels()];
        let mut estimate = known.clone();
        for (index, chunk) in plan.chunks.iter().enumerate() {
            let moments = self.some_pixels(chunk, &work, &|| {
                is_stopped.fetch_or(criterion.is_over(), Relaxed) || is_stopped.load(Relaxed)
            });
            chunk.iter().zip(moments).for_each(|(pixel, moments)| found[*pixel] = moments);
            if found.iter().any(Option::is_some) {
                estimate = self.combined(known, &found, plan, tally);
            }
            let unreached = plan.chunks.iter().flatten().copied().filter(|pixel| found[*pixel].is_none());
            if is_stopped.load(Relaxed) {
                return Ok((estimate.with_uncertain(unreached), false));
            }
            if index + 1 < plan.chunks.len() {
                checkpoint(&estimate.clone().with_uncertain(unreached), false)?;
            }
        }
        estimate.level = schedule::level_after(plan, &estimate);
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
        let Plan { counts, most_splits, typical_irradiance, .. } = plan;
        // Where nothing is typical, bounds tell nothing.
        let above = self.domain.fineness().refined_above.filter(|_| *typical_irradiance > 0.0);
        let refined_above = above.map_or(f64::INFINITY, |above| above * typical_irradiance);
        Work { receivers, options, counts, most_splits: *most_splits, negligible, refined_above, pass, tally }
    }

    /// What was known, and what a pass has found so far.
    fn combined(&self, known: &Estimate, found: &[Option<Moments>], plan: &Plan, tally: &Tally) -> Estimate {
        let mut estimate = known.clone();
        estimate.add(found, f64::from(plan.most_splits) / f64::from(MOST_SPLITS));
        estimate.statistics.passes += 1;
        estimate.statistics.points_per_pixel +=
            tally.points() * f64::from(self.options.replicates) / self.pixels() as f64;
        estimate
    }
}

/// Whether cuts are still so coarse that they may have missed much of the light, or all of it.
fn is_known_too_little(estimate: &Estimate) -> bool {
    let limits_left = SPLIT_LIMITS.len() - 1 - estimate.level;
    estimate.is_fine.contains(&false)
        && (estimate.level < TRUSTED_LEVEL || estimate.rel_error() == 0.0 && limits_left > 0)
}

impl Estimate {
    /// Black pixels that a pass with finer cuts has not reached are as uncertain as the picture is bright: coarse cuts may have missed
    /// their light in all replicates.
    fn with_uncertain(mut self, unreached: impl Iterator<Item = usize>) -> Self {
        let typical = Vec3::splat(schedule::typical_irradiance(&self) as f32 / 3.0);
        for pixel in unreached {
            let is_empty =
                [&self.irradiance, &self.standard_error].iter().all(|image| image.pixels[pixel] == Vec3::ZERO);
            if is_empty && !self.is_fine[pixel] {
                self.standard_error.pixels[pixel] = typical;
            }
        }
        self
    }

    /// Adds what an independent pass found; pixels that it did not reach stay as they are. `fineness`: the
    /// part of the finest cuts' splits that it was allowed.
    ///
    /// Passes weigh as the square of their points: better than as their number, because the error of quasi-random points falls
    /// faster than 1/√n. Cuts that are too coarse are far worse than their points say. Weights that do not depend on a pixel's own
    /// values keep its mean unbiased.
    fn add(&mut self, found: &[Option<Moments>], fineness: f64) {
        for (pixel, moments) in found.iter().enumerate() {
            let Some(Moments { mean, standard_error, points, is_fine }) = *moments else { continue };
            let weight = (if is_fine { points } else { fineness * points }).powi(2);
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
