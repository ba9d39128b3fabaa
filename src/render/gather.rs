//! The back ends: where the gather runs.

use std::fmt;

use serde::Serialize;

use super::on_gpu::OnGpu;
use crate::blocking::wait;
use crate::environment::{CubeMap, Environment, LightBounds};
use crate::gpu::{Adapter, Gpu, GpuError};
use crate::pinhole::cpu::{self, Accuracy, Light};
use crate::pinhole::gpu::{
    CellTreeBuffers, Engine, EnvironmentCube, GatherOptions, HierarchicalEngine, HierarchicalOptions,
    LightBoundsTexture, automatic_filter as automatic_filter_of, check_hardware_filter,
};
use crate::pinhole::{Filter, Params, PinholeTree, Pinholes, Receivers};
use crate::scene::Visibility;
use crate::{Error, OptionError, Progress};

/// Which back end is asked for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum BackendChoice {
    /// A hardware GPU if there is one, else the CPU (which is faster than a software GPU).
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// The best adapter, or the best one with this in its name; software ones too.
    Gpu(Option<String>),
}

impl BackendChoice {
    /// The same, decided once where it leads to the CPU: looking for adapters takes time.
    #[must_use]
    pub fn settled(&self, filter: Filter) -> Self {
        let hardware = || wait(None, Gpu::open(None)).is_ok_and(|gpu| !gpu.adapter.software);
        match self {
            Self::Auto if filter != Filter::Hardware && !hardware() => Self::Cpu,
            other => other.clone(),
        }
    }
}

/// What is summed, where it is made.
#[derive(Debug)]
pub(super) enum Samples {
    /// Samples, one by one.
    Flat(Pinholes),
    /// A hierarchy of them.
    Hierarchical {
        /// The cells.
        tree: Box<PinholeTree>,
        /// How bright the light is.
        bounds: LightBounds,
        /// How right the sum is to be.
        accuracy: Accuracy,
    },
}

/// What is summed, where it is summed.
#[derive(Debug)]
pub(super) enum Summed {
    /// On the CPU.
    Cpu(Samples),
    /// Samples one by one, on a GPU.
    GpuFlat {
        /// The pipelines.
        engine: Box<Engine>,
        /// The samples.
        pinholes: Pinholes,
    },
    /// A hierarchy on a GPU.
    GpuHierarchical {
        /// The pipelines.
        engine: Box<HierarchicalEngine>,
        /// The cells.
        tree: Box<CellTreeBuffers>,
        /// How bright the light is.
        bounds: LightBoundsTexture,
        /// How right the sum is to be.
        accuracy: Accuracy,
    },
}

/// An open back end.
#[derive(Debug)]
pub enum Backend {
    /// SIMD and all cores.
    Cpu,
    /// A GPU through wgpu.
    Gpu {
        /// The device.
        gpu: Box<Gpu>,
        /// The light on the device.
        environment: EnvironmentCube,
        /// What the user should know about this adapter.
        warning: Option<String>,
    },
}

/// What is said of a back end in reports.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "lowercase", tag = "backend")]
pub enum BackendReport {
    /// The CPU.
    Cpu {
        /// Worker threads.
        threads: usize,
    },
    /// A GPU.
    Gpu {
        /// The adapter.
        adapter: Adapter,
    },
}

impl BackendReport {
    /// The adapter; `None` on the CPU.
    pub fn adapter(&self) -> Option<&Adapter> {
        match self {
            Self::Cpu { .. } => None,
            Self::Gpu { adapter } => Some(adapter),
        }
    }
}

impl fmt::Display for BackendReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu { threads } => write!(f, "the CPU ({threads} threads)"),
            Self::Gpu { adapter } => adapter.fmt(f),
        }
    }
}

