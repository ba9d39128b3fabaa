//! Spheres around objects that send light, with bounds of their radiance. They know neither what the light is nor what is in its way.

use glam::DVec3;

use super::cone::{Cone, angle};
use super::geometry::Triangle;

/// A sphere around an object.
#[derive(Clone, Copy, Debug)]
pub(super) struct BrightSphere {
    pub centre: DVec3,
    pub radius: f64,
    /// At least the largest sum of the channels of the object's radiance.
    pub brightest: f64,
}

impl BrightSphere {
    /// `None` without triangles.
    pub fn around(triangles: &[&Triangle], brightest: f64) -> Option<Self> {
        let corners = || triangles.iter().flat_map(|triangle| triangle.corners);
        let around = |(low, high): (DVec3, DVec3), p: DVec3| (low.min(p), high.max(p));
        let (low, high) = corners().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), around);
        let centre = 0.5 * (low + high);
        let radius = corners().map(|p| p.distance(centre)).fold(0.0, f64::max);
        (low.x <= high.x).then_some(Self { centre, radius: radius * (1.0 + 1e-12), brightest })
    }

    /// Whether any point of it lies in a cone of directions from any point of another sphere.
    fn is_met(&self, (centre, radius): (DVec3, f64), cone: &Cone) -> bool {
        let to = self.centre - centre;
        let sine = (self.radius + radius) / to.length();
        sine >= 1.0 || angle(cone.axis, to.normalize()) <= cone.half_angle + sine.asin()
    }
}

/// At least the largest sum of the channels of the radiance that arrives at any point of a sphere in a cone of directions.
pub(super) fn brightest_within(spheres: &[BrightSphere], region: (DVec3, f64), cone: &Cone) -> f64 {
    spheres.iter().filter(|sphere| sphere.is_met(region, cone)).map(|sphere| sphere.brightest).fold(0.0, f64::max)
}

/// The largest of all.
pub(super) fn brightest(spheres: &[BrightSphere]) -> f64 {
    spheres.iter().map(|sphere| sphere.brightest).fold(0.0, f64::max)
}
