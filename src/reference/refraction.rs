//! Smooth interfaces between two media, as the ground truth sees them: Snell's law, the Fresnel equations and the n² of radiance, in
//! f64, with bounds over cones. It knows neither geometry nor light.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::DVec3;

use super::cone::{Cone, angle};
use crate::scene::{Interfaces, Refractor};

/// An interface. Receivers behind it are within the medium of the index `eta`, relative to the one in front.
#[derive(Clone, Copy, Debug)]
pub(super) struct Interface {
    eta: DVec3,
    fresnel: bool,
    /// Whether it is that of a closed object, which light leaves again.
    pub(super) is_closed: bool,
}

/// Bounds of what a region of an interface refracts to a receiver, for one index: a cone that holds the directions to the light, and at
/// least the largest factor on the radiance.
pub(super) struct Refracted {
    pub cone: Cone,
    /// How much more than linearly directions may spread within the cone, radians.
    pub bend: f64,
    /// By how much the refracted direction turns with the other one, at most.
    pub stretch: f64,
    pub factor: f64,
}

impl Interface {
    pub fn new(refractor: &Refractor) -> Self {
        let is_closed = refractor.interfaces == Interfaces::Two;
        Self { eta: refractor.eta, fresnel: refractor.fresnel, is_closed }
    }

    /// Whether it reflects at all.
    pub fn reflects(&self) -> bool {
        self.fresnel
    }

    /// The indices that differ: one, or one for each channel.
    pub fn indices(&self) -> &[f64] {
        if self.eta.min_element() < self.eta.max_element() { self.eta.as_ref() } else { &self.eta.as_ref()[..1] }
    }

    /// The index for a channel.
    pub fn index(&self, channel: usize) -> f64 {
        self.eta[channel]
    }

    /// The reflectance for light from the front, by the cosine of the angle of incidence.
    pub fn reflectance(&self, cosine: f64) -> DVec3 {
        self.eta.map(|eta| fresnel(cosine, transmitted_cosine(cosine, 1.0 / eta), eta))
    }

    /// The part of the light from the front, at an angle of this cosine, that is not reflected. Zero beyond the critical angle.
    pub fn passed_from_front(&self, cosine: f64, eta: f64) -> f64 {
        let behind = transmitted_cosine(cosine, 1.0 / eta);
        match behind > 0.0 {
            true if self.fresnel => 1.0 - fresnel(cosine, behind, eta),
            passes => f64::from(u8::from(passes)),
        }
    }

    /// The factor on the radiance that arrives behind the interface at an angle of this cosine: what is not reflected, over a smaller
    /// solid angle. Zero where light from behind would be totally reflected.
    pub fn factor(&self, cosine: f64, eta: f64) -> f64 {
        let outside = transmitted_cosine(cosine, eta);
        let passes = match outside > 0.0 {
            true if self.fresnel => 1.0 - fresnel(outside, cosine, eta),
            passes => f64::from(u8::from(passes)),
        };
        eta * eta * passes
    }

    /// Bounds of what a region refracts to a receiver behind it: `towards` holds the directions from the receiver to the region, `normals`
    /// the region's normals.
    pub fn refracted(&self, towards: &Cone, normals: &Cone, eta: f64) -> Refracted {
        let between = angle(towards.axis, normals.axis);
        let slack = towards.half_angle + normals.half_angle;
        let (steepest, flattest) = ((between - slack).max(0.0), between + slack);
        let factor = self.factor(steepest.cos().max(0.0), eta);
        let grazing = transmitted_cosine(flattest.min(FRAC_PI_2).cos(), eta);
        let of_angles = between_angles(
            towards,
            normals,
            [steepest, flattest].map(|angle| transmitted_cosine(angle.min(FRAC_PI_2).cos(), eta).acos()),
        );
        if flattest >= FRAC_PI_2 || grazing <= 0.0 {
            return Refracted { cone: of_angles, bend: f64::INFINITY, stretch: f64::INFINITY, factor };
        }
        // By how much the refracted direction turns with the direction, in the plane of incidence and across it, and with the normal.
        let turns = |incidence: f64| {
            let (inside, outside) = (incidence.cos(), transmitted_cosine(incidence.cos(), eta));
            let along = eta * inside / outside;
            (along.max(eta), (along - 1.0).abs().max((outside - eta * inside).abs()))
        };
        let (steep, flat) = (turns(steepest), turns(flattest));
        let (of_direction, of_normal) = (steep.0.max(flat.0), steep.1.max(flat.1));
        let turn = of_direction * towards.half_angle + of_normal * normals.half_angle;
        let tangent = (1.0 - grazing * grazing).sqrt() / grazing;
        let bend = 1.5 * (1.0 + of_direction * of_direction * (1.0 + tangent)) * slack * slack;
        if turn > of_angles.half_angle {
            return Refracted { cone: of_angles, bend, stretch: of_direction, factor };
        }
        let cone = Cone { axis: refract(towards.axis, normals.axis, eta), half_angle: turn };
        Refracted { cone, bend, stretch: of_direction, factor }
    }
}

