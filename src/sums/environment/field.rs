//! Radiance by direction, in the light's own frame and at its own resolution.

use std::borrow::Cow;
use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::layout::Layout;
use super::{EnvironmentError, LitBy, built_in_map};
use crate::image::Image;
use crate::parallel;
use crate::scene::{Light, MAX_RADIANCE};

/// The radiance of a light around the scene, before it is rotated and scaled.
#[derive(Clone, Debug)]
pub struct EnvironmentRadiance {
    kind: Kind,
    /// The largest radiance of a channel, W/(m²·sr).
    brightest: f32,
}

#[derive(Clone, Debug)]
enum Kind {
    Map(Layout),
    Spot {
        direction: Vec3,
        sigma_rad: f32,
        radiance: Vec3,
    },
    Constant(Vec3),
    /// Light geometry, and what lies behind it.
    Geometry {
        front: LitBy,
        background: Box<EnvironmentRadiance>,
    },
}

/// A Gaussian is less than the least 32-bit number beyond so many σ.
const NO_LIGHT_BEYOND: f32 = 14.5;

/// Face size up to which cube maps are finer than what they are made from.
const MAX_FINER_SIZE: u32 = 1024;

/// A face size times a factor, as far as that is not too large.
fn finer(size: u32, factor: u32) -> u32 {
    size.max((factor * size).min(MAX_FINER_SIZE))
}

impl Kind {
    /// The least and the largest radiance of a channel.
    fn range(&self) -> [f32; 2] {
        match self {
            Self::Map(layout) => [0.0, layout.brightest()],
            // A NaN makes a minimum of NaN.
            Self::Spot { radiance, .. } | Self::Constant(radiance) if radiance.is_nan() => [f32::NAN; 2],
            Self::Spot { radiance, .. } | Self::Constant(radiance) => [radiance.min_element(), radiance.max_element()],
            Self::Geometry { background, .. } => [0.0, background.brightest],
        }
    }
}

impl EnvironmentRadiance {
    /// The light that a scene describes.
    pub fn new(light: &Light) -> Result<Self, EnvironmentError> {
        let invalid = |what: &str| Err(EnvironmentError::Invalid { what: what.into() });
        let kind = match light {
            Light::Constant(radiance) => Kind::Constant(*radiance),
            Light::Spot { direction, .. } if !direction.is_normalized() => {
                return invalid("the direction of its spot is not of unit length");
            }
            Light::Spot { sigma_rad, .. } if !(1e-4..=1.0).contains(sigma_rad) => {
                return invalid("the σ of its spot is not from 0.0001 to 1");
            }
            Light::Spot { direction, sigma_rad, radiance } => {
                Kind::Spot { direction: *direction, sigma_rad: *sigma_rad, radiance: *radiance }
            }
            Light::BuiltInMap(name) => Kind::Map(Layout::new(&built_in_map(name)?)),
            Light::Map(map) => Kind::Map(Layout::new(map)),
        };
        // A built-in map is decoded only here, so a scene's own check has not seen it.
        let [darkest, brightest] = kind.range();
        if !(darkest >= 0.0 && brightest <= MAX_RADIANCE) {
            return invalid("its radiance must be from 0 to 1e36");
        }
        Ok(Self { kind, brightest })
    }

    /// This radiance behind light geometry.
    pub(super) fn behind(&self, front: LitBy) -> Self {
        let brightest = front.geometry.brightest().max(self.brightest * front.intensity);
        Self { kind: Kind::Geometry { front, background: Box::new(self.clone()) }, brightest }
    }

    /// Whether an intensity and a rotation in radians leave everything within range.
    ///
    /// # Errors
    /// An intensity that is negative or not finite, that makes the light too bright, or a rotation that is not finite.
    pub fn check_placement(&self, intensity: f32, rotation_rad: f32) -> Result<(), EnvironmentError> {
        let invalid = |what: &str| Err(EnvironmentError::Invalid { what: what.into() });
        if !rotation_rad.is_finite() {
            return invalid("its rotation is not a finite number");
        }
        if !(intensity >= 0.0 && self.brightest.max(1.0) * intensity.max(1.0) <= MAX_RADIANCE) {
            return invalid("its radiance, its intensity and their product must be from 0 to 1e36");
        }
        Ok(())
    }

