//! House blocks: boxes with rows of windows, shops at the foot, some with a
//! narrower tower on top.

use glam::{IVec3, Vec3};

use super::{EYE, HALF_STREET};
use crate::noise::{random, random3, smoothstep};

const LOT: f32 = 19.0;
const LOTS: i32 = 13;
const STOREY: f32 = 3.4;
const SHOP_HEIGHT: f32 = 4.2;
const SEED: u32 = 700;

pub struct Building {
    low: Vec3,
    high: Vec3,
    key: IVec3,
}

pub struct Hit {
    pub distance: f32,
    pub radiance: Vec3,
}

pub fn all() -> Vec<Building> {
    let lots = (0..LOTS * LOTS).map(|k| (k % LOTS, k / LOTS));
    // Behind the fronts only some tall blocks can be seen.
    let visible = lots.filter(|&(i, j)| i.min(j) == 0 || i.max(j) < 6);
    let quarters = [(1, 1), (1, -1), (-1, 1), (-1, -1)];
    visible
        .flat_map(|(i, j)| quarters.map(|(sx, sz)| IVec3::new(sx * (i + 1), 0, sz * (j + 1))))
        .flat_map(Building::on_lot)
        .collect()
}

/// The nearest wall that a ray meets.
pub fn meet(buildings: &[Building], origin: Vec3, direction: Vec3) -> Option<Hit> {
    let inverse = direction.recip();
    let entries = buildings.iter().filter_map(|b| Some((b.entry(origin, inverse)?, b)));
    let (distance, building) = entries.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let place = origin + direction * distance;
    Some(Hit { distance, radiance: building.wall(place, distance) })
}

impl Building {
    fn on_lot(lot: IVec3) -> Vec<Self> {
        let pick = random3(lot, SEED);
        let inner = (lot.abs().as_vec3() - 1.0) * LOT + HALF_STREET;
        let back = lot.x.abs().min(lot.z.abs()) > 1;
        let tall = if back { 24.0 } else { 11.0 };
        let height = tall + 34.0 * pick.x * pick.x;
        let gap = 0.6 * pick.z;
        let block = Self::between(lot, inner, LOT - gap, height);
        if pick.y < 0.6 {
            return vec![block];
        }
        let inset = 2.0 + 3.0 * pick.z;
        let tower_key = lot + IVec3::Y;
        let tower = Self::between(tower_key, inner + inset, LOT - 2.0 * inset, height * 1.7);
        vec![block, tower]
    }

    fn between(key: IVec3, inner: Vec3, width: f32, height: f32) -> Self {
        let side = key.signum().as_vec3();
        let (near, far) = (inner * side, (inner + width) * side);
        let (low, high) = (near.min(far), near.max(far));
        Self { low: Vec3::new(low.x, -EYE, low.z), high: Vec3::new(high.x, height - EYE, high.z), key }
    }

    /// Distance at which a ray enters the box.
    fn entry(&self, origin: Vec3, inverse: Vec3) -> Option<f32> {
        let (a, b) = ((self.low - origin) * inverse, (self.high - origin) * inverse);
        let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
        (enter > 0.0 && enter < leave).then_some(enter)
    }

    fn wall(&self, place: Vec3, distance: f32) -> Vec3 {
        let faces_x = (place.x - self.low.x).abs().min((place.x - self.high.x).abs())
            < (place.z - self.low.z).abs().min((place.z - self.high.z).abs());
        let (along, face) = if faces_x { (place.z, 0) } else { (place.x, 1) };
        let height = place.y + EYE;
        let stone = self.stone(along, height, place);
        // Small detail melts into its mean with distance.
        let detail = smoothstep(180.0, 90.0, distance);
        if height < SHOP_HEIGHT {
            return stone + self.shop(along, height, face) * (0.4 + 0.6 * detail);
        }
        stone + self.window(along, height, face)
    }

