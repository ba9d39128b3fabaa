//! What the camera sees, as it sees emitters, too, directly and in mirrors. Knows hits, but no rays of light.

use std::sync::Arc;

use super::{Hit, Tracer};
use crate::lanes::LANES;
use crate::scene::Ray;

/// What the camera sees: the scene, and emitters, through which light passes.
#[derive(Debug)]
pub struct CameraTracer {
    scene: Arc<Tracer>,
    emitters: Option<Arc<Tracer>>,
    near_emitters: Option<Arc<Tracer>>,
}

impl CameraTracer {
    /// The objects that light meets, too, all emitters, and those of them that mirrors show where they are.
    pub fn new(scene: Arc<Tracer>, emitters: Option<Arc<Tracer>>, near_emitters: Option<Arc<Tracer>>) -> Self {
        Self { scene, emitters, near_emitters }
    }

    /// The first thing that the camera sees along a ray.
    pub fn hit(&self, ray: Ray) -> Option<Hit> {
        nearer(self.scene.camera_hit(ray), self.emitters.as_ref().and_then(|emitters| emitters.camera_hit(ray)))
    }

    /// The first thing that it sees in a mirror or through an interface along a ray.
    pub fn secondary_hit(&self, ray: Ray) -> Option<Hit> {
        self.or_emitter(ray, self.scene.secondary_hit(ray))
    }

    /// What is seen where a ray meets this of what light meets, if anything, or a near emitter before it.
    pub fn or_emitter(&self, ray: Ray, hit: Option<Hit>) -> Option<Hit> {
        nearer(hit, self.near_emitters.as_ref().and_then(|emitters| emitters.secondary_hit(ray)))
    }

    /// The same along sixteen rays, in the lanes asked for.
    pub fn secondary_hits(&self, rays: &[Ray; LANES], lanes: u32) -> [Option<Hit>; LANES] {
        let hits = self.scene.secondary_hits(rays, lanes);
        let Some(emitters) = &self.near_emitters else { return hits };
        let shining = emitters.secondary_hits(rays, lanes);
        std::array::from_fn(|lane| nearer(hits[lane], shining[lane]))
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
