//! One image: the order of its passes.

use std::ops::Range;

use super::layout::{BLOCK_LEVELS, ESTIMATE_WORKGROUPS};
use super::pipelines::Passes;
use super::{DYNAMIC_OFFSET, ResolveTarget, Tiling};
use crate::pinhole::gpu::Geometry;

/// One image being gathered.
#[derive(Debug)]
pub struct HierarchicalFrame {
    /// One, or two by turns where there are split passes.
    pub(super) targets: Vec<wgpu::Texture>,
    pub(super) views: Vec<ResolveTarget>,
    pub(super) scene: wgpu::BindGroup,
    pub(super) receivers: wgpu::BindGroup,
    pub(super) rays: wgpu::BindGroup,
    pub(super) work: wgpu::BindGroup,
    /// For each target: the group that reads the other one.
    pub(super) results: Vec<wgpu::BindGroup>,
    pub(super) estimate: Option<wgpu::BindGroup>,
    pub(super) passes: Passes,
    pub(super) tiling: Tiling,
    /// The nodes without a parent, to be copied to where the lists are.
    pub(super) roots: wgpu::Buffer,
    pub(super) lists: wgpu::Buffer,
    pub(super) tolerance: wgpu::Buffer,
    /// What is bound where no rays are traced, until its structure is built.
    pub(super) empty_geometry: Option<Geometry>,
    pub(super) is_begun: bool,
}

impl HierarchicalFrame {
    /// Number of batches of tiles. Work, and memory, of a batch are bounded.
    pub fn batch_count(&self) -> u32 {
        self.tiling.count().div_ceil(self.tiling.per_batch)
    }

    /// Records a range of batches, up to [`Self::batch_count`]. Record every batch once, in order, in one encoder or in several.
    pub fn record(&mut self, encoder: &mut wgpu::CommandEncoder, batches: Range<u32>) {
        if let Some(geometry) = self.empty_geometry.take() {
            geometry.build(encoder);
        }
        if !self.is_begun {
            encoder.copy_buffer_to_buffer(&self.roots, 0, &self.lists, 0, self.roots.size());
            if let Some(estimate) = &self.estimate {
                self.record_estimate(encoder, estimate);
            }
            self.is_begun = true;
        }
        for batch in batches.start..batches.end.min(self.batch_count()) {
            let tiles = self.tiling.per_batch.min(self.tiling.count() - batch * self.tiling.per_batch);
            self.record_refinement(encoder, batch, tiles);
            (0..self.tiling.split_passes).for_each(|split| self.record_resolve(encoder, batch, tiles, split));
        }
    }

    /// Records only the estimate that a relative tolerance refers to; [`Self::allowed_error`] holds the result.
    pub fn record_estimate_only(&self, encoder: &mut wgpu::CommandEncoder) {
        if let Some(estimate) = &self.estimate {
            self.record_estimate(encoder, estimate);
        }
    }

    /// A buffer whose first word is the error allowed at a point, W/m², as a float.
    pub fn allowed_error(&self) -> &wgpu::Buffer {
        &self.tolerance
    }

    fn record_estimate(&self, encoder: &mut wgpu::CommandEncoder, estimate: &wgpu::BindGroup) {
        let label = Some("irradiance estimate");
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label, ..Default::default() });
        for (group, bound) in (0..).zip([&self.scene, &self.receivers, estimate]) {
            pass.set_bind_group(group, bound, &[]);
        }
        pass.set_pipeline(&self.passes.estimate);
        pass.dispatch_workgroups(ESTIMATE_WORKGROUPS, 1, 1);
        pass.set_pipeline(&self.passes.set_tolerance);
        pass.dispatch_workgroups(1, 1, 1);
    }

    fn record_refinement(&self, encoder: &mut wgpu::CommandEncoder, batch: u32, tiles: u32) {
        let mut pass = encoder
            .begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("refinement"), ..Default::default() });
        pass.set_bind_group(0, &self.scene, &[]);
        pass.set_bind_group(1, &self.receivers, &[]);
        pass.set_bind_group(3, &self.rays, &[]);
        let mut dispatch = |pipeline, level: u32| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(2, &self.work, &[self.uniform_offset(batch, level)]);
            pass.dispatch_workgroups(tiles << (2 * level), 1, 1);
        };
        // Blocks are made from smaller ones, lists from those of larger ones.
        (0..BLOCK_LEVELS).rev().for_each(|level| dispatch(&self.passes.receiver_blocks, level));
        (0..BLOCK_LEVELS).for_each(|level| dispatch(&self.passes.refine, level));
    }

    fn record_resolve(&self, encoder: &mut wgpu::CommandEncoder, batch: u32, tiles: u32, split: u32) {
        let target = split as usize % self.views.len();
        let load = if batch == 0 { wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT) } else { wgpu::LoadOp::Load };
        let ops = wgpu::Operations { load, store: wgpu::StoreOp::Store };
        let attachment =
            |view| Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops });
        let ResolveTarget { sum, walk } = &self.views[target];
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("resolve"),
            color_attachments: &[attachment(sum), attachment(walk)],
            ..Default::default()
        });
        pass.set_pipeline(&self.passes.resolve);
        pass.set_bind_group(0, &self.scene, &[]);
        pass.set_bind_group(1, &self.receivers, &[]);
        pass.set_bind_group(2, &self.results[target], &[self.uniform_offset(batch, BLOCK_LEVELS + split)]);
        pass.set_bind_group(3, &self.rays, &[]);
        pass.draw(0..6, 0..tiles);
    }

    /// Where the uniforms of a batch's pass are among all.
    fn uniform_offset(&self, batch: u32, pass: u32) -> u32 {
        (batch * (BLOCK_LEVELS + self.tiling.split_passes) + pass) * DYNAMIC_OFFSET as u32
    }

    /// The caustic: rgb = irradiance, W/m²; a = number of fetches, or negative where the adapter ended a shader's loop before it
    /// was done (Mesa's software adapter does after 65,535 iterations): give more split passes. Complete once all batches are
    /// recorded and submitted.
    pub fn caustic(&self) -> &wgpu::Texture {
        &self.targets[(self.tiling.split_passes as usize - 1) % self.targets.len()]
    }
}