/// A cone that holds the directions between two angles from any of the normals, in the planes of incidence: narrow next to total reflection,
/// where directions turn without bound.
fn between_angles(towards: &Cone, normals: &Cone, [steep, flat]: [f64; 2]) -> Cone {
    let across = towards.axis - towards.axis.dot(normals.axis) * normals.axis;
    let (sine, slack) = (across.length(), towards.half_angle + normals.half_angle);
    if slack >= FRAC_PI_2 || slack.sin() >= 0.9 * sine {
        return Cone::everything();
    }
    let (middle, half) = (0.5 * (steep + flat), 0.5 * (flat - steep));
    let azimuth = (slack.sin() / sine).asin();
    let axis = middle.sin() / sine * across + middle.cos() * normals.axis;
    // On the sphere the diagonal of a box of angles is at most so much longer than in the plane.
    Cone { axis: axis.normalize(), half_angle: (1.2 * half.hypot(azimuth) + normals.half_angle).min(PI) }
}

/// The cosine on the other side of an interface, whose index over that on this side is 1/`ratio`; 0 beyond the critical angle.
fn transmitted_cosine(cosine: f64, ratio: f64) -> f64 {
    (1.0 - ratio * ratio * (1.0 - cosine * cosine)).max(0.0).sqrt()
}

/// The reflectance of an interface for unpolarised light (Born & Wolf, *Principles of Optics*, Section 1.5.2): the cosines in front of
/// and behind it, and the index behind it over that in front. It is the same from both sides.
fn fresnel(front: f64, behind: f64, eta: f64) -> f64 {
    let s = (front - eta * behind) / (front + eta * behind);
    let p = (eta * front - behind) / (eta * front + behind);
    if front <= 0.0 || behind <= 0.0 { 1.0 } else { 0.5 * (s * s + p * p) }
}

/// The direction of a ray that leaves a medium along the normal's side (Snell's law as vectors): the index within over that without is
/// `eta`. Beyond the critical angle it is along the interface.
pub(super) fn refract(direction: DVec3, normal: DVec3, eta: f64) -> DVec3 {
    let inside = direction.dot(normal);
    let outside = transmitted_cosine(inside, eta);
    (eta * direction + (outside - eta * inside) * normal).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    fn interface(eta: f64, fresnel: bool) -> Interface {
        Interface { eta: DVec3::splat(eta), fresnel, is_closed: false }
    }

    #[test]
    fn snells_law_and_perpendicular_incidence() {
        for (eta, degrees) in [(1.333, 20.0f64), (1.5, 40.0), (0.75, 60.0), (1.0, 70.0)] {
            let inside = degrees.to_radians();
            let direction = DVec3::new(inside.sin(), inside.cos(), 0.0);
            let refracted = refract(direction, DVec3::Y, eta);
            assert!((refracted.x - eta * inside.sin()).abs() < 1e-12 && refracted.y > 0.0);
        }
        let lost = (0.333f64 / 2.333).powi(2);
        assert!((interface(1.333, true).factor(1.0, 1.333) - 1.333 * 1.333 * (1.0 - lost)).abs() < 1e-12);
        assert!((interface(1.333, true).reflectance(1.0).x - lost).abs() < 1e-12);
    }

    /// The flux from all directions of a uniform environment is what is not reflected, on either side.
    #[test]
    fn energy_is_conserved() {
        for eta in [0.8, 1.333, 2.0] {
            let interface = interface(eta, true);
            let over_angles = |value: &dyn Fn(f64) -> f64| -> f64 {
                let steps = 400_000;
                (0..steps).map(|k| value((f64::from(k) + 0.5) / f64::from(steps))).sum::<f64>() / f64::from(steps)
            };
            let arriving = over_angles(&|cosine| 2.0 * cosine * (1.0 - interface.reflectance(cosine).x));
            let passed = over_angles(&|cosine| 2.0 * cosine * interface.factor(cosine, eta));
            assert!((arriving - passed).abs() < 1e-4, "{eta}: {arriving}, {passed}");
        }
    }

    #[test]
    fn bounds_hold_within_cones() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(7);
        let mut bounded = 0;
        for _ in 0..40_000 {
            let eta = rng.random_range(0.6..1.8);
            let interface = interface(eta, rng.random());
            let mut cone = |axis: DVec3, most: f64| Cone { axis, half_angle: rng.random_range(0.0..most) };
            let (normals, towards) = (cone(DVec3::Y, 0.3), cone(DVec3::ZERO, 0.3));
            let incidence = rng.random_range(0.0f64..1.4);
            let towards = Cone { axis: DVec3::new(incidence.sin(), incidence.cos(), 0.0), ..towards };
            let mut within = |cone: &Cone| {
                let (u, v) = cone.axis.any_orthonormal_pair();
                let (off, around): (f64, f64) = (cone.half_angle * rng.random::<f64>(), rng.random_range(0.0..6.3));
                cone.axis * off.cos() + off.sin() * (around.cos() * u + around.sin() * v)
            };
            let (direction, normal) = (within(&towards), within(&normals));
            let cosine = direction.dot(normal);
            if cosine <= 0.0 {
                continue;
            }
            let Refracted { cone, factor, .. } = interface.refracted(&towards, &normals, eta);
            assert!(interface.factor(cosine, eta) <= factor + 1e-12);
            if interface.factor(cosine, eta) > 0.0 {
                let off = angle(cone.axis, refract(direction, normal, eta));
                assert!(off <= cone.half_angle + 1e-9, "{off} > {}", cone.half_angle);
                bounded += u32::from(cone.half_angle < PI);
            }
        }
        assert!(bounded > 10_000);
    }
}
