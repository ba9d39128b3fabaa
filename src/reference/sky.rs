//! Light of the environment and of emitters without a mirror: the integral of radiance × cosine, or of radiance × phase function, over the directions around a
//! receiver.
//!
//! Regions are boxes of azimuth and height about +Y, on which equal areas are equal solid angles (Archimedes).

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::DVec3;

use super::cone::Cone;
use super::domain::{Domain, Fineness, Lighting, ON_SURFACES, Receiver};
use super::emitters::Emitters;
use super::geometry::Geometry;
use super::light::Light;
use crate::scene::Visibility;

/// All directions.
pub(super) struct Sky<'a> {
    pub geometry: &'a Geometry,
    pub light: &'a Light,
    pub emitters: &'a Emitters,
    pub visibility: Visibility,
}

/// A box of directions.
#[derive(Clone, Copy)]
pub(super) struct Region {
    /// Radians about +Y.
    azimuth: [f64; 2],
    /// Cosine of the angle from +Y.
    height: [f64; 2],
    depth: u8,
    path: u64,
}

const MAX_DEPTH: u8 = 24;

fn direction(azimuth: f64, height: f64) -> DVec3 {
    let across = (1.0 - height * height).max(0.0).sqrt();
    DVec3::new(across * azimuth.cos(), height, across * azimuth.sin())
}

impl Region {
    fn cone(&self) -> Cone {
        let [low, high] = self.height.map(|h| h.clamp(-1.0, 1.0).acos());
        let axis = direction(0.5 * (self.azimuth[0] + self.azimuth[1]), (0.5 * (low + high)).cos());
        // First along the meridian, then along a circle that is at most as wide as the widest of the box.
        let widest = if low >= FRAC_PI_2 && high <= FRAC_PI_2 { 1.0 } else { low.sin().max(high.sin()) };
        let half_angle = 0.5 * (low - high) + 0.5 * (self.azimuth[1] - self.azimuth[0]) * widest;
        Cone { axis, half_angle: half_angle.min(PI) }
    }
}

impl Domain for Sky<'_> {
    type Region = Region;
    type Receiver = Receiver;

    fn fineness(&self) -> Fineness {
        ON_SURFACES
    }

    fn roots(&self, visit: &mut dyn FnMut(Region)) {
        visit(Region { azimuth: [0.0, TAU], height: [-1.0, 1.0], depth: 0, path: 0 });
    }

    fn measure(&self, region: &Region) -> f64 {
        (region.azimuth[1] - region.azimuth[0]) * (region.height[1] - region.height[0])
    }

    fn bound(&self, region: &Region, receiver: &Receiver) -> f64 {
        let cone = region.cone();
        let received = receiver.most_received(&cone);
        if received == 0.0 {
            return 0.0;
        }
        let emitted = self.emitters.bound((receiver.position, receiver.half_length()), &cone);
        received * self.light.bound(&cone).max(emitted)
    }

    fn split(&self, region: &Region, _: &Receiver, visit: &mut dyn FnMut(Region)) {
        if region.depth == MAX_DEPTH {
            return;
        }
        let halves = |[a, b]: [f64; 2]| [[a, 0.5 * (a + b)], [0.5 * (a + b), b]];
        // Gray's order: each part touches the next.
        for (k, (i, j)) in [(0, 0), (1, 0), (1, 1), (0, 1)].into_iter().enumerate() {
            visit(Region {
                azimuth: halves(region.azimuth)[i],
                height: halves(region.height)[j],
                depth: region.depth + 1,
                path: region.path << 2 | k as u64,
            });
        }
    }

    fn order(&self, region: &Region) -> u64 {
        region.path << (2 * (MAX_DEPTH - region.depth))
    }

    fn needs_all_numbers(&self) -> bool {
        false
    }

    fn integrand(&self, region: &Region, [_, u, v, ..]: [f64; 8], receiver: &Receiver) -> DVec3 {
        let between = |[a, b]: [f64; 2], t: f64| a + (b - a) * t;
        let towards = direction(between(region.azimuth, u), between(region.height, v));
        let received = receiver.received(towards);
        if received <= 0.0 {
            return DVec3::ZERO;
        }
        let casts_shadows = self.visibility == Visibility::Full;
        if let Some(met) = self.emitters.met(receiver.position, towards) {
            let between = [receiver.triangle(); 2];
            let is_hidden = casts_shadows && self.geometry.blocks_segment(receiver.position, met.position, between);
            return if is_hidden { DVec3::ZERO } else { received * met.radiance };
        }
        if casts_shadows && self.geometry.blocks_ray(receiver.position, towards, receiver.triangle()) {
            return DVec3::ZERO;
        }
        received * self.light.radiance(towards)
    }
}

impl Lighting for Sky<'_> {
    /// It is infinitely far away.
    fn angles(&self, region: &Region, _: &Receiver) -> [f64; 2] {
        [region.cone().half_angle, 0.0]
    }
}
