//! Street lamps: globes on poles, with their halos in the damp air and their
//! streaks on the wet road.

use glam::{IVec3, Vec3};

use super::{EYE, HALF_STREET};
use crate::noise::random3;

/// Distance between lamps along a street, metres.
pub const SPACING: f32 = 16.0;
const PER_ROW: i32 = 14;
const HEIGHT: f32 = 6.2;
const GLOBE: f32 = 0.19;
const POLE: f32 = 0.06;
/// Far globes are drawn at this angular radius and dimmed to keep their energy.
const LEAST_ANGLE: f32 = 0.0045;

pub struct Lamp {
    place: Vec3,
    towards: Vec3,
    distance: f32,
    radiance: Vec3,
}

/// Both rows of lamps in each of the four arms.
pub fn all() -> Vec<Lamp> {
    let arms = [(1, 0), (-1, 0), (0, 1), (0, -1)];
    let spots = (0..PER_ROW).flat_map(|k| arms.map(|arm| (k, arm)));
    spots.flat_map(|(k, (x, z))| [-1, 1].map(|side| Lamp::new(k, IVec3::new(x, 0, z), side))).collect()
}

impl Lamp {
    fn new(order: i32, arm: IVec3, side: i32) -> Self {
        let ahead = (order + 1) as f32 * SPACING;
        let across = arm.as_vec3().cross(Vec3::Y) * side as f32;
        let level = arm.as_vec3() * ahead + across * (HALF_STREET - 2.4);
        let place = level + Vec3::Y * (HEIGHT - EYE);
        let pick = random3(arm + IVec3::new(order, side, 0), 650);
        let sodium = Vec3::new(1.0, 0.58, 0.22);
        let white = Vec3::new(1.0, 0.86, 0.68);
        // One street has old lamps, the other has new ones.
        let colour = if arm.x == 0 { sodium } else { white };
        Self {
            place,
            towards: place.normalize(),
            distance: place.length(),
            radiance: colour * (900.0 + 700.0 * pick.x),
        }
    }

    /// Angular radius of the globe.
    fn angle(&self) -> f32 {
        GLOBE / self.distance
    }

    /// Radiance times the globe's radius squared: its intensity over pi.
    fn strength(&self) -> Vec3 {
        self.radiance * (GLOBE * GLOBE)
    }
}

/// The globes and their halos. No house hides a lamp from the crossing.
pub fn light(lamps: &[Lamp], direction: Vec3) -> Vec3 {
    lamps
        .iter()
        .filter(|lamp| direction.dot(lamp.towards) > 0.3)
        .map(|lamp| {
            let squared = (direction - lamp.towards).length_squared();
            let drawn = lamp.angle().max(LEAST_ANGLE);
            let dimmed = (lamp.angle() / drawn).powi(2);
            let globe = if squared < drawn * drawn { dimmed } else { 0.0 };
            let air = lamp.angle().powi(2) / (squared + 6e-4);
            let halo = 0.0035 * air + 0.02 * air.powi(2);
            lamp.radiance * (globe + halo)
        })
        .sum()
}

/// The nearer lamps' poles, dark against the street.
pub fn pole(lamps: &[Lamp], direction: Vec3) -> Option<Vec3> {
    lamps.iter().take(40).find_map(|lamp| {
        let level = Vec3::new(lamp.place.x, 0.0, lamp.place.z);
        let reach = level.length();
        let ahead = direction.dot(level) / reach;
        let at_pole = direction * (reach / ahead);
        let sideways = at_pole.dot(level.cross(Vec3::Y)) / reach;
        let thick = if at_pole.y + EYE < 0.9 { 2.0 * POLE } else { POLE };
        let beside = ahead <= 0.0 || sideways.abs() > thick;
        if beside || at_pole.y > lamp.place.y - 0.1 || at_pole.y < -EYE {
            return None;
        }
        let round = 1.0 - (sideways / thick).powi(2);
        Some(Vec3::new(0.05, 0.04, 0.03) * (0.2 + 0.8 * round))
    })
}

/// Irradiance of all lamps on the road at a place.
pub fn on_road(lamps: &[Lamp], place: Vec3) -> Vec3 {
    let one = |lamp: &Lamp| {
        let way = lamp.place - place;
        let squared = way.length_squared();
        lamp.strength() * (std::f32::consts::PI * way.y / (squared * squared.sqrt()))
    };
    lamps.iter().map(one).sum()
}

/// What a perfect but rippled mirror in place of the road would show of the
/// lamps: images drawn out towards the viewer.
pub fn streaks(lamps: &[Lamp], direction: Vec3) -> Vec3 {
    let level = direction.x.hypot(direction.z);
    let one = |lamp: &Lamp| {
        let image = Vec3::new(lamp.place.x, -2.0 * EYE - lamp.place.y, lamp.place.z);
        let far = image.x.hypot(image.z);
        let ahead = (direction.x * image.x + direction.z * image.z) / (level * far);
        if ahead < 0.9 {
            return Vec3::ZERO;
        }
        let aside = (direction.x * image.z - direction.z * image.x) / (level * far);
        let drop = (direction.y / level).atan() - (image.y / far).atan();
        let (wide, tall) = (lamp.angle().max(LEAST_ANGLE) * 1.1 + 0.004, 0.13);
        let fall = (-0.5 * ((aside / wide).powi(2) + (drop / tall).powi(2))).exp();
        lamp.strength() * (fall / (2.0 * wide * tall * image.length_squared()))
    };
    lamps.iter().map(one).sum()
}
