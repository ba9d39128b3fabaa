//! What the camera sees, as it sees emitters, too. Knows hits, but no rays of light.

use std::sync::Arc;

use super::{Hit, Tracer};
use crate::lanes::LANES;
use crate::scene::Ray;

/// What the camera sees: the scene, and emitters, through which light passes.
#[derive(Debug)]
pub(crate) struct CameraTracer {
    scene: Arc<Tracer>,
    emitters: Option<Arc<Tracer>>,
}

impl CameraTracer {
    /// The objects that light meets, too, and emitters.
    pub fn new(scene: Arc<Tracer>, emitters: Option<Arc<Tracer>>) -> Self {
        Self { scene, emitters }
    }

    /// The first thing that the camera sees along a ray.
    pub fn hit(&self, ray: Ray) -> Option<Hit> {
        nearer(self.scene.camera_hit(ray), self.emitters.as_ref().and_then(|emitters| emitters.camera_hit(ray)))
    }

    /// The first things along sixteen rays, in the lanes asked for.
    pub fn hits(&self, rays: &[Ray; LANES], lanes: u32) -> [Option<Hit>; LANES] {
        let hits = self.scene.camera_hits(rays, lanes);
        let Some(emitters) = &self.emitters else { return hits };
        let shining = emitters.camera_hits(rays, lanes);
        std::array::from_fn(|lane| nearer(hits[lane], shining[lane]))
    }
}

/// The nearer of two hits of one ray.
fn nearer(one: Option<Hit>, other: Option<Hit>) -> Option<Hit> {
    match (one, other) {
        (Some(one), Some(other)) => Some(if other.distance < one.distance { other } else { one }),
        (one, other) => one.or(other),
    }
}
