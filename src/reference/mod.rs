//! Ground truth: an unbiased estimate of the irradiance that the techniques approximate, and its standard error.
//!
//! It shares no sampling, footprint or filter code with what it judges. Data flows scene → `geometry` (f64 triangles) and
//! `light` (radiance from the original image) → a `domain` to integrate over (`reflectors`, or the `sky` for direct light) →
//! a `cut` per receiver point (the density) → replicates of quasi-random points, in
//! `passes` over the image → [`Estimate`].
//! This module must not know samples, cells, cube maps, back ends or wgpu.

mod brdf;
mod cone;
mod cut;
mod domain;
mod geometry;
mod gloss;
mod light;
mod map;
mod maxima;
mod passes;
mod receivers;
mod reflectors;
mod replicates;
mod sky;
mod store;
mod tree;

use self::domain::Domain;
use self::geometry::Geometry;
use self::light::Light;
use self::passes::Passes;
use self::receivers::Receivers;
use self::reflectors::Reflectors;
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
    /// What receivers reflect of that to the camera, by their own distribution functions, W/(m²·sr).
    Reflected,
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
    /// W/m², or what else the quantity is measured in.
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
    /// Sum of the passes' weights, squares of their mean points per replicate (the first one's a tenth of that).
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
        let fail = |key: &'static str, message: &str| Err(OptionError::invalid(key, message).into());
        if options.size.iter().any(|s| !(1..=16384).contains(s)) {
            return fail("size", "must be from 1×1 to 16384×16384 pixels");
        }
        if !(1..=16).contains(&options.pixel_samples) {
            return fail("pixel_samples", "must be from 1 to 16");
        }
        if !(16..=1024).contains(&options.replicates) {
            return fail("replicates", "must be from 16 to 1024");
        }
        if options.quantity != Quantity::Direct && scene.objects.iter().all(|o| o.reflector.is_none()) {
            return fail("reflector", "is missing: give an object `reflector = { sides = \"front\" }`");
        }
        let light = Light::new(&scene.environment)?;
        let notes = scene.notes.clone();
        let geometry = Geometry::new(&scene);
        let receivers = Receivers::find(&scene, &geometry, options.size, options.pixel_samples);
        let described = serde_json::to_string(&options).expect("options are plain data");
        let fingerprint = scene.fingerprint(&described);
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
        let Goal { rel_error, seconds, .. } = *goal;
        if !(rel_error > 0.0 && rel_error.is_finite()) {
            let message = format!("is {rel_error}, but must be a number greater than 0");
            return Err(OptionError::invalid("rel_error", message).into());
        }
        if let Some(seconds) = seconds.filter(|s| s.is_nan() || *s <= 0.0) {
            let message = format!("is {seconds}, but must be a number greater than 0");
            return Err(OptionError::invalid("seconds", message).into());
        }
        match self.options.quantity {
            Quantity::Caustic | Quantity::Reflected => {
                let domain = Reflectors::new(&self.scene, &self.geometry, &self.light, &self.options);
                self.passes(&domain, progress).solve(goal, known, save)
            }
            Quantity::Direct => {
                let Self { geometry, light, .. } = self;
                let domain = Sky { geometry, light, visibility: self.options.visibility };
                self.passes(&domain, progress).solve(goal, known, save)
            }
        }
    }

    fn passes<'a, D: Domain>(&'a self, domain: &'a D, progress: &'a dyn Progress) -> Passes<'a, D> {
        Passes { domain, receivers: &self.receivers, options: &self.options, progress }
    }
}
