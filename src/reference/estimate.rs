//! What is known of an image: means, standard errors, and how they came about.

use std::sync::Arc;

use glam::Vec3;

use super::{Ledger, ReferenceError};
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
    /// Light that is known otherwise, and that errors are relative to, too.
    pub(super) beside: Option<Arc<Image>>,
    /// The account of the picture's flux; `None` before the end, and of what none is kept of.
    pub ledger: Option<Ledger>,
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
            beside: None,
            ledger: None,
        }
    }

    /// The same with all that is unknown as 0 without error.
    pub(super) fn made_certain(mut self) -> Self {
        self.standard_error.pixels.fill(Vec3::ZERO);
        self.irradiance.pixels.fill(Vec3::ZERO);
        self.weights.fill(1.0);
        self.is_fine.fill(true);
        self.statistics.passes = 1;
        self
    }

    /// √Σse² / √ΣE² over the image; 0 for a black one without error, infinite while pixels are unknown.
    pub fn rel_error(&self) -> f64 {
        let norm =
            |pixels: &mut dyn Iterator<Item = Vec3>| pixels.map(|p| p.as_dvec3().length_squared()).sum::<f64>().sqrt();
        let own = self.irradiance.pixels.iter().copied();
        let norm_of_light = match &self.beside {
            Some(beside) => norm(&mut own.zip(&beside.pixels).map(|(own, beside)| own + *beside)),
            None => norm(&mut { own }),
        };
        let (error, norm) = (norm(&mut self.standard_error.pixels.iter().copied()), norm_of_light);
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

    /// An error that says how far the work came, unless every pixel is known, or that light is missing, unless the ledger of flux closes.
    pub fn check(&self) -> Result<(), ReferenceError> {
        let coverage = self.coverage();
        if coverage < 1.0 {
            return Err(ReferenceError::Incomplete { coverage });
        }
        match &self.ledger {
            Some(ledger) if !ledger.closes() => Err(ReferenceError::Unbalanced { ledger: ledger.clone() }),
            _ => Ok(()),
        }
    }
}
