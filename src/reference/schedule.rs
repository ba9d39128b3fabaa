//! What the next pass is to do: which pixels, how fine their cuts may be, and how many points they get, by what is known of the image and by
//! the time that is left. It knows neither domains nor receivers.

use super::allocation;
use super::estimate::Estimate;
use super::replicates::{self, MAX_POINTS, MOST_SPLITS};
use super::{Options, StoppingCriterion};
use crate::image::Image;

/// The most splits of a cut, pass by pass, or less where time is short: the first pass is over soon, whatever the scene. Each of the next
/// ones is about the pixels only whose cuts the one before left too coarse, so all of them together cost little more than the last.
pub(super) const SPLIT_LIMITS: [u32; 5] = [8, 64, 512, 4096, MOST_SPLITS];
/// Points per replicate while cuts are not as fine as pays: few, because finer cuts are worth more.
const PILOT_POINTS: u32 = 1;
/// Pixels that are computed between two checkpoints.
const PIXELS_PER_CHUNK: usize = 4096;
/// The part of the time left that a pass is planned to take: what passes over pixels cost is known roughly.
const PLANNED: f64 = 0.7;
/// Pixels whose new points would be fewer than this part of those that they have had are left out.
const LEAST_GAIN: f64 = 0.4;
/// A value is certain that is so many of its standard errors.
const CERTAIN: f64 = 2.5;

/// What a pass is to do.
pub(super) struct Plan {
    /// Points per replicate, for each pixel: at least.
    pub counts: Vec<u32>,
    /// Of a cut.
    pub most_splits: u32,
    pub typical_irradiance: f64,
    /// The pixels, in the order in which they are computed, in parts that are spread over the image.
    pub chunks: Vec<Vec<usize>>,
}

/// How a pass went.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pace {
    /// Points per second, all replicates together, with splits as the points that take as long.
    pub work_per_second: f64,
    pub most_splits: u32,
}

/// What is known, and how much work there is time for.
struct Situation<'a> {
    options: &'a Options,
    criterion: &'a StoppingCriterion<'a>,
    known: &'a Estimate,
    /// Which pixels have anything to compute.
    receives: &'a [bool],
    pace: Option<Pace>,
    /// Points per receiver, all replicates together.
    affordable: f64,
    typical_irradiance: f64,
}

/// `None` if there are points enough. `receives`: which pixels have anything to compute. `pace`: of the pass before, if there was one.
pub(super) fn next_plan(
    (options, criterion): (&Options, &StoppingCriterion),
    (known, receives): (&Estimate, &[bool]),
    pace: Option<Pace>,
) -> Option<Plan> {
    if known.coverage() < 1.0 {
        let chunks = chunks(options.size, |pixel| known.weights[pixel] == 0.0);
        let most_splits = SPLIT_LIMITS[known.level];
        return Some(Plan { counts: pilot_points(known), most_splits, typical_irradiance: 0.0, chunks });
    }
    let affordable = match pace {
        Some(Pace { work_per_second, .. }) if work_per_second > 0.0 => {
            PLANNED * criterion.seconds_left() * work_per_second / (count(receives) * receivers_of_pixel(options))
        }
        _ => f64::INFINITY,
    };
    let typical_irradiance = typical_irradiance(known);
    let situation = Situation { options, criterion, known, receives, pace, affordable, typical_irradiance };
    if known.is_fine.contains(&false) { Some(situation.finer_cuts()) } else { situation.more_points() }
}

/// Points that a pixel is the mean over.
fn receivers_of_pixel(options: &Options) -> f64 {
    f64::from(options.pixel_samples).powi(2)
}

/// How many of the pixels receive, at least 1.
fn count(receives: &[bool]) -> f64 {
    receives.iter().filter(|receives| **receives).count().max(1) as f64
}

fn pilot_points(known: &Estimate) -> Vec<u32> {
    vec![PILOT_POINTS; known.weights.len()]
}

impl Situation<'_> {
    /// Finer cuts where they are not fine enough.
    fn finer_cuts(&self) -> Plan {
        let Self { options, known, pace, affordable, typical_irradiance, .. } = *self;
        let chunks = chunks(options.size, |pixel| !known.is_fine[pixel]);
        let part = chunks.iter().map(Vec::len).sum::<usize>() as f64 / count(self.receives);
        // Better all pixels with coarser cuts than some with finer ones.
        let most = SPLIT_LIMITS[known.level];
        let least = pace.map_or(most, |pace| pace.most_splits.saturating_mul(2)).min(most);
        let is_cheap = |splits: &u32| part * replicates::work_of_splits((*splits).into()) <= affordable;
        let limits = std::iter::successors(Some(most), |splits| Some(splits / 2));
        let most_splits = limits.take_while(|splits| *splits > least).find(is_cheap).unwrap_or(least);
        Plan { counts: pilot_points(known), most_splits, typical_irradiance, chunks }
    }

    /// Points where they are missed; `None` if no more are allowed.
    fn more_points(&self) -> Option<Plan> {
        let Self { options, criterion, known, receives, affordable, typical_irradiance, .. } = *self;
        let used = known.statistics.points_per_pixel;
        let allowed = criterion.max_points.map_or(f64::INFINITY, |most| most - used);
        if allowed <= 0.1 * used {
            return None;
        }
        // Few pixels may have had far more points than the others.
        let logarithms = known.points().zip(receives).filter(|(_, receives)| **receives).map(|(points, _)| points.ln());
        let typical = (logarithms.sum::<f64>() / count(receives)).exp();
        let wanted = typical * growth(known.rel_error(), criterion.rel_error);
        let replicates = f64::from(options.replicates);
        // Cuts take about as long as points.
        let points = in_time(wanted, 0.5 * affordable / replicates)
            .min(allowed / receivers_of_pixel(options) / replicates)
            .max(2.0);
        let counts = allocation::points_per_pixel(points, options.size, (known, receives));
        let chunks =
            most_missed_first((known, receives), &counts).chunks(PIXELS_PER_CHUNK).map(<[usize]>::to_vec).collect();
        Some(Plan { counts, most_splits: SPLIT_LIMITS[known.level], typical_irradiance, chunks })
    }
}

