//! How long passes take on the device.

use std::cell::RefCell;

/// Compute passes of a preview, at most.
pub(super) const MAX_PASSES: u32 = 24;
/// The name of the passes that follow the gather, which is part of it: the gather itself is recorded elsewhere.
pub(super) const CAUSTIC: &str = "caustic";

/// How long a pass of a preview took on the GPU.
#[derive(Clone, Debug, PartialEq)]
pub struct PassTime {
    /// What it does.
    pub name: &'static str,
    /// Seconds.
    pub seconds: f64,
}

/// Timestamps at the beginning and the end of compute passes. The gather takes the time before passes called [`CAUSTIC`].
#[derive(Debug)]
pub(super) struct Timer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    /// Of the passes that were recorded.
    names: RefCell<Vec<&'static str>>,
}

impl Timer {
    /// `None` if the device has no timestamps.
    pub fn new(device: &wgpu::Device) -> Option<Self> {
        if !device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return None;
        }
        let count = 2 * MAX_PASSES;
        let (label, ty) = (Some("preview"), wgpu::QueryType::Timestamp);
        Some(Self {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor { label, ty, count }),
            resolved: device.create_buffer(&wgpu::BufferDescriptor {
                label,
                size: u64::from(count * wgpu::QUERY_SIZE),
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            names: RefCell::default(),
        })
    }

    pub fn restart(&self) {
        self.names.borrow_mut().clear();
    }

    /// Times a compute pass that is recorded next.
    pub fn pass(&self, name: &'static str) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let mut names = self.names.borrow_mut();
        let first = 2 * names.len() as u32;
        if first >= 2 * MAX_PASSES {
            return None;
        }
        names.push(name);
        Some(wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        })
    }

    /// Records the copy of the timestamps to a place in a buffer.
    pub fn finish(&self, encoder: &mut wgpu::CommandEncoder, to: &wgpu::Buffer, offset: u64) {
        let count = 2 * self.names.borrow().len() as u32;
        encoder.resolve_query_set(&self.queries, 0..count, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, to, offset, u64::from(count * wgpu::QUERY_SIZE));
    }

    /// The passes that were recorded last, from their timestamps and the nanoseconds between ticks.
    pub fn pass_times(&self, timestamps: &[u8], period_ns: f32) -> Vec<PassTime> {
        let names = self.names.borrow();
        let stamps: Vec<[u64; 2]> = bytemuck::pod_collect_to_vec(&timestamps[..16 * names.len()]);
        pass_times(&names, &stamps, f64::from(period_ns))
    }
}

/// The seconds of passes by name, in the order in which they first appear, from timestamps and nanoseconds between their ticks.
fn pass_times(names: &[&'static str], stamps: &[[u64; 2]], period_ns: f64) -> Vec<PassTime> {
    let mut times: Vec<PassTime> = Vec::new();
    let mut add = |name: &'static str, ticks: u64| {
        let seconds = 1e-9 * period_ns * ticks as f64;
        match times.iter_mut().find(|time| time.name == name) {
            Some(known) => known.seconds += seconds,
            None => times.push(PassTime { name, seconds }),
        }
    };
    for (index, (&name, [begin, end])) in names.iter().zip(stamps).enumerate() {
        let begin = if name == CAUSTIC && index > 0 { &stamps[index - 1][1] } else { begin };
        add(name, end.saturating_sub(*begin));
    }
    times
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gather_takes_the_time_between_passes() {
        let names = ["rays", "direct light", CAUSTIC, "direct light", CAUSTIC, "shading"];
        let stamps = [[0, 10], [11, 21], [121, 131], [131, 136], [140, 145], [150, 151]];
        let times = pass_times(&names, &stamps, 2.0);
        let seconds = |name| times.iter().find(|time| time.name == name).map(|time| (1e9 * time.seconds).round());
        assert_eq!(seconds("rays"), Some(20.0));
        assert_eq!(seconds("direct light"), Some(30.0));
        assert_eq!(seconds(CAUSTIC), Some(238.0));
        assert_eq!(seconds("shading"), Some(2.0));
        assert_eq!(times.len(), 4);
    }
}
