//! Interfaces between two media at a sample: how light is reflected and refracted there, one pair of a receiver and a sample at a time.
//! `cpu::crossing` has the same for sixteen receivers, `shaders/shared/interface.wgsl` for GPUs.
//!
//! A receiver behind the interface, in the medium of the relative index η, sees the environment in the refracted direction. Let ω be the
//! unit direction from a receiver to the sample, c = ω·n, and o the cosine of the refracted direction, o² = 1 − η²(1 − c²) (Snell's law).
//! Reflection and refraction are then one formula,
//!
//! ```text
//! r = μω + gn,    g = o − μc,    with μ = η behind the interface and μ = 1, o = −c in front of it,
//! ```
//!
//! and so is its differential, from which the footprint follows: 2o do = 2μ²c dc gives do − μ dc = −(μg/o) dc, so that
//!
//! ```text
//! dr = μ dω + g dn + s (dω·n + ω·dn) n,    s = −μg/o.
//! ```
//!
//! In front s = −2, and this is the derivative of ω − 2(ω·n)n. Radiance behind the interface is η² times what is not reflected, as it comes
//! from a smaller solid angle (Veach, *Robust Monte Carlo Methods for Light Transport Simulation*, Section 5.2).

use glam::{Vec2, Vec3};

use super::constants::{
    AZIMUTH_PER_SINE, CONE_PER_AXES, HALF_ANGLE_PER_CHORD, MAX_AZIMUTH_SINE, MAX_REFRACTED_BLUR, MIN_REFRACTED_COSINE,
    WHOLE_SPHERE_RAD,
};

/// An interface between two media.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interface {
    /// The refractive index behind it over that in front of it, where its normal points to.
    pub eta: f32,
    /// Whether it reflects a part of the light by the Fresnel equations; otherwise all of it is refracted, or totally reflected.
    pub fresnel: bool,
}

/// What an interface does with the light for one receiver; the names are those of the module's formulas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Crossing {
    /// μ.
    pub ratio: f32,
    /// g.
    pub bend: f32,
    /// s.
    pub slope: f32,
    /// o, positive.
    pub refracted_cosine: f32,
}

/// What an interface does at most with the light for receivers in a range of directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CrossingBounds {
    /// By how much more than the direction from a receiver the light's may turn.
    pub per_direction: f32,
    /// By how much more than the normal.
    pub per_normal: f32,
    /// By how much more than the cosines at the interface its factor may change.
    pub per_cosine: f32,
    /// The largest factor on the radiance.
    pub factor: f32,
    /// Whether both sides may be seen, or total reflection: then directions turn without bound.
    pub is_unbounded: bool,
    /// The refracted directions of a range behind the interface lie between these angles from the normal: their sines and cosines.
    refracted: Option<[Vec2; 2]>,
}

impl Interface {
    /// For a receiver that sees the interface at a cosine ω·n: negative in front of it, positive behind.
    pub(crate) fn crossing(self, cosine: f32) -> Crossing {
        let (ratio, refracted) = if cosine > 0.0 { (self.eta, self.refracted_cosine(cosine)) } else { (1.0, -cosine) };
        let bend = refracted - ratio * cosine;
        Crossing {
            ratio,
            bend,
            slope: -ratio * bend / refracted.max(MIN_REFRACTED_COSINE),
            refracted_cosine: refracted,
        }
    }

    /// The cosine in front of the interface, by that behind it; 0 where light would be totally reflected.
    fn refracted_cosine(self, cosine: f32) -> f32 {
        (1.0 - self.eta * self.eta * (1.0 - cosine * cosine)).max(0.0).sqrt()
    }

    /// The factor on the radiance for a receiver that sees the interface at a cosine ω·n: in front of it what is reflected, behind it η²
    /// times what passes.
    pub fn factor(self, cosine: f32) -> f32 {
        if cosine > 0.0 {
            let refracted = self.refracted_cosine(cosine);
            let passing = if self.fresnel { 1.0 - self.fresnel_reflectance(refracted, cosine) } else { 1.0 };
            return if refracted > 0.0 { self.eta * self.eta * passing } else { 0.0 };
        }
        if !self.fresnel {
            return 0.0;
        }
        let behind = (1.0 - (1.0 - cosine * cosine) / (self.eta * self.eta)).max(0.0).sqrt();
        self.fresnel_reflectance(-cosine, behind)
    }

    /// For unpolarised light, by the cosines on both sides (Born & Wolf, *Principles of Optics*, Section 1.5.2).
    fn fresnel_reflectance(self, front: f32, behind: f32) -> f32 {
        let s = (front - self.eta * behind) / (front + self.eta * behind).max(f32::MIN_POSITIVE);
        let p = (self.eta * front - behind) / (self.eta * front + behind).max(f32::MIN_POSITIVE);
        if front <= 0.0 || behind <= 0.0 { 1.0 } else { 0.5 * (s * s + p * p) }
    }

