//! The frame budget: from the time that previews took to what the next one may spend.

/// What a preview spends. On a GPU it is one submission: on slow ones, 2³⁰ pairs of a pixel and a sample take about a second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detail {
    /// Width and height of the picture that is computed, pixels.
    pub size: [u32; 2],
    /// The largest number of samples.
    pub samples: u32,
    /// The largest number of look-ups along a footprint's major axis.
    pub taps: u32,
    /// Pixels from one to the next in whose light is computed, along rows and columns, from 1 to 8; between them it is interpolated.
    pub spacing: u32,
    /// Directions of the shadow rays of direct light.
    pub shadow_directions: u32,
    /// On the CPU, diffuse surfaces keep the light of the last whole beauty picture while nothing but the camera moves.
    pub reuses_light: bool,
}

impl Detail {
    /// The spacing within its range.
    pub(super) fn spacing(&self) -> u32 {
        self.spacing.clamp(1, 8)
    }
}

/// Holds a target time per frame by choosing the [`Detail`] of each.
#[derive(Clone, Debug)]
pub struct Budget {
    /// Seconds per frame.
    target: f64,
    /// On a scale of coarse to fine details, see [`detail_at`]; from 0 to [`FINEST_LEVEL`].
    level: f64,
    /// Samples of the frame that was taken into account last.
    samples: u32,
}

/// Most changes of the level from one frame to the next.
const MAX_STEP_DOWN: f64 = 0.15;
const MAX_STEP_UP: f64 = 0.04;
/// The level changes by this much where a frame takes e times as long as it should. Costs grow about e⁶-fold from level 0 to 1.
const GAIN: f64 = 0.12;
/// Within this part of the target, nothing changes: detail that goes up and down is seen as flicker.
const DEAD_BAND: f64 = 0.15;
/// The level of the first frame.
const FIRST_LEVEL: f64 = 0.35;
/// CPUs reach about 1; what lies above is for GPUs.
const FINEST_LEVEL: f64 = 2.0;
/// Directions of shadow rays, at most: as many as whole pictures take.
const MAX_SHADOW_DIRECTIONS: u32 = 1024;

impl Budget {
    /// A budget of so many seconds per frame.
    ///
    /// ```
    /// let mut budget = pinspot::Budget::new(0.05);
    /// let first = budget.detail([800, 600]);
    /// (0..20).for_each(|_| budget.took(0.5));
    /// let later = budget.detail([800, 600]);
    /// assert!(later.samples < first.samples && later.size[0] < first.size[0]);
    /// ```
    pub fn new(target_seconds: f64) -> Self {
        Self { target: target_seconds.clamp(1e-3, 10.0), level: FIRST_LEVEL, samples: 0 }
    }

    /// Changes the target.
    pub fn set_target(&mut self, seconds: f64) {
        self.target = seconds.clamp(1e-3, 10.0);
    }

    /// What the next frame may spend, for a window of this many pixels.
    pub fn detail(&self, window: [u32; 2]) -> Detail {
        detail_at(self.level, window)
    }

    /// Takes into account how long a frame took, seconds. The first frame with another number of samples does not count: rigid mirrors
    /// get theirs once.
    pub fn took(&mut self, seconds: f64) {
        let samples = samples_at(self.level);
        if std::mem::replace(&mut self.samples, samples) != samples {
            return;
        }
        let excess = (seconds / self.target).max(1e-3).ln();
        if excess.abs() > DEAD_BAND {
            self.level = (self.level - (GAIN * excess).clamp(-MAX_STEP_UP, MAX_STEP_DOWN)).clamp(0.0, FINEST_LEVEL);
        }
    }
}

/// Samples at a level: in steps, so that they do not change from frame to frame.
fn samples_at(level: f64) -> u32 {
    (0.5 * (2.0 * between(160.0, 800.0, level).log2()).round()).exp2() as u32
}

/// A quantity that is `low` at level 0 and `high` at level 1.
fn between(low: f64, high: f64, level: f64) -> f64 {
    low * (high / low).powf(level)
}

/// From a sixteenth of the window's pixels and 160 samples of three taps to all of its pixels and, at level 1, 800 samples of sixteen. Above
/// that there are more samples, of which sums that are flat need no leaves, and light is computed in more pixels. Small pictures are better
/// than few samples: the error of `sheet` is .30 in every eighth pixel as in every fourth, but .78 from a quarter of the samples.
fn detail_at(level: f64, window: [u32; 2]) -> Detail {
    let between = |low: f64, high: f64| between(low, high, level);
    // In steps, so that the picture's size does not change from frame to frame, either.
    let steps = (between(4.0, 1.0).max(1.0) * 4.0).round() / 4.0;
    Detail {
        size: window.map(|edge| ((f64::from(edge) / steps).round() as u32).max(1)),
        samples: samples_at(level),
        taps: between(3.0, 16.0).min(16.0).round() as u32,
        spacing: between(4.0, 2.0).round() as u32,
        shadow_directions: (between(64.0, 160.0).round() as u32).min(MAX_SHADOW_DIRECTIONS),
        reuses_light: true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames whose cost follows from their detail settle near the target.
    #[test]
    fn the_target_is_held() {
        for speed in [1e5, 1e6, 1e7, 1e8, 1e10] {
            let cost = |detail: Detail| {
                let pixels = f64::from(detail.size[0] * detail.size[1]);
                (pixels * (1.0 + f64::from(detail.samples) / f64::from(detail.spacing).powi(2))) / speed / 10.0
            };
            let mut budget = Budget::new(0.05);
            let mut last = 0.0;
            for _ in 0..200 {
                last = cost(budget.detail([800, 600]));
                budget.took(last);
            }
            let [least, most] = [0.0, FINEST_LEVEL].map(|level| cost(detail_at(level, [800, 600])));
            let held = 0.05f64.clamp(least, most);
            assert!((0.6..1.6).contains(&(last / held)), "{speed}: {last} against {held}");
        }
    }

    /// What samples cost when they are placed does not drive the budget up and down.
    #[test]
    fn samples_that_are_placed_once_do_not_count() {
        let (mut budget, mut samples, mut changes) = (Budget::new(0.05), 0, 0);
        for frame in 0..200 {
            let detail = budget.detail([800, 600]);
            let is_placed = detail.samples != samples;
            changes += u32::from(is_placed && frame > 100);
            samples = detail.samples;
            budget.took(1e-4 * f64::from(samples) + if is_placed { 1.0 } else { 0.0 });
        }
        assert!((350..750).contains(&samples) && changes == 0, "{samples}, {changes} changes");
    }

    /// Every step towards the finest is finer in something, and coarser in nothing.
    #[test]
    fn details_become_finer() {
        let details: Vec<Detail> = (0..=20).map(|k| detail_at(0.1 * f64::from(k), [800, 600])).collect();
        for pair in details.windows(2) {
            let [coarse, fine] = [pair[0], pair[1]];
            assert!(fine != coarse && fine.size[0] >= coarse.size[0] && fine.samples >= coarse.samples, "{pair:?}");
            assert!(fine.taps >= coarse.taps && fine.spacing <= coarse.spacing, "{pair:?}");
            assert!(fine.shadow_directions >= coarse.shadow_directions, "{pair:?}");
        }
        let finest = details[20];
        assert_eq!((finest.size, finest.spacing, finest.taps), ([800, 600], 1, 16));
    }

    #[test]
    fn tiny_windows_have_a_pixel() {
        assert_eq!(detail_at(0.0, [1, 1]).size, [1, 1]);
    }
}
