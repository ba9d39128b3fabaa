//! The medium between objects: haze, smoke or murky water, the same everywhere, which absorbs and scatters light.

use std::f32::consts::PI;

use glam::Vec3;

use crate::OptionError;

/// A homogeneous medium. It fills all space or, where the scene has refractors of one interface, what lies behind these: the water of a pool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Medium {
    /// Scattering coefficient, 1/m, channel by channel.
    pub sigma_s: Vec3,
    /// Absorption coefficient, 1/m, channel by channel.
    pub sigma_a: Vec3,
    /// Mean cosine of the angle by which light is scattered: the parameter of Henyey and Greenstein's phase function
    /// (1941), from −0.99, backwards, via 0, evenly, to 0.99, forwards.
    pub g: f32,
}

impl Medium {
    /// The largest coefficient, 1/m.
    pub const MAX_SIGMA: f32 = 1e6;
    /// The largest |g|.
    pub const MAX_G: f32 = 0.99;
    /// What is wrong where there are closed refractors in it.
    pub(crate) const NOT_AROUND_SOLIDS: &str =
        "cannot fill a scene with closed refractors yet: remove it, or give these interfaces = 1";
    /// Farther than light that only this part of gets through, nothing is seen.
    const MIN_TRANSMITTANCE: f32 = 1e-4;

    /// Extinction coefficient, 1/m, channel by channel.
    pub fn extinction(&self) -> Vec3 {
        self.sigma_s + self.sigma_a
    }

    /// The part of the light that passes through so many metres (Beer–Lambert).
    pub fn transmittance(&self, distance: f32) -> Vec3 {
        (-distance * self.extinction()).map(f32::exp)
    }

    /// The phase function, 1/sr, at the cosine of the angle by which light is turned; its integral over all directions is 1.
    ///
    /// ```
    /// use pinspot::{glam::Vec3, scene::Medium};
    ///
    /// let haze = Medium { sigma_s: Vec3::splat(0.1), sigma_a: Vec3::ZERO, g: 0.5 };
    /// assert!(haze.phase(1.0) > 10.0 * haze.phase(-1.0));
    /// ```
    pub fn phase(&self, cosine: f32) -> f32 {
        let g = self.g;
        let squared = (1.0 + g * g - 2.0 * g * cosine).max(1e-9);
        (1.0 - g * g) / (4.0 * PI * squared * squared.sqrt())
    }

    /// The distance beyond which nothing is seen that the medium scatters, metres.
    pub fn sight(&self) -> f32 {
        let extinction = self.extinction();
        let scattering = (0..3).filter(|&channel| self.sigma_s[channel] > 0.0 || !self.scatters());
        let least = scattering.map(|channel| extinction[channel]).fold(f32::INFINITY, f32::min);
        -Self::MIN_TRANSMITTANCE.ln() / least.max(1e-9)
    }

    /// What is out of its range, if anything is: a coefficient, or g.
    pub fn check(&self) -> Result<(), OptionError> {
        let is_coefficient = |sigma: f32| (0.0..=Self::MAX_SIGMA).contains(&sigma);
        let sigmas = [self.sigma_s, self.sigma_a].map(|sigma| sigma.to_array());
        let is_valid = sigmas.as_flattened().iter().all(|sigma| is_coefficient(*sigma));
        if is_valid && (-Self::MAX_G..=Self::MAX_G).contains(&self.g) {
            return Ok(());
        }
        let message = "needs sigma_s and sigma_a from 0 to 1e6 per metre, and g from -0.99 to 0.99";
        Err(OptionError::invalid("medium", message))
    }

    /// Whether it scatters any light.
    pub fn scatters(&self) -> bool {
        self.sigma_s != Vec3::ZERO
    }
}
