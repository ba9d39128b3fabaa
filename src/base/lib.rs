//! The ground floor of Pinspot: descriptions of scenes, image files, materials, the names of stages and the use of all
//! cores.
//!
//! Users see these items in the crate `pinspot`. Nothing here knows samples, rays, cube maps or devices.

pub mod brdf;
mod disjoint_sets;
pub mod image;
pub mod maps;
mod option_error;
pub mod parallel;
pub mod progress;
pub mod reflectance;
pub mod scene;
pub mod vectors;
pub mod words;

pub use disjoint_sets::DisjointSets;
pub use glam;
pub use option_error::OptionError;
pub use progress::{NoProgress, Progress, Stage};
