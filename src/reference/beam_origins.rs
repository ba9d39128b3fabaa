//! Where the light of beams comes from: a direction or a point of a lamp each, by which lights with an extent are sampled evenly.

use std::f64::consts::TAU;

use glam::{DMat3, DVec2, DVec3};

use super::lamps::{Lamps, Source};
use crate::scene::{Lamp, Light, Scene};

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

/// The origins of all light of a scene, `count` for each light with an extent; `None` of an environment that is no spot.
pub(super) fn origins(scene: &Scene, lamps: &Lamps, count: u32) -> Option<Vec<Vec<Origin>>> {
    let environment = &scene.environment;
    let intensity = f64::from(environment.intensity);
    let mut lights = match &environment.light {
        Light::Spot { direction, sigma_rad, radiance } => {
            let turned = DMat3::from_rotation_y(f64::from(environment.rotation_rad)) * direction.as_dvec3();
            vec![of_spot(turned.normalize(), f64::from(*sigma_rad), intensity * radiance.as_dvec3(), count)]
        }
        Light::Constant(radiance) if intensity == 0.0 || radiance.max_element() == 0.0 => Vec::new(),
        _ => return None,
    };
    let of_lamp = |(k, lamp): (usize, &Source)| {
        let count = if lamp.radius <= f64::from(Lamp::MIN_RADIUS) { 1 } else { count };
        let place = |k: u32| if count == 1 { DVec2::ZERO } else { disc_point(k, count) };
        (0..count).map(|part| Origin::Lamp(k, place(part), 1.0 / f64::from(count))).collect()
    };
    lights.extend(lamps.sources().iter().enumerate().map(of_lamp));
    Some(lights)
}

fn of_spot(towards: DVec3, sigma: f64, radiance: DVec3, count: u32) -> Vec<Origin> {
    let count = if sigma < NO_EXTENT { 1 } else { count };
    let (u, v) = towards.any_orthonormal_pair();
    let irradiance = TAU * sigma * sigma * radiance / f64::from(count);
    let origin = |k: u32| {
        let place = disc_point(k, count);
        if count == 1 {
            return Origin::Direction(towards, irradiance);
        }
        // L(θ) sin θ dθ dφ is that of a plane normal distribution but for sin θ / θ.
        let angle = (sigma * (-2.0 * (1.0 - place.length_squared()).ln()).sqrt()).min(1.5);
        let across = place.normalize_or(DVec2::X);
        let direction = angle.cos() * towards + angle.sin() * (across.x * u + across.y * v);
        let factor = if angle > 0.0 { angle.sin() / angle } else { 1.0 };
        Origin::Direction(direction.normalize(), factor * irradiance)
    };
    (0..count).map(origin).collect()
}

/// The k-th of `count` points that cover the unit disc evenly (Vogel 1979).
fn disc_point(k: u32, count: u32) -> DVec2 {
    const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
    ((f64::from(k) + 0.5) / f64::from(count)).sqrt() * DVec2::from_angle(GOLDEN_ANGLE * f64::from(k))
}
