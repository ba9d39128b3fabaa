//! A city at night after rain: two streets cross under the viewer, lined with
//! lamps, lit windows and neon signs, under a moon and the glow of the city.
//!
//! The streets are modelled and their rays are cast, with one reflection in
//! the wet road. The model is this project's own and follows no published one.

mod buildings;
mod lamps;
mod signs;
mod street;

use glam::Vec3;

use crate::noise::{fbm, smoothstep};
use buildings::Building;
use lamps::Lamp;
use signs::Sign;

/// Height of the viewer's eye above the road, metres.
const EYE: f32 = 1.7;
/// Half the distance between the house fronts of a street.
const HALF_STREET: f32 = 10.0;
const MOON_TOWARDS: Vec3 = Vec3::new(0.085, 0.68, 0.728);
/// Angular radius; about three times the true one, as pictures tend to have.
const MOON_RADIUS: f32 = 0.014;

pub struct City {
    buildings: Vec<Building>,
    lamps: Vec<Lamp>,
    signs: Vec<Sign>,
}

impl City {
    pub fn new() -> Self {
        Self { buildings: buildings::all(), lamps: lamps::all(), signs: signs::all() }
    }

    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let seen =
            if direction.y < -1e-4 { self.road_or_front(direction) } else { self.above_road(Vec3::ZERO, direction) };
        if let Some(pole) = lamps::pole(&self.lamps, direction) {
            return pole;
        }
        seen + lamps::light(&self.lamps, direction) + signs::glow(&self.signs, direction)
    }

    fn road_or_front(&self, direction: Vec3) -> Vec3 {
        let place = direction * (-EYE / direction.y);
        if place.x.abs().min(place.z.abs()) > HALF_STREET {
            return self.above_road(Vec3::ZERO, direction);
        }
        let road = street::Road::at(place, &self.lamps);
        let ray = road.mirrored(direction);
        let share = road.mirror_share(direction);
        let streaks = lamps::streaks(&self.lamps, direction);
        road.radiance + (self.above_road(place, ray) + streaks) * share
    }

    /// Signs, house fronts and sky, from a place on or above the road.
    fn above_road(&self, origin: Vec3, direction: Vec3) -> Vec3 {
        let front = buildings::meet(&self.buildings, origin, direction);
        let reach = front.as_ref().map_or(f32::INFINITY, |hit| hit.distance);
        if let Some(light) = signs::meet(&self.signs, origin, direction, reach) {
            return light;
        }
        front.map_or_else(
            || sky(direction),
            |hit| {
                let clear = (-hit.distance / 260.0).exp();
                glow(0.0).lerp(hit.radiance, clear)
            },
        )
    }
}

/// The sky's glow at the sine of an elevation.
fn glow(up: f32) -> Vec3 {
    let horizon = Vec3::new(0.105, 0.082, 0.090);
    let zenith = Vec3::new(0.010, 0.017, 0.040);
    let low = (-up.max(0.0) * 4.5).exp();
    zenith.lerp(horizon, low)
}

fn sky(direction: Vec3) -> Vec3 {
    let place = direction / (direction.y.max(0.0) + 0.12);
    let cloud = smoothstep(-0.15, 0.7, fbm(place * 0.9, 5, 61));
    let lit_cloud = Vec3::new(0.055, 0.050, 0.066) * (0.4 + glow(direction.y) * 12.0);
    let open = glow(direction.y).lerp(lit_cloud, 0.75 * cloud);
    open + moon(direction) * (1.0 - 0.7 * cloud)
}

fn moon(direction: Vec3) -> Vec3 {
    let angle = direction.angle_between(MOON_TOWARDS);
    let halo = 0.25 * (-angle / 0.05).exp() + 0.06 * (-angle / 0.25).exp();
    let seas = 1.0 + 0.35 * fbm((direction - MOON_TOWARDS) * 120.0, 3, 62);
    let disc = if angle < MOON_RADIUS { 22.0 * seas } else { 0.0 };
    Vec3::new(0.90, 0.95, 1.0) * (disc + halo)
}
