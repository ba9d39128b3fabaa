//! The parts that the engine is made of, for other renderers, tests and benchmarks. This module may change with every
//! version.
//!
//! A program with its own wgpu device records the sum into its command encoder: see `examples/embed.rs`.

/// BRDFs of receivers.
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

/// Environment lighting: prefiltered cube maps, and what is derived from them.
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

/// Specular reflectance of mirrors by angle of incidence.
pub mod reflectance {
    pub use crate::reflectance::*;
}

/// Placement of samples: strategies, densities, and measures of their quality.
pub mod sampling {
    pub use crate::sampling::*;
}

/// Ray tracing.
pub mod tracing {
    pub use crate::tracing::*;
}

/// The receivers that a scene's camera sees.
pub use crate::stages::visible_receivers;
