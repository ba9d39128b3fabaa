//! Ground truth: an unbiased estimate of the irradiance that the techniques approximate, and its standard error.
//!
//! It shares no sampling, footprint or filter code with what it judges. Data flows scene → `geometry` (f64 triangles) and
//! `light` (radiance from the original image) → a `domain` to integrate over (`reflectors`, or the `sky` for direct light) →
//! a `cut` per receiver point (the density) → replicates of quasi-random points → [`Estimate`].
//! This module must not know samples, cells, cube maps, back ends or wgpu.

mod cone;
mod cut;
mod domain;
mod geometry;
mod light;
mod map;
mod maxima;
mod receivers;
mod reflectors;
mod replicates;
mod sky;
mod store;

use std::time::{Duration, Instant};

use rayon::prelude::*;

use self::domain::Domain;
use self::geometry::Geometry;
use self::light::Light;
use self::receivers::Receivers;
use self::reflectors::Reflectors;
use self::replicates::{Moments, Work};
use self::sky::Sky;
use crate::image::Image;
use crate::scene::{Scene, Visibility};
use crate::{Error, OptionError, Progress};

/// What is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Quantity {
    /// Irradiance by one mirror bounce, W/m², before albedo.
    #[default]
    Caustic,
    /// Irradiance from the environment without the mirrors' reflections, W/m², before albedo.
    Direct,
}

/// How points on the mirrors are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Density {
    /// In proportion to hierarchical bounds of light × geometry.
    #[default]
    Bounded,
    /// Uniformly: brute force, to check the former.
    Uniform,
}

/// What to compute and how.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Options {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// n: the mean over n×n points of a pixel; 1: at pixel centres.
    pub pixel_samples: u32,
    /// The quantity.
    pub quantity: Quantity,
    /// Occlusion.
    pub visibility: Visibility,
    /// `false` drops the 1/l² alone.
    pub attenuation: bool,
    /// How points are chosen.
    pub density: Density,
    /// Independent randomisations that the standard error comes from; at least 16.
    pub replicates: u32,
    /// Random seed.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            size: [512, 512],
            pixel_samples: 1,
            quantity: Quantity::default(),
            visibility: Visibility::default(),
            attenuation: true,
            density: Density::default(),
            replicates: 16,
            seed: 1,
        }
    }
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// The relative standard error √Σse² / √ΣE² over the image at which the work is done.
    pub rel_error: f64,
    /// Stop before that when this time is up; the first pass is always finished.
    pub seconds: Option<f64>,
    /// Stop before that after about this many points per pixel, all passes and replicates together.
    pub points: Option<f64>,
}

/// Irradiance and what is known of its error.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// W/m².
    pub irradiance: Image,
    /// Its standard error, W/m²; itself uncertain where most replicates miss a rare light, that is, where it is more than
    /// about a tenth of the irradiance.
    pub standard_error: Image,
    /// How it came about.
    pub account: Account,
}

/// How an estimate came about.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Account {
    /// Independent passes that were combined.
    pub passes: u32,
    /// Sum of the passes' weights, which are the squares of their points per replicate.
    pub weight: f64,
    /// Mean number of points per pixel, all passes and replicates together.
    pub points_per_pixel: f64,
    /// Seconds of work.
    pub seconds: f64,
}

impl Estimate {
    /// √Σse² / √ΣE² over the image; 0 for a black one without error.
    pub fn rel_error(&self) -> f64 {
        let norm = |image: &Image| image.pixels.iter().map(|p| p.as_dvec3().length_squared()).sum::<f64>().sqrt();
        let (error, norm) = (norm(&self.standard_error), norm(&self.irradiance));
        if error == 0.0 { 0.0 } else { error / norm }
    }
}

/// Points per replicate in the first pass.
const PILOT_POINTS: f64 = 16.0;
/// A pass takes about this long at most, so that an interruption costs no more.
const LONGEST_PASS: Duration = Duration::from_secs(90);

/// A scene, prepared for ground truth.
#[derive(Debug)]
pub struct Reference {
    scene: Scene,
    options: Options,
    geometry: Geometry,
    light: Light,
    receivers: Receivers,
    fingerprint: String,
    /// What was repaired while loading.
    pub notes: Vec<String>,
}

impl Reference {
    /// Loads the light and finds what the camera sees.
    pub fn new(scene: Scene, options: Options) -> Result<Self, Error> {
        let fail = |key: &'static str, message: &str| Err(OptionError { key, message: message.into() }.into());
        if options.size.iter().any(|s| !(1..=16384).contains(s)) {
            return fail("size", "must be from 1×1 to 16384×16384 pixels");
        }
        if !(1..=16).contains(&options.pixel_samples) {
            return fail("pixel_samples", "must be from 1 to 16");
        }
        if !(16..=1024).contains(&options.replicates) {
            return fail("replicates", "must be from 16 to 1024");
        }
        if options.quantity == Quantity::Caustic && scene.objects.iter().all(|o| o.reflector.is_none()) {
            return fail("reflector", "is missing: give an object `reflector = { sides = \"front\" }`");
        }
        let (light, repaired) = Light::load(&scene.environment)?;
        let notes = scene.notes.iter().cloned().chain(repaired).collect();
        let geometry = Geometry::new(&scene);
        let receivers = Receivers::find(&scene, &geometry, options.size, options.pixel_samples);
        let described = serde_json::to_string(&options).expect("options are plain data");
        let fingerprint = scene.fingerprint(&described)?;
        Ok(Self { scene, options, geometry, light, receivers, fingerprint, notes })
    }

