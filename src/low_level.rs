//! The parts that the engine is made of, for other renderers, tests and benchmarks. This module may change with every
//! version.
//!
//! A program with its own wgpu device records the sum into its command encoder: see `examples/embed.rs`. On the CPU, the sum
//! over a hierarchy of samples takes these steps:
//!
//! ```
//! use pinspot::low_level::cell_tree::{CellTree, TreeOptions};
//! use pinspot::low_level::environment::{CubeSize, Environment, LightBounds};
//! use pinspot::low_level::pinhole::{Params, PinholeTree, Receivers};
//! use pinspot::low_level::pinhole::cpu::{Accuracy, Light, estimate_irradiance, gather_hierarchical};
//! use pinspot::low_level::sampling::{Options, Strategy, Surface, sample};
//! use pinspot::glam::Vec3;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let (scene, _) = pinspot::load("ring-natural")?;
//! let surface = Surface::of_scene(&scene);
//! let set = sample(&surface, &Options { samples: 100, strategy: Strategy::Neighbourhood, seed: 1 })?;
//! let cells = CellTree::new(&surface, &set, &TreeOptions { leaves: 16, seed: 1 });
//! let tree = PinholeTree::new(&scene, cells);
//!
//! let environment = Environment::new(&scene.environment.light, CubeSize::Auto)?;
//! let bounds = LightBounds::new(&environment.cube);
//! let light = Light::Environment { cube: &environment.cube, bounds: &bounds };
//!
//! let receivers = Receivers::from_points(&[(Vec3::ZERO, Vec3::Y, 1)], 1);
//! let params = Params::default();
//! let error = 0.01 * estimate_irradiance(&receivers, &tree, light, &params);
//! let accuracy = Accuracy { error, split_near: true };
//! let sums = gather_hierarchical(&receivers, &tree, light, &params, accuracy, &pinspot::NoProgress);
//! let [red, green, blue, fetches] = sums[0];
//! assert!(red > 0.0 && green > 0.0 && blue > 0.0 && fetches > 0.0);
//! # Ok(())
//! # }
//! ```

/// BRDFs of receivers.
pub mod brdf {
    pub use pinspot_base::brdf::{BrdfTable, Gloss, LEAST_ROUGHNESS, Material, Materials, TableError};
}

/// A hierarchy of samples whose cells tile the reflectors.
pub mod cell_tree {
    pub use pinspot_sums::cell_tree::{CellNode, CellTree, MAX_LEAVES, NodeGeometry, TreeOptions};
}

/// Filters against the exact integral over a footprint.
#[cfg(feature = "gpu")]
pub mod conformance {
    pub use pinspot_render::conformance::{
        Conformance, Device, FilterResult, PATTERNS, Pattern, Verdict, examine, zone_plates,
    };
}

/// The surface around each sample: cells and curvature.
pub mod differential {
    pub use pinspot_sums::differential::{Cell, DifferentialSample, differentials, write_ply};
}

/// Environment lighting: prefiltered cube maps, and what is derived from them.
pub mod environment {
    pub use pinspot_sums::environment::{
        BUILT_IN_MAPS, Bound, BuiltInMap, CubeMap, CubeSize, Environment, EnvironmentError, EnvironmentRadiance, FACES,
        LightBounds, LightSampler, MAX_CUBE_SIZE, face_direction, face_of_direction, irradiance_map,
        texel_solid_angle_sr,
    };
}

/// Adapters, devices and shaders.
#[cfg(feature = "gpu")]
pub mod gpu {
    pub use pinspot_render::gpu::{Adapter, Gpu, GpuError, adapters};
}

/// Sums over pinhole samples, on the CPU and on GPUs.
pub mod pinhole {
    pub use pinspot_render::pinhole::{
        BATCH_SIZE, CURVE_POINTS, CellShapes, Epsilon, Filter, Footprint, GatherUniforms, MAX_TAPS, MEDIUM_OBJECT,
        NO_RECEIVER, Params, PinholeParts, PinholeSample, PinholeTree, Pinholes, Probe, ReceiverLayout, Receivers,
        ReflectanceCurve, SurroundingView, Surroundings, ViewDirections, Viewpoint, VisibilityMaps, pinholes,
    };

    /// On the CPU.
    pub mod cpu {
        pub use pinspot_render::pinhole::cpu::{
            Accuracy, CachedGather, CachedSums, Contribution, CubeLookup, HardwareFilterError, Lanes16, Light, Lights,
            TakenCell, cells_taken, contributions, contributions_to, estimate_irradiance, gather, gather_hierarchical,
            gather_lamp, gather_surroundings, probe,
        };
    }

    /// On GPUs.
    #[cfg(feature = "gpu")]
    pub mod gpu {
        pub use pinspot_render::pinhole::gpu::{
            CellTreeBuffers, Engine, EnvironmentCube, Frame, FrameInputs, FrameLight, FrameViewers, GatherOptions,
            Geometry, HardwareVerdict, HierarchicalEngine, HierarchicalFrame, HierarchicalInputs, HierarchicalOptions,
            LightBoundsBuilder, LightBoundsTexture, LightKind, MapTracer, MapTracing, MapUse, TARGET_FORMAT, Tolerance,
            TreeLight, UploadedLamp, UploadedSurroundings, VisibilityMapBuffers, automatic_filter,
            check_hardware_filter, probe,
        };
    }
}

/// Specular reflectance of mirrors by angle of incidence.
pub mod reflectance {
    pub use pinspot_base::reflectance::{Curve, Finish, Metal, WAVELENGTHS, coated, interface, rec709_of_reflectance};
}

/// Placement of samples: strategies, densities, and measures of their quality.
pub mod sampling {
    pub use pinspot_sums::sampling::{
        Density, Importance, MAX_SAMPLES, Options, Parameterization, PointSet, Quality, SamplingError, Spectrum,
        Strategy, StrategyStatistics, Surface, SurfacePoint, TestSurface, quality, sample, sample_by,
        strategy_statistics,
    };
}

/// Ray tracing.
pub mod tracing {
    pub use pinspot_sums::tracing::{Hit, Piece, Tracer};
}

/// The receivers that a scene's camera sees.
pub use pinspot_render::stages::visible_receivers;
