//! The stages that all techniques and pictures share: the prepared scene and light, and the camera's rays.
//!
//! Each stage keeps its result together with the inputs that it was made from (`memo`), and is made again only when one
//! of them changes. Data flows `scene`, `light` → `view`. This module must not know techniques.

mod direct_near_light;
mod emitter_parts;
mod light;
mod memo;
mod near_emitters;
mod refraction;
mod scene;
mod view;

pub(crate) use direct_near_light::DirectNearLight;
pub(crate) use light::{LightStages, PreparedLight};
pub use memo::{Id, Memo};
pub(crate) use near_emitters::{EmitterPart, NearEmitter, NearEmitters};
pub use refraction::{Refracted, colours, divided};
pub(crate) use scene::{LazySurface, PreparedScene, SceneStages, SurfaceMaterials};
pub use view::visible_receivers;
pub use view::{CameraRays, View, receivers_through_interfaces};

use serde::Serialize;

use crate::progress::Stage;

/// How often each stage has been made since the engine was created.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct StageCounts {
    counts: Vec<(Stage, u64)>,
}

impl StageCounts {
    /// How often this stage was made.
    pub fn of(&self, stage: Stage) -> u64 {
        self.counts.iter().filter(|(s, _)| *s == stage).map(|(_, count)| count).sum()
    }

    /// The stages made since an earlier count, in the order of the data flow.
    pub fn made_since(&self, earlier: &Self) -> Vec<Stage> {
        Stage::ENGINE.into_iter().filter(|&stage| self.of(stage) > earlier.of(stage)).collect()
    }

    pub(crate) fn add(&mut self, stage: Stage, count: u64) {
        match self.counts.iter_mut().find(|(s, _)| *s == stage) {
            Some((_, sum)) => *sum += count,
            None => self.counts.push((stage, count)),
        }
    }

    pub(crate) fn add_memo<K: PartialEq, T>(&mut self, memo: &Memo<K, T>) {
        self.add(memo.stage(), memo.times_made());
    }
}
