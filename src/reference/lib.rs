//! Ground truth: an unbiased estimate of the light that the techniques approximate, and its standard error.
//!
//! It shares the scene's description, file decoding, errors, progress and the use of all cores with what it judges, and
//! nothing else: a test pins its imports. Data flows scene → `geometry` (f64 triangles) and
//! `light` (radiance from the original image), `lamps` and `emitters` → a `domain` to integrate over (`reflectors`, or the `sky` for direct light) →
//! for light in the medium, `scattering` over the lines of sight, too →
//! a `cut` per receiver point or line of sight (the density) → replicates of quasi-random points, in
//! `passes` over the image → [`Estimate`]. Light of small lights comes `forward` by beams; and forward rays count the flux that the
//! [`Ledger`] holds every estimate of a caustic against.
//! This module must not know samples, cells, cube maps, back ends or wgpu.

mod allocation;
mod brdf;
mod bright_spheres;
mod cone;
mod cut;
mod direct;
mod domain;
mod emitters;
mod estimate;
mod forward;
mod geometry;
mod gloss;
mod lamps;
mod light;
mod lit_surfaces;
mod map;
mod maxima;
mod medium;
mod passes;
mod picture_plane;
mod receivers;
mod reflectance;
mod reflector_bounds;
mod reflector_light;
mod reflectors;
mod refraction;
mod replicates;
mod scattering;
mod schedule;
mod seen;
mod sights;
mod sky;
mod solids;
mod solution;
mod store;
mod tree;

pub use self::estimate::{Estimate, Statistics};
pub use self::forward::Ledger;
pub use self::store::{EstimateFile, Stored};

use std::path::PathBuf;

use glam::DVec3;

use self::domain::Receiver;
use self::emitters::Emitters;
use self::forward::{Shares, check_beams};
use self::geometry::Geometry;
use self::lamps::Lamps;
use self::light::Light;
use self::medium::Medium;
use self::receivers::Receivers;
use self::sights::Sight;
use pinspot_base::image::ImageError;
use pinspot_base::maps;
use pinspot_base::maps::EnvironmentError;
use pinspot_base::scene::{Chain, Chains, MeshError, Object, Scene, Visibility};
use pinspot_base::{OptionError, Progress, Stage, image, parallel, scene};

/// What is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Quantity {
    /// Irradiance by one reflection or refraction, W/m², before albedo.
    #[default]
    Caustic,
    /// What receivers reflect of that to the camera, by their own distribution functions, W/(m²·sr).
    Reflected,
    /// Irradiance from the environment without reflection or refraction, W/m², before albedo.
    Direct,
    /// What the medium scatters to the camera, once, of light by one reflection or refraction, W/(m²·sr).
    Scattered,
    /// What it scatters of light from the environment and lamps without reflection or refraction, W/(m²·sr).
    #[serde(rename = "scattered.direct")]
    ScatteredDirect,
}

impl Quantity {
    /// Whether it is light that the medium scatters.
    fn is_scattered(self) -> bool {
        matches!(self, Self::Scattered | Self::ScatteredDirect)
    }

    /// Whether its light comes by mirrors or interfaces.
    fn is_caustic(self) -> bool {
        !matches!(self, Self::Direct | Self::ScatteredDirect)
    }
}

/// How a caustic is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Estimator {
    /// By beams the light of spots and lamps that are so small that points would seldom find them, and by points all other.
    #[default]
    Auto,
    /// As an integral over the mirrors, for each point of a pixel: for every light.
    Points,
    /// By beams, without noise, the light of all spots and lamps, as means over whole pixels; by points all other.
    Beams,
}

impl Estimator {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// How points on the mirrors are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Density {
    /// In proportion to hierarchical bounds of light × geometry.
    #[default]
    Bounded,
    /// Uniformly: brute force, to check the former.
    Uniform,
}

/// What to compute and how.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Options {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// n: the mean over n×n points of a pixel; 1: at pixel centres.
    pub pixel_samples: u32,
    /// The quantity.
    pub quantity: Quantity,
    /// Which light counts as caustic.
    #[serde(skip_serializing_if = "Chains::is_all")]
    pub chains: Chains,
    /// Occlusion.
    pub visibility: Visibility,
    /// `false` drops the 1/l² alone.
    pub attenuation: bool,
    /// How points are chosen.
    pub density: Density,
    /// How a caustic is computed.
    #[serde(skip_serializing_if = "Estimator::is_default")]
    pub estimator: Estimator,
    /// Independent randomisations that the standard error comes from; at least 16.
    pub replicates: u32,
    /// Random seed.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            size: [512, 512],
            pixel_samples: 1,
            quantity: Quantity::default(),
            chains: Chains::ALL,
            visibility: Visibility::default(),
            attenuation: true,
            density: Density::default(),
            estimator: Estimator::default(),
            replicates: 16,
            seed: 1,
        }
    }
}

