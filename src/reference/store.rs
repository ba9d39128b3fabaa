//! References in files: an EXR with `R G B`, `error.R error.G error.B`, and what is needed to go on: each pixel's weight and
//! whether its cuts are as fine as pays (`weight.R weight.G`), and a text among the attributes.

use std::path::{Path, PathBuf};

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::estimate::Statistics;
use super::schedule::SPLIT_LIMITS;
use super::{Estimate, Reference, ReferenceError, StoppingCriterion};
use crate::Progress;
use crate::image::{Image, read_exr, read_exr_text, write_exr_with_text};

const FINGERPRINT: &str = "pinspot.fingerprint";
const CODE: &str = "pinspot.code";
const STATISTICS: &str = "pinspot.statistics";
const ERROR: &str = "error";
const WEIGHT: &str = "weight";
/// Seconds between two states of a file while the work goes on.
const SECONDS_BETWEEN_WRITES: f64 = 60.0;
/// No work of ours comes near these.
const MOST_PASSES: u32 = 1_000_000;
const MOST_POINTS: f64 = 1e15;
const MOST_WEIGHT: f32 = 1e30;

/// Where an estimate is kept.
#[derive(Clone, Copy, Debug)]
pub struct EstimateFile<'a> {
    /// The file (.exr).
    pub path: &'a Path,
    /// Names the code that computes. No other code goes on from the file.
    pub code: &'a str,
}

/// An estimate as it is kept in a file.
#[derive(Clone, Debug)]
pub struct Stored {
    /// The estimate.
    pub estimate: Estimate,
    /// Seconds of work so far, by the caller's clock.
    pub seconds: f64,
}

/// The text beside the pictures.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Text {
    statistics: Statistics,
    level: usize,
    seconds: f64,
}

impl Reference {
    /// Goes on from `known` (or starts) until the criterion is met, and keeps the state in a file: after every pass, about once
    /// a minute by `clock` (seconds from any start), and in the end.
    pub fn solve_in_file(
        &self,
        file: &EstimateFile,
        known: Option<Stored>,
        criterion: &StoppingCriterion,
        clock: &dyn Fn() -> f64,
        progress: &dyn Progress,
    ) -> Result<Stored, ReferenceError> {
        let started = clock();
        let before = known.as_ref().map_or(0.0, |k| k.seconds);
        let seconds = || before + (clock() - started).max(0.0);
        let mut written = started;
        let checkpoint = &mut |estimate: &Estimate, ends_pass: bool| {
            if !ends_pass && clock() - written < SECONDS_BETWEEN_WRITES {
                return Ok(());
            }
            written = clock();
            self.write(file, estimate, seconds())
        };
        let had = known.as_ref().map_or_else(Statistics::default, |k| k.estimate.statistics);
        let estimate = self.solve_in_passes(criterion, known.map(|k| k.estimate), progress, checkpoint)?;
        if had != estimate.statistics {
            self.write(file, &estimate, seconds())?;
        }
        Ok(Stored { estimate, seconds: seconds() })
    }

    /// Writes an estimate, whole or not at all.
    pub fn write(&self, file: &EstimateFile, estimate: &Estimate, seconds: f64) -> Result<(), ReferenceError> {
        let text = Text { statistics: estimate.statistics, level: estimate.level, seconds };
        let text = serde_json::to_string(&text).expect("numbers are plain data");
        let mut weights = estimate.irradiance.clone();
        for (pixel, (weight, is_fine)) in weights.pixels.iter_mut().zip(estimate.weights.iter().zip(&estimate.is_fine))
        {
            *pixel = Vec3::new(*weight, f32::from(*is_fine), 0.0);
        }
        let layers = [("", &estimate.irradiance), (ERROR, &estimate.standard_error), (WEIGHT, &weights)];
        let texts = [(FINGERPRINT, self.fingerprint().to_owned()), (CODE, file.code.to_owned()), (STATISTICS, text)];
        Ok(write_exr_with_text(file.path, &layers, &texts)?)
    }

    /// Reads an estimate to go on from; `None` if there is no file. A file that holds anything else than an earlier state of
    /// this very reference by the same code is an error: it may be hours of other work.
    pub fn read(&self, file: &EstimateFile) -> Result<Option<Stored>, ReferenceError> {
        let path = file.path;
        if !path.exists() {
            return Ok(None);
        }
        let damaged = |reason: String| ReferenceError::Damaged { path: path.into(), reason };
        let text = |name| read_exr_text(path, name).map_err(|e| damaged(e.to_string()));
        if text(FINGERPRINT)?.is_none_or(|fingerprint| fingerprint != self.fingerprint()) {
            return Err(ReferenceError::Foreign { path: PathBuf::from(path) });
        }
        let theirs = text(CODE)?.unwrap_or_else(|| "without a name".into());
        if theirs != file.code {
            return Err(ReferenceError::OtherCode { path: path.into(), theirs, ours: file.code.into() });
        }
        let text = text(STATISTICS)?.ok_or_else(|| damaged("its statistics are missing".into()))?;
        let text: Text = serde_json::from_str(&text).map_err(|e| damaged(format!("its statistics: {e}")))?;
        let layer = |name| read_exr(path, name).map_err(|e| damaged(e.to_string()));
        let stored = self.checked(&text, layer("")?, layer(ERROR)?, &layer(WEIGHT)?);
        stored.map(Some).map_err(|what| damaged(format!("{what} out of range")))
    }

