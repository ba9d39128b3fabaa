//! What to render: the `[render]` table and the command line, and the validated options they lead to.

use serde::{Deserialize, Serialize};

use crate::cell_tree::MAX_LEAVES;
use crate::environment::CubeSize;
use crate::image::Aov;
use crate::pinhole::{Epsilon, Filter, Footprint, MAX_TAPS, Params};
use crate::sampling::{self, Density, MAX_SAMPLES, Strategy};
use crate::scene::Visibility;
use crate::{Error, OptionError};

/// What a scene file or a command line says about rendering. Everything is optional, so that one can be laid over another.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Width and height, pixels.
    pub size: Option<[u32; 2]>,
    /// Number of samples asked for.
    pub samples: Option<u32>,
    /// How the samples are placed.
    pub strategy: Option<Strategy>,
    /// Where samples are denser.
    pub density: Option<Density>,
    /// How a sample's footprint is found.
    pub footprint: Option<Footprint>,
    /// How the environment is looked up under a footprint.
    pub filter: Option<FilterChoice>,
    /// Most look-ups along a footprint's major axis.
    pub taps: Option<u32>,
    /// Sample by sample, or by a hierarchy of them.
    pub evaluation: Option<EvaluationChoice>,
    /// Cells that each sample may be split into.
    pub leaves: Option<u32>,
    /// Error that the hierarchy may have, as a part of the mean irradiance.
    pub tolerance: Option<f32>,
    /// `false` drops the 1/l² (the result is then a pattern, not an irradiance).
    pub attenuation: Option<bool>,
    /// What keeps 1/l² finite.
    pub epsilon: Option<Epsilon>,
    /// Edge of the cube map's faces, texels.
    pub cube_size: Option<CubeSize>,
    /// Which occlusion is taken into account.
    pub visibility: Option<Visibility>,
    /// Random seed.
    pub seed: Option<u64>,
    /// n: values are means over n×n points of a pixel.
    pub pixel_samples: Option<u32>,
    /// Exposure, in stops.
    pub exposure_ev: Option<f32>,
    /// Exposure of the environment where the camera sees it, in stops; by default `exposure_ev`.
    pub background_exposure_ev: Option<f32>,
    /// Multiplies the caustic in the beauty picture (WS-26).
    pub caustic_gain: Option<f32>,
    /// What to render.
    pub aov: Option<Vec<Aov>>,
}

impl Settings {
    /// These settings with every key that `over` sets replaced.
    #[must_use]
    pub fn overridden_by(self, over: Self) -> Self {
        Self {
            size: over.size.or(self.size),
            samples: over.samples.or(self.samples),
            strategy: over.strategy.or(self.strategy),
            density: over.density.or(self.density),
            footprint: over.footprint.or(self.footprint),
            filter: over.filter.or(self.filter),
            taps: over.taps.or(self.taps),
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
            caustic_gain: over.caustic_gain.or(self.caustic_gain),
            aov: over.aov.or(self.aov),
        }
    }

    /// The options, defaults filled in and every value checked.
    pub fn options(self) -> Result<Options, Error> {
        let defaults = Options::default();
        let exposure_ev = self.exposure_ev.unwrap_or(0.0);
        let options = Options {
            size: self.size.unwrap_or(defaults.size),
            samples: self.samples.unwrap_or(defaults.samples),
            strategy: self.strategy.unwrap_or_default(),
            density: self.density.unwrap_or_default(),
            footprint: self.footprint.unwrap_or_default(),
            params: Params {
                filter: self.filter.unwrap_or_default().resolve(),
                taps: self.taps.unwrap_or(defaults.params.taps),
                attenuation: self.attenuation.unwrap_or(true),
                epsilon: self.epsilon.unwrap_or_default(),
                ..defaults.params
            },
            evaluation: self.evaluation.unwrap_or_default(),
            leaves: self.leaves,
            tolerance: self.tolerance.unwrap_or(defaults.tolerance),
            automatic_filter: self.filter.unwrap_or_default() == FilterChoice::Auto,
            cube_size: self.cube_size.unwrap_or_default(),
            visibility: self.visibility.unwrap_or_default(),
            seed: self.seed.unwrap_or(defaults.seed),
            pixel_samples: self.pixel_samples.unwrap_or(defaults.pixel_samples),
            aovs: self.aov.unwrap_or(defaults.aovs),
            look: Look {
                exposure_ev,
                background_exposure_ev: self.background_exposure_ev.unwrap_or(exposure_ev),
                caustic_gain: self.caustic_gain.unwrap_or(1.0),
                plain_diffuse: false,
            },
            overlay: Overlay::None,
        };
        options.check()?;
        Ok(options)
    }
}

/// A filter, or the choice of one left to Pinspot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FilterChoice {
    /// The GPU's own where a test finds it right, else anisotropic, in the shader.
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
    /// The filter; the automatic one as it is without a GPU.
    pub fn resolve(self) -> Filter {
        match self {
            Self::None => Filter::None,
            Self::Isotropic => Filter::Isotropic,
            Self::Auto | Self::Anisotropic => Filter::Anisotropic,
            Self::Hardware => Filter::Hardware,
            Self::Ewa => Filter::Ewa,
        }
    }
}

