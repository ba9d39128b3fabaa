//! The lights that photons come from: directions, and lamps.
//!
//! The environment is one of them if it is a small spot. All others are divided into directions of equal power first (`segmentation`).

use std::f32::consts::TAU;
use std::ops::Range;

use glam::{DVec2, Vec2, Vec3};

use super::constants::MAX_SPREAD_RAD;
use super::projection::{Bounds, Projection};
use crate::scene::{Lamp, Ray};

/// A light that photons come from.
#[derive(Clone, Debug, PartialEq)]
pub enum PhotonLight {
    /// Light from far away.
    Directional {
        /// Unit direction towards it.
        towards: Vec3,
        /// On a surface that faces it, W/m².
        irradiance: Vec3,
        /// Standard deviation of its radiance, radians; 0: all of it comes from one direction.
        sigma_rad: f32,
        /// How its radiance depends on the angle.
        profile: Profile,
    },
    /// A point or a sphere, or a spotlight.
    Lamp(Lamp),
}

/// The radiance of a directional light by the angle from its middle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Profile {
    /// L(θ) ~ exp(−θ²/2σ²).
    Gaussian,
    /// Even up to 2σ.
    Disc,
}

/// Spots are wider than this many standard deviations with a probability of 3e-5.
const WIDEST: f32 = 4.6;

impl PhotonLight {
    /// Whether its photons come from several directions at every point.
    pub fn is_extended(&self) -> bool {
        match self {
            Self::Directional { sigma_rad, .. } => *sigma_rad > 0.0,
            Self::Lamp(lamp) => lamp.radius > Lamp::MIN_RADIUS,
        }
    }

    /// About what it sends through an area in the scene, m²: at least that, and all that a lamp has; W, the sum of the channels.
    pub fn power_on(&self, area: f64) -> f64 {
        match self {
            Self::Directional { irradiance, .. } => irradiance.as_dvec3().element_sum() * area,
            Self::Lamp(lamp) => {
                let slide = lamp.beam.as_ref().and_then(|beam| beam.slide.as_ref());
                let brightest =
                    slide.map_or(1.0, |slide| slide.0.pixels.as_flattened().iter().copied().fold(0.0, f32::max));
                f64::from(lamp.intensity.element_sum() * brightest.max(1.0)) * 2.0 * f64::from(TAU)
            }
        }
    }

    /// So many lights without extent that together shine like it, seen from about `centre`.
    pub fn divided(&self, count: u32, centre: Vec3) -> Vec<Self> {
        let places: Vec<Vec2> = (0..count).map(|k| disc_point(k, count)).collect();
        self.in_parts(&places, centre)
    }

    /// Lights without extent out of an endless sequence: the longer a part of it is, the more it shines like this light.
    pub fn drawn(&self, numbers: Range<u32>, centre: Vec3) -> Vec<Self> {
        let places: Vec<Vec2> = numbers.map(point_of_sequence).map(on_disc).collect();
        self.in_parts(&places, centre)
    }

    /// Lights without extent at points of the unit disc.
    fn in_parts(&self, places: &[Vec2], centre: Vec3) -> Vec<Self> {
        if !self.is_extended() {
            return vec![self.clone()];
        }
        let (places, count) = (places.iter().copied(), places.len());
        match self {
            Self::Directional { towards, irradiance, sigma_rad, profile } => {
                let part = |place: Vec2| {
                    let (towards, factor) = spread(*towards, (*sigma_rad, *profile), place);
                    let irradiance = *irradiance * factor / count as f32;
                    Self::Directional { towards, irradiance, sigma_rad: 0.0, profile: *profile }
                };
                places.map(part).collect()
            }
            Self::Lamp(lamp) => {
                let (u, v) = (centre - lamp.position).normalize_or(Vec3::Y).any_orthonormal_pair();
                let part = |place: Vec2| {
                    let offset = lamp.radius * (place.x * u + place.y * v);
                    let position = lamp.position + offset;
                    let intensity = lamp.intensity / count as f32;
                    Self::Lamp(Lamp { position, intensity, radius: Lamp::MIN_RADIUS, ..lamp.clone() })
                };
                places.map(part).collect()
            }
        }
    }

    /// Its views of what casts caustics, of `photons`² rays each: one, or the six faces of a cube around a lamp between the casters.
    pub fn views(&self, casters: &[Vec3], scene: &Bounds, photons: u32) -> Vec<LightView> {
        let centre = Bounds::around(casters.iter().copied()).map_or(Vec3::ZERO, |bounds| bounds.centre());
        let radius = casters.iter().map(|p| p.distance(centre)).fold(0.0, f32::max);
        let points = casters.iter().copied();
        let (projections, pivot, spread) = match self {
            Self::Directional { towards, sigma_rad, .. } => {
                let view = Projection::parallel(-*towards, points, scene, photons);
                let pivot = (centre.as_dvec3() - view.origin).dot(view.axes[2]);
                let spread = f64::from(radius * (WIDEST * sigma_rad).min(MAX_SPREAD_RAD).tan());
                (vec![view.widened(spread)], pivot as f32, spread)
            }
            Self::Lamp(lamp) => {
                let pivot = lamp.position.distance(centre);
                // Where the lamp has an extent, casters are seen from all of it.
                let nearest = (pivot - radius).max(0.1 * pivot).max(lamp.radius);
                let spread = if self.is_extended() { f64::from(2.0 * lamp.radius / nearest) } else { 0.0 };
                let one = Projection::central(lamp.position, points, photons).map(|view| vec![view.widened(spread)]);
                let views = one.unwrap_or_else(|| Projection::cube(lamp.position, photons, 1).to_vec());
                (views, pivot, spread)
            }
        };
        let is_cube = projections.len() > 1;
        let view = |projection| LightView { light: self.clone(), projection, pivot, spread, is_cube };
        projections.into_iter().map(view).collect()
    }
}

