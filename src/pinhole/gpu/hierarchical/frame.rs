//! One image: the order of its passes.

use std::ops::Range;

use super::layout::LEVELS;
use super::{REPORT_BYTES, STAGE_STRIDE};

/// One image being gathered.
#[derive(Debug)]
pub struct HierarchicalFrame {
    /// One, or two by turns where there are parts.
    pub(super) targets: Vec<wgpu::Texture>,
    pub(super) views: Vec<wgpu::TextureView>,
    pub(super) scene: wgpu::BindGroup,
    pub(super) receivers: wgpu::BindGroup,
    pub(super) work: wgpu::BindGroup,
    /// For each target: the group that reads the other one.
    pub(super) results: Vec<wgpu::BindGroup>,
    pub(super) scouts: Option<wgpu::BindGroup>,
    pub(super) passes: Passes,
    /// Tiles of the image, and of a run.
    pub(super) tiles: u32,
    pub(super) tiles_per_run: u32,
    pub(super) parts: u32,
    /// The nodes above all others, to be copied to where the lists are.
    pub(super) tops: wgpu::Buffer,
    pub(super) lists: wgpu::Buffer,
    pub(super) is_begun: bool,
}

/// Its pipelines.
#[derive(Clone, Debug)]
pub(super) struct Passes {
    pub blocks: wgpu::ComputePipeline,
    pub cut: wgpu::ComputePipeline,
    pub scout: wgpu::ComputePipeline,
    pub settle: wgpu::ComputePipeline,
    pub finish: wgpu::RenderPipeline,
}

impl HierarchicalFrame {
    /// Number of runs of tiles. Work, and memory, of a run are bounded.
    pub fn run_count(&self) -> u32 {
        self.tiles.div_ceil(self.tiles_per_run)
    }

    /// Records a range of runs. Record every run once, in order, in one encoder or in several.
    pub fn record(&mut self, encoder: &mut wgpu::CommandEncoder, runs: Range<u32>) {
        if !self.is_begun {
            encoder.copy_buffer_to_buffer(&self.tops, 0, &self.lists, 0, self.tops.size());
            if let Some(scouts) = &self.scouts {
                self.record_scouts(encoder, scouts);
            }
            self.is_begun = true;
        }
        for run in runs {
            let tiles = self.tiles_per_run.min(self.tiles - run * self.tiles_per_run);
            self.record_cuts(encoder, run, tiles);
            (0..self.parts).for_each(|part| self.record_finish(encoder, run, tiles, part));
        }
    }

    fn record_scouts(&self, encoder: &mut wgpu::CommandEncoder, scouts: &wgpu::BindGroup) {
        let mut pass =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("scouts"), ..Default::default() });
        for (group, bound) in (0..).zip([&self.scene, &self.receivers, scouts]) {
            pass.set_bind_group(group, bound, &[]);
        }
        pass.set_pipeline(&self.passes.scout);
        pass.dispatch_workgroups((REPORT_BYTES / 16) as u32, 1, 1);
        pass.set_pipeline(&self.passes.settle);
        pass.dispatch_workgroups(1, 1, 1);
    }

    fn record_cuts(&self, encoder: &mut wgpu::CommandEncoder, run: u32, tiles: u32) {
        let mut pass =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("cuts"), ..Default::default() });
        pass.set_bind_group(0, &self.scene, &[]);
        pass.set_bind_group(1, &self.receivers, &[]);
        let mut dispatch = |pipeline, level: u32| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(2, &self.work, &[self.stage(run, level)]);
            pass.dispatch_workgroups(tiles << (2 * level), 1, 1);
        };
        // Blocks are known by their parts, cuts by those of larger blocks.
        (0..LEVELS).rev().for_each(|level| dispatch(&self.passes.blocks, level));
        (0..LEVELS).for_each(|level| dispatch(&self.passes.cut, level));
    }

    fn record_finish(&self, encoder: &mut wgpu::CommandEncoder, run: u32, tiles: u32, part: u32) {
        let target = part as usize % self.views.len();
        let load = if run == 0 { wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT) } else { wgpu::LoadOp::Load };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("finish"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.views[target],
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.passes.finish);
        pass.set_bind_group(0, &self.scene, &[]);
        pass.set_bind_group(1, &self.receivers, &[]);
        pass.set_bind_group(2, &self.results[target], &[self.stage(run, LEVELS + part)]);
        pass.draw(0..6, 0..tiles);
    }

    /// Where a stage of a run is among all.
    fn stage(&self, run: u32, number: u32) -> u32 {
        (run * (LEVELS + self.parts) + number) * STAGE_STRIDE as u32
    }

    /// The caustic: rgb = irradiance, W/m²; a = number of fetches, or negative where the adapter ended a shader's loop before it
    /// was done (Mesa's software adapter does after 65,535 iterations): give more parts. Complete once all runs are recorded and
    /// submitted.
    pub fn caustic(&self) -> &wgpu::Texture {
        &self.targets[(self.parts as usize - 1) % self.targets.len()]
    }
}
