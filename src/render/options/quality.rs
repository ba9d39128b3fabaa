//! Qualities by name: settings that make sense together.

use serde::{Deserialize, Serialize};

use super::{EvaluationChoice, MAX_CELLS_OF_BINDING, Options, Settings};
use crate::pinhole::Footprint;
use crate::technique::Technique;

/// How much time a picture is worth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quality {
    /// A quarter of the samples, larger cells and a larger error: for composing a picture.
    Draft,
    /// The scene's own settings.
    #[default]
    Normal,
    /// Smaller cells, a smaller error, and four points a pixel.
    Final,
}

/// One quality, relative to the scene's settings.
struct Step {
    /// One in so many of the samples.
    samples_divisor: u32,
    leaves: u32,
    tolerance: f32,
    pixel_samples: u32,
}

/// From a first glance, by way of a draft, to final.
const STEPS: [Step; 5] = [
    Step { samples_divisor: 16, leaves: 4, tolerance: 0.2, pixel_samples: 1 },
    DRAFT,
    Step { samples_divisor: 1, leaves: 64, tolerance: 0.01, pixel_samples: 1 },
    Step { samples_divisor: 1, leaves: 256, tolerance: 0.003, pixel_samples: 1 },
    FINAL,
];
const DRAFT: Step = Step { samples_divisor: 4, leaves: 16, tolerance: 0.05, pixel_samples: 1 };
const FINAL: Step = Step { samples_divisor: 1, leaves: 256, tolerance: 0.003, pixel_samples: 2 };
/// No step has fewer samples, unless the scene has.
const MIN_SAMPLES: u32 = 100;

impl Step {
    fn samples(&self, samples: u32) -> u32 {
        (samples / self.samples_divisor).max(MIN_SAMPLES.min(samples))
    }

    /// Leaves per sample, as far as every device has memory for them.
    fn leaves(&self, samples: u32) -> u32 {
        let most = (MAX_CELLS_OF_BINDING / u64::from(samples)).max(1) as u32;
        self.leaves.min(4u32.pow(most.ilog(4)))
    }
}

impl Settings {
    /// These settings at another quality. Flat sums and footprints by curvature have no leaves and no tolerance.
    #[must_use]
    pub fn at_quality(self, quality: Quality) -> Self {
        let step = match quality {
            Quality::Draft => DRAFT,
            Quality::Normal => return self,
            Quality::Final => FINAL,
        };
        let samples = step.samples(self.samples.unwrap_or(Options::default().samples));
        let has_leaves =
            self.evaluation != Some(EvaluationChoice::Flat) && self.footprint != Some(Footprint::Curvature);
        Self {
            samples: Some(samples),
            leaves: if has_leaves { Some(step.leaves(samples)) } else { self.leaves },
            tolerance: if has_leaves { Some(step.tolerance) } else { self.tolerance },
            pixel_samples: Some(step.pixel_samples),
            ..self
        }
    }
}

impl Options {
    /// The same picture from coarse to fine, each several times as much work as the one before.
    pub fn coarse_to_fine(&self) -> Vec<Self> {
        if self.technique == Technique::ImageSpace {
            return self.with_few_to_many_photons();
        }
        let mut steps: Vec<Self> = STEPS.iter().map(|step| self.at_step(step)).collect();
        steps.dedup();
        steps
    }

    /// These options at another quality, as [`Settings::at_quality`].
    #[must_use]
    pub fn at_quality(&self, quality: Quality) -> Self {
        let has_photons = self.technique == Technique::ImageSpace;
        match quality {
            Quality::Normal => self.clone(),
            Quality::Draft if has_photons => self.with_few_to_many_photons().swap_remove(0),
            Quality::Final if has_photons => self.with_few_to_many_photons().pop().unwrap_or_else(|| self.clone()),
            Quality::Draft => self.at_step(&DRAFT),
            Quality::Final => self.at_step(&FINAL),
        }
    }

    fn at_step(&self, step: &Step) -> Self {
        let has_leaves = self.evaluation != EvaluationChoice::Flat && self.footprint != Footprint::Curvature;
        let samples = step.samples(self.samples);
        let options = self.clone().with_samples(samples).with_pixel_samples(step.pixel_samples);
        if has_leaves {
            options.with_leaves(Some(step.leaves(samples))).with_tolerance(step.tolerance)
        } else {
            options
        }
    }

    /// The same for techniques that send photons.
    fn with_few_to_many_photons(&self) -> Vec<Self> {
        let photons = self.image_space.photons;
        let at = |photons: u32, pixel_samples: u32| {
            let mut options = self.clone().with_pixel_samples(pixel_samples.max(self.pixel_samples));
            options.image_space.photons = photons;
            options
        };
        let mut steps = vec![at(photons / 4, 1), at(photons, 1), at(2 * photons, 1), at(4 * photons, 2)];
        // Near the limits some are out of range.
        steps.retain(|step| step.check().is_ok());
        steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn qualities_are_valid_for_any_number_of_samples() {
        for samples in [1, 30, 1000, 65_536] {
            let settings = Settings { samples: Some(samples), ..Default::default() };
            for quality in [Quality::Draft, Quality::Normal, Quality::Final] {
                let options = settings.clone().at_quality(quality).options().unwrap();
                assert!(options.samples <= samples, "{samples}, {quality:?}");
            }
            let options = settings.options().unwrap();
            let steps = options.coarse_to_fine();
            assert!(steps.iter().all(|step| step.check().is_ok()));
            let work = |o: &Options| f64::from(o.samples * o.leaves.unwrap_or(1)) / f64::from(o.tolerance);
            assert!(steps.windows(2).all(|pair| work(&pair[0]) <= work(&pair[1])));
        }
    }

    #[test]
    fn photons_become_more() {
        for photons in [16, 64, 512, 4096, 8192] {
            let mut options = Options::default().with_technique(Technique::ImageSpace);
            options.image_space.photons = photons;
            let steps = options.coarse_to_fine();
            let counts: Vec<u32> = steps.iter().map(|step| step.image_space.photons).collect();
            assert!(counts.contains(&photons) && counts.is_sorted_by(|a, b| a < b), "{counts:?}");
            assert!(counts.len() >= 2 && steps.iter().all(|step| step.check().is_ok()), "{counts:?}");
        }
    }

    #[test]
    fn flat_sums_differ_in_samples_only() {
        let flat = Options::default().with_evaluation(EvaluationChoice::Flat);
        let steps = flat.coarse_to_fine();
        assert!(steps.iter().all(|step| step.leaves.is_none() && step.tolerance == flat.tolerance));
        assert_eq!(steps.iter().map(|step| step.samples).collect::<Vec<_>>(), [100, 250, 1000, 1000]);
    }
}