/// A direction of a directional light by a point of the unit disc, and the factor on the irradiance of a light of L(θ) θ dθ that makes it one of
/// L(θ) sin θ dθ.
fn spread(towards: Vec3, (sigma_rad, profile): (f32, Profile), place: Vec2) -> (Vec3, f32) {
    let (u, v) = towards.any_orthonormal_pair();
    let r = place.length().min(1.0 - 1e-6);
    let deviations = match profile {
        Profile::Gaussian => (-2.0 * (1.0 - r * r).ln()).sqrt(),
        Profile::Disc => 2.0 * r,
    };
    let angle = (sigma_rad * deviations).min(MAX_SPREAD_RAD);
    let across = place.try_normalize().unwrap_or(Vec2::X);
    let direction = angle.cos() * towards + angle.sin() * (across.x * u + across.y * v);
    (direction.normalize(), if angle > 0.0 { angle.sin() / angle } else { 1.0 })
}

/// The k-th of `count` points that cover the unit disc evenly (Vogel 1979).
fn disc_point(k: u32, count: u32) -> Vec2 {
    const GOLDEN_ANGLE: f32 = 2.399_963_2;
    let radius = ((k as f32 + 0.5) / count as f32).sqrt();
    radius * Vec2::from_angle(GOLDEN_ANGLE * k as f32)
}

/// Maps a point of the unit square to the unit disc; equal areas stay equal.
fn on_disc(part: Vec2) -> Vec2 {
    part.x.sqrt() * Vec2::from_angle(TAU * part.y)
}

/// The k-th point of a sequence that covers the unit square evenly (Roberts 2018, R2).
pub fn point_of_sequence(k: u32) -> Vec2 {
    const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
    let [x, y] = STEPS.map(|step| (0.5 + f64::from(k) * step).fract());
    DVec2::new(x, y).as_vec2()
}

/// What a light sees: a grid of rays that photons go along.
#[derive(Clone, Debug)]
pub struct LightView {
    /// The light.
    pub light: PhotonLight,
    /// The grid, with one photon in each texel.
    pub projection: Projection,
    /// Rays of extended lights are turned about points at this distance along the view axis, metres, where the casters are.
    pub pivot: f32,
    /// How far from where they would be casters may appear in an extended light, in the plane's unit.
    pub spread: f64,
    /// It is a face of a cube. Photons in its border have no flux: they are neighbours of those at its edges.
    pub is_cube: bool,
}

impl LightView {
    /// The same window with `photons`² rays.
    pub fn resized(&self, photons: u32) -> Self {
        Self { projection: self.projection.resized(photons), ..self.clone() }
    }

    /// The unit direction in which light would arrive at a point that nothing has turned.
    pub fn undeflected(&self, point: Vec3) -> Vec3 {
        match &self.light {
            PhotonLight::Directional { towards, .. } => -*towards,
            PhotonLight::Lamp(lamp) => (point - lamp.position).normalize_or(Vec3::NEG_Y),
        }
    }

    /// The ray of a photon at a place of the grid, and its flux, W. `part`: a point of the unit square, by which the origin in an extended
    /// light is chosen.
    pub fn emit(&self, place: DVec2, part: Vec2) -> (Ray, Vec3) {
        let Ray { origin, direction } = self.projection.ray(place);
        let measure = self.projection.measure(place) as f32;
        let on_disc = on_disc(part);
        match &self.light {
            PhotonLight::Directional { irradiance, sigma_rad, profile, .. } if *sigma_rad > 0.0 => {
                let (back, factor) = spread(-direction, (*sigma_rad, *profile), on_disc);
                let cosine = -back.dot(direction);
                let pivot = origin + self.pivot * direction;
                let ray = Ray { origin: pivot + self.pivot / cosine * back, direction: -back };
                // The grid is seen at an angle.
                (ray, *irradiance * factor * cosine * measure)
            }
            PhotonLight::Directional { irradiance, .. } => (Ray { origin, direction }, *irradiance * measure),
            PhotonLight::Lamp(lamp) => {
                let is_beyond = self.is_cube && self.projection.is_in_border(place);
                let flux = if is_beyond { Vec3::ZERO } else { lamp.intensity_towards(direction) * measure };
                if !self.light.is_extended() {
                    return (Ray { origin, direction }, flux);
                }
                let (u, v) = direction.any_orthonormal_pair();
                let from = origin + lamp.radius * (on_disc.x * u + on_disc.y * v);
                let target = origin + self.pivot.max(2.0 * lamp.radius) * direction;
                (Ray { origin: from, direction: (target - from).normalize() }, flux)
            }
        }
    }
}
