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

mod backend;
#[cfg(feature = "blocking")]
pub mod blocking;
mod brdf;
mod cell_tree;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
#[cfg(feature = "gpu")]
mod conformance;
mod differential;
mod disjoint_sets;
mod engine;
mod environment;
mod error;
#[cfg(feature = "gpu")]
mod gpu;
pub mod image;
mod image_space;
mod lanes;
pub mod low_level;
mod options;
mod pinhole;
mod progress;
pub mod reference;
mod reflectance;
#[cfg(feature = "report")]
pub mod report;
mod sampling;
pub mod scene;
mod sequence;
mod stages;
mod technique;
mod tracing;
mod vectors;
#[cfg(feature = "view")]
mod viewer;
mod words;

pub use backend::{Backend, BackendChoice, BackendReport, Device};
#[cfg(feature = "gpu")]
pub use engine::PassTime;
pub use engine::{
    Budget, Detail, Engine, Inspection, LineKind, MAX_FOOTPRINTS, MapFootprint, Mark, Preview, ReceiverInspection,
    Rendered, Report, TakenCell,
};
pub use environment::CubeSize;
pub use error::{Error, OptionError};
pub use glam;
pub use image_space::{Hits, ImageSpaceOptions, Incidence, Ledger, Loss, MapView, Mode, Traversal};
pub use options::{
    DisplaySettings, Evaluation, EvaluationChoice, Exposure, Exposures, FilterChoice, Options, Overlay, Quality,
    Settings, load,
};
pub use pinhole::{Epsilon, Filter, Footprint, SampleView};
pub use progress::{NoProgress, Progress, Stage};
pub use sampling::{Density, Strategy};
pub use sequence::{Sequence, SequenceReport};
pub use stages::StageCounts;
pub use technique::{PhotonStatistics, Technique, place_samples};
#[cfg(feature = "view")]
pub use viewer::{ViewError, view};
#[cfg(feature = "gpu")]
pub use wgpu;