    /// Names everything that the result depends on; two references with one fingerprint may be combined.
    pub fn fingerprint(&self) -> &str {
        &self.fingerprint
    }

    /// Adds passes to `known` (or starts) until the goal is reached, and shows every improvement to `save`.
    pub fn solve(
        &self,
        goal: &Goal,
        known: Option<Estimate>,
        progress: &dyn Progress,
        save: &mut dyn FnMut(&Estimate) -> Result<(), Error>,
    ) -> Result<Estimate, Error> {
        let Goal { rel_error, seconds, points } = *goal;
        if !(rel_error > 0.0 && rel_error.is_finite()) {
            let message = format!("is {rel_error}, but must be a number greater than 0");
            return Err(OptionError { key: "rel_error", message }.into());
        }
        if let Some(seconds) = seconds.filter(|s| s.is_nan() || *s <= 0.0) {
            let message = format!("is {seconds}, but must be a number greater than 0");
            return Err(OptionError { key: "seconds", message }.into());
        }
        let started = Instant::now();
        let mut estimate = if let Some(estimate) = known {
            estimate
        } else {
            let first = self.pass(PILOT_POINTS, None, 0, progress);
            save(&first)?;
            first
        };
        let mut last_points = (estimate.account.weight / f64::from(estimate.account.passes)).sqrt();
        let mut last_seconds = estimate.account.seconds / f64::from(estimate.account.passes);
        while estimate.rel_error() > rel_error {
            let left = seconds.map_or(f64::INFINITY, |s| s - started.elapsed().as_secs_f64());
            let points_left = points.map_or(f64::INFINITY, |p| p - estimate.account.points_per_pixel);
            // What is left is too little for anything that would help.
            if left <= 0.1 * last_seconds || points_left <= 0.1 * estimate.account.points_per_pixel {
                break;
            }
            let wanted = last_points * growth(estimate.rel_error(), rel_error);
            let affordable = last_points * LONGEST_PASS.as_secs_f64().min(left) / last_seconds;
            let allowed = points_left / f64::from(self.options.replicates);
            let points = wanted.min(affordable).min(allowed).max(2.0);
            let pass = self.pass(points, Some(&estimate), u64::from(estimate.account.passes), progress);
            (last_points, last_seconds) = (points, pass.account.seconds);
            estimate = combine(estimate, &pass);
            save(&estimate)?;
        }
        Ok(estimate)
    }

    /// One independent pass of about `points` points per replicate and pixel; where `known` is uncertain, more.
    fn pass(&self, points: f64, known: Option<&Estimate>, index: u64, progress: &dyn Progress) -> Estimate {
        progress.begin("reference", u64::from(self.options.size[0]) * u64::from(self.options.size[1]));
        let started = Instant::now();
        let counts = replicates::points_per_pixel(points, known, self.options.size);
        let work = Work { receivers: &self.receivers, options: &self.options, counts: &counts, pass: index, progress };
        let moments = match self.options.quantity {
            Quantity::Caustic => {
                let Options { visibility, attenuation, .. } = self.options;
                let domain = Reflectors::new(&self.scene, &self.geometry, &self.light, visibility, attenuation);
                all_pixels(&domain, &work)
            }
            Quantity::Direct => {
                let Self { geometry, light, .. } = self;
                all_pixels(&Sky { geometry, light, visibility: self.options.visibility }, &work)
            }
        };
        let [width, height] = self.options.size;
        let image = |f: fn(&Moments) -> glam::DVec3| Image {
            width,
            height,
            pixels: moments.iter().map(|m| f(m).as_vec3()).collect(),
        };
        let total: f64 = counts.iter().map(|c| f64::from(*c)).sum::<f64>() * f64::from(self.options.replicates);
        Estimate {
            irradiance: image(|m| m.mean),
            standard_error: image(|m| m.standard_error),
            account: Account {
                passes: 1,
                weight: points * points,
                points_per_pixel: total / counts.len() as f64,
                seconds: started.elapsed().as_secs_f64(),
            },
        }
    }
}

fn all_pixels<D: Domain>(domain: &D, work: &Work) -> Vec<Moments> {
    let pixels = work.counts.len();
    (0..pixels)
        .into_par_iter()
        .with_min_len(16)
        .map_init(cut::Cut::new, |cut, pixel| replicates::pixel(domain, work, pixel, cut))
        .collect()
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
