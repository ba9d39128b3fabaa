//! Leaves: flat ones strewn in space, seen where spheres around the viewer cut
//! through them. Near spheres show large dark leaves, far ones fine bright
//! foliage.

use glam::{IVec3, Vec3};

use super::{EYE, Hit, angle_from_sun, forward_scatter};
use crate::noise::{fbm, random, random3, smoothstep};

/// Radii of the spheres, metres, near to far.
const SHELLS: [f32; 12] = [3.0, 4.2, 5.4, 6.8, 8.4, 10.2, 12.4, 15.0, 18.0, 22.0, 28.0, 36.0];
/// Height of the tree tops above the viewer.
const CROWN: f32 = 21.0;
/// Leaves that each cell may hold.
const LEAVES: i32 = 2;

/// One leaf, in cells of its shell.
struct Leaf {
    centre: Vec3,
    along: Vec3,
    across: Vec3,
    length: f32,
    width: f32,
}

/// The first leaf in `direction` nearer than `reach`.
pub fn meet(direction: Vec3, reach: f32) -> Option<Hit> {
    let shells = SHELLS.iter().enumerate();
    shells
        .take_while(|(_, radius)| **radius < reach)
        .find_map(|(index, &radius)| meet_shell(direction, radius, index as u32))
}

fn meet_shell(direction: Vec3, radius: f32, shell: u32) -> Option<Hit> {
    let place = direction * radius;
    let share = share_of_leaves(direction, place, shell);
    if share <= 0.0 {
        return None;
    }
    let size = 0.17 + 0.0145 * radius;
    let point = place / size;
    let base = (point - 0.5).floor().as_ivec3();
    // Leaves stay within reach of the eight nearest cell centres.
    (0..8 * LEAVES).find_map(|k| {
        let cell = base + IVec3::new(k & 1, (k >> 1) & 1, (k >> 2) & 1);
        let seed = 500 + shell * 20 + (k as u32 >> 3) * 10;
        if random(cell, seed) > share {
            return None;
        }
        let side = Leaf::of(cell, seed).side_at(point)?;
        Some(Hit { distance: radius, radiance: shade(direction, place, cell, seed) * side })
    })
}

/// The share of cells that hold a leaf: clumps, under an even crown, above
/// bare stems, with low shrubs at some distance.
fn share_of_leaves(direction: Vec3, place: Vec3, shell: u32) -> f32 {
    let height = place.y + EYE;
    let radius = place.length();
    let crown = smoothstep(2.6, 6.5, height) * smoothstep(CROWN, CROWN - 5.0, height);
    let shrubs = smoothstep(9.0, 14.0, radius) * smoothstep(2.3, 0.3, height);
    if crown.max(shrubs) <= 0.0 {
        return 0.0;
    }
    let clump = fbm(place * 0.36, 3, 77 + shell);
    let crown_share = smoothstep(-0.42, 0.30, clump);
    let shrub_share = smoothstep(-0.15, 0.35, clump);
    let window = 0.38 + 0.62 * smoothstep(0.015, 0.20, angle_from_sun(direction));
    (crown * crown_share * window).max(shrubs * shrub_share)
}

impl Leaf {
    fn of(cell: IVec3, seed: u32) -> Self {
        let jitter = (random3(cell, seed + 1) - 0.5) * 0.6;
        let along = (random3(cell, seed + 2) - 0.5).normalize_or(Vec3::X);
        let other = (random3(cell, seed + 3) - 0.5).normalize_or(Vec3::Y);
        let scale = 0.7 + 0.3 * random(cell, seed + 4);
        Self {
            centre: cell.as_vec3() + 0.5 + jitter,
            along,
            across: along.cross(other).normalize_or(Vec3::Z),
            length: 0.70 * scale,
            width: 0.37 * scale,
        }
    }

    /// None outside; within, the brightness of one or the other half of the
    /// leaf, which its midrib parts.
    fn side_at(&self, point: Vec3) -> Option<f32> {
        let offset = point - self.centre;
        let t = offset.dot(self.along) / self.length;
        let side = offset.dot(self.across);
        let rest = offset - offset.dot(self.along) * self.along;
        let pointed = self.width * (1.0 - t * t) * (1.0 - 0.3 * t);
        let inside = t.abs() < 1.0 && rest.length_squared() < pointed * pointed;
        inside.then_some(if side > 0.0 { 1.0 } else { 0.78 })
    }
}

/// Light from one leaf: a little from all around, more high in the crown, and
/// most where the sun shines through it towards the viewer.
fn shade(direction: Vec3, place: Vec3, cell: IVec3, seed: u32) -> Vec3 {
    let pick = random3(cell, seed + 5);
    let height = place.y + EYE;
    let lit = smoothstep(2.0, 17.0, height);
    let old = Vec3::new(0.16, 0.30, 0.07);
    let young = Vec3::new(0.46, 0.60, 0.10);
    let tint = old.lerp(young, pick.x * pick.x * (0.4 + 0.6 * lit));
    let fleck = if pick.y > 0.90 - 0.25 * lit { 1.0 } else { 0.12 };
    let around = 0.14 + 0.70 * lit * (0.4 + pick.z);
    let shining = (0.7 + 7.0 * forward_scatter(direction)) * fleck * (0.25 + lit);
    tint * (around + shining)
}
