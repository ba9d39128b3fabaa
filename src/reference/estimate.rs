//! What is known of an image: means, standard errors, and how they came about.

use glam::Vec3;

use super::ReferenceError;
use crate::image::Image;

/// Irradiance and what is known of its error.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// W/m², or what else the quantity is measured in; 0 where nothing is known yet.
    pub irradiance: Image,
    /// Its standard error, W/m²; itself uncertain where most replicates miss a rare light, that is, where it is more than
    /// about a tenth of the irradiance. Infinite where nothing is known yet.
    pub standard_error: Image,
    /// How it came about.
    pub statistics: Statistics,
    /// Sums of the weights of the passes that reached each pixel.
    pub(super) weights: Vec<f32>,
    /// Whether the cuts for each pixel have been as fine as pays.
    pub(super) is_fine: Vec<bool>,
    /// How fine cuts may be in the next pass: an index of [`super::schedule::SPLIT_LIMITS`].
    pub(super) level: usize,
}

/// How an estimate came about.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Statistics {
    /// Independent passes that were begun.
    pub passes: u32,
    /// Mean number of points per pixel, all passes and replicates together.
    pub points_per_pixel: f64,
}

impl Estimate {
    pub(super) fn unknown([width, height]: [u32; 2]) -> Self {
        let black = Image::new(width, height);
        Self {
            standard_error: black.map(|_| Vec3::INFINITY),
            weights: vec![0.0; black.pixels.len()],
            is_fine: vec![false; black.pixels.len()],
            irradiance: black,
            statistics: Statistics::default(),
            level: 0,
        }
    }

    /// √Σse² / √ΣE² over the image; 0 for a black one without error, infinite while pixels are unknown.
    pub fn rel_error(&self) -> f64 {
        let norm = |image: &Image| image.pixels.iter().map(|p| p.as_dvec3().length_squared()).sum::<f64>().sqrt();
        let (error, norm) = (norm(&self.standard_error), norm(&self.irradiance));
        if error == 0.0 { 0.0 } else { error / norm }
    }

    /// The part of the pixels that anything is known of.
    pub fn coverage(&self) -> f64 {
        self.weights.iter().filter(|w| **w > 0.0).count() as f64 / self.weights.len() as f64
    }

    /// About the points per replicate that each pixel's value comes from: weights are squares of points.
    pub(super) fn points(&self) -> impl Iterator<Item = f64> {
        self.weights.iter().map(|weight| f64::from(*weight).sqrt())
    }

    /// An error that says how far the work came, unless every pixel is known.
    pub fn check_complete(&self) -> Result<(), ReferenceError> {
        let coverage = self.coverage();
        if coverage < 1.0 { Err(ReferenceError::Incomplete { coverage }) } else { Ok(()) }
    }
}
