//! Maps of earlier frames, which temporal filtering averages with those of the next one. Knows neither scenes nor how maps are made.

use std::collections::VecDeque;
use std::sync::Arc;

use glam::{DVec2, Vec3};

use crate::image_space::{ImageSpaceOptions, Incident, Maps, Pattern};

/// Where photons of four frames pass the texels of their grid: together they are one that is twice as fine.
const QUARTERS: [[f64; 2]; ImageSpaceOptions::MAX_TEMPORAL_FRAMES as usize] =
    [[0.25, 0.25], [0.75, 0.75], [0.75, 0.25], [0.25, 0.75]];

/// Maps of the last frames, the newest first, all made with the same options.
#[derive(Clone, Debug, Default)]
pub(super) struct PastFrames {
    options: ImageSpaceOptions,
    frames: VecDeque<Arc<Maps>>,
    /// The number of the next frame.
    next: u32,
    /// How many of the newest frames have the same inputs.
    unchanged: u32,
}

impl PastFrames {
    /// Those that were made with these options; without any, if there are none.
    pub fn with(&self, options: &ImageSpaceOptions) -> Self {
        if self.options == *options { self.clone() } else { Self { options: *options, ..Self::default() } }
    }

    /// How many frames are missing: one, or all where there are none yet.
    pub fn missing(&self) -> u32 {
        if self.frames.is_empty() { self.options.temporal_frames } else { 1 }
    }

    /// How many of the newest frames have the same inputs once the missing ones are there, if theirs are the last one's or not. It changes until
    /// all frames that are averaged are alike.
    pub fn unchanged_after(&self, is_same: bool) -> u32 {
        let before = if is_same { self.unchanged } else { 0 };
        (before + self.missing()).min(self.options.temporal_frames)
    }

    /// The rays of the next frame's photons.
    pub fn pattern(&self, seed: u64) -> Pattern {
        let is_papers = self.options.paper;
        if self.options.temporal_frames == 1 {
            return Pattern { seed, offset: DVec2::splat(0.5), is_papers };
        }
        let offset = DVec2::from_array(QUARTERS[self.next as usize % QUARTERS.len()]);
        // Extended lights are sampled at other points in each frame.
        Pattern { seed: seed.wrapping_add(u64::from(self.next).wrapping_mul(0x9e37_79b9)), offset, is_papers }
    }

    /// Adds the maps of a frame; those that are no longer averaged are dropped. `is_same`: its inputs are those of the last one.
    pub fn push(&mut self, maps: Maps, is_same: bool) {
        self.unchanged = if is_same { (self.unchanged + 1).min(self.options.temporal_frames) } else { 1 };
        self.frames.push_front(Arc::new(maps));
        self.frames.truncate(self.options.temporal_frames as usize);
        self.next += 1;
    }

    /// The newest maps.
    pub fn newest(&self) -> Option<&Maps> {
        self.frames.front().map(|maps| &**maps)
    }

    /// The light on a point of an object, on the side of a normal: the mean of what the frames say that show it.
    pub fn light_at(&self, point: Vec3, normal: Vec3, object: u32) -> Incident {
        let mut found = self.frames.iter().filter_map(|maps| maps.light_at(point, normal, object));
        let Some(first) = found.next() else { return Incident::default() };
        if self.frames.len() == 1 {
            return first;
        }
        let weighted = |light: &Incident| light.irradiance.element_sum() * light.direction;
        let (mut sum, mut count) = (Incident { direction: weighted(&first), ..first }, 1.0);
        for light in found {
            sum.irradiance += light.irradiance;
            sum.direction += weighted(&light);
            sum.reflected = sum.reflected.zip(light.reflected).map(|(a, b)| a + b);
            count += 1.0;
        }
        Incident {
            irradiance: sum.irradiance / count,
            direction: sum.direction.normalize_or_zero(),
            reflected: sum.reflected.map(|reflected| reflected / count),
        }
    }
}