    /// The parts of a file together, or what of them nothing that was written here can be.
    fn checked(
        &self,
        text: &Text,
        irradiance: Image,
        standard_error: Image,
        weights: &Image,
    ) -> Result<Stored, &'static str> {
        let Text { statistics, level, seconds } = *text;
        let within = |value: f64, most: f64| (0.0..=most).contains(&value);
        if [&irradiance, &standard_error, weights].iter().any(|i| [i.width, i.height] != self.options.size) {
            return Err("its size is");
        }
        if statistics.passes > MOST_PASSES || !within(statistics.points_per_pixel, MOST_POINTS) {
            return Err("its statistics are");
        }
        if level >= SPLIT_LIMITS.len() || !within(seconds, f64::MAX) {
            return Err("its statistics are");
        }
        let is_fine = weights.pixels.iter().map(|w| w.y > 0.5).collect();
        let weights: Vec<f32> = weights.pixels.iter().map(|w| w.x).collect();
        if weights.iter().any(|w| !(0.0..=MOST_WEIGHT).contains(w) || *w == 0.0 && level > 0) {
            return Err("a pixel's weight is");
        }
        let is_known = |pixel: Vec3| pixel.is_finite() && pixel.min_element() >= 0.0;
        let known = weights.iter().zip(&standard_error.pixels).all(|(w, error)| *w == 0.0 || is_known(*error));
        if !known || !irradiance.pixels.iter().all(|p| is_known(*p)) {
            return Err("a pixel is");
        }
        let estimate =
            Estimate { irradiance, standard_error, statistics, weights, is_fine, level, beside: None, ledger: None };
        Ok(Stored { estimate, seconds })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Options;
    use pinspot_base::NoProgress;

    fn reference(seed: u64) -> Reference {
        let scene = crate::scene::load::<toml::Table>("mirror-sphere").unwrap().scene;
        Reference::new(scene, Options { size: [12, 8], seed, ..Default::default() }).unwrap()
    }

    fn file(path: &Path) -> EstimateFile<'_> {
        EstimateFile { path, code: "this code" }
    }

    fn solved(reference: &Reference, path: &Path) -> Stored {
        let ticks = std::cell::Cell::new(0.0);
        let clock = || ticks.replace(ticks.get() + 1.0);
        let criterion = StoppingCriterion::new(0.2);
        reference.solve_in_file(&file(path), None, &criterion, &clock, &NoProgress).unwrap()
    }

    #[test]
    fn a_file_is_gone_on_from_by_its_own_reference_only() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.exr");
        let own = reference(1);
        assert!(own.read(&file(&path)).unwrap().is_none(), "there is none yet");
        let first = solved(&own, &path);
        assert!(first.seconds >= 1.0, "by the caller's clock");
        let known = own.read(&file(&path)).unwrap().expect("the same reference");
        assert_eq!(known.estimate.irradiance, first.estimate.irradiance);
        assert_eq!(known.estimate.standard_error, first.estimate.standard_error);
        assert_eq!(known.estimate.weights, first.estimate.weights);
        assert_eq!(known.estimate.statistics, first.estimate.statistics);
        let better = StoppingCriterion::new(0.1 * first.estimate.rel_error());
        let better = own.solve_in_file(&file(&path), Some(known), &better, &|| 0.0, &NoProgress).unwrap();
        assert!(better.estimate.statistics.passes > first.estimate.statistics.passes);
        assert!(better.estimate.rel_error() <= 0.1 * first.estimate.rel_error());
        assert!(better.seconds <= first.seconds, "what the clock did not count is not added");

        let is_foreign = |path| matches!(own.read(&file(path)), Err(ReferenceError::Foreign { .. }));
        assert!(matches!(reference(2).read(&file(&path)), Err(ReferenceError::Foreign { .. })), "another seed");
        let by_other_code = own.read(&EstimateFile { path: &path, code: "other code" }).unwrap_err();
        assert!(matches!(by_other_code, ReferenceError::OtherCode { .. }));
        let message = by_other_code.to_string();
        assert!(["truth.exr", "this code", "other code"].iter().all(|part| message.contains(part)), "{message}");
        crate::image::write_exr(&path, &[("", &Image::new(12, 8))]).unwrap();
        assert!(is_foreign(&path), "another picture");
    }

    #[test]
    fn damaged_files_are_refused_with_the_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.exr");
        let own = reference(1);
        let refused = || {
            let message = own.read(&file(&path)).unwrap_err().to_string();
            assert!(
                message.contains("truth.exr") && message.contains("damaged") && message.contains("delete it"),
                "{message}"
            );
        };
        let Stored { estimate, seconds } = solved(&own, &path);
        let spoil = |spoil: &dyn Fn(&mut Estimate)| {
            let mut estimate = estimate.clone();
            spoil(&mut estimate);
            own.write(&file(&path), &estimate, seconds).unwrap();
            refused();
        };
        spoil(&|e| e.weights[3] = f32::MAX);
        spoil(&|e| e.weights[3] = f32::NAN);
        spoil(&|e| e.weights[3] = -1.0);
        spoil(&|e| (e.weights[3], e.level) = (0.0, 1));
        spoil(&|e| e.standard_error.pixels[5].y = f32::INFINITY);
        spoil(&|e| e.irradiance.pixels[5].y = f32::NAN);
        spoil(&|e| e.irradiance.pixels[5].y = -1.0);
        spoil(&|e| e.statistics.points_per_pixel = 1e300);
        spoil(&|e| e.statistics.passes = u32::MAX);
        spoil(&|e| e.level = 77);
        own.write(&file(&path), &estimate, -1.0).unwrap();
        refused();
        own.write(&file(&path), &estimate, seconds).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for end in [whole.len() / 2, 100, 0] {
            std::fs::write(&path, &whole[..end]).unwrap();
            refused();
        }
        std::fs::write(&path, &whole).unwrap();
        assert!(own.read(&file(&path)).unwrap().is_some());
    }
}
