//! Passes over the image until a goal is reached: how many points each takes, what it costs, and their combination.

use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;

use super::cut::Cut;
use super::domain::Domain;
use super::receivers::Receivers;
use super::replicates::{self, LEAST_SPLITS, MOST_SPLITS, Moments, POINTS_PER_SPLIT, Tally, Work};
use super::{Account, Estimate, Goal, Options};
use crate::image::Image;
use crate::{Error, Progress, Stage};

/// Points per replicate in the first pass, at least.
const PILOT_POINTS: u32 = 16;
/// What a point of it weighs: it does not know yet where points are needed.
const WEIGHT_OF_FIRST: f64 = 0.1;
/// A pass takes about so many seconds at most, so that an interruption costs no more,
const LONGEST_PASS: f64 = 90.0;
/// unless that is less than so many times what its cuts cost with the fewest points.
const LONGEST_IN_CUTS: f64 = 2.0;
/// About so many pixels tell what irradiance is typical, and how long a pass takes, before anything is known.
const SCOUTS: f64 = 144.0;
/// Where no more than this part of the typical irradiance can arrive, no finer cut is needed.
const NEGLIGIBLE: f64 = 0.1;

/// The work on one reference.
pub(super) struct Passes<'a, D> {
    pub domain: &'a D,
    pub receivers: &'a Receivers,
    pub options: &'a Options,
    pub progress: &'a dyn Progress,
}

/// How fast the work goes. Its unit is a split with the points that it is worth, or as many points without.
struct Pace {
    seconds_per_unit: f64,
    /// What the cuts of some pixels want that get few points.
    splits: Vec<f64>,
}

impl Pace {
    /// Mean number of splits if none has more than this.
    fn splits_per_pixel(&self, most: f64) -> f64 {
        self.splits.iter().map(|s| s.min(most)).sum::<f64>() / self.splits.len().max(1) as f64
    }
}

/// What a pass is to do.
struct Plan {
    /// Points per replicate, for each pixel: at least.
    counts: Vec<u32>,
    most_splits: u32,
    typical_irradiance: f64,
}

