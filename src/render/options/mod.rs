//! What to render and how: validated options, and the settings of a `[render]` table or command line that become options.
//!
//! This module must not know how anything is computed.

mod quality;
mod settings;

pub use quality::Quality;
pub use settings::{Settings, load};

use serde::{Deserialize, Serialize};

use crate::OptionError;
use crate::cell_tree::MAX_LEAVES;
use crate::environment::CubeSize;
use crate::image::{Aov, ToneMap};
use crate::image_space::ImageSpaceOptions;
use crate::pinhole::{Epsilon, Filter, Footprint, MAX_TAPS, Params};
use crate::sampling::{self, Density, MAX_SAMPLES, Strategy};
use crate::scene::Visibility;
use crate::technique::Technique;
use crate::words::NumberOrWord;

/// A filter, or automatic choice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FilterChoice {
    /// The GPU's own where a test finds it correct, else anisotropic, in the shader.
    #[default]
    Auto,
    /// [`Filter::None`].
    None,
    /// [`Filter::Isotropic`].
    Isotropic,
    /// [`Filter::Anisotropic`].
    Anisotropic,
    /// [`Filter::Hardware`].
    Hardware,
    /// [`Filter::Ewa`].
    Ewa,
}

impl FilterChoice {
    /// The filter; `None` if the back end chooses.
    pub fn filter(self) -> Option<Filter> {
        match self {
            Self::Auto => None,
            Self::None => Some(Filter::None),
            Self::Isotropic => Some(Filter::Isotropic),
            Self::Anisotropic => Some(Filter::Anisotropic),
            Self::Hardware => Some(Filter::Hardware),
            Self::Ewa => Some(Filter::Ewa),
        }
    }

    /// Its name in scene files and on the command line.
    pub fn name(self) -> &'static str {
        self.filter().map_or("auto", Filter::name)
    }
}

/// How the samples are summed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EvaluationChoice {
    /// Hierarchical where the other options allow it, else flat.
    #[default]
    Auto,
    /// Evaluates every sample at every receiver, as the paper does.
    Flat,
    /// Traverses a tree of cells, as deep as the tolerance requires.
    Hierarchical,
}

impl EvaluationChoice {
    /// Its name in scene files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Flat => "flat",
            Self::Hierarchical => "hierarchical",
        }
    }
}

/// How the samples are summed, after automatic choices.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "mode")]
pub enum Evaluation {
    /// Every sample is evaluated at every receiver.
    Flat {
        /// Cells that each sample is split into.
        leaves: u32,
    },
    /// A tree of cells is traversed.
    Hierarchical {
        /// Cells that each sample is split into.
        leaves: u32,
        /// Allowed error, relative to the mean irradiance.
        tolerance: f32,
    },
}

impl Evaluation {
    /// The technique's mode, as reports name it.
    pub fn mode(self) -> &'static str {
        match self {
            Self::Flat { .. } => "flat",
            Self::Hierarchical { .. } => "hierarchical",
        }
    }

    /// The largest number of cells that a sample is split into.
    pub fn leaves(self) -> u32 {
        match self {
            Self::Flat { leaves } | Self::Hierarchical { leaves, .. } => leaves,
        }
    }
}

/// Default number of leaves per sample in a hierarchy. With 64, sunlit caustics of `ring` and `gloss` are visibly grainy; with this many
/// most pictures take a twentieth longer, rough mirrors a third.
const LEAVES: u32 = 256;
/// Default number under near light and, unless memory is short, where there are many samples.
const FEW_LEAVES: u32 = 64;
/// There are many samples where the default number of leaves would make more cells than this, whose tree takes seconds to build.
const MANY_CELLS: u64 = 1 << 20;

