//! The library's error, with a variant per stage. Each message says what is wrong, where, and what would be right.

use crate::OptionError;
use crate::environment::EnvironmentError;
#[cfg(feature = "gpu")]
use crate::gpu::GpuError;
use crate::image::ImageError;
use crate::pinhole::cpu::HardwareFilterError;
use crate::progress::Progress;
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
    Reference(ReferenceError),
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

impl From<HardwareFilterError> for Error {
    fn from(error: HardwareFilterError) -> Self {
        OptionError::invalid("filter", format!("does not fit: {error}")).into()
    }
}

impl From<ReferenceError> for Error {
    fn from(error: ReferenceError) -> Self {
        match error {
            ReferenceError::Option(error) => Self::Option(error),
            ReferenceError::Mesh(error) => Self::Mesh(error),
            ReferenceError::Environment(error) => Self::Environment(error),
            ReferenceError::Image(error) => Self::Image(error),
            ReferenceError::Cancelled => Self::Cancelled,
            error => Self::Reference(error),
        }
    }
}

/// Ends what nobody waits for any more, before incomplete results are used.
pub(crate) fn check_wanted(progress: &dyn Progress) -> Result<(), Error> {
    if progress.is_cancelled() { Err(Error::Cancelled) } else { Ok(()) }
}
