//! Surfaces of revolution about +Y: the ring, the solid ring and the cup.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Vec2, Vec3};

use super::{Cup, Parts, Ring, SolidRing, Torus};

/// Segments around the axis.
const SEGMENTS: u32 = 256;

/// A point of a profile: (radius, y) and the normal there, in the same half-plane.
#[derive(Clone, Copy)]
struct ProfilePoint {
    at: Vec2,
    normal: Vec2,
}

/// Sweeps a profile around the axis. The profile runs so that the front lies to its right
/// (radius to the right, y up): a rising profile faces outwards.
fn revolve(profile: &[ProfilePoint]) -> Parts {
    let mut parts = Parts::default();
    for segment in 0..SEGMENTS {
        let (sin, cos) = (TAU * segment as f32 / SEGMENTS as f32).sin_cos();
        let in_space = |v: Vec2| Vec3::new(v.x * cos, v.y, -v.x * sin);
        for point in profile {
            parts.vertex(in_space(point.at), in_space(point.normal));
        }
    }
    let rows = profile.len() as u32;
    for segment in 0..SEGMENTS {
        let (here, next) = (segment * rows, (segment + 1) % SEGMENTS * rows);
        for row in 0..rows - 1 {
            // Profile points that coincide with the next one are corners: no surface between them.
            if profile[row as usize].at != profile[row as usize + 1].at {
                parts.quad([here + row, next + row, next + row + 1, here + row + 1]);
            }
        }
    }
    parts
}

/// `count` steps along a straight segment, both ends included.
fn line(from: Vec2, to: Vec2, count: u32) -> Vec<ProfilePoint> {
    let along = (to - from).normalize();
    let normal = Vec2::new(along.y, -along.x);
    (0..=count).map(|i| ProfilePoint { at: from.lerp(to, i as f32 / count as f32), normal }).collect()
}

/// A circular arc; `from_rad` and `to_rad` are the angles of its outward normals, counter-clockwise from +radius.
fn arc(centre: Vec2, radius: f32, from_rad: f32, to_rad: f32, count: u32) -> Vec<ProfilePoint> {
    (0..=count)
        .map(|i| {
            let normal = Vec2::from_angle(from_rad + (to_rad - from_rad) * i as f32 / count as f32);
            ProfilePoint { at: centre + radius * normal, normal }
        })
        .collect()
}

pub(super) fn ring(ring: &Ring) -> Parts {
    // Falling, so that the inside is the front.
    revolve(&line(Vec2::new(ring.radius, ring.height), Vec2::new(ring.radius, 0.0), 16))
}

pub(super) fn torus(torus: &Torus) -> Parts {
    revolve(&arc(Vec2::new(torus.radius, 0.0), torus.tube, 0.0, TAU, 96))
}

pub(super) fn solid_ring(ring: &SolidRing) -> Parts {
    let (half, round) = (0.5 * ring.thickness, 0.3 * ring.thickness);
    let (inner, outer) = (ring.radius - half, ring.radius + half);
    let corner = |r: f32, y: f32, from: f32| arc(Vec2::new(r, y), round, from, from + FRAC_PI_2, 8);
    // Counter-clockwise around the wall's cross-section, from the foot of the outer side.
    let mut profile = line(Vec2::new(outer, round), Vec2::new(outer, ring.height - round), 16);
    profile.extend(corner(outer - round, ring.height - round, 0.0));
    profile.extend(corner(inner + round, ring.height - round, FRAC_PI_2));
    profile.extend(line(Vec2::new(inner, ring.height - round), Vec2::new(inner, round), 16));
    profile.extend(corner(inner + round, round, PI));
    profile.extend(corner(outer - round, round, PI + FRAC_PI_2));
    profile
        .dedup_by(|next, previous| next.at.abs_diff_eq(previous.at, 1e-6) && next.normal.dot(previous.normal) > 0.999);
    let first = profile[0];
    *profile.last_mut().expect("the profile has points") = first;
    revolve(&profile)
}

/// The cup's profile is an ellipse quarter with straight upper walls: a round bottom, inside and outside,
/// on a flat foot.
pub(super) fn cup(cup: &Cup) -> Parts {
    let Cup { radius, height, thickness } = *cup;
    let round = 0.5 * thickness;
    let foot = 0.45 * radius;
    // Outside, from the middle of the foot up to the rim.
    let bend = 0.45 * height;
    let mut profile = line(Vec2::ZERO, Vec2::new(foot, 0.0), 4);
    profile.extend(elliptic_bowl(foot, radius, 0.0, bend, false));
    profile.extend(line(Vec2::new(radius, bend), Vec2::new(radius, height - round), 12));
    profile.extend(arc(Vec2::new(radius - round, height - round), round, 0.0, PI, 12));
    // Inside, down to the middle.
    let (inner, floor) = (radius - thickness, thickness);
    profile.extend(line(Vec2::new(inner, height - round), Vec2::new(inner, bend), 12));
    profile.extend(elliptic_bowl(0.3 * inner, inner, floor, bend, true));
    profile.extend(line(Vec2::new(0.3 * inner, floor), Vec2::new(0.0, floor), 6));
    profile
        .dedup_by(|next, previous| next.at.abs_diff_eq(previous.at, 1e-6) && next.normal.dot(previous.normal) > 0.999);
    revolve(&profile)
}

/// A quarter of an ellipse from (`from_radius`, `bottom`), level, to (`to_radius`, `top`), upright; `inside`
/// runs it downwards, front towards the axis.
fn elliptic_bowl(from_radius: f32, to_radius: f32, bottom: f32, top: f32, inside: bool) -> Vec<ProfilePoint> {
    let semi = Vec2::new(to_radius - from_radius, top - bottom);
    let steps = 24;
    (0..=steps)
        .map(|i| {
            let t = FRAC_PI_2 * i as f32 / steps as f32;
            let t = if inside { FRAC_PI_2 - t } else { t };
            let at = Vec2::new(from_radius + semi.x * t.sin(), top - semi.y * t.cos());
            let outwards = Vec2::new(t.sin() / semi.x, -t.cos() / semi.y).normalize();
            ProfilePoint { at, normal: if inside { -outwards } else { outwards } }
        })
        .collect()
}