/// An overlay on the beauty picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Overlay {
    /// Nothing.
    #[default]
    None,
    /// A dot for every sample.
    Samples,
    /// The normal of every sample.
    Normals,
    /// The principal directions at every sample, as long as the surface is curved along them.
    Curvature,
    /// The cell that every sample stands for, as the rectangle of the same area moments.
    Cells,
    /// A dot where each of some thousand photons meets a receiver; image-space techniques only, which have no samples for the others.
    Photons,
    /// A caustic map in a corner, of image-space techniques only: the first light's or, where the picture has the camera's map, the one for
    /// what the camera does not see.
    CausticMap,
}

/// How brightly radiance is displayed.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "NumberOrWord")]
pub enum Exposure {
    /// Metered on the picture: its middle tones become grey, and its brightest parts do not wash out.
    Auto,
    /// Stops; from −64 to 64.
    Stops(f32),
}

impl Default for Exposure {
    fn default() -> Self {
        Self::Stops(0.0)
    }
}

impl TryFrom<NumberOrWord> for Exposure {
    type Error = String;
    fn try_from(value: NumberOrWord) -> Result<Self, String> {
        value.to_string().parse()
    }
}

impl std::str::FromStr for Exposure {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match (text, text.parse()) {
            ("auto", _) => Ok(Self::Auto),
            (_, Ok(stops)) => Ok(Self::Stops(stops)),
            _ => Err(format!("'{text}' is not an exposure; give auto or a number of stops")),
        }
    }
}

/// How radiance is displayed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DisplaySettings {
    /// The exposure.
    pub exposure: Exposure,
    /// Exposure of the environment where the camera sees it directly, stops, from −64 to 64; `None`: that of everything else.
    pub background_exposure_ev: Option<f32>,
    /// The tone map.
    pub tone_map: ToneMap,
}

impl DisplaySettings {
    /// The exposures in use; `meter` is asked if one has to be found.
    pub fn exposures(&self, meter: impl FnOnce() -> f32) -> Exposures {
        let exposure_ev = match self.exposure {
            Exposure::Auto => meter(),
            Exposure::Stops(stops) => stops,
        };
        Exposures { exposure_ev, background_exposure_ev: self.background_exposure_ev.unwrap_or(exposure_ev) }
    }
}

/// Exposures in use.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Exposures {
    /// Of surfaces, stops.
    pub exposure_ev: f32,
    /// Of the environment where the camera sees it directly, stops.
    pub background_exposure_ev: f32,
}

