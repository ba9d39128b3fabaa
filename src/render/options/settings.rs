//! The `[render]` table of a scene file, and the command line that overrides it.

use serde::Deserialize;

use super::{DisplaySettings, EvaluationChoice, Exposure, FilterChoice, Options};
use crate::Error;
use crate::OptionError;
use crate::environment::CubeSize;
use crate::image::{Aov, ToneMap};
use crate::image_space::{Hits, ImageSpaceOptions, Incidence, MapView, Mode, Traversal};
use crate::pinhole::{Epsilon, Footprint};
use crate::sampling::{Density, Strategy};
use crate::scene::{Loaded, Scene, Visibility};
use crate::technique::Technique;

/// Rendering options of a scene file or a command line. Each is optional, so that one set can override another.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Width and height, pixels.
    pub size: Option<[u32; 2]>,
    /// How the caustic's irradiance is computed.
    pub technique: Option<Technique>,
    /// How photons of image-space techniques become irradiance.
    pub mode: Option<Mode>,
    /// How photons find what they meet.
    pub hits: Option<Hits>,
    /// Which photons of a light's view are followed.
    pub traversal: Option<Traversal>,
    /// Photons along each edge of a light's view.
    pub photons: Option<u32>,
    /// Whose view the maps of image-space techniques are.
    pub caustic_map: Option<MapView>,
    /// Texels along each edge of a light's caustic map.
    pub caustic_map_size: Option<u32>,
    /// Directional lights that image-space techniques divide an environment map into.
    pub lights: Option<u32>,
    /// Directions or points that they divide extended lights into.
    pub light_directions: Option<u32>,
    /// Diameter of splats of one size, texels.
    pub splat_diameter: Option<f32>,
    /// From where glossy receivers take the light of a caustic.
    pub incidence: Option<Incidence>,
    /// Frames whose maps are averaged.
    pub temporal_frames: Option<u32>,
    /// Polygons and gathers by the letter of the paper.
    pub paper: Option<bool>,
    /// Requested number of samples.
    pub samples: Option<u32>,
    /// How the samples are placed.
    pub strategy: Option<Strategy>,
    /// What the density of the samples follows.
    pub density: Option<Density>,
    /// How the samples' footprints are derived.
    pub footprint: Option<Footprint>,
    /// How the environment is filtered over a footprint.
    pub filter: Option<FilterChoice>,
    /// The largest number of look-ups along a footprint's major axis.
    pub taps: Option<u32>,
    /// Flat or hierarchical summation.
    pub evaluation: Option<EvaluationChoice>,
    /// The largest number of cells that each sample is split into.
    pub leaves: Option<u32>,
    /// Allowed error of a hierarchical sum, relative to the mean irradiance.
    pub tolerance: Option<f32>,
    /// Parts of each camera ray in a medium.
    pub medium_steps: Option<u32>,
    /// `false` drops the factor 1/l² (the result is then a pattern, not an irradiance).
    pub attenuation: Option<bool>,
    /// The term that keeps 1/l² finite.
    pub epsilon: Option<Epsilon>,
    /// Edge of the cube map's faces, texels.
    pub cube_size: Option<CubeSize>,
    /// Which occlusion is taken into account.
    pub visibility: Option<Visibility>,
    /// Random seed.
    pub seed: Option<u64>,
    /// n: each pixel is the mean over n×n points.
    pub pixel_samples: Option<u32>,
    /// Exposure, in stops, or `auto`.
    pub exposure_ev: Option<Exposure>,
    /// Exposure of the environment where the camera sees it, in stops; by default `exposure_ev`.
    pub background_exposure_ev: Option<f32>,
    /// How exposed radiance becomes a display's.
    pub tone_map: Option<ToneMap>,
    /// Multiplies the caustic in the beauty picture.
    pub caustic_gain: Option<f32>,
    /// The pictures to render.
    pub aov: Option<Vec<Aov>>,
}

