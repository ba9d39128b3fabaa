//! Options that several commands share. Names are parsed by the same types as in scene files.

use std::path::Path;

use clap::Args;
use clap::error::ErrorKind;
use serde::de::DeserializeOwned;
use serde::de::value::{Error as WordError, StrDeserializer};

use pinspot::image::{Aov, ToneMap};
use pinspot::scene::{Light, Loaded, MapLayout, Scene, Visibility, load};
use pinspot::{
    BackendChoice, CubeSize, Density, Epsilon, EvaluationChoice, Exposure, FilterChoice, Footprint, Hits, Incidence,
    MapView, Mode, OptionError, Options, Overlay, Quality, Settings, Strategy, Technique, Traversal,
};

use super::console::{Console, Failure};
use super::errors::{message, option_message};

/// Sampling options.
#[derive(Debug, Args)]
pub struct SamplingOptions {
    /// Number of samples, such as 5000 or 5k [default: 1000]
    #[arg(long, value_parser = parse_count, value_name = "N")]
    pub samples: Option<u32>,
    /// Strategy that places samples: random, grid, quantised-grid, neighbourhood or elimination [default: neighbourhood]
    #[arg(long, value_parser = word::<Strategy>, value_name = "NAME")]
    pub strategy: Option<Strategy>,
    /// What the density of samples follows: uniform, curvature, normal, visibility or contribution [default: uniform]
    #[arg(long, value_parser = word::<Density>, value_name = "NAME")]
    pub density: Option<Density>,
    /// Random seed [default: 1]
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
}

/// Options of image-space techniques.
#[derive(Debug, Args)]
pub struct PhotonOptions {
    /// How photons become irradiance: auto (points or exact polygons, in passes until two halves agree to twice --tolerance), points, gather,
    /// polygons, exact-polygons, splats, multi-resolution, thin-lens, thick-lens or footprints [default: auto]
    #[arg(long, value_parser = word::<Mode>, value_name = "NAME")]
    pub mode: Option<Mode>,
    /// How photons find what they meet: traced (by rays), image (in images from the light's view, as in the papers) or quarter-image (in
    /// images a quarter as fine) [default: traced]
    #[arg(long, value_parser = word::<Hits>, value_name = "NAME")]
    pub hits: Option<Hits>,
    /// Which photons are followed: dense (all), hierarchical (all, and those that land in one texel are put together), maximal-level
    /// (where casters are, from coarse to fine) or texel-error (the same, and those that land in one texel are one) [default: dense]
    #[arg(long, value_parser = word::<Traversal>, value_name = "NAME")]
    pub traversal: Option<Traversal>,
    /// Photons along each edge of a light's view, in each pass [default: 512]
    #[arg(long, value_name = "N")]
    pub photons: Option<u32>,
    /// Whose view caustic maps are: eye (the camera's) or light [default: eye]
    #[arg(long, value_parser = word::<MapView>, value_name = "NAME")]
    pub caustic_map: Option<MapView>,
    /// Texels along each edge of a light's caustic map [default: 512]
    #[arg(long, value_name = "N")]
    pub caustic_map_size: Option<u32>,
    /// Directional lights that an environment map is divided into; sixteen times as many in the mode auto [default: 24]
    #[arg(long, value_name = "N")]
    pub lights: Option<u32>,
    /// Directions or points that extended lights are divided into, for modes with neighbouring photons [default: 24]
    #[arg(long, value_name = "N")]
    pub light_directions: Option<u32>,
    /// Diameter of splats of one size, texels [default: 2.5]
    #[arg(long, value_name = "TEXELS")]
    pub splat_diameter: Option<f32>,
    /// From where glossy receivers take the light: mean (direction of a texel's photons), photon (each one's own) or light (as if nothing had
    /// turned it) [default: mean]
    #[arg(long, value_parser = word::<Incidence>, value_name = "NAME")]
    pub incidence: Option<Incidence>,
    /// Frames whose maps are averaged, from 1 to 4: each and those before it [default: 1]
    #[arg(long, value_name = "N")]
    pub temporal_frames: Option<u32>,
    /// Polygons and gathers by the letter of Wyman and Davis 2006 (Equations 3 and 9), for comparison
    #[arg(long)]
    pub paper: bool,
}

