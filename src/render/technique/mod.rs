//! Techniques: ways to compute a caustic, the irradiance that reaches receivers via mirrors and interfaces.
//!
//! A technique prepares itself from the shared stages ([`crate::stages`]), keeps its own intermediate results, and
//! returns a `Sum`, which can be evaluated at any receivers. To add one, add a variant of [`Technique`] and a module
//! that implements `TechniqueStages`. This module must not know pictures, camera paths or files.

mod image_space;
mod past_frames;
mod photon_passes;
mod pinhole;

use std::fmt;
use std::pin::Pin;
use std::sync::Arc;

use glam::Vec3;
use serde::{Deserialize, Serialize};

pub use self::pinhole::place_samples;
use crate::Error;
use crate::backend::Backend;
use crate::differential::DifferentialSample;
#[cfg(feature = "gpu")]
use crate::gpu::GpuError;
use crate::image_space::{Hits, Incidence, Ledger, MapPicture, MapView, Mode, Traversal};
use crate::options::{Evaluation, Options};
use crate::pinhole::cpu::{Contribution, TakenCell};
#[cfg(feature = "gpu")]
use crate::pinhole::gpu::{EnvironmentCube, Frame};
use crate::pinhole::{Filter, Receivers, SampleView};
use crate::progress::Progress;
use crate::scene::{Chain, Chains, Object, Scene};
use crate::stages::{LightStages, PreparedLight, PreparedScene, StageCounts};
use crate::tracing::Hit;

/// A way to compute a caustic: the irradiance that reaches receivers via mirrors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Technique {
    /// Each sample of a mirror projects the environment like a pinhole camera (Wand and Straßer 2003, Section 3).
    #[default]
    Pinhole,
    /// Photons from the lights' views, in maps of the receivers (Wyman and Davis 2006, and what followed).
    ImageSpace,
}

impl Technique {
    /// Its name in scene files, reports and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pinhole => "pinhole",
            Self::ImageSpace => "image-space",
        }
    }

    /// All techniques.
    pub const ALL: [Self; 2] = [Self::Pinhole, Self::ImageSpace];

    /// The chains of a scene that it computes: pinholes all of them but light through closed objects.
    pub fn chains(self, scene: &Scene) -> Chains {
        match self {
            Self::Pinhole if scene.objects.iter().any(|object| object.casts(Chain::TT)) => Chains::SINGLE,
            Self::Pinhole | Self::ImageSpace => Chains::ALL,
        }
    }

    /// What there is in a scene that the technique cannot compute, if there is anything.
    pub fn unsupported(self, scene: &Scene) -> Option<&'static str> {
        let has = |is_such: fn(&Object) -> bool| scene.objects.iter().any(is_such);
        match self {
            Self::ImageSpace if scene.medium.is_some() => Some("media"),
            Self::ImageSpace if has(Object::is_near_light) => Some("emitters that are near"),
            Self::ImageSpace if has(|o| o.reflector.is_some_and(|r| r.finish.roughness > 0.0)) => Some("rough mirrors"),
            Self::Pinhole | Self::ImageSpace => None,
        }
    }

    /// Its stages, still empty.
    pub(crate) fn stages(self) -> Box<dyn TechniqueStages> {
        match self {
            Self::Pinhole => Box::new(pinhole::PinholeStages::new()),
            Self::ImageSpace => Box::new(image_space::ImageSpaceStages::new()),
        }
    }
}

impl fmt::Display for Technique {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A future result.
pub(crate) type Pending<'a, T> = Pin<Box<dyn Future<Output = Result<T, Error>> + 'a>>;

/// The inputs of a technique.
#[derive(Clone, Copy)]
pub(crate) struct Inputs<'a> {
    pub scene: &'a Scene,
    pub prepared: &'a PreparedScene,
    pub light: &'a PreparedLight,
    pub options: &'a Options,
    pub backend: &'a Backend,
    /// The light that is summed.
    pub chains: Chains,
    /// The result is for a moment: what costs much and shows little may be coarser.
    pub is_preview: bool,
    pub progress: &'a dyn Progress,
}

/// A technique's own stages.
pub(crate) trait TechniqueStages: fmt::Debug + Send {
    /// Makes again what changed. Returns the same sum if nothing did.
    fn prepare<'a>(&'a mut self, inputs: Inputs<'a>, light: &'a mut LightStages) -> Pending<'a, Arc<dyn Sum>>;

    /// The mirrors' surface around the samples that it places.
    fn surface_samples(&mut self, inputs: &Inputs) -> Result<Arc<Vec<DifferentialSample>>, Error>;

    /// What the technique computes for a place on a surface.
    fn inspect(&mut self, inputs: &Inputs, place: &Hit) -> Result<Inspected, Error>;

    /// The cells that a hierarchical sum takes for a place on a receiver; `None` if sums are flat.
    fn cells_taken(
        &mut self,
        inputs: &Inputs,
        light: &mut LightStages,
        place: &Hit,
    ) -> Result<Option<Vec<TakenCell>>, Error>;

    /// Adds the counts of its stages.
    fn count(&self, counts: &mut StageCounts);
}

