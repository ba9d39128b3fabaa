//! Techniques: ways to compute the irradiance that reaches receivers by way of the mirrors.
//!
//! A technique prepares itself from the stages that all share ([`crate::stages`]), keeps what it has made, and hands out a
//! [`Sum`] that is evaluated at any receivers. To add one: a variant of [`Technique`], and a module with an implementation of
//! [`TechniqueStages`]. This module must not know pictures, cameras' paths or files.

mod pinhole;

use std::fmt;
use std::pin::Pin;
use std::sync::Arc;

use glam::Vec3;
use serde::{Deserialize, Serialize};

pub use self::pinhole::place_samples;
use crate::Error;
use crate::backend::Backend;
use crate::options::{Evaluation, Options};
use crate::pinhole::{Filter, Receivers};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::stages::{LightStages, PreparedLight, PreparedScene, StageCounts};

/// A way to compute the irradiance that reaches receivers by way of the mirrors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Technique {
    /// Every sample of a mirror projects the environment like a pinhole camera (Wand and Straßer 2003).
    #[default]
    Pinhole,
}

impl Technique {
    /// Its name in scene files, in reports and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pinhole => "pinhole",
        }
    }

    /// Its stages, with nothing made yet.
    pub(crate) fn stages(self) -> Box<dyn TechniqueStages> {
        match self {
            Self::Pinhole => Box::new(pinhole::PinholeStages::new()),
        }
    }
}

impl fmt::Display for Technique {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A result that may have to be waited for.
pub(crate) type Pending<'a, T> = Pin<Box<dyn Future<Output = Result<T, Error>> + 'a>>;

/// What a technique prepares itself from.
pub(crate) struct Inputs<'a> {
    pub scene: &'a Scene,
    pub prepared: &'a PreparedScene,
    pub light: &'a PreparedLight,
    pub options: &'a Options,
    pub backend: &'a Backend,
    pub progress: &'a dyn Progress,
}

/// A technique's own stages.
pub(crate) trait TechniqueStages: fmt::Debug + Send {
    /// Makes what changed again. The same sum comes back where nothing did.
    fn prepare<'a>(&'a mut self, inputs: Inputs<'a>, light: &'a mut LightStages) -> Pending<'a, Arc<dyn Sum>>;

    /// Adds how often its stages were made.
    fn count(&self, counts: &mut StageCounts);
}

/// A technique that is ready to be evaluated.
pub(crate) trait Sum: fmt::Debug + Send + Sync {
    /// Irradiance at every receiver in W/m² and, in w, the number of fetches of the environment; towards viewers, where
    /// the receivers have any, radiance in W/(m²·sr). For an intensity of the environment of 1. Tells how many receivers
    /// are done.
    fn irradiance<'a>(&'a self, receivers: &'a Receivers, progress: &'a dyn Progress) -> Pending<'a, Vec<[f32; 4]>>;

    /// What it is made of.
    fn statistics(&self) -> &Statistics;
}

/// What a sum is made of.
#[derive(Clone, Debug)]
pub(crate) struct Statistics {
    /// Samples in use.
    pub samples: usize,
    /// Where they are.
    pub positions: Arc<Vec<Vec3>>,
    /// How they are summed.
    pub evaluation: Evaluation,
    /// How the environment is looked up.
    pub filter: Filter,
    /// What the user should know about the filter.
    pub warning: Option<String>,
}
