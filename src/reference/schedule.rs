//! What the next pass is to do: which pixels, how fine their cuts may be, and how many points they get, by what is known of the image and by
//! the time that is left. It knows neither domains nor receivers.

use super::allocation;
use super::estimate::Estimate;
use super::replicates::{self, MAX_POINTS, MOST_SPLITS};
use super::{Options, StoppingCriterion};

/// The most splits of a cut, pass by pass: the first is over soon, whatever the scene. Each of the next ones is about the
/// pixels only whose cuts the one before left too coarse, so all of them together cost little more than the last.
pub(super) const SPLIT_LIMITS: [u32; 5] = [8, 64, 512, 4096, MOST_SPLITS];
/// Points per replicate while cuts are not as fine as pays: few, because finer cuts are worth more.
const PILOT_POINTS: u32 = 1;
/// Pixels that are computed between two checkpoints.
const PIXELS_PER_CHUNK: usize = 4096;
/// The part of the time left that a pass is planned to take: what passes over pixels cost is known roughly.
const PLANNED: f64 = 0.7;

/// A pixel that gets fewer points than this part of those that it has had would hardly be better for them.
const LEAST_GAIN: f64 = 0.4;

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

/// `None` if there are points enough. `pace`: of the pass before, if there was one.
pub(super) fn next_plan(
    options: &Options,
    criterion: &StoppingCriterion,
    known: &Estimate,
    pace: Option<Pace>,
) -> Option<Plan> {
    let most_splits = SPLIT_LIMITS[known.level];
    let pilot = || vec![PILOT_POINTS; known.weights.len()];
    if known.coverage() < 1.0 {
        let chunks = chunks(options.size, |pixel| known.weights[pixel] == 0.0);
        return Some(Plan { counts: pilot(), most_splits, typical_irradiance: 0.0, chunks });
    }
    let typical_irradiance = typical_irradiance(known);
    let pixels = known.weights.len() as f64;
    // Points per pixel that there is time for, all replicates together.
    let affordable = match pace {
        Some(Pace { work_per_second, .. }) if work_per_second > 0.0 => {
            PLANNED * criterion.seconds_left() * work_per_second / pixels
        }
        _ => f64::INFINITY,
    };
    if known.is_fine.contains(&false) {
        let chunks = chunks(options.size, |pixel| !known.is_fine[pixel]);
        let part = chunks.iter().map(Vec::len).sum::<usize>() as f64 / pixels;
        // Better all pixels with coarser cuts than some with finer ones.
        let least = pace.map_or(most_splits, |pace| pace.most_splits.saturating_mul(2)).min(most_splits);
        let is_cheap = |splits: &u32| part * replicates::work_of_splits((*splits).into()) <= affordable;
        let limits = std::iter::successors(Some(most_splits), |splits| Some(splits / 2));
        let most_splits = limits.take_while(|splits| *splits > least).find(is_cheap).unwrap_or(least);
        return Some(Plan { counts: pilot(), most_splits, typical_irradiance, chunks });
    }
    let used = known.statistics.points_per_pixel;
    let allowed = criterion.max_points.map_or(f64::INFINITY, |most| most - used);
    if allowed <= 0.1 * used {
        return None;
    }
    // Few pixels may have had far more points than the others.
    let typical = (known.points().map(f64::ln).sum::<f64>() / pixels).exp();
    let wanted = typical * growth(known.rel_error(), criterion.rel_error);
    let replicates = f64::from(options.replicates);
    // Cuts take about as long as points.
    let points = in_time(wanted, 0.5 * affordable / replicates).min(allowed / replicates).max(2.0);
    let counts = allocation::points_per_pixel(points, options.size, known);
    let gain: Vec<f64> = known.points().zip(&counts).map(|(had, gets)| f64::from(*gets) / had).collect();
    let is_most = |pixel: usize| counts[pixel] >= MAX_POINTS;
    let mut pixels: Vec<usize> = (0..gain.len()).filter(|pixel| gain[*pixel] > LEAST_GAIN || is_most(*pixel)).collect();
    if pixels.is_empty() {
        pixels = (0..gain.len()).collect();
    }
    // If time is over before the pass is, it has been where points are missed most.
    pixels.sort_by(|a, b| gain[*b].total_cmp(&gain[*a]));
    let chunks = pixels.chunks(PIXELS_PER_CHUNK).map(<[usize]>::to_vec).collect();
    Some(Plan { counts, most_splits, typical_irradiance, chunks })
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

/// Root mean square over the image without its brightest hundredth, where a few points may have found far too much.
fn typical_irradiance(known: &Estimate) -> f64 {
    let mut sums: Vec<f32> = known.irradiance.pixels.iter().map(|p| p.element_sum()).collect();
    sums.sort_unstable_by(f32::total_cmp);
    let usual = &sums[..sums.len() - sums.len() / 100];
    (usual.iter().map(|sum| f64::from(*sum).powi(2)).sum::<f64>() / usual.len() as f64).sqrt()
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
        next_plan(&Options { size: [8, 8], ..Options::default() }, &criterion, known, Some(pace)).unwrap()
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