/// How the samples are summed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EvaluationChoice {
    /// Hierarchical where that can be, else flat.
    #[default]
    Auto,
    /// Every sample for every receiver, as the paper does.
    Flat,
    /// By a tree of cells, as finely as the tolerance asks for.
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

/// How the samples are summed, decided.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "evaluation")]
pub enum Evaluation {
    /// Every one for every receiver.
    Flat {
        /// Cells that each sample is split into.
        leaves: u32,
    },
    /// By a tree of cells.
    Hierarchical {
        /// Cells that each sample is split into.
        leaves: u32,
        /// Error, as a part of the mean irradiance.
        tolerance: f32,
    },
}

impl Evaluation {
    /// Cells that each sample is split into at most.
    pub fn leaves(self) -> u32 {
        match self {
            Self::Flat { leaves } | Self::Hierarchical { leaves, .. } => leaves,
        }
    }
}

/// Leaves that the hierarchy gives each sample by default: from there on what the tree costs outweighs what it gains
/// (`cargo bench --bench hierarchy`).
const LEAVES: u32 = 64;

/// What is drawn over the beauty picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Overlay {
    /// Nothing.
    #[default]
    None,
    /// A dot for every sample (WS-25).
    Samples,
}

/// How the beauty picture looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Stops.
    pub exposure_ev: f32,
    /// Stops, for the environment where the camera sees it directly (WS-21).
    pub background_exposure_ev: f32,
    /// Multiplies the caustic (WS-26).
    pub caustic_gain: f32,
    /// Everything diffuse and grey, no mirrors and no caustics: shows the shapes (WS-25).
    pub plain_diffuse: bool,
}

/// Validated options of a render.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Number of samples asked for.
    pub samples: u32,
    /// How they are placed.
    pub strategy: Strategy,
    /// Where they are denser.
    pub density: Density,
    /// How their footprints are found.
    pub footprint: Footprint,
    /// The gather.
    pub params: Params,
    /// How the samples are summed.
    pub evaluation: EvaluationChoice,
    /// Cells that each sample may be split into; `None`: 64 in a hierarchy (fewer, by powers of four, where all together would
    /// be too many), else 1. The power of four below counts.
    pub leaves: Option<u32>,
    /// Error that a hierarchy may have, as a part of the mean irradiance over the picture; from 1e-5 to 1.
    pub tolerance: f32,
    /// The filter was left to Pinspot: a GPU whose own filter is right uses that instead of [`Filter::Anisotropic`] in
    /// `params`; any other filter there stays.
    pub automatic_filter: bool,
    /// The environment's cube map.
    pub cube_size: CubeSize,
    /// Occlusion.
    pub visibility: Visibility,
    /// Random seed.
    pub seed: u64,
    /// n×n points a pixel.
    pub pixel_samples: u32,
    /// What to render; not empty.
    pub aovs: Vec<Aov>,
    /// How the beauty looks.
    pub look: Look,
    /// What is drawn over it.
    pub overlay: Overlay,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            size: [512, 512],
            samples: 1000,
            strategy: Strategy::default(),
            density: Density::default(),
            footprint: Footprint::default(),
            params: Params::default(),
            evaluation: EvaluationChoice::default(),
            leaves: None,
            tolerance: 0.01,
            automatic_filter: true,
            cube_size: CubeSize::default(),
            visibility: Visibility::default(),
            seed: 1,
            pixel_samples: 1,
            aovs: vec![Aov::Beauty],
            look: Look { exposure_ev: 0.0, background_exposure_ev: 0.0, caustic_gain: 1.0, plain_diffuse: false },
            overlay: Overlay::None,
        }
    }
}

/// The longest edge of a picture, pixels.
const MAX_SIZE: u32 = 16384;
/// The most cells of a hierarchy, or samples of a sum without one.
const MAX_CELLS: u64 = 1 << 22;
/// The most leaves whose tree surely fits into the 128 MiB that every WebGPU device binds: 64 bytes a node, and four nodes for
/// three leaves.
const MAX_CELLS_OF_BINDING: u64 = 1_500_000;