macro_rules! options {
    ($($(#[doc = $doc:literal])+ $field:ident / $setter:ident: $type:ty = $default:expr,)*) => {
        /// What to render and how. Every field has a default and a setter of its own.
        ///
        /// ```
        /// use pinspot::Options;
        ///
        /// let options = Options::default().with_size([64, 64]).with_samples(100);
        /// assert_eq!(options.tolerance, 0.01);
        /// assert!(options.with_taps(0).check().is_err());
        /// ```
        #[derive(Clone, Debug, PartialEq)]
        #[non_exhaustive]
        pub struct Options {
            $($(#[doc = $doc])+ pub $field: $type,)*
        }

        impl Default for Options {
            fn default() -> Self {
                Self { $($field: $default,)* }
            }
        }

        impl Options {
            $(
                $(#[doc = $doc])+
                #[must_use]
                pub fn $setter(mut self, $field: $type) -> Self {
                    self.$field = $field;
                    self
                }
            )*
        }
    };
}

options! {
    /// Width and height, pixels; each from 1 to 16384.
    size / with_size: [u32; 2] = [512, 512],
    /// n: each pixel is the mean over n×n points; from 1 to 16.
    pixel_samples / with_pixel_samples: u32 = 1,
    /// The pictures to render, each at most once.
    aovs / with_aovs: Vec<Aov> = vec![Aov::Beauty],
    /// How the caustic's irradiance is computed.
    technique / with_technique: Technique = Technique::default(),
    /// What image-space techniques do.
    image_space / with_image_space: ImageSpaceOptions = ImageSpaceOptions::default(),
    /// Requested number of samples; from 1 to [`MAX_SAMPLES`].
    samples / with_samples: u32 = 1000,
    /// How the samples are placed.
    strategy / with_strategy: Strategy = Strategy::default(),
    /// What the density of the samples follows.
    density / with_density: Density = Density::default(),
    /// Random seed.
    seed / with_seed: u64 = 1,
    /// How the samples' footprints are derived.
    footprint / with_footprint: Footprint = Footprint::default(),
    /// How the environment is filtered over a footprint.
    filter / with_filter: FilterChoice = FilterChoice::default(),
    /// The largest number of look-ups along a footprint's major axis; from 1 to [`MAX_TAPS`].
    taps / with_taps: u32 = 16,
    /// `false` drops the factor 1/l² (the result is then a pattern, not an irradiance).
    attenuation / with_attenuation: bool = true,
    /// The term that keeps 1/l² finite.
    epsilon / with_epsilon: Epsilon = Epsilon::default(),
    /// How the samples are summed.
    evaluation / with_evaluation: EvaluationChoice = EvaluationChoice::default(),
    /// The largest number of cells that each sample is split into, rounded down to a power of four. `None`: 256 in a hierarchy
    /// (64 under near light, fewer where the tree would become large), else 1.
    leaves / with_leaves: Option<u32> = None,
    /// Allowed error of a hierarchical sum, relative to the mean irradiance; from 1e-5 to 1. See docs/scenes.md.
    tolerance / with_tolerance: f32 = 0.01,
    /// Parts of each camera ray in a medium, by which the light is summed that is scattered there; from 1 to 256.
    medium_steps / with_medium_steps: u32 = 32,
    /// Resolution of the environment's cube map.
    cube_size / with_cube_size: CubeSize = CubeSize::default(),
    /// Which occlusion is taken into account.
    visibility / with_visibility: Visibility = Visibility::default(),
    /// Exposures.
    display / with_display: DisplaySettings = DisplaySettings::default(),
    /// Multiplies the caustic in the beauty picture; from 0 to 1e6.
    caustic_gain / with_caustic_gain: f32 = 1.0,
    /// Shows the shapes: everything is diffuse and grey, without mirrors or caustics.
    plain_diffuse / with_plain_diffuse: bool = false,
    /// An overlay on the beauty picture.
    overlay / with_overlay: Overlay = Overlay::None,
}

/// Upper limit of [`Options::medium_steps`].
pub const MAX_MEDIUM_STEPS: u32 = 256;
/// The longest edge of a picture, pixels.
const MAX_SIZE: u32 = 16384;
/// The largest number of leaves in a hierarchy, or of samples in a flat sum.
const MAX_CELLS: u64 = 1 << 22;
/// The largest number of leaves whose tree is sure to fit into the 128 MiB that every WebGPU device can bind: 64 bytes per node,
/// and four nodes for every three leaves.
const MAX_CELLS_OF_BINDING: u64 = 1_500_000;

/// Options and values, any of which would do.
type Remedies = &'static [(&'static str, &'static str)];

/// The largest factor on the caustic.
const MAX_CAUSTIC_GAIN: f32 = 1e6;

/// Checks that a number is in a range; NaN is in none.
fn in_range<T: Copy + PartialOrd + std::fmt::Display>(
    key: &'static str,
    value: T,
    low: T,
    high: T,
) -> Result<(), OptionError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(OptionError::OutOfRange { key, value: value.to_string(), expected: format!("from {low} to {high}") })
}

impl Options {
    /// Checks that every value is in its range and that no two contradict each other.
    pub fn check(&self) -> Result<(), OptionError> {
        let [width, height] = self.size;
        if !(1..=MAX_SIZE).contains(&width) || !(1..=MAX_SIZE).contains(&height) {
            let expected = format!("from 1×1 to {MAX_SIZE}×{MAX_SIZE} pixels");
            return Err(OptionError::OutOfRange { key: "size", value: format!("{width}×{height}"), expected });
        }
        self.check_overlay()?;
        in_range("pixel_samples", self.pixel_samples, 1, 16)?;
        in_range("samples", self.samples, 1, MAX_SAMPLES)?;
        in_range("taps", self.taps, 1, MAX_TAPS)?;
        in_range("medium_steps", self.medium_steps, 1, MAX_MEDIUM_STEPS)?;
        in_range("tolerance", self.tolerance, 1e-5, 1.0)?;
        if let Exposure::Stops(stops) = self.display.exposure {
            in_range("exposure_ev", stops, -64.0, 64.0)?;
        }
        in_range("background_exposure_ev", self.display.background_exposure_ev.unwrap_or(0.0), -64.0, 64.0)?;
        in_range("caustic_gain", self.caustic_gain, 0.0, MAX_CAUSTIC_GAIN)?;
        if let Epsilon::Value(epsilon) = self.epsilon {
            in_range("epsilon", epsilon, 0.0, 1e30)?;
        }
        self.image_space.check()?;
        self.check_pictures()?;
        self.check_leaves()
    }

    fn check_overlay(&self) -> Result<(), OptionError> {
        let (shows, remedies): (_, &'static [(&str, &str)]) = match (self.overlay, self.technique) {
            (Overlay::Photons | Overlay::CausticMap, Technique::Pinhole) => {
                ("photons", &[("technique", "image-space"), ("overlay", "samples")])
            }
            (Overlay::Samples | Overlay::Normals | Overlay::Curvature | Overlay::Cells, Technique::ImageSpace) => {
                ("samples", &[("technique", "pinhole"), ("overlay", "photons")])
            }
            _ => return Ok(()),
        };
        let reason = format!("shows {shows}, of which the technique {} has none", self.technique);
        Err(OptionError::Conflict { key: "overlay", reason, remedies })
    }

    fn check_pictures(&self) -> Result<(), OptionError> {
        let expected =
            "one or more of beauty, caustic, caustic.R, caustic.T, caustic.TT, caustic.TTTT, direct, scattered, scattered.direct, albedo, normal, position, depth, each once".to_owned();
        let repeated = (1..self.aovs.len()).find(|&i| self.aovs[..i].contains(&self.aovs[i]));
        match repeated {
            Some(i) => {
                let value = format!("{} twice", self.aovs[i].name());
                Err(OptionError::OutOfRange { key: "aov", value, expected })
            }
            None if self.aovs.is_empty() => {
                Err(OptionError::OutOfRange { key: "aov", value: "empty".to_owned(), expected })
            }
            None => Ok(()),
        }
    }

    fn check_leaves(&self) -> Result<(), OptionError> {
        let Some(leaves) = self.leaves else { return Ok(()) };
        in_range("leaves", leaves, 1, MAX_LEAVES)?;
        let cells = u64::from(self.samples) * u64::from(leaves);
        if cells > MAX_CELLS {
            let reason = format!("make {cells} cells with {} samples, but at most {MAX_CELLS} fit", self.samples);
            return Err(OptionError::Conflict {
                key: "leaves",
                reason,
                remedies: &[("samples", "fewer"), ("leaves", "fewer")],
            });
        }
        if leaves > 1 && self.footprint == Footprint::Curvature {
            let reason = "are cells, which curvature footprints have none of".to_owned();
            return Err(OptionError::Conflict {
                key: "leaves",
                reason,
                remedies: &[("footprint", "cells"), ("leaves", "1")],
            });
        }
        Ok(())
    }

    /// How the samples are summed with this filter, on a GPU or on the CPU. Near light needs few leaves: lamps are seen by closed forms, and
    /// views of other near light are coarse.
    pub(crate) fn resolved_evaluation(
        &self,
        filter: Filter,
        on_gpu: bool,
        has_near_light: bool,
    ) -> Result<Evaluation, OptionError> {
        let power_of_four = |leaves: u32| 4u32.pow(leaves.ilog(4));
        let flat = Evaluation::Flat { leaves: power_of_four(self.leaves.unwrap_or(1)) };
        let most = if on_gpu { MAX_CELLS_OF_BINDING } else { MAX_CELLS };
        let fits = |leaves: &u32| {
            let most = if *leaves > FEW_LEAVES { MANY_CELLS.min(most) } else { most };
            u64::from(self.samples) * u64::from(*leaves) <= most
        };
        let first = if has_near_light { FEW_LEAVES } else { LEAVES };
        let by_default =
            std::iter::successors(Some(first), |leaves| Some(leaves / 4)).take_while(|l| *l > 0).find(fits);
        let leaves = power_of_four(self.leaves.or(by_default).unwrap_or(1));
        let hierarchical = Evaluation::Hierarchical { leaves, tolerance: self.tolerance };
        let has_filter = filter == Filter::Anisotropic || filter == Filter::Hardware && on_gpu;
        let obstacles: [(bool, &str, Remedies); 4] = [
            (
                self.leaves.is_none() && !fits(&1),
                "has more cells than a GPU binds",
                &[("samples", "fewer"), ("backend", "cpu"), ("evaluation", "flat")],
            ),
            (
                self.footprint != Footprint::Cells,
                "needs footprints that are cells",
                &[("footprint", "cells"), ("evaluation", "flat")],
            ),
            (!has_filter, "filters anisotropically", &[("filter", "anisotropic"), ("evaluation", "flat")]),
            (
                self.epsilon == Epsilon::Paper,
                "has no sample area to take the paper's ε from",
                &[("epsilon", "auto"), ("evaluation", "flat")],
            ),
        ];
        let obstacle = obstacles.into_iter().find(|(stands, ..)| *stands);
        match (self.evaluation, obstacle) {
            (EvaluationChoice::Hierarchical, Some((_, reason, remedies))) => {
                let reason = format!("hierarchical {reason}");
                Err(OptionError::Conflict { key: "evaluation", reason, remedies })
            }
            (EvaluationChoice::Flat, _) | (_, Some(_)) => Ok(flat),
            _ => Ok(hierarchical),
        }
    }

    /// The options of the sampling stage.
    pub fn sampling(&self) -> sampling::Options {
        sampling::Options { samples: self.samples, strategy: self.strategy, seed: self.seed }
    }

    /// The size of the same picture, reduced so that its longer side has at most so many pixels.
    pub fn size_within(&self, longer_side: u32) -> [u32; 2] {
        let own = self.size[0].max(self.size[1]);
        self.size.map(|edge| (edge * longer_side.min(own) / own).max(1))
    }

    /// The parameters of a sum with this filter and rotation of the environment.
    pub fn params(&self, filter: Filter, environment_rotation_rad: f32) -> Params {
        let Self { taps, attenuation, epsilon, .. } = *self;
        Params { filter, taps, attenuation, epsilon, softening: 0.0, environment_rotation_rad, ..Params::default() }
    }

    /// Whether any requested picture shows caustics.
    pub(crate) fn shows_caustic(&self) -> bool {
        self.aovs.contains(&Aov::Caustic) || self.aovs.contains(&Aov::Beauty) && !self.plain_diffuse
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_default_there_are_as_many_leaves_as_fit() {
        let resolved = |samples, on_gpu| {
            Options::default().with_samples(samples).resolved_evaluation(Filter::Anisotropic, on_gpu, false).unwrap()
        };
        let hierarchical = |leaves| Evaluation::Hierarchical { leaves, tolerance: 0.01 };
        assert_eq!([resolved(1000, false), resolved(1000, true)], [hierarchical(256); 2]);
        let under_near_light = Options::default().resolved_evaluation(Filter::Anisotropic, false, true).unwrap();
        assert_eq!(under_near_light, hierarchical(64));
        assert_eq!([resolved(5000, false), resolved(5000, true)], [hierarchical(64); 2]);
        assert_eq!([resolved(40_000, false), resolved(40_000, true)], [hierarchical(64), hierarchical(16)]);
        assert_eq!([resolved(100_000, false), resolved(1_000_000, false)], [hierarchical(16), hierarchical(4)]);
        assert_eq!(resolved(1_400_000, true), hierarchical(1));
        assert_eq!(resolved(2_000_000, true), Evaluation::Flat { leaves: 1 });
    }
}