impl Settings {
    /// These settings, overridden by every key that `over` sets.
    #[must_use]
    pub fn overridden_by(self, over: Self) -> Self {
        Self {
            size: over.size.or(self.size),
            technique: over.technique.or(self.technique),
            mode: over.mode.or(self.mode),
            hits: over.hits.or(self.hits),
            traversal: over.traversal.or(self.traversal),
            photons: over.photons.or(self.photons),
            caustic_map: over.caustic_map.or(self.caustic_map),
            caustic_map_size: over.caustic_map_size.or(self.caustic_map_size),
            lights: over.lights.or(self.lights),
            light_directions: over.light_directions.or(self.light_directions),
            splat_diameter: over.splat_diameter.or(self.splat_diameter),
            incidence: over.incidence.or(self.incidence),
            temporal_frames: over.temporal_frames.or(self.temporal_frames),
            paper: over.paper.or(self.paper),
            samples: over.samples.or(self.samples),
            strategy: over.strategy.or(self.strategy),
            density: over.density.or(self.density),
            footprint: over.footprint.or(self.footprint),
            filter: over.filter.or(self.filter),
            taps: over.taps.or(self.taps),
            medium_steps: over.medium_steps.or(self.medium_steps),
            evaluation: over.evaluation.or(self.evaluation),
            leaves: over.leaves.or(self.leaves),
            tolerance: over.tolerance.or(self.tolerance),
            attenuation: over.attenuation.or(self.attenuation),
            epsilon: over.epsilon.or(self.epsilon),
            cube_size: over.cube_size.or(self.cube_size),
            visibility: over.visibility.or(self.visibility),
            seed: over.seed.or(self.seed),
            pixel_samples: over.pixel_samples.or(self.pixel_samples),
            exposure_ev: over.exposure_ev.or(self.exposure_ev),
            background_exposure_ev: over.background_exposure_ev.or(self.background_exposure_ev),
            tone_map: over.tone_map.or(self.tone_map),
            caustic_gain: over.caustic_gain.or(self.caustic_gain),
            aov: over.aov.or(self.aov),
        }
    }

    /// The options of image-space techniques.
    fn image_space(&self) -> ImageSpaceOptions {
        let defaults = ImageSpaceOptions::default();
        ImageSpaceOptions {
            mode: self.mode.unwrap_or_default(),
            hits: self.hits.unwrap_or_default(),
            traversal: self.traversal.unwrap_or_default(),
            photons: self.photons.unwrap_or(defaults.photons),
            caustic_map: self.caustic_map.unwrap_or_default(),
            caustic_map_size: self.caustic_map_size.unwrap_or(defaults.caustic_map_size),
            lights: self.lights.unwrap_or(defaults.lights),
            light_directions: self.light_directions.unwrap_or(defaults.light_directions),
            splat_diameter: self.splat_diameter.unwrap_or(defaults.splat_diameter),
            incidence: self.incidence.unwrap_or_default(),
            temporal_frames: self.temporal_frames.unwrap_or(defaults.temporal_frames),
            paper: self.paper.unwrap_or(defaults.paper),
        }
    }

    /// The options, with defaults for missing keys. Checks every value.
    pub fn options(self) -> Result<Options, OptionError> {
        let defaults = Options::default();
        let options = Options {
            size: self.size.unwrap_or(defaults.size),
            technique: self.technique.unwrap_or_default(),
            image_space: self.image_space(),
            samples: self.samples.unwrap_or(defaults.samples),
            strategy: self.strategy.unwrap_or_default(),
            density: self.density.unwrap_or_default(),
            footprint: self.footprint.unwrap_or_default(),
            filter: self.filter.unwrap_or_default(),
            taps: self.taps.unwrap_or(defaults.taps),
            medium_steps: self.medium_steps.unwrap_or(defaults.medium_steps),
            attenuation: self.attenuation.unwrap_or(defaults.attenuation),
            epsilon: self.epsilon.unwrap_or_default(),
            evaluation: self.evaluation.unwrap_or_default(),
            leaves: self.leaves,
            tolerance: self.tolerance.unwrap_or(defaults.tolerance),
            cube_size: self.cube_size.unwrap_or_default(),
            visibility: self.visibility.unwrap_or_default(),
            seed: self.seed.unwrap_or(defaults.seed),
            pixel_samples: self.pixel_samples.unwrap_or(defaults.pixel_samples),
            aovs: self.aov.unwrap_or(defaults.aovs),
            display: DisplaySettings {
                exposure: self.exposure_ev.unwrap_or_default(),
                background_exposure_ev: self.background_exposure_ev,
                tone_map: self.tone_map.unwrap_or_default(),
            },
            caustic_gain: self.caustic_gain.unwrap_or(defaults.caustic_gain),
            plain_diffuse: defaults.plain_diffuse,
            overlay: defaults.overlay,
        };
        options.check()?;
        Ok(options)
    }
}

/// Loads a scene file, or the built-in scene of that name, with the options of its `[render]` table.
///
/// ```
/// let (scene, options) = pinspot::load("ring")?;
/// assert_eq!(scene.name, "ring");
/// assert!(options.check().is_ok());
/// # Ok::<(), pinspot::Error>(())
/// ```
///
/// # Errors
/// An invalid scene, mesh or light, or an option out of range.
pub fn load(path_or_name: &str) -> Result<(Scene, Options), Error> {
    let Loaded { scene, render, .. } = crate::scene::load::<Settings>(path_or_name)?;
    Ok((scene, render.options()?))
}