    /// Bounds for receivers that see the interface at a cosine from `least` to `most`, both in [−1, 1]. Where both sides are seen, or total
    /// reflection, directions are unbounded.
    pub(super) fn bounds(self, least: f32, most: f32) -> CrossingBounds {
        let reflected = if least < 0.0 { self.factor(most.min(0.0)) } else { 0.0 };
        let refracted = if most > 0.0 { self.factor(most) } else { 0.0 };
        let factor = reflected.max(refracted);
        if most <= 0.0 {
            let mirror = CrossingBounds { per_direction: 1.0, per_normal: 2.0, per_cosine: 1.0, factor, ..UNBOUNDED };
            return CrossingBounds { is_unbounded: false, ..mirror };
        }
        if least <= 0.0 {
            return CrossingBounds { factor, ..UNBOUNDED };
        }
        let [grazing, steep] = [least, most].map(|cosine| self.refracted_cosine(cosine));
        let refracted = [steep, grazing].map(|cosine| Vec2::new((1.0 - cosine * cosine).sqrt(), cosine));
        let turns = |cosine: f32, refracted: f32| {
            let along = self.eta * cosine / refracted.max(MIN_REFRACTED_COSINE);
            (along.max(self.eta), (along - 1.0).abs().max((refracted - self.eta * cosine).abs()))
        };
        let (of_least, of_most) = (turns(least, grazing), turns(most, steep));
        let per_direction = of_least.0.max(of_most.0);
        CrossingBounds {
            per_direction,
            per_normal: of_least.1.max(of_most.1),
            per_cosine: (per_direction / self.eta).max(1.0),
            factor,
            is_unbounded: grazing <= MIN_REFRACTED_COSINE,
            refracted: Some(refracted),
        }
    }
}

const UNBOUNDED: CrossingBounds = CrossingBounds {
    per_direction: 1.0,
    per_normal: 2.0,
    per_cosine: 1.0,
    factor: 0.0,
    is_unbounded: true,
    refracted: None,
};

impl Crossing {
    /// The unit direction to the light, from the unit direction ω to the sample and its normal.
    pub fn direction(&self, towards: Vec3, normal: Vec3) -> Vec3 {
        self.ratio * towards + self.bend * normal
    }

    /// The width in the plane of incidence of a blur that is `lobe` wide where a mirror reflects: second orders are as strong as first ones.
    pub fn blur(&self, lobe: f32) -> f32 {
        (0.5 * self.slope.abs()).min(MAX_REFRACTED_BLUR) * lobe
    }

    /// How that direction changes along a side of a cell, per metre of the distance: `side` is tangent, `change` that of the normal.
    pub fn side(&self, (side, change): (Vec3, Vec3), (towards, normal): (Vec3, Vec3), distance: f32) -> Vec3 {
        let turn = (side - towards * towards.dot(side)) / distance;
        let cosine_change = turn.dot(normal) + towards.dot(change);
        self.ratio * turn + self.bend * change + self.slope * cosine_change * normal
    }
}

impl CrossingBounds {
    /// A cone around the light for a bundle of directions and normals of these radii: the axis and its radius. `crossing` is that of the
    /// axes of both.
    pub fn cone(
        &self,
        crossing: &Crossing,
        (towards, normal): (Vec3, Vec3),
        directions: f32,
        normals: f32,
    ) -> (Vec3, f32) {
        let radius = if self.is_unbounded {
            WHOLE_SPHERE_RAD
        } else {
            (self.per_direction * directions + self.per_normal * normals).min(WHOLE_SPHERE_RAD)
        };
        let around_r = (crossing.direction(towards, normal), radius);
        match self.cone_of_angles((towards, normal), directions + normals, normals) {
            Some(of_angles) if of_angles.1 < radius => of_angles,
            _ => around_r,
        }
    }