/// When to stop: at the first of these.
#[derive(Clone, Copy)]
#[non_exhaustive]
pub struct StoppingCriterion<'a> {
    /// The relative standard error √Σse² / √ΣE² over the image at which the work is done.
    pub rel_error: f64,
    /// About so many points per pixel, all passes and replicates together, once all is known of how fine cuts must be.
    pub max_points: Option<f64>,
    /// Asked before every pixel, from any thread: whether to begin nothing more.
    pub should_stop: &'a (dyn Fn() -> bool + Sync),
    /// The seconds that are left, by any clock, asked like `should_stop`; passes are planned to fit in them.
    pub seconds_left: Option<&'a (dyn Fn() -> f64 + Sync)>,
}

impl<'a> StoppingCriterion<'a> {
    /// Only the relative standard error.
    pub const fn new(rel_error: f64) -> Self {
        const fn never() -> bool {
            false
        }
        Self { rel_error, max_points: None, should_stop: &never, seconds_left: None }
    }

    /// The same with a limit to the points per pixel.
    #[must_use]
    pub const fn with_max_points(self, max_points: f64) -> Self {
        Self { max_points: Some(max_points), ..self }
    }

    /// The same with an end that the caller decides on: a key, a closed window.
    #[must_use]
    pub const fn with_should_stop<'b>(self, should_stop: &'b (dyn Fn() -> bool + Sync)) -> StoppingCriterion<'b>
    where
        'a: 'b,
    {
        StoppingCriterion { should_stop, ..self }
    }

    /// The same with a limit to the time, given as the seconds that are left at any moment.
    #[must_use]
    pub const fn with_seconds_left<'b>(self, seconds_left: &'b (dyn Fn() -> f64 + Sync)) -> StoppingCriterion<'b>
    where
        'a: 'b,
    {
        StoppingCriterion { seconds_left: Some(seconds_left), ..self }
    }

    /// Infinite where there is no limit.
    fn seconds_left(&self) -> f64 {
        self.seconds_left.map_or(f64::INFINITY, |left| left())
    }

    fn is_over(&self) -> bool {
        self.seconds_left() <= 0.0 || (self.should_stop)()
    }
}