/// Options of the environment.
#[derive(Debug, Args)]
pub struct EnvironmentOptions {
    /// Environment map to use instead of the scene's light: a file (.exr, .hdr), a layer of one (sky.exr#LAYER), or the name of a built-in map
    #[arg(long, value_name = "FILE")]
    pub env: Option<String>,
    /// Rotation of the environment about +Y, counter-clockwise, in degrees [default: the scene's]
    #[arg(long, value_parser = parse_finite, value_name = "DEG", allow_hyphen_values = true)]
    pub env_rotation_deg: Option<f32>,
    /// Factor on the environment's radiance [default: the scene's]
    #[arg(long, value_parser = parse_not_negative, value_name = "FACTOR", allow_hyphen_values = true)]
    pub env_intensity: Option<f32>,
}

/// Options that do not depend on the technique: picture, light and back end.
#[derive(Debug, Args)]
pub struct SceneOptions {
    /// Image size in pixels [default: 512x512]
    #[arg(long, value_parser = parse_size, value_name = "WxH")]
    pub size: Option<[u32; 2]>,
    /// Maximum number of look-ups along a footprint's major axis [default: 16]
    #[arg(long, value_name = "N")]
    pub taps: Option<u32>,
    /// Parts of each camera ray in a medium, by which scattered light is summed [default: 32]
    #[arg(long, value_name = "N")]
    pub medium_steps: Option<u32>,
    /// Attenuation by the squared distance, 1/l²: on or off [default: on]
    #[arg(long, value_parser = parse_switch, value_name = "on|off")]
    pub attenuation: Option<bool>,
    /// Term that keeps 1/l² finite: auto, paper, or a value in m² [default: auto]
    #[arg(long, value_name = "auto|paper|VALUE")]
    pub epsilon: Option<Epsilon>,
    /// Size of the environment's cube-map faces in texels: auto, or a power of two [default: auto]
    #[arg(long, value_name = "auto|N")]
    pub cube_size: Option<CubeSize>,
    /// Occlusion: full (by all objects, before and after the mirror or interface), or none (as in the
    /// paper) [default: full]
    #[arg(long, value_parser = word::<Visibility>, value_name = "none|full")]
    pub visibility: Option<Visibility>,
    /// Average NxN points per pixel [default: 1]
    #[arg(long, value_name = "N")]
    pub pixel_samples: Option<u32>,
    /// Exposure: a number of stops, or auto (metered on the picture) [default: the scene's; auto with --env]
    #[arg(long, value_name = "auto|EV", allow_hyphen_values = true)]
    pub exposure: Option<Exposure>,
    #[command(flatten)]
    pub environment: EnvironmentOptions,
    /// Back end: auto (a hardware GPU if there is one, else the CPU), gpu or cpu [default: auto]
    #[arg(long, value_parser = ["auto", "gpu", "cpu"], value_name = "NAME", hide_possible_values = true)]
    pub backend: Option<String>,
    /// Use the GPU adapter whose name contains this
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
}

