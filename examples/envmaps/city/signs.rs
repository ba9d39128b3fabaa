//! Neon signs: blades that stand out from the house fronts over the pavement.

use glam::{IVec3, Vec3};

use super::HALF_STREET;
use crate::noise::{hash, smoothstep};

pub struct Sign {
    centre: Vec3,
    /// Along the street.
    normal: Vec3,
    across: Vec3,
    half_width: f32,
    half_height: f32,
    colour: Vec3,
    key: i32,
}

/// Street arm, side, distance along it, height, half height and colour.
type Spec = (IVec3, f32, f32, f32, f32, Vec3);

const MAGENTA: Vec3 = Vec3::new(30.0, 2.2, 17.0);
const CYAN: Vec3 = Vec3::new(1.6, 20.0, 26.0);
const RED: Vec3 = Vec3::new(34.0, 2.4, 1.4);
const AMBER: Vec3 = Vec3::new(30.0, 13.0, 1.5);
const GREEN: Vec3 = Vec3::new(2.5, 25.0, 6.0);
const BLUE: Vec3 = Vec3::new(3.0, 6.5, 34.0);

const SPECS: [Spec; 9] = [
    (IVec3::Z, 1.0, 21.0, 6.6, 2.5, MAGENTA),
    (IVec3::Z, -1.0, 30.0, 7.2, 3.0, CYAN),
    (IVec3::Z, 1.0, 46.0, 7.5, 3.2, AMBER),
    (IVec3::Z, -1.0, 62.0, 8.5, 3.5, RED),
    (IVec3::X, 1.0, 25.0, 7.0, 2.6, GREEN),
    (IVec3::X, -1.0, 41.0, 7.5, 3.0, RED),
    (IVec3::NEG_Z, 1.0, 24.0, 6.8, 2.8, BLUE),
    (IVec3::NEG_Z, -1.0, 39.0, 7.6, 3.0, MAGENTA),
    (IVec3::NEG_X, -1.0, 22.0, 6.5, 2.4, AMBER),
];

pub fn all() -> Vec<Sign> {
    (0..).zip(SPECS).map(|(key, spec)| Sign::new(key, spec)).collect()
}

/// The light of the sign that a ray meets within `reach`.
pub fn meet(signs: &[Sign], origin: Vec3, direction: Vec3, reach: f32) -> Option<Vec3> {
    signs.iter().find_map(|s| s.meet(origin, direction, reach))
}

/// Soft light around the signs in the damp air.
pub fn glow(signs: &[Sign], direction: Vec3) -> Vec3 {
    let one = |sign: &Sign| {
        let angle = direction.angle_between(sign.centre);
        let size = sign.half_height / sign.centre.length();
        sign.colour * (0.010 * (-angle / size).exp())
    };
    signs.iter().map(one).sum()
}

impl Sign {
    fn new(key: i32, (arm, side, along, height, half_height, colour): Spec) -> Self {
        let normal = arm.as_vec3();
        let across = normal.cross(Vec3::Y) * side;
        let half_width = 0.75;
        let out = HALF_STREET - half_width - 0.25;
        Self {
            centre: normal * along + across * out + Vec3::Y * height,
            normal,
            across,
            half_width,
            half_height,
            colour,
            key,
        }
    }

    fn meet(&self, origin: Vec3, direction: Vec3, reach: f32) -> Option<Vec3> {
        let distance = (self.centre - origin).dot(self.normal) / direction.dot(self.normal);
        if !(0.0..reach).contains(&distance) {
            return None;
        }
        let offset = origin + direction * distance - self.centre;
        let (x, y) = (offset.dot(self.across), offset.y);
        let inside = x.abs() < self.half_width && y.abs() < self.half_height;
        inside.then(|| self.colour * self.tubes(x, y) + self.colour * 0.02)
    }

    /// Brightness of the neon tubes: a border, and made-up letters within.
    fn tubes(&self, x: f32, y: f32) -> f32 {
        let edge = (self.half_width - x.abs()).min(self.half_height - y.abs());
        let border = tube(edge - 0.10);
        let letter_height = 1.15;
        let line = (y + self.half_height) / letter_height;
        let place = IVec3::new(self.key, line.floor() as i32, 3);
        let (across, up) = (x / 0.42, (line - line.floor()) * 2.0 - 1.0);
        let mut best = border;
        if across.abs() < 1.1 && edge > 0.2 {
            best = best.max(letter(hash(place, 660), across, up / 0.72));
        }
        best
    }
}

/// Seven strokes, each on or off, as in a digital watch.
fn letter(strokes: u32, x: f32, y: f32) -> f32 {
    let level = |at: f32| if x.abs() < 1.0 { (y - at) * 0.4 } else { 9.0 };
    let upright = |at: f32, half: f32| {
        if y * half > 0.0 && y.abs() < 1.0 { (x - at) * 0.4 } else { 9.0 }
    };
    let gaps = [
        level(-1.0),
        level(0.0),
        level(1.0),
        upright(-1.0, 1.0),
        upright(1.0, 1.0),
        upright(-1.0, -1.0),
        upright(1.0, -1.0),
    ];
    let lit = (0..).zip(gaps).filter(|(bit, _)| (strokes >> (bit * 3)) & 7 > 2);
    lit.map(|(_, gap)| tube(gap)).fold(0.0, f32::max)
}

/// Brightness at a distance (metres) from a tube's middle.
fn tube(gap: f32) -> f32 {
    smoothstep(0.085, 0.03, gap.abs())
}