    /// The same from the range of angles from the normal, which is narrower next to total reflection.
    fn cone_of_angles(&self, (towards, normal): (Vec3, Vec3), slack: f32, normals: f32) -> Option<(Vec3, f32)> {
        let [steep, flat] = self.refracted?;
        let across = towards - towards.dot(normal) * normal;
        let sine = across.length();
        if slack > MAX_AZIMUTH_SINE * sine {
            return None;
        }
        let middle = (steep + flat).normalize();
        let axis = middle.x / sine * across + middle.y * normal;
        let half = HALF_ANGLE_PER_CHORD * 0.5 * (steep - flat).length();
        let azimuth = AZIMUTH_PER_SINE * slack / sine;
        Some((axis, CONE_PER_AXES * Vec2::new(half, azimuth).length() + normals))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use rand::{RngExt, SeedableRng};

    /// Snell's law in f64, written out.
    fn refract(towards: DVec3, normal: DVec3, eta: f64) -> DVec3 {
        let across = eta * (towards - normal * towards.dot(normal));
        across + normal * (1.0 - across.length_squared()).sqrt()
    }

    fn direction_in_f64(place: DVec3, normal: DVec3, eta: f64) -> DVec3 {
        let towards = place.normalize();
        let normal = normal.normalize();
        let cosine = towards.dot(normal);
        if cosine < 0.0 { towards - 2.0 * cosine * normal } else { refract(towards, normal, eta) }
    }

    #[test]
    fn differentials_are_finite_differences() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(3);
        let mut refracted = 0;
        for _ in 0..2000 {
            let eta: f32 = rng.random_range(0.6..2.0);
            let interface = Interface { eta, fresnel: true };
            let mut vector = || DVec3::from_array([0; 3].map(|_| rng.random_range(-1.0..1.0)));
            let (normal, place) = (vector().normalize(), 2.0 * vector());
            let side = {
                let side = vector();
                side - normal * side.dot(normal)
            };
            let change = {
                let change = vector();
                change - normal * change.dot(normal)
            };
            let (towards, distance) = (place.normalize(), place.length());
            let cosine = towards.dot(normal);
            let crossing = interface.crossing(cosine as f32);
            // Next to total reflection and to grazing incidence derivatives grow without bound.
            if crossing.refracted_cosine < 0.15 || distance < 0.3 {
                continue;
            }
            let found = crossing.direction(towards.as_vec3(), normal.as_vec3()).as_dvec3();
            assert!(found.abs_diff_eq(direction_in_f64(place, normal, eta.into()), 1e-5));
            let h = 1e-5;
            let at = |h: f64| direction_in_f64(place + h * side, normal + h * change, eta.into());
            let expected = (at(h) - at(-h)) / (2.0 * h);
            let of_normal = (side.as_vec3(), change.as_vec3());
            let found = crossing.side(of_normal, (towards.as_vec3(), normal.as_vec3()), distance as f32).as_dvec3();
            assert!(
                found.abs_diff_eq(expected, 2e-4 * (1.0 + expected.length())),
                "{eta} {cosine}: {found} {expected}"
            );
            refracted += u32::from(cosine > 0.0);
        }
        assert!(refracted > 300);
    }

    /// Receivers in front get what is reflected, behind it what passes; both together are all of the flux.
    #[test]
    fn energy_is_conserved() {
        for eta in [0.75f32, 1.333, 1.8] {
            let interface = Interface { eta, fresnel: true };
            let steps = 100_000;
            let mean = |value: &dyn Fn(f32) -> f32| {
                let cosine = |k: u32| (k as f32 + 0.5) / steps as f32;
                (0..steps).map(|k| f64::from(2.0 * cosine(k) * value(cosine(k)))).sum::<f64>() / f64::from(steps)
            };
            let (reflected, passed) = (mean(&|c| interface.factor(-c)), mean(&|c| interface.factor(c)));
            assert!((reflected + passed - 1.0).abs() < 1e-3, "{eta}: {reflected} + {passed}");
        }
        let nothing = Interface { eta: 1.0, fresnel: false };
        assert_eq!((nothing.factor(0.3), nothing.factor(-0.3)), (1.0, 0.0));
        assert!(nothing.crossing(0.3).bend.abs() < 1e-6);
        assert_eq!(Interface { eta: 1.5, fresnel: false }.factor(0.5), 0.0, "totally reflected");
    }

    #[test]
    fn bounds_hold() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(5);
        let mut bounded = 0;
        for _ in 0..40_000 {
            let interface = Interface { eta: rng.random_range(0.6..1.8), fresnel: rng.random() };
            let incidence = rng.random_range(0.0f32..3.1);
            let [directions, normals] = [0; 2].map(|_| rng.random_range(0.0f32..0.2));
            let slack = directions + normals;
            let [flat, steep] =
                [(incidence + slack).min(std::f32::consts::PI), (incidence - slack).max(0.0)].map(f32::cos);
            let bounds = interface.bounds(flat, steep);
            let axis = Vec3::new(incidence.sin(), incidence.cos(), 0.0);
            let mut within = |axis: Vec3, radius: f32| {
                let (u, v) = axis.any_orthonormal_pair();
                let (off, around): (f32, f32) = (radius * rng.random::<f32>().sqrt(), rng.random_range(0.0..6.3));
                axis * off.cos() + off.sin() * (around.cos() * u + around.sin() * v)
            };
            let (towards, normal) = (within(axis, directions), within(Vec3::Y, normals));
            let cosine = towards.dot(normal);
            assert!(interface.factor(cosine) <= bounds.factor * 1.0001 + 1e-6);
            if interface.factor(cosine) > 0.0 {
                let light = interface.crossing(cosine).direction(towards, normal);
                let (axis, radius) = bounds.cone(&interface.crossing(axis.y), (axis, Vec3::Y), directions, normals);
                let off = axis.angle_between(light);
                assert!(
                    off <= radius * 1.001 + 2e-3,
                    "{off} > {radius}: {interface:?} {incidence} {directions} {normals}"
                );
                bounded += u32::from(radius < 1.0);
            }
        }
        assert!(bounded > 10_000, "{bounded}");
    }
}