/// Options that override the scene's `[render]` table.
#[derive(Debug, Args)]
pub struct CommonOptions {
    /// Technique that computes caustics: pinhole, or image-space (photons from the lights' views) [default: pinhole]
    #[arg(long, value_parser = word::<Technique>, value_name = "NAME")]
    pub technique: Option<Technique>,
    #[command(flatten)]
    pub image_space: PhotonOptions,
    #[command(flatten)]
    pub sampling: SamplingOptions,
    /// How footprints are derived: from cells, or from curvature (as in the paper) [default: cells]
    #[arg(long, value_parser = word::<Footprint>, value_name = "NAME")]
    pub footprint: Option<Footprint>,
    /// Filter of the environment: auto (hardware where a test finds it correct, else anisotropic), none, isotropic,
    /// anisotropic, hardware or ewa [default: auto]
    #[arg(long, value_parser = word::<FilterChoice>, value_name = "NAME")]
    pub filter: Option<FilterChoice>,
    /// How samples are summed: auto (hierarchical where possible), flat (every sample at every receiver) or
    /// hierarchical (a tree of cells) [default: auto]
    #[arg(long, value_parser = word::<EvaluationChoice>, value_name = "NAME")]
    pub evaluation: Option<EvaluationChoice>,
    /// Maximum number of cells that each sample is split into, rounded down to a power of four [default: 256 in a
    /// hierarchy, or fewer under near light and with many samples, else 1]
    #[arg(long, value_name = "N")]
    pub leaves: Option<u32>,
    /// Allowed error of a hierarchical sum, relative to the caustic's mean irradiance; unless the caustic is an output
    /// of its own, half of it is also allowed relative to the direct light [default: 0.01]
    #[arg(long, value_name = "FRACTION")]
    pub tolerance: Option<f32>,
    /// Samples, leaves, tolerance and points per pixel by one name: draft, normal or final; options given beside it win
    #[arg(long, value_parser = word::<Quality>, value_name = "NAME")]
    pub quality: Option<Quality>,
    #[command(flatten)]
    pub scene: SceneOptions,
    /// Pictures to render, separated by commas: beauty, caustic, caustic.R, caustic.T, caustic.TT and caustic.TTTT (what is
    /// reflected or refracted once, refracted by one closed object, or by two), direct, scattered and scattered.direct (what a medium scatters),
    /// albedo, normal, position, depth [default:
    /// beauty]
    #[arg(long, value_parser = word::<Aov>, value_delimiter = ',', value_name = "NAMES")]
    pub aov: Option<Vec<Aov>>,
    /// Exposure of the environment where the camera sees it directly, in stops [default: the exposure]
    #[arg(long, value_name = "EV", allow_hyphen_values = true)]
    pub background_exposure: Option<f32>,
    /// How exposed radiance becomes a display's: neutral (Khronos PBR Neutral), filmic, or linear (cut off at 1) [default: neutral]
    #[arg(long, value_parser = word::<ToneMap>, value_name = "NAME")]
    pub tone_map: Option<ToneMap>,
    /// Factor on the caustic in the beauty picture
    #[arg(long, value_name = "FACTOR", allow_hyphen_values = true)]
    pub caustic_gain: Option<f32>,
    /// Overlay on the beauty picture: samples, normals, curvature (principal directions), cells, or of image-space photons (where they land) or caustic-map (in a corner)
    #[arg(long, value_parser = word::<Overlay>, value_name = "NAME")]
    pub overlay: Option<Overlay>,
    /// Show shapes only: everything is diffuse, without mirrors or caustics
    #[arg(long)]
    pub plain_diffuse: bool,
}

impl CommonOptions {
    fn settings(&self) -> Settings {
        Settings {
            technique: self.technique,
            mode: self.image_space.mode,
            hits: self.image_space.hits,
            traversal: self.image_space.traversal,
            photons: self.image_space.photons,
            caustic_map: self.image_space.caustic_map,
            caustic_map_size: self.image_space.caustic_map_size,
            lights: self.image_space.lights,
            light_directions: self.image_space.light_directions,
            splat_diameter: self.image_space.splat_diameter,
            incidence: self.image_space.incidence,
            temporal_frames: self.image_space.temporal_frames,
            paper: self.image_space.paper.then_some(true),
            samples: self.sampling.samples,
            strategy: self.sampling.strategy,
            density: self.sampling.density,
            footprint: self.footprint,
            filter: self.filter,
            evaluation: self.evaluation,
            leaves: self.leaves,
            tolerance: self.tolerance,
            seed: self.sampling.seed,
            background_exposure_ev: self.background_exposure,
            tone_map: self.tone_map,
            caustic_gain: self.caustic_gain,
            aov: self.aov.clone(),
            ..self.scene.settings()
        }
    }

