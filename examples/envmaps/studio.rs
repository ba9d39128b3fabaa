//! A dark neutral photo studio with three soft boxes: a large key at the upper
//! left of the view, a cool strip at the right, and a warm fill overhead
//! behind. The rounded room is lit by the boxes, with no bounced light.

use glam::Vec3;

/// Half widths of the room, the floor's depth and the ceiling's height, metres.
const HALF_WIDTH: f32 = 5.0;
const FLOOR: f32 = 1.5;
const CEILING: f32 = 4.2;
/// The room is |x/a|^n + |y/b|^n + |z/a|^n = 1: a box with rounded corners.
const ROUNDNESS: f32 = 7.0;
const FRAME: f32 = 0.035;
const WALL_ALBEDO: f32 = 0.07;

struct SoftBox {
    centre: Vec3,
    facing: Vec3,
    right: Vec3,
    up: Vec3,
    half_size: (f32, f32),
    radiance: Vec3,
}

pub struct Studio {
    boxes: [SoftBox; 3],
}

impl Studio {
    pub fn new() -> Self {
        // The view looks along +Z, so the left of the picture is +X.
        Self {
            boxes: [
                SoftBox::new((2.0, 1.75, 2.1), (1.15, 0.85), (44.0, 41.5, 38.0)),
                SoftBox::new((-2.9, 0.45, 1.3), (0.17, 1.25), (21.0, 24.0, 28.0)),
                SoftBox::new((-0.5, 2.6, -1.9), (0.85, 0.5), (15.5, 13.5, 11.2)),
            ],
        }
    }

    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let seen = self.boxes.iter().find_map(|b| b.seen(direction));
        seen.unwrap_or_else(|| self.room(direction))
    }

    /// The room's surface in a direction, lit by the boxes.
    fn room(&self, direction: Vec3) -> Vec3 {
        let height = if direction.y < 0.0 { FLOOR } else { CEILING };
        let half = Vec3::new(HALF_WIDTH, height, HALF_WIDTH);
        let scaled = direction / half;
        let sum: f32 = scaled.abs().powf(ROUNDNESS).element_sum();
        let distance = sum.powf(-1.0 / ROUNDNESS);
        let outward = scaled.signum() * scaled.abs().powf(ROUNDNESS - 1.0) / half;
        let (place, normal) = (direction * distance, -outward.normalize());
        let light: Vec3 = self.boxes.iter().map(|b| b.irradiance(place, normal)).sum();
        let ambient = Vec3::new(0.20, 0.21, 0.23);
        (light + ambient) * (WALL_ALBEDO / std::f32::consts::PI)
    }
}

impl SoftBox {
    /// A box at `centre` that faces the viewer.
    fn new(centre: (f32, f32, f32), half_size: (f32, f32), radiance: (f32, f32, f32)) -> Self {
        let centre = Vec3::from(centre);
        let facing = -centre.normalize();
        let right = facing.cross(Vec3::Y).normalize();
        Self { centre, facing, right, up: right.cross(facing), half_size, radiance: radiance.into() }
    }

    /// The face, the frame or the stand, if `direction` meets one.
    fn seen(&self, direction: Vec3) -> Option<Vec3> {
        let along = direction.dot(self.facing);
        if along > -0.05 {
            return None;
        }
        let offset = direction * (self.centre.dot(self.facing) / along) - self.centre;
        let x = offset.dot(self.right).abs() - self.half_size.0;
        let y = offset.dot(self.up).abs() - self.half_size.1;
        if x.max(y) > FRAME {
            return self.stand(direction);
        }
        if x.max(y) > 0.0 {
            return Some(self.radiance * 4e-4 + Vec3::splat(0.004));
        }
        Some(self.face(x / self.half_size.0 + 1.0, y / self.half_size.1 + 1.0))
    }

    /// The cloth is brightest before the lamp; `x` and `y` go from 0 at the
    /// middle to 1 at the edge.
    fn face(&self, x: f32, y: f32) -> Vec3 {
        let spread = (-(x * x + y * y) * 0.75).exp();
        let lamp = (-(x * x + y * y) * 9.0).exp();
        let edge = 1.0 - 0.35 * x.powi(8).max(y.powi(8));
        self.radiance * ((0.30 + 0.62 * spread + 0.18 * lamp) * edge)
    }

    /// A thin dark pole from the box down to the floor.
    fn stand(&self, direction: Vec3) -> Option<Vec3> {
        let level = Vec3::new(self.centre.x, 0.0, self.centre.z);
        let reach = level.length();
        let ahead = direction.dot(level) / reach;
        if ahead <= 0.0 {
            return None;
        }
        let at_stand = direction * (reach / ahead);
        let sideways = at_stand.dot(level.cross(Vec3::Y)) / reach;
        let height = at_stand.y;
        let inside = sideways.abs() < 0.018 && height < self.centre.y && height > -FLOOR;
        let sheen = 1.0 - (sideways / 0.018).powi(2);
        inside.then(|| Vec3::splat(0.004 + 0.02 * sheen))
    }

    /// Irradiance at a place with a normal, the box taken as a small emitter.
    fn irradiance(&self, place: Vec3, normal: Vec3) -> Vec3 {
        let way = self.centre - place;
        let area = 4.0 * self.half_size.0 * self.half_size.1;
        let squared = way.length_squared();
        let towards = way / squared.sqrt();
        // Some light leaks round the box, so that no hard shadow edge shows.
        let leaving = (0.5 - 0.5 * towards.dot(self.facing)).powi(2);
        let arriving = (0.15 + 0.85 * towards.dot(normal)).max(0.0);
        self.radiance * (0.6 * area * leaving * arriving / (squared + area))
    }
}