/// A place on a surface, taken apart.
#[derive(Clone, Debug)]
pub(crate) struct Inspected {
    /// What each sample adds to it as a receiver.
    pub contributions: Vec<Contribution>,
    /// What the sample that is nearest to it sees; `None` without visibility.
    pub view: Option<SampleView>,
}

/// A technique that is ready to be evaluated.
pub(crate) trait Sum: fmt::Debug + Send + Sync {
    /// Irradiance at every receiver in W/m², with the number of fetches of the environment in w; for receivers with
    /// view directions, radiance towards the viewers in W/(m²·sr). For an environment of intensity 1. Progress counts
    /// receivers.
    fn irradiance<'a>(&'a self, receivers: &'a Receivers, progress: &'a dyn Progress) -> Pending<'a, Vec<[f32; 4]>>;

    /// Figures about the sum.
    fn statistics(&self) -> &Statistics;

    /// A caustic map of techniques that have any, small enough to be shown in a corner of the picture.
    fn caustic_map(&self) -> Option<MapPicture> {
        None
    }

    /// The sum as a pass over receivers that are already on the GPU, if it is one.
    #[cfg(feature = "gpu")]
    fn on_gpu(&self) -> Option<&dyn SumOnGpu> {
        None
    }
}

/// A sum whose receivers are textures on the device.
#[cfg(feature = "gpu")]
pub(crate) trait SumOnGpu {
    /// The passes over receivers without viewers, one for each light, whose results are added: positions with objects, normals, and the
    /// size of both textures.
    fn frames(&self, receivers: [&wgpu::TextureView; 2], size: [u32; 2]) -> Result<Vec<Frame>, GpuError>;

    /// Turns the passes of an earlier sum over these receivers into those of this sum. Returns whether that is possible: otherwise new
    /// ones are needed.
    fn update(
        &self,
        frames: &mut [Frame],
        receivers: [&wgpu::TextureView; 2],
        size: [u32; 2],
    ) -> Result<bool, GpuError>;

    /// Records the tracing of visibility maps that has not been done yet; what is recorded has to be submitted. Returns the buffer whose
    /// first word counts the rays that the adapter did not let be finished: if there are any, the sum is wrong.
    fn record_maps(&self, encoder: &mut wgpu::CommandEncoder) -> Option<&wgpu::Buffer>;

    /// The environment that it looks up.
    fn environment(&self) -> &Arc<EnvironmentCube>;
}

/// Figures about a sum.
#[derive(Clone, Debug, Default)]
pub struct Statistics {
    /// Samples in use.
    pub samples: usize,
    /// Their positions or, of techniques that send photons, where some of these met receivers.
    pub positions: Arc<Vec<Vec3>>,
    /// How the samples are summed; `None` without samples.
    pub evaluation: Option<Evaluation>,
    /// How the environment is filtered; `None` where it is not looked up.
    pub filter: Option<Filter>,
    /// Of techniques that send photons.
    pub photons: Option<PhotonStatistics>,
    /// What may be wrong, one sentence each.
    pub warnings: Vec<String>,
}

/// Passes of photons.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub struct PassStatistics {
    /// How many there were.
    pub photon_passes: u32,
    /// The root of the mean squared error of the irradiance in maps, relative to that of the irradiance, as half the difference of two halves of the
    /// photons.
    pub photon_error: f64,
}

/// Figures about photons and what became of them.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub struct PhotonStatistics {
    /// How photons became irradiance.
    pub mode: Mode,
    /// How photons found what they met.
    pub hits: Hits,
    /// Which photons were followed.
    pub traversal: Traversal,
    /// Whose view the maps are.
    pub caustic_map: MapView,
    /// From where glossy receivers take the light.
    pub incidence: Incidence,
    /// Frames whose maps are averaged.
    pub temporal_frames: u32,
    /// Whether polygons and gathers follow the letter of the paper.
    pub paper: bool,
    /// With the mode `auto`: the passes that were sent, and about the relative error of the caustic that two halves of them show.
    #[serde(flatten)]
    pub passes: Option<PassStatistics>,
    /// Photons that were followed.
    pub photons: u64,
    /// Photons that met a receiver by way of a mirror or an interface; those of a cluster may be one.
    pub photons_used: u64,
    /// Lights that sent them.
    pub lights: usize,
    /// The account of their flux.
    pub flux: Ledger,
}
