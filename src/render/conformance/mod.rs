//! How well filters average an environment cube over footprints: every filter against the exact integral.
//!
//! Vendors give no such test, and several adapters ignore explicit gradients on cube maps without a word. Data flows
//! `patterns` (test cubes) × `footprints` → `truth` (the integral of the cube's bilinear level 0 over the parallelogram, in
//! f64) and a filter's answers → [`FilterResult`] with a [`Verdict`]. This module must not know scenes or samples.

mod footprints;
mod patterns;
mod picture;
mod truth;

pub use patterns::{PATTERNS, Pattern};
pub use picture::zone_plates;

use serde::{Serialize, Serializer};

use self::footprints::{Case, cases};
use self::truth::means;
use crate::boxed::BoxFuture;
use crate::gpu::{Gpu, GpuError};
use crate::pinhole::{Filter, Probe, cpu, gpu};

/// What a filter's answers are worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Close to the exact integral, whatever the footprint's shape.
    Right,
    /// Right in some footprints, too blurred or aliased in others.
    Approximate,
    /// Given gradients, and makes nothing of their direction.
    WrongIgnoresGradients,
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Right => "right",
            Self::Approximate => "approximate",
            Self::WrongIgnoresGradients => "wrong: ignores the gradients",
        })
    }
}

/// Where a filter runs.
#[derive(Clone, Copy, Debug)]
pub enum Device<'a> {
    /// The CPU back end.
    Cpu,
    /// An adapter.
    Gpu(&'a Gpu),
}

impl<'a> Device<'a> {
    /// The wgpu device; `None` for the CPU.
    pub fn wgpu_device(self) -> Option<&'a wgpu::Device> {
        match self {
            Self::Cpu => None,
            Self::Gpu(gpu) => Some(&gpu.device),
        }
    }

    async fn probe(
        self,
        pattern: Pattern,
        filter: Filter,
        taps: u32,
        probes: &[Probe],
    ) -> Result<Vec<[f32; 4]>, GpuError> {
        match self {
            // `filters` offers none that the CPU lacks.
            Self::Cpu => Ok(cpu::probe(pattern.cube(), filter, taps, probes).unwrap_or_default()),
            Self::Gpu(device) => gpu::probe(device, pattern.cube(), filter, taps, probes).await,
        }
    }

    /// The filters that are tried here: all of them, the anisotropic one with several numbers of taps.
    pub fn filters(self) -> Vec<(Filter, u32)> {
        let mut filters = vec![
            (Filter::None, 1),
            (Filter::Isotropic, 1),
            (Filter::Anisotropic, 4),
            (Filter::Anisotropic, 8),
            (Filter::Anisotropic, 16),
            (Filter::Ewa, 1),
        ];
        if matches!(self, Self::Gpu(_)) {
            filters.push((Filter::Hardware, 16));
        }
        filters
    }
}

