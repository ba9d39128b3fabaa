//! A gather on a GPU: receivers go up in strips, work is submitted in pieces of bounded length, sums come back.

use std::borrow::Cow;
use std::ops::Range;

use super::gather::Summed;
use crate::blocking::wait;
use crate::gpu::{Gpu, GpuError};
use crate::pinhole::cpu::Accuracy;
use crate::pinhole::gpu::{
    CellTreeBuffers, Engine, EnvironmentCube, FrameInputs, FrameViewers, HierarchicalEngine, HierarchicalInputs,
    LightBoundsTexture, Tolerance,
};
use crate::pinhole::{Arrangement, BATCH_SIZE, Params, Pinholes, Receivers, Viewers};
use crate::{Error, Progress};

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
const MAX_SPLIT_PASSES: u32 = 512;

/// A gather on a GPU.
pub(super) struct OnGpu<'a> {
    pub gpu: &'a Gpu,
    pub environment: &'a EnvironmentCube,
    pub params: &'a Params,
    pub progress: &'a dyn Progress,
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
    /// Gathers at every receiver.
    pub fn gather(&self, receivers: &Receivers, summed: &Summed) -> Result<Vec<[f32; 4]>, Error> {
        let most = match summed {
            Summed::GpuFlat { .. } => (pairs_per_submit(self.gpu) / u64::from(BATCH_SIZE)) as usize,
            _ => usize::MAX,
        };
        let mut sums = Vec::with_capacity(receivers.positions.len());
        for strip in strips(receivers, self.gpu.adapter.max_texture, most) {
            sums.extend(self.gather_strip(summed, &strip)?);
        }
        Ok(sums)
    }

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
        Ok(wait(Some(&self.gpu.device), self.gpu.read_texture(frame.caustic()))?)
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
            is_grid: receivers.arrangement == Arrangement::Picture,
            tree,
            environment: self.environment,
            bounds,
            params: *self.params,
            tolerance: Tolerance::Absolute(accuracy.error),
            split_near: accuracy.split_near,
            split_passes: if self.gpu.adapter.software { 8 } else { 1 },
        };
        let points = receivers.positions.len() as u64;
        while inputs.split_passes <= MAX_SPLIT_PASSES {
            let mut frame = engine.frame(&self.gpu.device, &inputs)?;
            self.submit(points, frame.batch_count(), 1, |encoder, runs| frame.record(encoder, runs))?;
            let sums = wait(Some(&self.gpu.device), self.gpu.read_texture(frame.caustic()))?;
            if sums.iter().all(|sum| sum[3] >= 0.0) {
                return Ok(sums);
            }
            inputs.split_passes *= 8;
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
            wait(Some(&self.gpu.device), self.gpu.submitted_work_done())?;
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
