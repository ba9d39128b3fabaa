//! The medium as the ground truth sees it, in f64: what gets through it, and how it scatters.

use std::f64::consts::PI;

use glam::DVec3;

use super::cone::{Cone, angle};
use crate::scene::{Interfaces, Medium as Described, Scene};

/// A homogeneous medium.
#[derive(Clone, Copy, Debug)]
pub(super) struct Medium {
    /// Scattering and extinction coefficients, 1/m.
    scattering: DVec3,
    extinction: DVec3,
    pub phase: Phase,
    /// Whether it lies only behind the scene's interfaces.
    pub is_behind_interfaces: bool,
}

/// The phase function of Henyey and Greenstein (1941), 1/sr, by its mean cosine.
#[derive(Clone, Copy, Debug)]
pub(super) struct Phase(pub f64);

impl Medium {
    pub fn of_scene(scene: &Scene) -> Option<Self> {
        let Described { sigma_s, sigma_a, g } = scene.medium?;
        let (scattering, absorption) = (sigma_s.as_dvec3(), sigma_a.as_dvec3());
        let is_behind_interfaces = scene.objects.iter().any(|object| object.has_interfaces(Interfaces::One));
        Some(Self { scattering, extinction: scattering + absorption, phase: Phase(g.into()), is_behind_interfaces })
    }

    /// The part of the light that gets so far, m (Beer–Lambert).
    pub fn transmittance(&self, distance: f64) -> DVec3 {
        transmittance(self.extinction, distance)
    }

    /// Its largest channel.
    pub fn most_transmittance(&self, distance: f64) -> f64 {
        (-self.extinction.min_element() * distance).exp()
    }

    /// What is scattered per metre at a distance from the camera, and gets there: 1/m.
    pub fn scattered_to_camera(&self, distance: f64) -> DVec3 {
        self.scattering * self.transmittance(distance)
    }

    /// The largest number of mean free paths in so many metres.
    pub fn optical_thickness(&self, distance: f64) -> f64 {
        self.extinction.max_element() * distance
    }

    /// The extinction, 1/m, between lamps and what their light falls on first: nothing where that is an interface, because the medium
    /// is behind it.
    pub fn extinction_before_surfaces(&self) -> DVec3 {
        if self.is_behind_interfaces { DVec3::ZERO } else { self.extinction }
    }

    /// That between lamps and points of the medium.
    pub fn extinction(&self) -> DVec3 {
        self.extinction
    }
}

/// The part of the light that gets so far at an extinction, 1/m.
pub(super) fn transmittance(extinction: DVec3, distance: f64) -> DVec3 {
    (-distance * extinction).map(f64::exp)
}

impl Phase {
    /// The part of the light, 1/sr, that is turned by an angle of this cosine.
    pub fn value(self, cosine: f64) -> f64 {
        let Self(g) = self;
        let squared = 1.0 + g * g - 2.0 * g * cosine;
        (1.0 - g * g) / (4.0 * PI * squared * squared.sqrt())
    }

    /// The largest part, 1/sr, that reaches a direction from light that comes from any direction of a cone.
    pub fn largest(self, view: DVec3, from: &Cone) -> f64 {
        let turned = angle(-from.axis, view);
        let extreme =
            if self.0 >= 0.0 { (turned - from.half_angle).max(0.0) } else { (turned + from.half_angle).min(PI) };
        self.value(extreme.cos())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_light_goes_somewhere_and_its_mean_cosine_is_g() {
        for g in [-0.8, 0.0, 0.3, 0.9] {
            let steps = 200_000;
            let cosines = (0..steps).map(|k| -1.0 + (f64::from(k) + 0.5) * 2.0 / f64::from(steps));
            let sums = cosines.map(|c| 2.0 * PI * Phase(g).value(c) * DVec3::new(1.0, c, 0.0)).sum::<DVec3>();
            let sums = sums * 2.0 / f64::from(steps);
            assert!(sums.abs_diff_eq(DVec3::new(1.0, g, 0.0), 1e-6), "{g}: {sums}");
        }
    }

    /// The same as the scene's own description in f32, which the engine uses.
    #[test]
    fn it_is_that_of_the_scenes_description() {
        let sigmas = (glam::Vec3::new(0.1, 0.5, 2.0), glam::Vec3::new(0.3, 0.0, 0.1));
        let described = Described { sigma_s: sigmas.0, sigma_a: sigmas.1, g: -0.6 };
        let (scattering, absorption) = (sigmas.0.as_dvec3(), sigmas.1.as_dvec3());
        let phase = Phase(described.g.into());
        let own = Medium { scattering, extinction: scattering + absorption, phase, is_behind_interfaces: false };
        for k in 0..=20 {
            let part = k as f32 / 20.0;
            let transmittance = described.transmittance(3.0 * part).as_dvec3();
            assert!(own.transmittance(f64::from(3.0 * part)).abs_diff_eq(transmittance, 1e-6));
            let (phase, cosine) = (f64::from(described.phase(2.0 * part - 1.0)), f64::from(2.0 * part - 1.0));
            assert!((own.phase.value(cosine) - phase).abs() < 1e-5 * phase);
        }
    }
}