    /// The wall itself, by the light of the street lamps.
    fn stone(&self, along: f32, height: f32, place: Vec3) -> Vec3 {
        let pick = random3(self.key, SEED + 1);
        let albedo = Vec3::new(0.30, 0.27, 0.24).lerp(Vec3::new(0.20, 0.21, 0.23), pick.x);
        let from_lamp = (along * std::f32::consts::TAU / super::lamps::SPACING).cos();
        let on_street = place.x.abs().min(place.z.abs()) < HALF_STREET + 1.5;
        let street = if on_street { 1.0 } else { 0.15 };
        let lamp_light = street * (0.75 + 0.25 * from_lamp) * (-height / 8.0).exp();
        let ledge = if (height / STOREY).fract() < 0.07 { 1.35 } else { 1.0 };
        albedo * ledge * (Vec3::new(0.70, 0.46, 0.24) * lamp_light + Vec3::new(0.024, 0.026, 0.040))
    }

    fn window(&self, along: f32, height: f32, face: i32) -> Vec3 {
        let style = random3(self.key, SEED + 2);
        let width = 1.7 + 2.2 * style.x;
        let (column, row) = (along / width, (height - SHOP_HEIGHT) / STOREY);
        let (x, y) = (column - column.floor(), row - row.floor());
        let margin = 0.12 + 0.14 * style.y;
        if x < margin || x > 1.0 - margin || !(0.24..0.80).contains(&y) {
            return Vec3::ZERO;
        }
        let id = IVec3::new(column.floor() as i32, row.floor() as i32, face * 64);
        let room = id + self.key * 101;
        let whole_floor = random(IVec3::new(face, id.y, 7) + self.key * 57, SEED + 3);
        let chance = if whole_floor < 0.12 { 0.85 } else { 0.10 + 0.28 * style.z };
        let pick = random3(room, SEED + 4);
        if pick.x > chance {
            return Vec3::new(0.004, 0.006, 0.012);
        }
        let curtain = if pick.y < 0.3 && x > 0.5 { 0.35 } else { 1.0 };
        let lamp_near_ceiling = 0.55 + 0.9 * (y - 0.24);
        room_colour(room) * ((0.8 + 4.2 * pick.z * pick.z) * lamp_near_ceiling * curtain)
    }

    fn shop(&self, along: f32, height: f32, face: i32) -> Vec3 {
        let bay = along / 5.5;
        let x = bay - bay.floor();
        let key = IVec3::new(bay.floor() as i32, 5, face) + self.key * 31;
        let pick = random3(key, SEED + 5);
        let open = pick.x < 0.62;
        let framed = !(0.06..0.94).contains(&x) || (x * 3.0).fract() < 0.04;
        if !open || framed {
            return Vec3::ZERO;
        }
        if (3.15..3.75).contains(&height) && pick.y > 0.35 {
            return hue(pick.z) * 5.0;
        }
        let pane = smoothstep(0.5, 0.6, height) * smoothstep(3.0, 2.9, height);
        room_colour(key) * (pane * (1.5 + 4.5 * pick.y) * (0.5 + 0.2 * height))
    }
}

/// Warm lamps in most rooms, cool tubes in some.
fn room_colour(key: IVec3) -> Vec3 {
    let pick = random(key, SEED + 6);
    let warm = Vec3::new(1.0, 0.66, 0.34);
    let neutral = Vec3::new(1.0, 0.86, 0.66);
    let cool = Vec3::new(0.70, 0.88, 1.0);
    match pick {
        p if p < 0.55 => warm.lerp(neutral, p / 0.55),
        p if p < 0.80 => neutral,
        _ => cool,
    }
}

/// A saturated colour of a shop sign, `turn` from 0 to 1 around the circle.
fn hue(turn: f32) -> Vec3 {
    let phase = Vec3::new(0.0, 0.33, 0.67) + turn;
    let wave = phase.map(|p| 0.5 + 0.5 * (p * std::f32::consts::TAU).cos());
    0.08 + 0.92 * wave * wave
}
