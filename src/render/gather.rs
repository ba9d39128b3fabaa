//! The back ends: where the gather runs.

use std::fmt;

use serde::Serialize;

use crate::environment::{CubeMap, Environment, LightBounds};
use crate::gpu::{Adapter, Gpu, GpuError};
use crate::pinhole::cpu::{self, Accuracy, Light};
use crate::pinhole::gpu::{
    Engine, EnvironmentCube, FrameInputs, FrameViewers, Options, automatic_filter as automatic_filter_of,
    check_hardware_filter,
};
use crate::pinhole::{BATCH_SIZE, Filter, Params, PinholeTree, Pinholes, Receivers, Viewers};
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
        let hardware = || Gpu::open(None).is_ok_and(|gpu| !gpu.adapter.software);
        match self {
            Self::Auto if filter != Filter::Hardware && !hardware() => Self::Cpu,
            other => other.clone(),
        }
    }
}

/// What is summed.
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

/// An open back end.
#[derive(Debug)]
pub enum Backend {
    /// SIMD and all cores.
    Cpu,
    /// A GPU through wgpu.
    Gpu {
        /// The device.
        gpu: Box<Gpu>,
        /// The pipelines.
        engine: Box<Engine>,
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
            BackendChoice::Gpu(name) => Some(Gpu::open(name.as_deref())?),
            BackendChoice::Auto if params.filter == Filter::Hardware => Gpu::open(None).ok(),
            BackendChoice::Auto => Gpu::open(None).ok().filter(|gpu| !gpu.adapter.software),
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
        let filter = if replaceable { automatic_filter_of(&gpu)? } else { params.filter };
        let engine = Engine::new(
            &gpu.device,
            &Options { filter, visibility: options.visibility == Visibility::Full, ..Default::default() },
        );
        let environment = EnvironmentCube::upload(&gpu.device, &gpu.queue, &environment.cube)?;
        let warning = hardware_warning(&gpu, params)?;
        gpu.check()?;
        Ok((Self::Gpu { gpu: Box::new(gpu), engine: Box::new(engine), environment, warning }, filter))
    }

