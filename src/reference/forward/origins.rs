//! Where the light of beams comes from: a direction or a point of a lamp each, by which lights with an extent are sampled evenly.

use std::f64::consts::TAU;

use glam::{DMat3, DVec2, DVec3};

use crate::lamps::Source;
use crate::scene::{EnvironmentSource, Lamp, Light};

/// Lights of less extent than this, radians, are a single direction.
const NO_EXTENT: f64 = 2e-4;

/// Where light comes from.
#[derive(Clone, Copy, Debug)]
pub(super) enum Origin {
    /// Far away, in a unit direction, with the irradiance on what faces it, W/m².
    Direction(DVec3, DVec3),
    /// A lamp, by its number: a place in the unit disc that it looks like, and the part of its light that comes from there.
    Lamp(usize, DVec2, f64),
}

/// The origins of a lamp's light.
pub(super) fn of_lamp(number: usize, lamp: &Source, count: u32) -> Vec<Origin> {
    let count = if lamp.radius <= f64::from(Lamp::MIN_RADIUS) { 1 } else { count };
    let place = |k: u32| if count == 1 { DVec2::ZERO } else { disc_point(k, count) };
    (0..count).map(|part| Origin::Lamp(number, place(part), 1.0 / f64::from(count))).collect()
}

/// The origins of the light of an environment that is a spot; none of others.
pub(super) fn of_spot(environment: &EnvironmentSource, count: u32) -> Vec<Origin> {
    let Light::Spot { direction, sigma_rad, .. } = &environment.light else { return Vec::new() };
    let turned = DMat3::from_rotation_y(f64::from(environment.rotation_rad)) * direction.as_dvec3();
    let (towards, sigma) = (turned.normalize(), f64::from(*sigma_rad));
    let count = if sigma < NO_EXTENT { 1 } else { count };
    let irradiance = spot_irradiance(environment) / f64::from(count);
    let origin = |k: u32| {
        if count == 1 {
            return Origin::Direction(towards, irradiance);
        }
        let (direction, factor) = spot_direction(towards, sigma, disc_point(k, count));
        Origin::Direction(direction, factor * irradiance)
    };
    (0..count).map(origin).collect()
}

/// On what faces a spot that is small, W/m².
pub(super) fn spot_irradiance(environment: &EnvironmentSource) -> DVec3 {
    let Light::Spot { sigma_rad, radiance, .. } = &environment.light else { return DVec3::ZERO };
    TAU * f64::from(*sigma_rad).powi(2) * f64::from(environment.intensity) * radiance.as_dvec3()
}

/// A direction of a spot by a place in the unit disc, and the factor on the irradiance that it brings: L(θ) sin θ dθ dφ is that of a plane normal
/// distribution but for sin θ / θ.
pub(super) fn spot_direction(towards: DVec3, sigma: f64, place: DVec2) -> (DVec3, f64) {
    let (u, v) = towards.any_orthonormal_pair();
    let angle = (sigma * (-2.0 * (1.0 - place.length_squared()).ln()).sqrt()).min(1.5);
    let across = place.normalize_or(DVec2::X);
    let direction = angle.cos() * towards + angle.sin() * (across.x * u + across.y * v);
    (direction.normalize(), if angle > 0.0 { angle.sin() / angle } else { 1.0 })
}

/// The k-th of `count` points that cover the unit disc evenly (Vogel 1979).
fn disc_point(k: u32, count: u32) -> DVec2 {
    const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
    ((f64::from(k) + 0.5) / f64::from(count)).sqrt() * DVec2::from_angle(GOLDEN_ANGLE * f64::from(k))
}
