//! Light through leaves: a wood in the sun, seen from a path on its floor.
//!
//! The wood is modelled and its rays are cast: trunks and branches, shells of
//! leaves from the nearest twigs to the far crowns, the floor with flecks of
//! sun, and bright haze. Behind the gaps stand the sky and the sun's glow. The
//! model is this project's own and follows no published one.

mod floor;
mod leaves;
mod trees;

use glam::Vec3;

use trees::Tree;

/// Height of the viewer's eye above the floor, metres.
const EYE: f32 = 1.6;
const SUN_TOWARDS: Vec3 = Vec3::new(0.381, 0.762, 0.524);
/// Distance over which the haze takes about two thirds of the light.
const HAZE_LENGTH: f32 = 42.0;
/// Brightest radiance: the sun glimpsed through a gap.
const SUN_RADIANCE: f32 = 1000.0;

/// What a ray meets first.
struct Hit {
    distance: f32,
    radiance: Vec3,
}

pub struct Forest {
    trees: Vec<Tree>,
}

impl Forest {
    pub fn new() -> Self {
        Self { trees: trees::grow() }
    }

    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let wood = nearer(trees::meet(&self.trees, direction), floor::meet(&self.trees, direction));
        let reach = wood.as_ref().map_or(f32::INFINITY, |hit| hit.distance);
        match nearer(leaves::meet(direction, reach), wood) {
            Some(hit) => through_haze(&hit, direction),
            None => beyond(direction),
        }
    }
}

fn nearer(a: Option<Hit>, b: Option<Hit>) -> Option<Hit> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if a.distance < b.distance { a } else { b }),
        (a, b) => a.or(b),
    }
}

fn angle_from_sun(direction: Vec3) -> f32 {
    direction.angle_between(SUN_TOWARDS)
}

/// How strongly light is scattered forward to the viewer, 0 to 1.
fn forward_scatter(direction: Vec3) -> f32 {
    let cosine = direction.dot(SUN_TOWARDS).max(0.0);
    0.25 * cosine + 0.75 * cosine.powi(10)
}

fn haze(direction: Vec3) -> Vec3 {
    let shade = Vec3::new(0.17, 0.24, 0.13);
    shade + Vec3::new(1.5, 1.35, 0.62) * forward_scatter(direction)
}

fn through_haze(hit: &Hit, direction: Vec3) -> Vec3 {
    let clear = (-hit.distance / HAZE_LENGTH).exp();
    haze(direction).lerp(hit.radiance, clear)
}

/// The sky and the sun behind the wood; low down, woods without end.
fn beyond(direction: Vec3) -> Vec3 {
    let angle = angle_from_sun(direction);
    let sky = Vec3::new(3.4, 4.0, 4.7);
    let aureole = 24.0 * (-angle / 0.16).exp() + 330.0 * (-(angle / 0.055).powi(2)).exp();
    let disc = if angle < 0.020 { SUN_RADIANCE } else { 0.0 };
    let open = sky + Vec3::new(1.0, 0.93, 0.76) * (aureole + disc);
    let open = open.min(Vec3::new(1.0, 0.96, 0.88) * SUN_RADIANCE);
    let height = crate::noise::smoothstep(0.02, 0.30, direction.y);
    (haze(direction) * 1.6).lerp(open, height)
}
