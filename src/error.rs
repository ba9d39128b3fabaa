//! The library's error, with a variant per stage. Each message says what is wrong, where, and what would be right.

use crate::environment::EnvironmentError;
#[cfg(feature = "gpu")]
use crate::gpu::GpuError;
use crate::image::ImageError;
use crate::pinhole::cpu::HardwareFilterError;
use crate::reference::ReferenceError;
#[cfg(feature = "report")]
use crate::report::ReportError;
use crate::sampling::SamplingError;
use crate::scene::{MeshError, SceneError};

/// Anything that can go wrong between a scene file and a picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The scene file, or a mesh in it.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// An object's mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The light.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// The samples.
    #[error(transparent)]
    Sampling(#[from] SamplingError),
    /// The GPU.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A picture file.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The ground truth.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// A report.
    #[cfg(feature = "report")]
    #[error(transparent)]
    Report(#[from] ReportError),
    /// An option out of its range.
    #[error(transparent)]
    Option(#[from] OptionError),
    /// The progress sink said that the result is not wanted any more.
    #[error("cancelled")]
    Cancelled,
}

/// An invalid option. The command adds its flags to the message.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum OptionError {
    /// A value outside its range.
    #[error("{key} is {value}, but must be {expected}")]
    OutOfRange {
        /// The option, as scene files call it.
        key: &'static str,
        /// What was given.
        value: String,
        /// What can be given.
        expected: String,
    },
    /// A value that another option rules out.
    #[error("{key} {reason}")]
    Conflict {
        /// The option, as scene files call it.
        key: &'static str,
        /// Why it cannot be.
        reason: String,
        /// Options and values, any of which would do.
        remedies: &'static [(&'static str, &'static str)],
    },
}

impl From<HardwareFilterError> for Error {
    fn from(error: HardwareFilterError) -> Self {
        OptionError::invalid("filter", format!("does not fit: {error}")).into()
    }
}

impl OptionError {
    /// A value that cannot be, for this reason.
    pub fn invalid(key: &'static str, reason: impl Into<String>) -> Self {
        Self::Conflict { key, reason: reason.into(), remedies: &[] }
    }

    /// The option, as scene files call it.
    pub fn key(&self) -> &'static str {
        match self {
            Self::OutOfRange { key, .. } | Self::Conflict { key, .. } => key,
        }
    }
}
