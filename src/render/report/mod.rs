//! Comparisons of techniques against the ground truth: what `pinspot compare` writes.
//!
//! Data flows [`Plan`] (which combinations) → `cells` (one rendered combination, kept in a file) → `rows` (its errors) →
//! `findings` (what the numbers say) → [`Comparison::write`]: report.json, report.csv and report.html. It calls the
//! renderer, the reference and the statistics of strategies as any user of the library would, and must not know wgpu or shaders.

mod cells;
mod compare;
mod comparison;
mod encode;
mod findings;
mod flip;
mod page;
mod plan;
mod rows;

pub use cells::Clock;
pub use compare::{Request, compare};
pub use comparison::{Comparison, ReferenceSummary, Unavailable};
pub use encode::spectrum_picture;
pub use findings::Finding;
pub use plan::{Figure, Plan};
pub use rows::Row;

use std::path::PathBuf;

use crate::options::EvaluationChoice;

/// Why a report could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The folder could not be made.
    #[error("cannot create the folder '{}': {reason}; give -o a folder that can be written to", path.display())]
    Folder {
        /// Folder.
        path: PathBuf,
        /// The system's reason.
        reason: String,
    },
    /// An evaluation that none of the plan's filters and footprints go with.
    #[error(
        "no combination of these has the evaluation {}: a hierarchy filters anisotropically and needs the footprint cells; name both, or leave the evaluation out",
        evaluation.name()
    )]
    NoCombination {
        /// The evaluation.
        evaluation: EvaluationChoice,
    },
    /// A scene that none of the techniques can compute.
    #[error("nothing can be compared on this scene: {reason}; choose other techniques")]
    NoTechnique {
        /// Each technique's reason.
        reason: String,
    },
    /// A reference that is mostly noise.
    #[error(
        "the reference has a relative standard error of {rel_error:.2} so far, and nothing can be compared with that; the same command goes on from here: give it more --seconds"
    )]
    NoReference {
        /// Its relative standard error.
        rel_error: f64,
    },
    /// A filter that the back end does not have.
    #[error("the CPU has no hardware filter; leave it out, or compare on a GPU")]
    NoHardwareFilter,
    /// A mask of another size.
    #[error("the mask '{}' is {width}×{height} pixels, but the pictures are {expected_width}×{expected_height}; give a mask of their size", path.display())]
    MaskSize {
        /// File.
        path: PathBuf,
        /// Its width.
        width: u32,
        /// Its height.
        height: u32,
        /// The pictures' width.
        expected_width: u32,
        /// The pictures' height.
        expected_height: u32,
    },
    /// A mask that names no pixel.
    #[error("the mask '{}' is black all over; paint white what is to be measured", path.display())]
    MaskEmpty {
        /// File.
        path: PathBuf,
    },
}