    /// Radiance that arrives from a unit direction in the light's frame, W/(m²·sr).
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        self.look_up(direction, Layout::radiance)
    }

    /// Puts the radiance in place of each of many unit directions; much faster than one by one for equirectangular maps.
    pub fn radiance_of_all(&self, directions: &mut [Vec3]) {
        match &self.kind {
            Kind::Map(layout) => layout.radiance_of_all(directions),
            _ => directions.iter_mut().for_each(|d| *d = self.radiance(*d)),
        }
    }

    /// The same, reconstructed more smoothly: for the eye, not for measurements.
    pub fn smooth_radiance(&self, direction: Vec3) -> Vec3 {
        self.look_up(direction, Layout::smooth_radiance)
    }

    /// An equirectangular picture of so many rows, twice as wide: [`Self::smooth_radiance`] in the middles of its pixels.
    pub fn equirectangular(&self, height: u32) -> Image {
        let width = 2 * height;
        let radiance = |pixel: usize| {
            let at =
                Vec2::new((pixel as u32 % width) as f32 + 0.5, (pixel as u32 / width) as f32 + 0.5) / height as f32;
            let (azimuth, polar) = (PI * at.x, PI * at.y);
            self.smooth_radiance(Vec3::new(azimuth.sin() * polar.sin(), polar.cos(), -azimuth.cos() * polar.sin()))
        };
        Image { width, height, pixels: parallel::collect((width * height) as usize, &radiance) }
    }

    /// What the camera sees beside light geometry, which it sees where it is: [`Self::smooth_radiance`] without it.
    pub fn background(&self, direction: Vec3) -> Vec3 {
        match &self.kind {
            Kind::Geometry { front, background } => front.intensity * background.smooth_radiance(direction),
            _ => self.smooth_radiance(direction),
        }
    }

    /// Puts [`Self::background`] in place of each of many unit directions; much faster than one by one for equirectangular maps.
    pub fn background_of_all(&self, directions: &mut [Vec3]) {
        match &self.kind {
            Kind::Geometry { front, background } => {
                background.background_of_all(directions);
                for radiance in directions {
                    *radiance *= front.intensity;
                }
            }
            Kind::Map(layout) => layout.smooth_radiance_of_all(directions),
            _ => directions.iter_mut().for_each(|d| *d = self.smooth_radiance(*d)),
        }
    }

    fn look_up(&self, d: Vec3, in_map: impl Fn(&Layout, Vec3) -> Vec3 + Copy) -> Vec3 {
        match &self.kind {
            Kind::Map(layout) => in_map(layout, d),
            Kind::Constant(radiance) => *radiance,
            Kind::Spot { direction, sigma_rad, radiance } => {
                // The chord gives small angles without the cancellation of acos.
                let chord = (d - *direction).length();
                if chord > NO_LIGHT_BEYOND * sigma_rad {
                    return Vec3::ZERO;
                }
                let angle = 2.0 * (0.5 * chord).min(1.0).asin();
                *radiance * (-0.5 * (angle / sigma_rad).powi(2)).exp()
            }
            Kind::Geometry { front, background } => {
                front.radiance(d).unwrap_or_else(|| front.intensity * background.look_up(d, in_map))
            }
        }
    }

    /// The light to be averaged over cells `texel_rad` wide on a grid of 64² points: a spot that would fall between them is
    /// made as wide as they are apart, and dimmer, so that its energy stays.
    pub(super) fn resolved_by(&self, texel_rad: f32) -> Cow<'_, Self> {
        let least_sigma_rad = texel_rad / 32.0;
        match self.kind {
            Kind::Spot { direction, sigma_rad, radiance } if sigma_rad < least_sigma_rad => {
                let radiance = radiance * (sigma_rad / least_sigma_rad).powi(2);
                let kind = Kind::Spot { direction, sigma_rad: least_sigma_rad, radiance };
                Cow::Owned(Self { kind, brightest: radiance.max_element() })
            }
            _ => Cow::Borrowed(self),
        }
    }

    /// The smallest angle over which the radiance changes much, radians; `None` for a constant.
    pub fn detail_rad(&self) -> Option<f32> {
        match &self.kind {
            Kind::Map(layout) => Some(std::f32::consts::FRAC_PI_2 / layout.texels_per_quarter() as f32),
            // A Gaussian needs no more than two samples per σ.
            Kind::Spot { sigma_rad, .. } => Some(1.5 * sigma_rad),
            Kind::Constant(_) => None,
            Kind::Geometry { front, background } => {
                let own = front.geometry.angular_radius_rad();
                Some(background.detail_rad().map_or(own, |other| own.min(other)))
            }
        }
    }

    /// The cube map's face size that keeps the light's detail: a quarter of a map's width, and a texel of at most σ/2 for a spot. If
    /// that is coarse, four or two times as much, as interpolation between texels blurs suns and spots. At least 256. A power of
    /// two.
    pub fn cube_size(&self) -> u32 {
        let wanted = match &self.kind {
            Kind::Map(layout) => finer(layout.texels_per_quarter() as u32, 4),
            // A face spans [−1, 1]: 2/size radians a texel at its centre.
            Kind::Spot { sigma_rad, .. } => finer((4.0 / sigma_rad).ceil() as u32, 2),
            Kind::Constant(_) => 0,
            Kind::Geometry { front, background } => front.geometry.cube_size().max(background.cube_size()),
        };
        wanted.max(256).next_power_of_two()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spot_has_the_radiance_and_solid_angle_of_its_definition() {
        let light = Light::Spot { direction: Vec3::X, sigma_rad: 0.1, radiance: Vec3::splat(6.0) };
        let spot = EnvironmentRadiance::new(&light).unwrap();
        assert!((spot.radiance(Vec3::X).x - 6.0).abs() < 1e-5);
        let off = Vec3::new(0.1f32.cos(), 0.0, 0.1f32.sin());
        assert!((spot.radiance(off).x - 6.0 * (-0.5f32).exp()).abs() < 1e-4);
    }

    #[test]
    fn a_spot_keeps_its_energy_in_a_cube_map_of_any_size() {
        use crate::environment::{CubeSize, Environment, texel_solid_angle_sr};
        let tilted = Vec3::new(0.3, 0.8, -0.4).normalize();
        for (direction, sigma_rad) in [(Vec3::Y, 1e-4), (tilted, 1e-4), (tilted, 2e-3), (tilted, 0.02)] {
            for size in [16, 64, 128] {
                let light = Light::Spot { direction, sigma_rad, radiance: Vec3::ONE };
                let cube = Environment::new(&light, CubeSize::Texels(size)).unwrap().cube;
                let texel = |(k, t): (usize, &glam::Vec4)| {
                    let k = k as u32 % (size * size);
                    f64::from(t.y) * texel_solid_angle_sr(size, k % size, k / size)
                };
                let energy: f64 = cube.level(0).iter().enumerate().map(texel).sum();
                let expected = std::f64::consts::TAU * f64::from(sigma_rad).powi(2);
                assert!((energy / expected - 1.0).abs() < 0.01, "σ {sigma_rad}, {size}: {}", energy / expected);
            }
        }
    }

    #[test]
    fn lights_made_in_code_are_checked() {
        let refused = |light: Light, rotation_rad: f32, intensity: f32| {
            let placed = EnvironmentRadiance::new(&light).and_then(|r| r.check_placement(intensity, rotation_rad));
            placed.unwrap_err().to_string()
        };
        let white = || Light::Constant(Vec3::ONE);
        let spot = |direction, sigma_rad| Light::Spot { direction, sigma_rad, radiance: Vec3::ONE };
        assert!(refused(white(), f32::NAN, 1.0).contains("rotation"));
        assert!(refused(white(), 0.0, f32::NAN).contains("intensity"));
        assert!(refused(white(), 0.0, -1.0).contains("intensity"));
        assert!(refused(Light::Constant(Vec3::splat(f32::NAN)), 0.0, 1.0).contains("radiance"));
        assert!(refused(Light::Constant(Vec3::splat(1e30)), 0.0, 1e30).contains("product"));
        assert!(refused(Light::BuiltInMap("clear-sky".into()), 0.0, 1e36).contains("product"));
        assert!(refused(spot(Vec3::ZERO, 0.1), 0.0, 1.0).contains("unit length"));
        assert!(refused(spot(Vec3::Y, 0.0), 0.0, 1.0).contains("σ"));
        assert!(refused(Light::BuiltInMap("clear".into()), 0.0, 1.0).contains("clear-sky"));
    }
}
