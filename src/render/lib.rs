//! The engine of Pinspot: stages, techniques and pictures, on CPUs and on GPUs.
//!
//! ```text
//!  scene ──► stages ──► technique (pinhole, image_space) ──► engine ──► image
//! ```
//!
//! Data flows from left to right; no module imports from one to its right. Users see these items in the crate `pinspot`.

mod backend;
#[cfg(feature = "blocking")]
pub mod blocking;
mod boxed;
#[cfg(feature = "gpu")]
pub mod conformance;
pub mod engine;
mod error;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod image_space;
pub mod options;
pub mod pinhole;
#[cfg(feature = "report")]
pub mod report;
pub mod sequence;
pub mod stages;
pub mod technique;

pub use backend::{Backend, BackendChoice, BackendReport, Device};
pub use boxed::BoxFuture;
pub use engine::{Engine, Rendered, Report};
pub use error::Error;
pub use options::{Evaluation, EvaluationChoice, Exposure, Exposures, FilterChoice, Options, Settings, load};
pub use pinspot_reference as reference;
#[cfg(feature = "gpu")]
pub use wgpu;

use pinspot_base::{NoProgress, OptionError, brdf, image, parallel, progress, reflectance, scene, words};
use pinspot_sums::{cell_tree, differential, environment, lanes, sampling, tracing};