impl<D: Domain> Passes<'_, D> {
    /// Adds passes to `known` (or starts) until the goal is reached, and shows every improvement to `save`.
    pub fn solve(
        &self,
        goal: &Goal,
        known: Option<Estimate>,
        save: &mut dyn FnMut(&Estimate) -> Result<(), Error>,
    ) -> Result<Estimate, Error> {
        let started = Instant::now();
        let left = || goal.seconds.map_or(f64::INFINITY, |s| s - started.elapsed().as_secs_f64());
        if let Some(known) = known.as_ref().filter(|k| k.rel_error() <= goal.rel_error) {
            return Ok(known.clone());
        }
        let (mut pace, typical) = self.scout();
        let mut most_splits = 0;
        let mut estimate = if let Some(known) = known {
            known
        } else {
            let counts = vec![PILOT_POINTS; self.pixels()];
            let plan = Plan { counts, most_splits: self.most_splits(&pace, left()), typical_irradiance: typical };
            let (first, _) = self.pass(&plan, 0);
            save(&first)?;
            most_splits = plan.most_splits;
            first
        };
        while estimate.rel_error() > goal.rel_error {
            let Some(plan) = self.next_plan(goal, &estimate, &pace, left()) else { break };
            // With much coarser cuts than before a pass would do more harm than good.
            if plan.most_splits < most_splits / 2 {
                break;
            }
            most_splits = plan.most_splits;
            let (pass, seconds_per_unit) = self.pass(&plan, u64::from(estimate.account.passes));
            pace.seconds_per_unit = seconds_per_unit;
            estimate = combine(estimate, &pass);
            save(&estimate)?;
        }
        Ok(estimate)
    }

    fn pixels(&self) -> usize {
        self.options.size.iter().map(|s| *s as usize).product()
    }

    /// A few pixels across and down: the pace, and the typical irradiance.
    fn scout(&self) -> (Pace, f64) {
        let [width, height] = self.options.size.map(|s| s as usize);
        let stride = (self.pixels() as f64 / SCOUTS).sqrt().ceil() as usize;
        let rows = (stride / 2..height).step_by(stride);
        let scouts: Vec<usize> =
            rows.flat_map(|j| (stride / 2..width).step_by(stride).map(move |i| j * width + i)).collect();
        let counts = vec![PILOT_POINTS; self.pixels()];
        let mut plan = Plan { counts, most_splits: MOST_SPLITS, typical_irradiance: 0.0 };
        // Once for the irradiance, and again for the pace, as it depends on that.
        plan.typical_irradiance = rms(self.some_pixels(&plan, &scouts).1.into_iter().map(|m| m.mean));
        let started = Instant::now();
        let (tallies, _) = self.some_pixels(&plan, &scouts);
        let units: f64 = tallies.iter().map(|t| self.units(t)).sum();
        let pace = Pace {
            seconds_per_unit: started.elapsed().as_secs_f64() / units.max(1.0),
            splits: tallies.iter().map(Tally::splits).collect(),
        };
        (pace, plan.typical_irradiance)
    }

    fn some_pixels(&self, plan: &Plan, pixels: &[usize]) -> (Vec<Tally>, Vec<Moments>) {
        let pixel = |cut: &mut _, pixel: &usize| {
            let tally = Tally::default();
            // Other random numbers than any pass's: what passes do may depend on these.
            let moments = replicates::pixel(self.domain, &self.work(plan, u64::MAX, &tally), *pixel, cut);
            (tally, moments)
        };
        pixels.par_iter().map_init(Cut::new, pixel).unzip()
    }

    /// The work that was tallied.
    fn units(&self, tally: &Tally) -> f64 {
        tally.splits().max(tally.points() * self.units_per_point())
    }

    /// Units for one point per replicate.
    fn units_per_point(&self) -> f64 {
        f64::from(self.options.replicates) / f64::from(POINTS_PER_SPLIT)
    }

    /// As many splits per pixel as there is time for.
    fn most_splits(&self, pace: &Pace, seconds: f64) -> u32 {
        let affordable = seconds / (pace.seconds_per_unit * self.pixels() as f64);
        let mut most = MOST_SPLITS;
        while most > LEAST_SPLITS && pace.splits_per_pixel(f64::from(most)) > affordable {
            most = (0.9 * f64::from(most)) as u32;
        }
        most
    }

    /// `None` if nothing that would help is affordable.
    fn next_plan(&self, goal: &Goal, known: &Estimate, pace: &Pace, left: f64) -> Option<Plan> {
        let Account { passes, points_per_pixel, seconds, .. } = known.account;
        let replicates = f64::from(self.options.replicates);
        let allowed = goal.points.map_or(f64::INFINITY, |p| p - points_per_pixel);
        if left <= 0.1 * seconds / f64::from(passes) || allowed <= 0.1 * points_per_pixel {
            return None;
        }
        let cuts = pace.seconds_per_unit * pace.splits_per_pixel(f64::INFINITY) * self.pixels() as f64;
        let affordable = left.min(LONGEST_PASS.max(LONGEST_IN_CUTS * cuts));
        let typical_points = points_per_pixel / (replicates * f64::from(passes));
        let wanted = typical_points * growth(known.rel_error(), goal.rel_error);
        let mut points = wanted.min(allowed / replicates).max(2.0);
        let mut counts = replicates::points_per_pixel(points, known);
        while points > 2.0 && self.predicted_seconds(&counts, pace) > affordable {
            points = (0.8 * points).max(2.0);
            counts = replicates::points_per_pixel(points, known);
        }
        let typical_irradiance = rms(known.irradiance.pixels.iter().map(|p| p.as_dvec3()));
        Some(Plan { counts, most_splits: self.most_splits(pace, left), typical_irradiance })
    }

    fn predicted_seconds(&self, counts: &[u32], pace: &Pace) -> f64 {
        let splits = pace.splits_per_pixel(f64::INFINITY);
        let units = |count: &u32| splits.max(f64::from(*count) * self.units_per_point());
        pace.seconds_per_unit * counts.iter().map(units).sum::<f64>()
    }

    fn work<'b>(&'b self, plan: &'b Plan, pass: u64, tally: &'b Tally) -> Work<'b> {
        let Plan { counts, most_splits, typical_irradiance } = plan;
        let Self { receivers, options, .. } = self;
        let negligible = NEGLIGIBLE * typical_irradiance;
        Work { receivers, options, counts, most_splits: *most_splits, negligible, pass, tally }
    }

    /// One independent pass, and its seconds per unit.
    fn pass(&self, plan: &Plan, index: u64) -> (Estimate, f64) {
        let [width, height] = self.options.size;
        self.progress.begin(Stage::Reference, self.pixels() as u64);
        let started = Instant::now();
        let tally = Tally::default();
        let work = self.work(plan, index, &tally);
        let pixel = |cut: &mut _, pixel| {
            self.progress.advance(1);
            replicates::pixel(self.domain, &work, pixel, cut)
        };
        let moments: Vec<Moments> =
            (0..self.pixels()).into_par_iter().with_min_len(16).map_init(Cut::new, pixel).collect();
        let image = |f: fn(&Moments) -> DVec3| Image {
            width,
            height,
            pixels: moments.iter().map(|m| f(m).as_vec3()).collect(),
        };
        let seconds = started.elapsed().as_secs_f64();
        let points = tally.points() / self.pixels() as f64;
        let points_per_pixel = points * f64::from(self.options.replicates);
        let weight = points * points * if index == 0 { WEIGHT_OF_FIRST } else { 1.0 };
        let account = Account { passes: 1, weight, points_per_pixel, seconds };
        let estimate = Estimate { irradiance: image(|m| m.mean), standard_error: image(|m| m.standard_error), account };
        (estimate, seconds / self.units(&tally).max(1.0))
    }
}

fn rms(values: impl ExactSizeIterator<Item = DVec3>) -> f64 {
    let count = values.len().max(1) as f64;
    (values.map(|v| v.element_sum().powi(2)).sum::<f64>() / count).sqrt()
}

/// By which factor the points must grow to bring an error down, if quasi-random points converge as n^-¾.
fn growth(error: f64, goal: f64) -> f64 {
    (1.1 * error / goal).powf(4.0 / 3.0).clamp(2.0, 64.0)
}

/// The mean of independent estimates, weighted by the square of their points: better than by their number, because the
/// error of quasi-random points falls faster than 1/√n. Weights that depend on no estimate keep the mean unbiased.
fn combine(a: Estimate, b: &Estimate) -> Estimate {
    let (Account { weight: wa, .. }, Account { weight: wb, .. }) = (a.account, b.account);
    let total = wa + wb;
    let mut combined = a;
    for (mean, other) in combined.irradiance.pixels.iter_mut().zip(&b.irradiance.pixels) {
        *mean = ((wa * mean.as_dvec3() + wb * other.as_dvec3()) / total).as_vec3();
    }
    for (error, other) in combined.standard_error.pixels.iter_mut().zip(&b.standard_error.pixels) {
        let (ea, eb) = (wa / total * error.as_dvec3(), wb / total * other.as_dvec3());
        *error = (ea * ea + eb * eb).map(f64::sqrt).as_vec3();
    }
    let account = &mut combined.account;
    account.passes += b.account.passes;
    account.weight = total;
    account.points_per_pixel += b.account.points_per_pixel;
    account.seconds += b.account.seconds;
    combined
}
