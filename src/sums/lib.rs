//! The sums over pinholes on CPUs, and what they are made from: samples, cells, rays and environment lighting.
//!
//! All SIMD code is in this crate, which is therefore compiled with full optimisation. Users see its items in the crate
//! `pinspot`, most of them in `pinspot::low_level`. Nothing here knows devices, techniques or the engine.

pub mod cell_tree;
pub mod differential;
pub mod environment;
pub mod lanes;
pub mod pinhole;
pub mod sampling;
pub mod tracing;

use pinspot_base::{DisjointSets, brdf, image, parallel, progress, reflectance, scene, words};
