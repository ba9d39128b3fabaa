//! The stages of the engine by name, and how far a long one has come. Knows no work and no clock.

use std::fmt;

use serde::Serialize;

/// A stage of the engine: something that is made from the stages before it and kept until one of them changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Stage {
    /// The device is opened.
    Device,
    /// Objects' meshes in world space; one is made again for each object that moved or changed its shape.
    Geometry,
    /// The ray tracer's hierarchy of bounding volumes.
    Bvh,
    /// The surface that reflects.
    Surface,
    /// What the objects' surfaces do with light.
    Materials,
    /// The environment as a prefiltered cube map.
    Light,
    /// Bounds of the environment's radiance, for the hierarchy.
    LightBounds,
    /// The environment's irradiance by normal.
    Irradiance,
    /// The environment's distribution of power, for shadow rays.
    LightSampler,
    /// The samples' positions.
    Points,
    /// The surface around each sample: its cell and curvature.
    Differentials,
    /// The tree of cells.
    Tree,
    /// What each sample sees of its surroundings.
    Visibility,
    /// Pipelines, and copies of light and samples on the device.
    Upload,
    /// The mean irradiance over the picture, which the tolerance refers to.
    Estimate,
    /// What the camera sees: one ray for every point of the picture.
    Rays,
    /// Irradiance by way of the mirrors.
    Caustic,
    /// Irradiance from the environment itself.
    Direct,
    /// Paths from the camera by way of the mirrors that it sees.
    Paths,
    /// The light at the ends of these paths.
    PathEnds,
    /// Radiance towards the camera.
    Shading,
    /// The picture as it is displayed: exposed and tone-mapped.
    Display,
    /// The ground truth.
    Reference,
    /// Figures of sampling strategies.
    Quality,
    /// Trying filters.
    Filters,
}

impl Stage {
    /// The stages of a picture, in the order of the data.
    pub const ENGINE: [Self; 21] = [
        Self::Geometry,
        Self::Bvh,
        Self::Surface,
        Self::Materials,
        Self::Light,
        Self::LightBounds,
        Self::Irradiance,
        Self::LightSampler,
        Self::Points,
        Self::Differentials,
        Self::Tree,
        Self::Visibility,
        Self::Upload,
        Self::Estimate,
        Self::Rays,
        Self::Caustic,
        Self::Direct,
        Self::Paths,
        Self::PathEnds,
        Self::Shading,
        Self::Display,
    ];

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Device => "device",
            Self::Geometry => "geometry",
            Self::Bvh => "bvh",
            Self::Surface => "surface",
            Self::Materials => "materials",
            Self::Light => "light",
            Self::LightBounds => "light-bounds",
            Self::Irradiance => "irradiance",
            Self::LightSampler => "light-sampler",
            Self::Points => "points",
            Self::Differentials => "differentials",
            Self::Tree => "tree",
            Self::Visibility => "visibility",
            Self::Upload => "upload",
            Self::Estimate => "estimate",
            Self::Rays => "rays",
            Self::Caustic => "caustic",
            Self::Direct => "direct",
            Self::Paths => "paths",
            Self::PathEnds => "path-ends",
            Self::Shading => "shading",
            Self::Display => "display",
            Self::Reference => "reference",
            Self::Quality => "quality",
            Self::Filters => "filters",
        }
    }

    /// What a progress bar says while it runs.
    pub fn activity(self) -> &'static str {
        match self {
            Self::Device => "opening the device",
            Self::Geometry | Self::Bvh | Self::Surface | Self::Materials => "preparing the scene",
            Self::Light | Self::LightBounds | Self::Irradiance | Self::LightSampler => "preparing the light",
            Self::Points | Self::Differentials => "sampling the reflectors",
            Self::Tree => "building the tree",
            Self::Visibility => "tracing visibility maps",
            Self::Upload => "uploading",
            Self::Estimate => "estimating the irradiance",
            Self::Rays | Self::Paths => "tracing camera rays",
            Self::Caustic => "summing the caustic",
            Self::Direct => "direct light",
            Self::PathEnds => "summing reflections",
            Self::Shading => "shading",
            Self::Display => "tone mapping",
            Self::Reference => "reference",
            Self::Quality => "sampling quality",
            Self::Filters => "testing filters",
        }
    }
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Is told what is worked on. Called from any thread; stages do not nest. The library reads no clock: whoever wants
/// seconds takes them between [`Progress::begin`] and [`Progress::end`].
pub trait Progress: Sync {
    /// A stage begins; it will take `total` steps.
    fn begin(&self, stage: Stage, total: u64);
    /// More steps of the stage are done.
    fn advance(&self, steps: u64);
    /// The stage is over, whether it succeeded or not.
    fn end(&self, stage: Stage);
}

/// Ignores all progress.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProgress;

impl Progress for NoProgress {
    fn begin(&self, _: Stage, _: u64) {}
    fn advance(&self, _: u64) {}
    fn end(&self, _: Stage) {}
}
