//! **Pinspot** renders caustics from natural light.
//!
//! Every small piece of a mirror acts as a pinhole camera that projects its surroundings onto the surfaces it faces. Wand and
//! Straßer (*Real-Time Caustics*, 2003) made an algorithm of it: discretise the reflector into sample points; each projects
//! the environment map onto the receivers, blurred by a footprint that follows from the surface's curvature around the
//! sample; sum over the samples. Pinspot is that algorithm, on GPUs through wgpu and on CPUs.
//!
//! ```text
//!  scene ──► stages ──► technique (pinhole: sampling, differential, cell_tree) ──► engine ──► image
//!                                                                                    │
//!  scene ──► reference ─────────────────────────────────────────────► report ◄───────┘
//! ```
//!
//! Data flows from left to right; no module imports from one to its right.
//!
//! Programs that want pictures start at [`Engine`]. Programs with a wgpu device of their own start at
//! [`low_level::gpu`]; see `examples/embed.rs`. Comparisons with the ground truth are in [`report`] and
//! [`reference`](mod@reference).
//!
//! ```
//! use pinspot::{Backend, Engine, NoProgress, blocking};
//!
//! let (scene, options) = pinspot::load("mirror-sphere")?;
//! let backend = Backend::cpu();
//! let mut engine = Engine::new(scene, options.with_size([32, 32]).with_samples(50), backend.clone());
//! let rendered = blocking::wait(backend.device(), engine.render(&NoProgress))?;
//! assert_eq!(rendered.layers[0].1.pixels.len(), 32 * 32);
//! # Ok::<(), pinspot::Error>(())
//! ```
//!
//! # Features
//!
//! All are on by default. Without any of them the crate is a library for scenes, light, sampling, trees and sums on the CPU.
//!
//! | feature | adds |
//! |---|---|
//! | `gpu` | sums, rays and previews on GPUs through wgpu |
//! | `blocking` | waiting for the library's futures on the calling thread |
//! | `builtin-maps` | the environment maps of `envmaps`, embedded |
//! | `report` | comparisons with the ground truth as JSON, CSV and HTML |
//! | `view` | the interactive window |
//! | `cli` | the `pinspot` command |
//!
//! # Units
//!
//! Metres, radians, W/(m²·sr), W/m². Right-handed, Y up, linear Rec.709.

// The command is written as any other program that uses the library.
#[cfg(feature = "cli")]
extern crate self as pinspot;

#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
pub mod low_level;
#[cfg(feature = "view")]
mod viewer;

pub use glam;
pub use pinspot_base::{NoProgress, OptionError, Progress, Stage, image, scene};
pub use pinspot_reference as reference;
#[cfg(feature = "blocking")]
pub use pinspot_render::blocking;
/// The README's snippets are compiled with the tests of this documentation.
#[cfg(all(doctest, feature = "blocking", feature = "gpu"))]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(feature = "gpu")]
pub use pinspot_render::engine::PassTime;
pub use pinspot_render::engine::{
    Budget, Detail, Engine, Inspection, LineKind, MAX_FOOTPRINTS, MapFootprint, Mark, Preview, ReceiverInspection,
    Rendered, Report, TakenCell,
};
pub use pinspot_render::image_space::{Hits, ImageSpaceOptions, Incidence, Ledger, Loss, MapView, Mode, Traversal};
pub use pinspot_render::options::{
    DisplaySettings, Evaluation, EvaluationChoice, Exposure, Exposures, FilterChoice, Options, Overlay, Quality,
    Settings, load,
};
#[cfg(feature = "report")]
pub use pinspot_render::report;
pub use pinspot_render::sequence::{Sequence, SequenceReport};
pub use pinspot_render::stages::StageCounts;
pub use pinspot_render::technique::{PhotonStatistics, Technique, place_samples};
pub use pinspot_render::{Backend, BackendChoice, BackendReport, BoxFuture, Device, Error};
pub use pinspot_sums::environment::CubeSize;
pub use pinspot_sums::pinhole::{Epsilon, Filter, Footprint, SampleView};
pub use pinspot_sums::sampling::{Density, Strategy};
#[cfg(feature = "view")]
pub use viewer::{ViewError, view};
#[cfg(feature = "gpu")]
pub use wgpu;

/// Names the code of this build: the version, and a hash of all sources. Pictures and references that are kept in files carry it, so that
/// those of other code are neither used again nor gone on from.
pub fn code_id() -> &'static str {
    concat!(env!("CARGO_PKG_VERSION"), "+", env!("PINSPOT_CODE"))
}
