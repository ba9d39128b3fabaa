//! The parts that the engine is made of, for renderers of one's own, tests and benchmarks. What is here may change with every
//! version.
//!
//! A program with a wgpu device of its own records the sum into its command encoder: see `examples/embed.rs`.

/// What receivers do with light.
pub mod brdf {
    pub use crate::brdf::*;
}

/// A hierarchy of samples whose cells tile the reflectors.
pub mod cell_tree {
    pub use crate::cell_tree::*;
}

/// Filters against the exact integral over a footprint.
#[cfg(feature = "gpu")]
pub mod conformance {
    pub use crate::conformance::*;
}

/// The surface around each sample: cells and curvature.
pub mod differential {
    pub use crate::differential::*;
}

/// Light: prefiltered cube maps and what is derived from them.
pub mod environment {
    pub use crate::environment::*;
}

/// Adapters, devices and shaders.
#[cfg(feature = "gpu")]
pub mod gpu {
    pub use crate::gpu::*;
}

/// Sums over pinhole samples, on the CPU and on GPUs.
pub mod pinhole {
    pub use crate::pinhole::*;
}

/// How much a mirror reflects by the angle of incidence.
pub mod reflectance {
    pub use crate::reflectance::*;
}

/// Where the samples are: strategies, densities, and how evenly they spread.
pub mod sampling {
    pub use crate::sampling::*;
}

/// Rays against a scene.
pub mod tracing {
    pub use crate::tracing::*;
}

/// The receivers that a scene's camera sees.
pub use crate::stages::visible_receivers;