/// The pixels that would be better for so many points: if time is over before the pass is, it has been where points are missed most.
fn most_missed_first((known, receives): (&Estimate, &[bool]), counts: &[u32]) -> Vec<usize> {
    let gain: Vec<f64> = known.points().zip(counts).map(|(had, gets)| f64::from(*gets) / had).collect();
    let is_better = |pixel: &usize| gain[*pixel] > LEAST_GAIN || counts[*pixel] >= MAX_POINTS;
    let receiving = || (0..gain.len()).filter(|pixel| receives[*pixel]);
    let mut pixels: Vec<usize> = receiving().filter(is_better).collect();
    if pixels.is_empty() {
        pixels = receiving().collect();
    }
    pixels.sort_by(|a, b| gain[*b].total_cmp(&gain[*a]));
    pixels
}

/// The level of the next pass after a whole one.
pub(super) fn level_after(plan: &Plan, estimate: &Estimate) -> usize {
    if !estimate.is_fine.contains(&false) {
        return SPLIT_LIMITS.len() - 1;
    }
    let reached = SPLIT_LIMITS.iter().filter(|limit| **limit <= plan.most_splits).count();
    reached.min(SPLIT_LIMITS.len() - 1)
}

/// The points of a pass where no more than so many fit in the time that is left: all of it, if what a pass as wanted leaves were too little
/// for another one.
fn in_time(wanted: f64, affordable: f64) -> f64 {
    if affordable < 2.0 * wanted { affordable } else { wanted }
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

/// Root mean square over the image of the sum of the channels, as far as it is known for certain: a few points may have found far too much.
/// Where nothing is certain yet, the brightest hundredth of the pixels counts no more than the next one.
pub(super) fn typical_irradiance(known: &Estimate) -> f64 {
    let sums = |image: &Image| image.pixels.iter().map(|p| f64::from(p.element_sum())).collect::<Vec<f64>>();
    let (means, errors) = (sums(&known.irradiance), sums(&known.standard_error));
    let certain = means.iter().zip(&errors).filter(|(mean, error)| **mean > CERTAIN * **error).map(|(mean, _)| *mean);
    let certain: f64 = certain.map(|mean| mean * mean).sum();
    let mut sorted = means;
    sorted.sort_unstable_by(f64::total_cmp);
    let brightest = sorted[sorted.len() - 1 - sorted.len() / 100];
    // Where nearly all of it is black, what shines is what is left.
    let most = if brightest > 0.0 { brightest } else { f64::MAX };
    let usual: f64 = sorted.iter().map(|sum| sum.min(most).powi(2)).sum();
    (usual.max(certain) / sorted.len() as f64).sqrt()
}

/// By which factor the points must grow to bring an error down, if quasi-random points converge as n^-¾.
fn growth(error: f64, goal: f64) -> f64 {
    (1.1 * error / goal).powf(4.0 / 3.0).clamp(2.0, 8.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image that is known, with cuts that are as fine as pays or not.
    fn known(is_fine: bool) -> Estimate {
        let mut estimate = Estimate::unknown([8, 8]);
        estimate.weights.fill(16.0);
        estimate.is_fine.fill(is_fine);
        estimate.standard_error.pixels.fill(glam::Vec3::ONE);
        estimate.irradiance.pixels.fill(glam::Vec3::ONE);
        estimate.level = if is_fine { SPLIT_LIMITS.len() - 1 } else { 2 };
        estimate
    }

    fn plan(known: &Estimate, work_in_time: f64) -> Plan {
        let left = || 1.0 / PLANNED;
        let criterion = StoppingCriterion::new(1e-3).with_seconds_left(&left);
        let pace = Pace { work_per_second: work_in_time, most_splits: SPLIT_LIMITS[1] };
        next_plan((&Options { size: [8, 8], ..Options::default() }, &criterion), (known, &[true; 64]), Some(pace))
            .unwrap()
    }

    #[test]
    fn cuts_are_as_fine_as_there_is_time_for() {
        let coarse = known(false);
        let of_all = |splits: u32| 64.001 * replicates::work_of_splits(splits.into());
        assert_eq!(plan(&coarse, of_all(512)).most_splits, 512);
        assert_eq!(plan(&coarse, of_all(511)).most_splits, 256);
        assert_eq!(plan(&coarse, 0.1 * of_all(64)).most_splits, 128, "always finer than before");
    }

    #[test]
    fn points_fit_in_the_time_and_no_pass_is_empty() {
        let fine = known(true);
        let points = |plan: &Plan| plan.counts.iter().sum::<u32>();
        let work = 64.001 * 16.0 * 2.0 * 16.0;
        assert_eq!(points(&plan(&fine, work)), 64 * 16, "as many as there is time for");
        assert_eq!(points(&plan(&fine, 100.0 * work)), 64 * 32, "no more than eight times as many");
        assert!(!plan(&fine, 0.0001 * work).chunks.is_empty());
    }
}
