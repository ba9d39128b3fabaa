//! The names of the stages, and the progress of long ones. Independent of the work itself, and of clocks.

use std::fmt;

use serde::Serialize;

/// A stage: a result that is made from the stages before it, and kept until one of them changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Stage {
    /// The device.
    Device,
    /// Objects' meshes in world space, each made again when its object moves or changes its shape.
    Geometry,
    /// The ray tracer's bounding volume hierarchy.
    Bvh,
    /// The reflecting surface, from which samples are drawn.
    Surface,
    /// Reflectance of the objects' surfaces.
    Materials,
    /// The environment as a prefiltered cube map.
    Light,
    /// Emitters, as they are seen from the mirrors.
    LightGeometry,
    /// What mirrors see of surfaces in the light of lamps.
    Surroundings,
    /// The cube map with emitters drawn into it.
    LitEnvironment,
    /// Bounds of the environment's radiance, for hierarchical sums.
    LightBounds,
    /// The environment's irradiance by normal.
    Irradiance,
    /// The environment's distribution of power, for importance sampling of direct light.
    LightSampler,
    /// The samples' positions.
    Points,
    /// The surface around each sample: its cell and curvature.
    Differentials,
    /// The tree of cells.
    Tree,
    /// The samples' visibility maps.
    Visibility,
    /// Pipelines, and copies of light and samples on the device.
    Upload,
    /// The estimate of the mean irradiance over the picture, to which the tolerance is relative.
    Estimate,
    /// Photons from the lights' views, and the maps that they are added to.
    Photons,
    /// Camera rays: the first hit for every point of the picture.
    Rays,
    /// The caustic: irradiance via mirrors.
    Caustic,
    /// Direct light: irradiance from the environment without a mirror.
    Direct,
    /// Light that the medium scatters towards the camera.
    Scattering,
    /// Paths from the camera via the mirrors that it sees.
    Paths,
    /// The light at the end points of these paths.
    PathEnds,
    /// Radiance towards the camera.
    Shading,
    /// The display image: exposed and tone-mapped.
    Display,
    /// The ground truth.
    Reference,
    /// Quality measures of sampling strategies.
    Quality,
    /// Tests of filters.
    Filters,
}

impl Stage {
    /// The stages of a picture, in the order of the data flow.
    pub const ENGINE: [Self; 26] = [
        Self::Geometry,
        Self::Bvh,
        Self::Surface,
        Self::Materials,
        Self::Light,
        Self::LightGeometry,
        Self::LitEnvironment,
        Self::LightBounds,
        Self::Irradiance,
        Self::LightSampler,
        Self::Points,
        Self::Differentials,
        Self::Tree,
        Self::Visibility,
        Self::Surroundings,
        Self::Upload,
        Self::Estimate,
        Self::Photons,
        Self::Rays,
        Self::Caustic,
        Self::Direct,
        Self::Scattering,
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
            Self::LightGeometry => "light-geometry",
            Self::LitEnvironment => "lit-environment",
            Self::LightBounds => "light-bounds",
            Self::Irradiance => "irradiance",
            Self::LightSampler => "light-sampler",
            Self::Points => "points",
            Self::Differentials => "differentials",
            Self::Tree => "tree",
            Self::Visibility => "visibility",
            Self::Surroundings => "surroundings",
            Self::Upload => "upload",
            Self::Estimate => "estimate",
            Self::Photons => "photons",
            Self::Rays => "rays",
            Self::Caustic => "caustic",
            Self::Direct => "direct",
            Self::Scattering => "scattering",
            Self::Paths => "paths",
            Self::PathEnds => "path-ends",
            Self::Shading => "shading",
            Self::Display => "display",
            Self::Reference => "reference",
            Self::Quality => "quality",
            Self::Filters => "filters",
        }
    }

    /// The text of a progress bar during the stage.
    pub fn activity(self) -> &'static str {
        match self {
            Self::Device => "opening the device",
            Self::Geometry | Self::Bvh | Self::Surface | Self::Materials => "preparing the scene",
            Self::Light
            | Self::LightGeometry
            | Self::LitEnvironment
            | Self::LightBounds
            | Self::Irradiance
            | Self::LightSampler => "preparing the light",
            Self::Points | Self::Differentials => "sampling the reflectors",
            Self::Tree => "building the tree",
            Self::Visibility => "tracing visibility maps",
            Self::Surroundings => "rendering what mirrors see",
            Self::Upload => "uploading",
            Self::Estimate => "estimating the irradiance",
            Self::Photons => "sending photons",
            Self::Rays | Self::Paths => "tracing camera rays",
            Self::Caustic => "summing the caustic",
            Self::Direct => "direct light",
            Self::Scattering => "scattering",
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

/// Receives progress, and says whether the result is still wanted. Methods are called from any thread; stages do not nest. The
/// library reads no clock: to time a stage, measure from [`Progress::begin`] to [`Progress::end`].
pub trait Progress: Sync {
    /// A stage begins, which has `total` steps.
    fn begin(&self, stage: Stage, total: u64);
    /// So many more steps of the stage are done.
    fn advance(&self, steps: u64);
    /// The stage ends, successfully or not.
    fn end(&self, stage: Stage);
    /// Whether nobody waits for the result any more. Long stages ask it often, and then end early; what they made is not kept.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Work within a stage, whose steps are not counted.
pub struct Uncounted<'a>(pub &'a dyn Progress);

impl Progress for Uncounted<'_> {
    fn begin(&self, _: Stage, _: u64) {}
    fn advance(&self, _: u64) {}
    fn end(&self, _: Stage) {}
    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

/// A sink that ignores all progress.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProgress;

impl Progress for NoProgress {
    fn begin(&self, _: Stage, _: u64) {}
    fn advance(&self, _: u64) {}
    fn end(&self, _: Stage) {}
}
