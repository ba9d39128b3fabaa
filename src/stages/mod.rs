//! The stages that every technique and every picture stand on: the scene and the light made ready, and what the camera sees.
//!
//! Each stage keeps its result together with the inputs that it was made from (`memo`), and makes it again only when one
//! of them changed. Data flows [`scene`](self::scene), `light` → `view`. This module must not know techniques.

mod light;
mod memo;
mod scene;
mod view;

pub(crate) use light::{LightStages, PreparedLight};
pub(crate) use memo::{Id, Memo};
pub(crate) use scene::{PreparedScene, SceneStages, SurfaceMaterials};
pub use view::visible_receivers;
pub(crate) use view::{CameraRays, View};

use serde::Serialize;

use crate::progress::Stage;

/// How often each stage was made since the engine was.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct StageCounts {
    counts: Vec<(Stage, u64)>,
}

impl StageCounts {
    /// How often a stage was made.
    pub fn of(&self, stage: Stage) -> u64 {
        self.counts.iter().filter(|(s, _)| *s == stage).map(|(_, count)| count).sum()
    }

    /// The stages that were made since an earlier count, in the order of the data.
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