impl Options {
    /// Whether every value is in its range.
    pub fn check(&self) -> Result<(), Error> {
        let fail = |key: &'static str, message: String| Err(OptionError { key, message }.into());
        let [width, height] = self.size;
        if width == 0 || height == 0 || width > MAX_SIZE || height > MAX_SIZE {
            return fail("size", format!("is {width}×{height}, but must be from 1×1 to {MAX_SIZE}×{MAX_SIZE} pixels"));
        }
        if !(1..=MAX_TAPS).contains(&self.params.taps) {
            return fail("taps", format!("is {}, but must be from 1 to {MAX_TAPS}", self.params.taps));
        }
        if !(1..=16).contains(&self.pixel_samples) {
            return fail("pixel_samples", format!("is {}, but must be from 1 to 16", self.pixel_samples));
        }
        if self.aovs.is_empty() {
            return fail(
                "aov",
                "names nothing; give one or more of beauty, caustic, direct, albedo, normal, position, depth".into(),
            );
        }
        if (1..self.aovs.len()).any(|i| self.aovs[..i].contains(&self.aovs[i])) {
            return fail("aov", "names a picture twice; name each once".into());
        }
        if !(1..=MAX_SAMPLES).contains(&self.samples) {
            return fail("samples", format!("is {}, but must be from 1 to {MAX_SAMPLES}", self.samples));
        }
        if !(1..=MAX_LEAVES).contains(&self.leaves.unwrap_or(1)) {
            return fail("leaves", format!("is {}, but must be from 1 to {MAX_LEAVES}", self.leaves.unwrap_or(1)));
        }
        let cells = u64::from(self.samples) * u64::from(self.leaves.unwrap_or(1));
        if cells > MAX_CELLS {
            return fail(
                "leaves",
                format!(
                    "make {cells} cells with {} samples, but at most {MAX_CELLS} fit; give fewer of either",
                    self.samples
                ),
            );
        }
        if !(1e-5..=1.0).contains(&self.tolerance) {
            return fail("tolerance", format!("is {}, but must be from 0.00001 to 1", self.tolerance));
        }
        if self.leaves.unwrap_or(1) > 1 && self.footprint == Footprint::Curvature {
            return fail(
                "leaves",
                "are cells, which --footprint curvature does without; give --footprint cells, or 1 leaf".into(),
            );
        }
        let Look { exposure_ev, background_exposure_ev, caustic_gain, .. } = self.look;
        if !(exposure_ev.abs() <= 64.0 && background_exposure_ev.abs() <= 64.0) {
            return fail("exposure_ev", "must be from -64 to 64 stops".into());
        }
        if !(caustic_gain >= 0.0 && caustic_gain.is_finite()) {
            return fail("caustic_gain", format!("is {caustic_gain}, but must be a number that is not negative"));
        }
        Ok(())
    }

    /// How the samples are summed, on a GPU or not.
    pub(super) fn settled_evaluation(&self, on_gpu: bool) -> Result<Evaluation, OptionError> {
        let split = |leaves: u32| 4u32.pow(leaves.ilog(4));
        let flat = Evaluation::Flat { leaves: split(self.leaves.unwrap_or(1)) };
        let most = if on_gpu { MAX_CELLS_OF_BINDING } else { MAX_CELLS };
        let fits = |leaves: &u32| u64::from(self.samples) * u64::from(*leaves) <= most;
        let by_default =
            std::iter::successors(Some(LEAVES), |leaves| Some(leaves / 4)).take_while(|l| *l > 0).find(fits);
        let leaves = split(self.leaves.or(by_default).unwrap_or(1));
        let hierarchical = Evaluation::Hierarchical { leaves, tolerance: self.tolerance };
        let filters = match self.params.filter {
            Filter::Anisotropic => true,
            Filter::Hardware => on_gpu,
            _ => false,
        };
        let obstacle = [
            (
                self.leaves.is_none() && !fits(&1),
                "has more cells than a GPU binds; give fewer --samples, or --backend cpu",
            ),
            (self.footprint != Footprint::Cells, "needs cells; give --footprint cells"),
            (!filters, "filters anisotropically; give --filter anisotropic"),
            (self.params.epsilon == Epsilon::Paper, "knows no area to take the paper's ε from; give another --epsilon"),
        ];
        let obstacle = obstacle.into_iter().find_map(|(stands, remedy)| stands.then_some(remedy));
        match (self.evaluation, obstacle) {
            (EvaluationChoice::Hierarchical, Some(remedy)) => {
                let message = format!("hierarchical {remedy}, or --evaluation flat");
                Err(OptionError { key: "evaluation", message })
            }
            (EvaluationChoice::Flat, _) | (_, Some(_)) => Ok(flat),
            _ => Ok(hierarchical),
        }
    }

    /// How many samples are placed, and how.
    pub(super) fn sampling(&self) -> sampling::Options {
        sampling::Options { samples: self.samples, strategy: self.strategy, seed: self.seed }
    }

    /// Whether any picture shows caustics.
    pub(super) fn needs_gather(&self) -> bool {
        self.aovs.contains(&Aov::Caustic) || self.aovs.contains(&Aov::Beauty) && !self.look.plain_diffuse
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_default_there_are_as_many_leaves_as_fit() {
        let settled = |samples, on_gpu| Options { samples, ..Options::default() }.settled_evaluation(on_gpu).unwrap();
        let hierarchical = |leaves| Evaluation::Hierarchical { leaves, tolerance: 0.01 };
        assert_eq!([settled(1000, false), settled(1000, true)], [hierarchical(64); 2]);
        assert_eq!([settled(40_000, false), settled(40_000, true)], [hierarchical(64), hierarchical(16)]);
        assert_eq!([settled(100_000, false), settled(1_000_000, false)], [hierarchical(16), hierarchical(4)]);
        assert_eq!(settled(1_400_000, true), hierarchical(1));
        assert_eq!(settled(2_000_000, true), Evaluation::Flat { leaves: 1 });
    }
}
