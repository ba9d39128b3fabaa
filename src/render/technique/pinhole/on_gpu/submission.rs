//! Work in pieces of bounded duration, so that no watchdog fires and progress can be shown.

use std::ops::Range;

use crate::gpu::{Gpu, GpuError};
use crate::progress::Progress;

/// Sample–receiver pairs per submission: well under a second on a slow GPU, so that no watchdog fires.
const PAIRS_PER_SUBMIT: u64 = 1 << 28;
/// The same for software adapters, where it only sets the pace of the progress bar.
const PAIRS_PER_SUBMIT_IN_SOFTWARE: u64 = 1 << 24;

pub(super) fn pairs_per_submit(gpu: &Gpu) -> u64 {
    if gpu.adapter.software { PAIRS_PER_SUBMIT_IN_SOFTWARE } else { PAIRS_PER_SUBMIT }
}

/// Work that is submitted in pieces, `step` at a time.
pub(super) struct Submission<'a> {
    pub gpu: &'a Gpu,
    /// Receiver points, which the progress counts.
    pub points: u64,
    pub pieces: u32,
    pub step: u32,
    pub progress: &'a dyn Progress,
}

impl Submission<'_> {
    /// Submits all pieces, or those before it is cancelled.
    pub async fn run(&self, mut record: impl FnMut(&mut wgpu::CommandEncoder, Range<u32>)) -> Result<(), GpuError> {
        let mut reported = 0;
        for first in (0..self.pieces).step_by(self.step as usize) {
            let last = first.saturating_add(self.step).min(self.pieces);
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            record(&mut encoder, first..last);
            self.gpu.queue.submit([encoder.finish()]);
            self.gpu.submitted_work_done().await?;
            let done = self.points * u64::from(last) / u64::from(self.pieces);
            self.progress.advance(done - reported);
            reported = done;
            if self.progress.is_cancelled() {
                break;
            }
        }
        Ok(())
    }
}
