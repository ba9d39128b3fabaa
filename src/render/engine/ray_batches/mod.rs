//! Rays of whole pictures, many at a time, for devices that trace them faster than the CPU. Where there is no such device, stages trace
//! their rays one by one or in packets. Knows neither pixels nor light.

#[cfg(feature = "gpu")]
pub(super) mod on_gpu;

use glam::Vec3;

use super::shadows::LightDirection;
use crate::scene::Ray;
use crate::technique::Pending;
use crate::tracing::Hit;

/// Traces rays in batches. Directions are of unit length.
pub(super) trait RayBatches: Sync {
    /// The first things that the camera sees.
    fn camera_hits<'a>(&'a self, rays: &'a [Ray]) -> Pending<'a, Vec<Option<Hit>>>;

    /// The first things along rays that leave surfaces.
    fn secondary_hits<'a>(&'a self, rays: &'a [Ray]) -> Pending<'a, Vec<Option<Hit>>>;

    /// Whether anything lies on rays that leave surfaces.
    fn blocked<'a>(&'a self, rays: &'a [Ray]) -> Pending<'a, Vec<bool>>;

    /// The part of the irradiance by some directions that arrives at points, per channel.
    fn unoccluded_fractions<'a>(
        &'a self,
        points: &'a [&'a Hit],
        directions: &'a [LightDirection],
    ) -> Pending<'a, Vec<Vec3>>;
}