impl Backend {
    /// Opens a back end; with it the filter, which may be the GPU's own if the choice is automatic.
    pub(super) fn open(
        choice: &BackendChoice,
        environment: &Environment,
        options: &super::Options,
    ) -> Result<(Self, Filter), Error> {
        let params = &options.params;
        let gpu = match choice {
            BackendChoice::Cpu => None,
            BackendChoice::Gpu(name) => Some(wait(None, Gpu::open(name.as_deref()))?),
            BackendChoice::Auto if params.filter == Filter::Hardware => wait(None, Gpu::open(None)).ok(),
            BackendChoice::Auto => wait(None, Gpu::open(None)).ok().filter(|gpu| !gpu.adapter.software),
        };
        let Some(gpu) = gpu else {
            if params.filter == Filter::Hardware {
                let message =
                    "hardware needs a GPU; use --filter anisotropic, or --backend gpu where there is one".into();
                return Err(OptionError { key: "filter", message }.into());
            }
            return Ok((Self::Cpu, params.filter));
        };
        let replaceable = options.automatic_filter && params.filter == Filter::Anisotropic;
        let filter = if replaceable { wait(Some(&gpu.device), automatic_filter_of(&gpu))? } else { params.filter };
        let environment = EnvironmentCube::upload(&gpu.device, &gpu.queue, &environment.cube)?;
        let warning = hardware_warning(&gpu, params)?;
        gpu.check()?;
        Ok((Self::Gpu { gpu: Box::new(gpu), environment, warning }, filter))
    }

    /// Brings what is summed to where it is summed.
    pub(super) fn ready(&self, samples: Samples, options: &super::Options) -> Result<Summed, Error> {
        let Self::Gpu { gpu, .. } = self else { return Ok(Summed::Cpu(samples)) };
        let (filter, visibility) = (options.params.filter, options.visibility == Visibility::Full);
        Ok(match samples {
            Samples::Flat(pinholes) => {
                let engine = Engine::new(&gpu.device, &GatherOptions { filter, visibility, ..Default::default() });
                Summed::GpuFlat { engine: Box::new(engine), pinholes }
            }
            Samples::Hierarchical { tree, bounds, accuracy } => Summed::GpuHierarchical {
                engine: Box::new(HierarchicalEngine::new(&gpu.device, &HierarchicalOptions { filter, visibility })),
                tree: Box::new(CellTreeBuffers::upload(&gpu.device, &tree)?),
                bounds: LightBoundsTexture::upload(&gpu.device, &gpu.queue, &bounds),
                accuracy,
            },
        })
    }

    /// Gathers at every receiver: R, G, B in W/m² and the number of fetches. `light` is the cube that the back end was
    /// opened with; a GPU has its own copy.
    pub(super) fn gather(
        &self,
        receivers: &Receivers,
        summed: &Summed,
        light: &CubeMap,
        params: &Params,
        progress: &dyn Progress,
    ) -> Result<Vec<[f32; 4]>, Error> {
        progress.begin("gathering", receivers.positions.len() as u64);
        match (self, summed) {
            (_, Summed::Cpu(Samples::Flat(pinholes))) => {
                Ok(cpu::gather(receivers, pinholes, light, params, &|n| progress.advance(n)))
            }
            (_, Summed::Cpu(Samples::Hierarchical { tree, bounds, accuracy })) => {
                let light = Light { cube: light, bounds };
                Ok(cpu::gather_hierarchical(receivers, tree, light, params, *accuracy, &|n| progress.advance(n)))
            }
            (Self::Gpu { gpu, environment, .. }, summed) => {
                OnGpu { gpu, environment, params, progress }.gather(receivers, summed)
            }
            (Self::Cpu, _) => unreachable!("without a GPU sums are made ready for the CPU"),
        }
    }

    pub(super) fn report(&self) -> BackendReport {
        match self {
            Self::Cpu => BackendReport::Cpu { threads: rayon::current_num_threads() },
            Self::Gpu { gpu, .. } => BackendReport::Gpu { adapter: gpu.adapter.clone() },
        }
    }

    pub(super) fn warning(&self) -> Option<&str> {
        match self {
            Self::Gpu { warning, .. } => warning.as_deref(),
            Self::Cpu => None,
        }
    }
}

fn hardware_warning(gpu: &Gpu, params: &Params) -> Result<Option<String>, GpuError> {
    if params.filter != Filter::Hardware {
        return Ok(None);
    }
    let verdict = wait(Some(&gpu.device), check_hardware_filter(gpu))?;
    Ok((!verdict.is_right()).then(|| {
        format!(
            "the hardware filter of '{}' is wrong for explicit gradients on cube maps (error {:.2} of a pattern's deviation); the picture is, too: use --filter anisotropic",
            gpu.adapter.name, verdict.rms_error
        )
    }))
}