/// Why a reference could not be computed, or kept in its file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReferenceError {
    /// An option out of its range, or a scene that has nothing to compute.
    #[error(transparent)]
    Option(#[from] OptionError),
    /// An object's mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The light.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// The file that keeps the estimate.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The progress sink said that the result is not wanted any more.
    #[error("cancelled")]
    Cancelled,
    /// The work was stopped before anything was known of every pixel.
    #[error("the work was stopped when {:.0} % of the pixels had been reached for the first time", 100.0 * coverage)]
    Incomplete {
        /// The part of the pixels that were reached.
        coverage: f64,
    },
    /// An estimate that lacks light, or has too much.
    #[error("the estimate and the light do not agree: {ledger}")]
    Unbalanced {
        /// The account.
        ledger: Ledger,
    },
    /// A file that is something else.
    #[error("'{}' exists, and is no earlier state of this reference (its scene, light, size, options and seed)", path.display())]
    Foreign {
        /// File.
        path: PathBuf,
    },
    /// An estimate of the same picture by other code.
    #[error("'{}' holds an estimate by other code (Pinspot {theirs}; this is {ours}), which may not be mixed with this one's", path.display())]
    OtherCode {
        /// File.
        path: PathBuf,
        /// The code that wrote it.
        theirs: String,
        /// The code that would go on.
        ours: String,
    },
    /// A file that cannot be gone on from.
    #[error("the reference in '{}' is damaged ({reason}); delete it", path.display())]
    Damaged {
        /// File.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

/// Says what is missing where nothing can cast a caustic by these chains.
fn check_chains(scene: &Scene, chains: Chains) -> Result<(), OptionError> {
    let casts = |o: &Object| Chain::ALL.iter().any(|chain| chains.contains(*chain) && o.casts(*chain));
    if scene.objects.iter().any(casts) {
        return Ok(());
    }
    if scene.objects.iter().all(|o| o.specular().is_none()) {
        let message = "is missing: give an object `reflector = { sides = \"front\" }` or `refractor = { eta = 1.333 }`";
        return Err(OptionError::invalid("reflector", message));
    }
    let message = format!(
        "is {chains}, but no object casts such a caustic: R needs a reflector or a refractor with fresnel, T a refractor, TT a closed one with interfaces = 2"
    );
    Err(OptionError::invalid("chains", message))
}

/// What there is to scatter light, or says that nothing does.
fn check_medium(scene: &Scene) -> Result<Medium, OptionError> {
    let message = "is missing, or scatters nothing: give the scene `medium = { sigma_s = 0.1 }`";
    let scatters = scene.medium.is_some_and(|medium| medium.scatters());
    let medium = Medium::of_scene(scene).filter(|_| scatters);
    medium.ok_or_else(|| OptionError::invalid("medium", message))
}

/// What the picture is of.
#[derive(Debug)]
enum Picture {
    /// Light on surfaces.
    Surfaces(Receivers<Receiver>),
    /// Light in the medium.
    Medium(Medium, Receivers<Sight>),
}

/// A scene, prepared for ground truth.
///
/// ```
/// use pinspot::NoProgress;
/// use pinspot::reference::{Options, Reference, StoppingCriterion};
///
/// let (scene, _) = pinspot::load("mirror-sphere")?;
/// let reference = Reference::new(scene, Options { size: [8, 8], ..Options::default() })?;
/// let criterion = StoppingCriterion::new(0.1);
/// let estimate = reference.solve(&criterion, None, &NoProgress, &mut |_| Ok(()))?;
/// assert!(estimate.rel_error() <= 0.1);
/// println!("{} ± {} W/m²", estimate.irradiance.mean(), estimate.standard_error.mean());
/// # Ok::<(), pinspot::Error>(())
/// ```
#[derive(Debug)]
pub struct Reference {
    scene: Scene,
    options: Options,
    geometry: Geometry,
    light: Light,
    lamps: Lamps,
    emitters: Emitters,
    /// What is left to beams.
    shares: Shares,
    picture: Picture,
    fingerprint: String,
    /// What was repaired while loading.
    pub notes: Vec<String>,
}

impl Reference {
    /// Loads the light and finds what the camera sees.
    pub fn new(scene: Scene, options: Options) -> Result<Self, ReferenceError> {
        let fail = |key: &'static str, message: &str| Err(OptionError::invalid(key, message).into());
        if options.size.iter().any(|s| !(1..=16384).contains(s)) {
            return fail("size", "must be from 1×1 to 16384×16384 pixels");
        }
        scene.check_medium()?;
        if !(1..=16).contains(&options.pixel_samples) {
            return fail("pixel_samples", "must be from 1 to 16");
        }
        if !(16..=1024).contains(&options.replicates) {
            return fail("replicates", "must be from 16 to 1024");
        }
        if options.quantity.is_caustic() {
            check_chains(&scene, options.chains)?;
        }
        if options.estimator == Estimator::Beams {
            check_beams(&scene, &options)?;
        }
        let scattering = options.quantity.is_scattered().then(|| check_medium(&scene)).transpose()?;
        let light = Light::new(&scene.environment)?;
        let extinction = before_lamps(&scene, options.quantity);
        let (lamps, emitters) = (Lamps::of_scene(&scene, extinction), Emitters::of_scene(&scene, extinction));
        let notes = scene.notes.clone();
        scene.check_placements()?;
        let geometry = Geometry::new(&scene);
        let shares = Shares::of_scene(&scene, (&geometry, &lamps), &options);
        let Options { size, pixel_samples, .. } = options;
        let picture = match scattering {
            None => Picture::Surfaces(Receivers::find(&scene, (&geometry, &emitters), size, pixel_samples)),
            Some(medium) => Picture::Medium(medium, Receivers::through(&medium, &scene, size, pixel_samples)),
        };
        let described = serde_json::to_string(&options).expect("options are plain data");
        let fingerprint = scene.fingerprint(&described);
        Ok(Self { scene, options, geometry, light, lamps, emitters, shares, picture, fingerprint, notes })
    }

    /// Whether any light is left to beams, which have means over whole pixels.
    pub fn uses_beams(&self) -> bool {
        !self.shares.is_empty()
    }

    /// What is computed, and how.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Names everything that the result depends on besides the code; two references with one fingerprint and one code may be combined.
    pub fn fingerprint(&self) -> &str {
        &self.fingerprint
    }
}

/// The extinction, 1/m, between lamps or emitters and what their light falls on first.
fn before_lamps(scene: &Scene, quantity: Quantity) -> DVec3 {
    let Some(medium) = Medium::of_scene(scene) else { return DVec3::ZERO };
    match quantity {
        Quantity::ScatteredDirect => medium.extinction(),
        _ => medium.extinction_before_surfaces(),
    }
}
