//! A caustic map on the GPU: what its texels show, and the sums of what is added to them.

use std::sync::Arc;
use std::sync::atomic::AtomicU32;

use wgpu::BufferUsages;

use super::layout::GpuTexel;
use crate::gpu::{Gpu, GpuError};
use crate::image_space::Deposits;
use crate::image_space::caustic_map::{CausticMap, ForGloss, watts_per_step};
use crate::image_space::constants::{MAX_RECEIVER_LAYERS, MAX_VISIBLE_LAYERS, SPLAT_SIZES};
use crate::image_space::irradiance_map::IrradianceMap;
use crate::image_space::ledger::Ledger;
use crate::image_space::maps::MapInputs;
use crate::image_space::multi_resolution::Resolutions;
use crate::image_space::options::{ImageSpaceOptions, Mode, Traversal};
use crate::image_space::projection::Projection;
use crate::image_space::receiver_layers::ReceiverLayers;

/// A map that photons are added to.
#[derive(Debug)]
pub(super) struct MapOnGpu<'a> {
    pub projection: Projection,
    /// It shows what the camera sees; otherwise the receivers alone.
    pub is_camera: bool,
    /// Receivers that each texel shows at most.
    pub layers: u32,
    pub kept: ForGloss<'a>,
    pub watts_per_step: f64,
    pub texels: wgpu::Buffer,
    pub sums: wgpu::Buffer,
    pub counts: wgpu::Buffer,
}

impl<'a> MapOnGpu<'a> {
    /// An empty one of what the camera sees or, of receivers one behind the other, of so many layers.
    ///
    /// # Errors
    /// It does not fit in the device's buffers.
    pub fn new(
        gpu: &Gpu,
        inputs: &MapInputs<'a>,
        projection: Projection,
        receivers: Option<u32>,
    ) -> Result<Self, GpuError> {
        let sizes = Self::sizes(gpu, inputs, &projection, receivers)?;
        Ok(Self::with_buffers(gpu, inputs, (projection, receivers), sizes))
    }

    /// One without texels, in which layers are counted.
    ///
    /// # Errors
    /// Not even one layer would fit.
    pub fn to_count_layers(gpu: &Gpu, inputs: &MapInputs<'a>, projection: Projection) -> Result<Self, GpuError> {
        Self::sizes(gpu, inputs, &projection, Some(1))?;
        Ok(Self::with_buffers(gpu, inputs, (projection, Some(MAX_RECEIVER_LAYERS)), [64; 3]))
    }

    /// Bytes of the buffers.
    fn sizes(
        gpu: &Gpu,
        inputs: &MapInputs<'a>,
        projection: &Projection,
        receivers: Option<u32>,
    ) -> Result<[u64; 3], GpuError> {
        let texels = projection.texel_count() as u64 * u64::from(receivers.unwrap_or(MAX_VISIBLE_LAYERS));
        let splat_sizes = u64::from(splat_sizes_of(inputs.options));
        let words = words_of(inputs.for_gloss(receivers.is_none())) as u64;
        let has_counts = splat_sizes > 1 || inputs.options.mode == Mode::Gather;
        let sizes = [
            texels * size_of::<GpuTexel>() as u64,
            texels * splat_sizes * words * size_of::<u32>() as u64,
            if has_counts { texels * splat_sizes * size_of::<u32>() as u64 } else { 16 },
        ];
        let limits = gpu.device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        if let Some(bytes) = sizes.into_iter().find(|bytes| *bytes > limit) {
            return Err(GpuError::CausticMapTooLarge { size: projection.size, bytes, limit });
        }
        Ok(sizes)
    }

    fn with_buffers(
        gpu: &Gpu,
        inputs: &MapInputs<'a>,
        (projection, receivers): (Projection, Option<u32>),
        [texels, sums, counts]: [u64; 3],
    ) -> Self {
        let buffer = |label, size| {
            let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        Self {
            projection,
            is_camera: receivers.is_none(),
            layers: receivers.unwrap_or(MAX_VISIBLE_LAYERS),
            kept: inputs.for_gloss(receivers.is_none()),
            watts_per_step: watts_per_step(inputs.total_watts()),
            texels: buffer("texels of a caustic map", texels),
            sums: buffer("sums of a caustic map", sums),
            counts: buffer("counts of a caustic map", counts),
        }
    }

    /// The layers that were counted in it; at least one.
    pub async fn counted_layers(&self, gpu: &Gpu) -> Result<u32, GpuError> {
        let counts: Vec<u32> = read(gpu, &self.counts).await?;
        Ok(counts[0].max(1))
    }

    /// Reads the sums. Returns the finished map, and what is left of the account.
    pub async fn finish(self, gpu: &Gpu, options: &ImageSpaceOptions) -> Result<(IrradianceMap, Ledger), GpuError> {
        let texels: Vec<GpuTexel> = read(gpu, &self.texels).await?;
        let sums: Vec<u32> = read(gpu, &self.sums).await?;
        let words = words_of(self.kept);
        let mode = options.mode;
        let count = texels.len();
        let shown =
            Arc::new(ReceiverLayers::of_texels(self.projection, texels.into_iter().map(GpuTexel::into).collect()));
        let map = |size: usize| {
            let of_size = &sums[size * count * words..(size + 1) * count * words];
            let part = |first: usize| of_size.chunks(words).map(|texel| integers(&texel[first..first + 6])).collect();
            let for_gloss = if words > 6 { part(6) } else { Vec::new() };
            CausticMap::of_sums(shown.clone(), [part(0), for_gloss], (self.watts_per_step, self.kept))
        };
        let mut deposits = Deposits { map: map(0), mode, resolutions: None, counts: Vec::new() };
        if mode == Mode::Gather {
            let counts: Vec<u32> = read(gpu, &self.counts).await?;
            deposits.counts = counts.into_iter().map(AtomicU32::new).collect();
        }
        if splat_sizes_of(options) > 1 {
            let counts: Vec<u32> = read(gpu, &self.counts).await?;
            let maps = (0..SPLAT_SIZES as usize).map(map).collect();
            deposits.resolutions =
                Some(Resolutions::of_sums(maps, counts.chunks(count).map(<[u32]>::to_vec).collect()));
            deposits.map = deposits.map.emptied();
        }
        Ok(deposits.finish())
    }
}

/// Words of a texel's sums.
fn words_of(kept: ForGloss) -> usize {
    if matches!(kept, ForGloss::Nothing) { 6 } else { 12 }
}

/// How many sizes of splats have sums of their own; clusters are added to one each.
fn splat_sizes_of(options: &ImageSpaceOptions) -> u32 {
    if options.mode == Mode::MultiResolution && options.traversal == Traversal::Dense { SPLAT_SIZES } else { 1 }
}

/// Three signed integers of two words each.
fn integers(words: &[u32]) -> [i64; 3] {
    [0, 2, 4].map(|k| (u64::from(words[k + 1]) << 32 | u64::from(words[k])) as i64)
}

async fn read<T: bytemuck::Pod>(gpu: &Gpu, buffer: &wgpu::Buffer) -> Result<Vec<T>, GpuError> {
    Ok(bytemuck::pod_collect_to_vec(&gpu.read_buffer(buffer, buffer.size()).await?))
}