    /// Loads a scene, overriding its options by these.
    pub fn load(&self, scene: &str, console: &Console) -> Result<(Scene, Options), Failure> {
        let (scene, mut options) = self.scene.load(scene, self.quality.unwrap_or_default(), self.settings())?;
        options.overlay = self.overlay.unwrap_or_default();
        options.plain_diffuse = self.plain_diffuse;
        for option in self.without_effect(options.technique) {
            let name = options.technique.name();
            console
                .warn(&format!("{option} changes nothing: it is not an option of the technique {name} (--technique)"));
        }
        Ok((scene, options))
    }

    /// The options that were given and mean nothing to a technique.
    fn without_effect(&self, technique: Technique) -> Vec<&'static str> {
        let (photons, sampling) = (&self.image_space, &self.sampling);
        let of_photons = [
            ("--mode", photons.mode.is_some()),
            ("--hits", photons.hits.is_some()),
            ("--traversal", photons.traversal.is_some()),
            ("--photons", photons.photons.is_some()),
            ("--caustic-map", photons.caustic_map.is_some()),
            ("--caustic-map-size", photons.caustic_map_size.is_some()),
            ("--lights", photons.lights.is_some()),
            ("--light-directions", photons.light_directions.is_some()),
            ("--splat-diameter", photons.splat_diameter.is_some()),
            ("--incidence", photons.incidence.is_some()),
            ("--temporal-frames", photons.temporal_frames.is_some()),
            ("--paper", photons.paper),
        ];
        let of_pinholes = [
            ("--samples", sampling.samples.is_some()),
            ("--strategy", sampling.strategy.is_some()),
            ("--density", sampling.density.is_some()),
            ("--filter", self.filter.is_some()),
            ("--taps", self.scene.taps.is_some()),
            ("--epsilon", self.scene.epsilon.is_some()),
            ("--quality", self.quality.is_some()),
            ("--footprint", self.footprint.is_some()),
            ("--evaluation", self.evaluation.is_some()),
            ("--leaves", self.leaves.is_some()),
            ("--tolerance", self.tolerance.is_some()),
        ];
        let of_others = if technique == Technique::Pinhole { &of_photons[..] } else { &of_pinholes };
        of_others.iter().filter(|(_, is_given)| *is_given).map(|(name, _)| *name).collect()
    }
}

impl SceneOptions {
    pub fn settings(&self) -> Settings {
        Settings {
            size: self.size,
            taps: self.taps,
            medium_steps: self.medium_steps,
            attenuation: self.attenuation,
            epsilon: self.epsilon,
            cube_size: self.cube_size,
            visibility: self.visibility,
            pixel_samples: self.pixel_samples,
            exposure_ev: self.exposure,
            ..Default::default()
        }
    }

    /// Loads a scene at a quality, overriding its settings by others.
    pub fn load(&self, scene: &str, quality: Quality, over: Settings) -> Result<(Scene, Options), Failure> {
        let loaded = load::<Settings>(scene).map_err(|e| message(&e.into()))?;
        // Errors in the file are reported with file and line, not as errors of the command line.
        let check = loaded.render.clone().options();
        check.map_err(|error| loaded.render_error(error.key(), option_message(&error)).to_string())?;
        let Loaded { mut scene, mut render, .. } = loaded;
        if self.environment.env.is_some() {
            // The scene's exposures are those for its own light.
            (render.exposure_ev, render.background_exposure_ev) = (Some(Exposure::Auto), None);
        }
        self.environment.apply(&mut scene)?;
        let options = render.at_quality(quality).overridden_by(over).options().map_err(|e| wrong_option(&e))?;
        Ok((scene, options))
    }

    /// The requested back end. Contradicting options are a wrong command line.
    pub fn backend(&self) -> Result<BackendChoice, Failure> {
        backend_choice(self.backend.as_deref(), self.adapter.as_deref())
    }
}