/// How a filter did.
#[derive(Clone, Debug, Serialize)]
pub struct FilterResult {
    /// The filter.
    pub filter: Filter,
    /// Most taps, where the filter has them.
    pub taps: u32,
    /// The verdict.
    pub verdict: Verdict,
    /// Root mean square error over all footprints and patterns; 1 is the pattern's deviation, or that of the exact means
    /// where it is larger (footprints seek the sun).
    pub rms_error: f64,
    /// The same, pattern by pattern.
    pub by_pattern: Vec<(Pattern, f64)>,
    /// The same, aspect ratio by aspect ratio.
    pub by_aspect: Vec<(f64, f64)>,
    /// The same by where the footprint lies.
    #[serde(serialize_with = "as_pairs")]
    pub by_place: Vec<(&'static str, f64)>,
    /// How much of the difference between footprints along and across stripes comes out: 1 is all, 0 is none.
    pub orientation: f64,
    /// Mean fetches per footprint.
    pub fetches: f64,
}

fn as_pairs<S: Serializer>(pairs: &[(&'static str, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(pairs.iter())
}

/// Results of all filters on one device.
#[derive(Clone, Debug, Serialize)]
pub struct Conformance {
    /// The device, in words.
    pub device: String,
    /// Filter by filter.
    pub results: Vec<FilterResult>,
    /// What `--filter auto` picks here: by a quick form of this test that every render can afford.
    pub auto: Filter,
    /// Footprints per pattern.
    pub footprints: usize,
}

/// An error up to this much of a pattern's deviation is right: 16 taps have .066, 8 taps, with which long footprints blur, .074.
const RIGHT: f64 = 0.07;
/// Less than this much of the difference between two directions is none.
const SEES_DIRECTION: f64 = 0.5;

/// Tries all filters on a device. `progress` is told of every pattern that a filter is done with.
pub fn examine<'a>(device: Device<'a>, progress: &'a dyn Fn()) -> BoxFuture<'a, Result<Conformance, GpuError>> {
    Box::pin(async move {
        let cases = cases();
        let exact: Vec<Vec<f64>> = PATTERNS.iter().map(|pattern| means(pattern.cube(), &cases)).collect();
        let mut results = Vec::new();
        for (filter, taps) in device.filters() {
            let mut answers = Vec::new();
            let mut fetches = 0.0;
            for pattern in PATTERNS {
                let probes: Vec<Probe> = cases.iter().map(|c| c.probe).collect();
                let got = device.probe(pattern, filter, taps, &probes).await?;
                fetches += got.iter().map(|g| f64::from(g[3])).sum::<f64>();
                answers.push(got.iter().map(|g| f64::from(g[0])).collect::<Vec<f64>>());
                progress();
            }
            fetches /= (cases.len() * PATTERNS.len()) as f64;
            results.push(judge(filter, taps, &cases, &exact, &answers, fetches));
        }
        let (device, auto) = match device {
            Device::Cpu => ("CPU".to_owned(), Filter::Anisotropic),
            Device::Gpu(gpu) => (gpu.adapter.to_string(), gpu::automatic_filter(gpu).await?),
        };
        Ok(Conformance { device, auto, results, footprints: cases.len() })
    })
}

fn judge(
    filter: Filter,
    taps: u32,
    cases: &[Case],
    exact: &[Vec<f64>],
    answers: &[Vec<f64>],
    fetches: f64,
) -> FilterResult {
    // Errors in deviations: [pattern][case].
    let errors: Vec<Vec<f64>> = PATTERNS
        .iter()
        .zip(exact.iter().zip(answers))
        .map(|(pattern, (exact, got))| {
            let deviation = pattern.deviation().max(deviation(exact));
            exact.iter().zip(got).map(|(e, g)| (g - e) / deviation).collect()
        })
        .collect();
    let over = |chosen: &dyn Fn(&Case) -> bool| {
        let all = errors.iter().flat_map(|e| e.iter().zip(cases)).filter(|(_, case)| chosen(case));
        let (sum, count) = all.fold((0.0, 0.0), |(sum, count), (e, _)| (sum + e * e, count + 1.0));
        f64::sqrt(sum / count)
    };
    let rms_error = over(&|_| true);
    let of_pattern = |e: &Vec<f64>| (e.iter().map(|e| e * e).sum::<f64>() / e.len() as f64).sqrt();
    let orientation = orientation(cases, exact, answers);
    let verdict = if rms_error <= RIGHT {
        Verdict::Right
    } else if filter == Filter::Hardware && orientation < SEES_DIRECTION {
        Verdict::WrongIgnoresGradients
    } else {
        Verdict::Approximate
    };
    FilterResult {
        filter,
        taps,
        verdict,
        rms_error,
        by_pattern: PATTERNS.iter().copied().zip(errors.iter().map(of_pattern)).collect(),
        by_aspect: footprints::ASPECTS.iter().map(|a| (*a, over(&|c| c.aspect == *a))).collect(),
        by_place: footprints::PLACES.iter().map(|p| (p.name, over(&|c| c.place == p.name))).collect(),
        orientation,
        fetches,
    }
}

/// Standard deviation.
fn deviation(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}

/// The slope of the answers' differences between two perpendicular footprints over the exact ones, on stripes.
fn orientation(cases: &[Case], exact: &[Vec<f64>], answers: &[Vec<f64>]) -> f64 {
    let (mut xx, mut xy) = (0.0, 0.0);
    for (pattern, (exact, got)) in PATTERNS.iter().zip(exact.iter().zip(answers)) {
        if !matches!(pattern, Pattern::Rows | Pattern::Columns) {
            continue;
        }
        for (k, case) in cases.iter().enumerate().filter(|(_, c)| c.aspect >= 8.0) {
            if let Some(other) = case.perpendicular {
                xx += (exact[k] - exact[other]).powi(2);
                xy += (exact[k] - exact[other]) * (got[k] - got[other]);
            }
        }
    }
    xy / xx
}
