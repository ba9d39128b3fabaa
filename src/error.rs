//! The library's error: one variant a stage. Each message says what is wrong, where, and what to do.

use crate::environment::EnvironmentError;
use crate::gpu::GpuError;
use crate::image::ImageError;
use crate::reference::ReferenceError;
use crate::report::ReportError;
use crate::sampling::SamplingError;
use crate::scene::SceneError;

/// Anything that can go wrong between a scene file and a picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The scene file, or a mesh in it.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The light.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// The samples.
    #[error(transparent)]
    Sampling(#[from] SamplingError),
    /// The GPU.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A picture file.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The ground truth.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// A report.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// An option out of its range.
    #[error(transparent)]
    Option(#[from] OptionError),
}

/// An option out of its range.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{key} {message}")]
pub struct OptionError {
    /// The option's name.
    pub key: &'static str,
    /// What is wrong and what to do.
    pub message: String,
}