    /// Gathers at every receiver: R, G, B in W/m² and the number of fetches. `light` is the cube that the back end was
    /// opened with; a GPU has its own copy.
    pub(super) fn gather(
        &self,
        receivers: &Receivers,
        samples: &Samples,
        light: &CubeMap,
        params: &Params,
        progress: &dyn Progress,
    ) -> Result<Vec<[f32; 4]>, Error> {
        progress.begin("gathering", receivers.positions.len() as u64);
        match (self, samples) {
            (_, Samples::Hierarchical { tree, bounds, accuracy }) => {
                let light = Light { cube: light, bounds };
                Ok(cpu::gather_hierarchical(receivers, tree, light, params, *accuracy, &|n| progress.advance(n)))
            }
            (Self::Cpu, Samples::Flat(pinholes)) => {
                Ok(cpu::gather(receivers, pinholes, light, params, &|n| progress.advance(n)))
            }
            (Self::Gpu { gpu, engine, environment, .. }, Samples::Flat(pinholes)) => {
                let mut sums = Vec::with_capacity(receivers.positions.len());
                let most = (pairs_per_submit(gpu) / u64::from(BATCH_SIZE)) as usize;
                for strip in strips(receivers, gpu.adapter.max_texture, most) {
                    sums.extend(gather_strip(gpu, engine, environment, &strip, pinholes, params, progress)?);
                }
                Ok(sums)
            }
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
    let verdict = check_hardware_filter(gpu)?;
    Ok((!verdict.is_right()).then(|| {
        format!(
            "the hardware filter of '{}' is wrong for explicit gradients on cube maps (error {:.2} of a pattern's deviation); the picture is, too: use --filter anisotropic",
            gpu.adapter.name, verdict.rms_error
        )
    }))
}

/// The receivers in whole rows: pieces that fit into the adapter's textures and, but for a single row, have at most
/// `most` points, so that one batch of samples is a submission of bounded length.
fn strips(receivers: &Receivers, max_texture: u32, most: usize) -> Vec<Receivers> {
    let width = receivers.width;
    if width > max_texture {
        // Too wide: any arrangement will do, as a gather looks at one point at a time.
        let folded = Receivers { width: max_texture, ..receivers.clone() };
        return strips(&pad_rows(folded), max_texture, most);
    }
    let rows = (most / width as usize).clamp(1, max_texture as usize);
    let per_strip = width as usize * rows;
    let count = receivers.positions.len();
    let strip = |start: usize| {
        let part = start..(start + per_strip).min(count);
        let viewers = receivers.viewers.as_ref().map(|viewers| Viewers {
            directions: viewers.directions[part.clone()].to_vec(),
            materials: viewers.materials.clone(),
        });
        Receivers {
            width,
            arrangement: receivers.arrangement,
            height: (part.len() as u32).div_ceil(width),
            positions: receivers.positions[part.clone()].to_vec(),
            normals: receivers.normals[part].to_vec(),
            viewers,
        }
    };
    (0..count).step_by(per_strip).map(strip).collect()
}

fn pad_rows(mut receivers: Receivers) -> Receivers {
    let rows = (receivers.positions.len() as u32).div_ceil(receivers.width);
    let count = (rows * receivers.width) as usize;
    receivers.height = rows;
    receivers.positions.resize(count, [0.0, 0.0, 0.0, crate::pinhole::NO_RECEIVER]);
    receivers.normals.resize(count, [0.0; 4]);
    if let Some(viewers) = &mut receivers.viewers {
        viewers.directions.resize(count, [0.0; 4]);
    }
    receivers
}

/// Sample–receiver pairs per submission: well under a second on a slow GPU, so that no watchdog fires.
const PAIRS_PER_SUBMIT: u64 = 1 << 28;
/// The same for software adapters, where it only paces the progress bar.
const PAIRS_PER_SUBMIT_IN_SOFTWARE: u64 = 1 << 24;

fn pairs_per_submit(gpu: &Gpu) -> u64 {
    if gpu.adapter.software { PAIRS_PER_SUBMIT_IN_SOFTWARE } else { PAIRS_PER_SUBMIT }
}

fn gather_strip(
    gpu: &Gpu,
    engine: &Engine,
    environment: &EnvironmentCube,
    receivers: &Receivers,
    pinholes: &Pinholes,
    params: &Params,
    progress: &dyn Progress,
) -> Result<Vec<[f32; 4]>, Error> {
    let size = [receivers.width, receivers.height];
    let positions = gpu.upload_texture(size, &receivers.positions);
    let normals = gpu.upload_texture(size, &receivers.normals);
    let views = receivers.viewers.as_ref().map(|viewers| gpu.upload_texture(size, &viewers.directions));
    let viewers = views.as_ref().zip(receivers.viewers.as_ref());
    let inputs = FrameInputs {
        positions: &positions,
        normals: &normals,
        viewers: viewers.map(|(directions, viewers)| FrameViewers { directions, materials: &viewers.materials }),
        size,
        pinholes,
        environment,
        params: *params,
    };
    let mut frame = engine.frame(&gpu.device, &inputs)?;

    let points = receivers.positions.len() as u64;
    let step = (pairs_per_submit(gpu) / (points * u64::from(BATCH_SIZE)).max(1)).clamp(1, u64::from(u32::MAX)) as u32;
    let batches = frame.batch_count();
    let mut reported = 0;
    for first in (0..batches).step_by(step as usize) {
        let last = first.saturating_add(step).min(batches);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        frame.record(&mut encoder, first..last);
        gpu.queue.submit([encoder.finish()]);
        gpu.wait()?;
        let done = points * u64::from(last) / u64::from(batches);
        progress.advance(done - reported);
        reported = done;
    }
    Ok(gpu.read_texture(frame.caustic())?)
}
