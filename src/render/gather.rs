//! The back ends: where the gather runs.

use std::borrow::Cow;
use std::fmt;
use std::ops::Range;

use serde::Serialize;

use crate::environment::{CubeMap, Environment, LightBounds};
use crate::gpu::{Adapter, Gpu, GpuError};
use crate::pinhole::cpu::{self, Accuracy, Light};
use crate::pinhole::gpu::{
    CellTreeBuffers, Engine, EnvironmentCube, FrameInputs, FrameViewers, HierarchicalEngine, HierarchicalInputs,
    HierarchicalOptions, LightBoundsTexture, Options, Tolerance, automatic_filter as automatic_filter_of,
    check_hardware_filter,
};
use crate::pinhole::{Arrangement, BATCH_SIZE, Filter, Params, PinholeTree, Pinholes, Receivers, Viewers};
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
                let engine = Engine::new(&gpu.device, &Options { filter, visibility, ..Default::default() });
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
                let most = match summed {
                    Summed::GpuFlat { .. } => (pairs_per_submit(gpu) / u64::from(BATCH_SIZE)) as usize,
                    _ => usize::MAX,
                };
                let on = OnGpu { gpu, environment, params, progress };
                let mut sums = Vec::with_capacity(receivers.positions.len());
                for strip in strips(receivers, gpu.adapter.max_texture, most) {
                    sums.extend(on.gather_strip(summed, &strip)?);
                }
                Ok(sums)
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
        // Too wide: what is left is a list.
        let folded = Receivers { width: max_texture, arrangement: Arrangement::List, ..receivers.clone() };
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

/// Parts that pixels' work is divided into at most, where an adapter ends loops early.
const MOST_PARTS: u32 = 512;

/// A gather on a GPU.
struct OnGpu<'a> {
    gpu: &'a Gpu,
    environment: &'a EnvironmentCube,
    params: &'a Params,
    progress: &'a dyn Progress,
}

/// Receivers on the GPU.
struct Uploaded<'a> {
    positions: wgpu::TextureView,
    normals: wgpu::TextureView,
    directions: Option<wgpu::TextureView>,
    receivers: &'a Receivers,
}

impl<'a> Uploaded<'a> {
    fn new(gpu: &Gpu, receivers: &'a Receivers) -> Self {
        let size = [receivers.width, receivers.height];
        Self {
            positions: gpu.upload_texture(size, &receivers.positions),
            normals: gpu.upload_texture(size, &receivers.normals),
            directions: receivers.viewers.as_ref().map(|viewers| gpu.upload_texture(size, &viewers.directions)),
            receivers,
        }
    }

    fn size(&self) -> [u32; 2] {
        [self.receivers.width, self.receivers.height]
    }

    fn viewers(&self) -> Option<FrameViewers<'_>> {
        let viewers = self.directions.as_ref().zip(self.receivers.viewers.as_ref());
        viewers.map(|(directions, viewers)| FrameViewers { directions, materials: &viewers.materials })
    }
}

impl OnGpu<'_> {
    fn gather_strip(&self, summed: &Summed, receivers: &Receivers) -> Result<Vec<[f32; 4]>, Error> {
        match summed {
            Summed::GpuFlat { engine, pinholes } => self.flat(engine, pinholes, receivers),
            Summed::GpuHierarchical { engine, tree, bounds, accuracy } => {
                let tiled = Tiled::new(receivers);
                let sums = self.hierarchical(engine, (tree, bounds), *accuracy, &tiled.receivers)?;
                Ok(tiled.in_order(sums))
            }
            Summed::Cpu(_) => unreachable!("sums on the CPU are gathered there"),
        }
    }

    fn flat(&self, engine: &Engine, pinholes: &Pinholes, receivers: &Receivers) -> Result<Vec<[f32; 4]>, Error> {
        let uploaded = Uploaded::new(self.gpu, receivers);
        let inputs = FrameInputs {
            positions: &uploaded.positions,
            normals: &uploaded.normals,
            viewers: uploaded.viewers(),
            size: uploaded.size(),
            pinholes,
            environment: self.environment,
            params: *self.params,
        };
        let mut frame = engine.frame(&self.gpu.device, &inputs)?;
        let points = receivers.positions.len() as u64;
        let pairs = pairs_per_submit(self.gpu);
        let step = (pairs / (points * u64::from(BATCH_SIZE)).max(1)).clamp(1, u64::from(u32::MAX)) as u32;
        self.submit(points, frame.batch_count(), step, |encoder, batches| frame.record(encoder, batches))?;
        Ok(self.gpu.read_texture(frame.caustic())?)
    }

    fn hierarchical(
        &self,
        engine: &HierarchicalEngine,
        (tree, bounds): (&CellTreeBuffers, &LightBoundsTexture),
        accuracy: Accuracy,
        receivers: &Receivers,
    ) -> Result<Vec<[f32; 4]>, Error> {
        let uploaded = Uploaded::new(self.gpu, receivers);
        let mut inputs = HierarchicalInputs {
            positions: &uploaded.positions,
            normals: &uploaded.normals,
            viewers: uploaded.viewers(),
            size: uploaded.size(),
            is_picture: receivers.arrangement == Arrangement::Picture,
            tree,
            environment: self.environment,
            bounds,
            params: *self.params,
            tolerance: Tolerance::Absolute(accuracy.error),
            split_near: accuracy.split_near,
            parts: if self.gpu.adapter.software { 8 } else { 1 },
        };
        let points = receivers.positions.len() as u64;
        while inputs.parts <= MOST_PARTS {
            let mut frame = engine.frame(&self.gpu.device, &inputs)?;
            self.submit(points, frame.run_count(), 1, |encoder, runs| frame.record(encoder, runs))?;
            let sums = self.gpu.read_texture(frame.caustic())?;
            if sums.iter().all(|sum| sum[3] >= 0.0) {
                return Ok(sums);
            }
            inputs.parts *= 8;
        }
        Err(GpuError::LoopCutShort { adapter: self.gpu.adapter.name.clone() }.into())
    }

    /// Submits so many pieces of work, `step` at a time.
    fn submit(
        &self,
        points: u64,
        count: u32,
        step: u32,
        mut record: impl FnMut(&mut wgpu::CommandEncoder, Range<u32>),
    ) -> Result<(), GpuError> {
        let mut reported = 0;
        for first in (0..count).step_by(step as usize) {
            let last = first.saturating_add(step).min(count);
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            record(&mut encoder, first..last);
            self.gpu.queue.submit([encoder.finish()]);
            self.gpu.wait()?;
            let done = points * u64::from(last) / u64::from(count);
            self.progress.advance(done - reported);
            reported = done;
        }
        Ok(())
    }
}

/// Receivers as the tiles of a hierarchical gather want them: a list becomes a picture whose tiles are runs of it.
struct Tiled<'a> {
    receivers: Cow<'a, Receivers>,
    /// Where each of a list's points went.
    places: Option<Vec<usize>>,
}

impl<'a> Tiled<'a> {
    fn new(receivers: &'a Receivers) -> Self {
        match receivers.arrangement {
            Arrangement::Picture => Self { receivers: Cow::Borrowed(receivers), places: None },
            Arrangement::List => {
                let (tiled, places) = receivers.in_tiles();
                Self { receivers: Cow::Owned(tiled), places: Some(places) }
            }
        }
    }

    fn in_order(&self, sums: Vec<[f32; 4]>) -> Vec<[f32; 4]> {
        match &self.places {
            None => sums,
            Some(places) => places.iter().map(|&place| sums[place]).collect(),
        }
    }
}