/// The back end that `--backend` and `--adapter` ask for. Contradicting options are a wrong command line.
pub(super) fn backend_choice(backend: Option<&str>, adapter: Option<&str>) -> Result<BackendChoice, Failure> {
    Ok(match (backend.unwrap_or("auto"), adapter) {
        ("cpu", None) => BackendChoice::Cpu,
        ("cpu", Some(_)) => {
            let message = "--adapter names a GPU, but --backend is cpu; drop one of them";
            return Err(Failure::command_line(ErrorKind::ArgumentConflict, message));
        }
        #[cfg(feature = "gpu")]
        ("gpu", name) | ("auto", name @ Some(_)) => BackendChoice::Gpu(name.map(str::to_owned)),
        #[cfg(not(feature = "gpu"))]
        ("gpu", _) | (_, Some(_)) => {
            let message = "this program was built without the feature 'gpu'; give --backend cpu";
            return Err(Failure::command_line(ErrorKind::InvalidValue, message));
        }
        _ => BackendChoice::Auto,
    })
}

/// A wrong command line: the scene's own options have been found valid, so the flags are to blame.
fn wrong_option(error: &OptionError) -> Failure {
    Failure::command_line(ErrorKind::InvalidValue, &option_message(error))
}

impl EnvironmentOptions {
    /// Replaces what is given of a scene's environment.
    pub fn apply(&self, scene: &mut Scene) -> Result<(), String> {
        if let Some(map) = &self.env {
            let (light, notes) = Light::map(Path::new(""), map, MapLayout::Auto).map_err(|e| e.to_string())?;
            scene.environment.light = light;
            scene.notes.extend(notes);
        }
        if let Some(degrees) = self.env_rotation_deg {
            scene.environment.rotation_rad = degrees.to_radians();
        }
        scene.environment.intensity = self.env_intensity.unwrap_or(scene.environment.intensity);
        Ok(())
    }
}

/// Parses a name as in a scene file.
pub(super) fn word<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    T::deserialize(StrDeserializer::<WordError>::new(text)).map_err(|e| e.to_string().replace('`', "'"))
}

pub(super) fn parse_size(text: &str) -> Result<[u32; 2], String> {
    // One number is a square.
    let (width, height) = text.split_once('x').unwrap_or((text, text));
    let number =
        |t: &str| t.parse().map_err(|_| format!("'{t}' is no number of pixels; give WIDTHxHEIGHT, such as 640x480"));
    Ok([number(width)?, number(height)?])
}

/// A number of things: 5000, 5k or 1M.
pub(super) fn parse_count(text: &str) -> Result<u32, String> {
    let (digits, factor) = match text.as_bytes().last() {
        Some(b'k') => (&text[..text.len() - 1], 1e3),
        Some(b'M') => (&text[..text.len() - 1], 1e6),
        _ => return text.parse().map_err(|_| format!("'{text}' is no whole number; give one such as 5000 or 5k")),
    };
    let number = digits.parse::<f64>().map_or(f64::NAN, |number| number * factor);
    if (0.0..=f64::from(u32::MAX)).contains(&number) && number.fract() == 0.0 {
        Ok(number as u32)
    } else {
        Err(format!("'{text}' is no whole number; give one such as 5000 or 5k"))
    }
}

/// A number greater than 0.
pub(super) fn parse_positive(text: &str) -> Result<f64, String> {
    let number = text.parse().map_err(|_| format!("'{text}' is no number"))?;
    if number > 0.0 && f64::is_finite(number) { Ok(number) } else { Err("give a number greater than 0".into()) }
}

fn parse_finite(text: &str) -> Result<f32, String> {
    let number: f32 = text.parse().map_err(|_| format!("'{text}' is no number"))?;
    if number.is_finite() { Ok(number) } else { Err("give a finite number".into()) }
}

fn parse_not_negative(text: &str) -> Result<f32, String> {
    parse_finite(text).and_then(|number| if number >= 0.0 { Ok(number) } else { Err("give 0 or more".into()) })
}

pub(super) fn parse_switch(text: &str) -> Result<bool, String> {
    match text {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err("give on or off".into()),
    }
}
