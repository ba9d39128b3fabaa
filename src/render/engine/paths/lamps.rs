//! Lamps that paths meet on their way from surface to surface, and how much of each the paths of a pixel see: a disc is smooth at its
//! edge, and in a mirror that shows it smaller than a pixel.

use glam::Vec3;

use super::{PixelPaths, Source};
use crate::engine::escapes::{Escape, footprints};
use crate::pinhole::{chord_of_sphere, filled_part};
use crate::scene::{Lamp, Medium, Ray};
use crate::tracing::Hit;

/// Paths that pass a lamp at a larger angle, radians, see nothing of it.
const MAX_ANGLE: f32 = 0.25;
/// Full width of what one of a rough mirror's sampled microfacets stands for, radians, for a GGX surface of width 1.
const FACET_BLUR: f32 = 1.5;

/// A path that comes near a lamp.
#[derive(Clone, Copy, Debug)]
pub(super) struct Passing {
    /// Which of the pixel's points it belongs to.
    pub point: u16,
    /// Hash of what it met, and of the lamp.
    key: u64,
    direction: Vec3,
    towards: Vec3,
    chord: f32,
    /// Of the lamp, times the path's throughput.
    radiance: Vec3,
    is_background: bool,
    /// The sides of its footprint, if they are known already.
    sides: Option<[Vec3; 2]>,
}

/// A ray along a path.
pub(super) struct Segment<'a> {
    pub point: u16,
    pub key: u64,
    pub ray: Ray,
    /// Those of the neighbouring points, horizontally and vertically, for rays from the camera.
    pub beside: Option<[Ray; 2]>,
    /// What it meets.
    pub hit: Option<&'a Hit>,
    pub throughput: Vec3,
    /// GGX width of the roughest mirror so far.
    pub alpha: f32,
    /// Through which it runs.
    pub medium: Option<Medium>,
}

/// The lamps that a part of a path passes.
pub(super) fn passed<'a>(lamps: &'a [Lamp], segment: &'a Segment<'a>) -> impl Iterator<Item = Passing> + 'a {
    lamps.iter().zip(1..).filter_map(move |(lamp, number)| {
        let Segment { point, key, ray, beside, hit, throughput, alpha, medium } = segment;
        let direction = ray.direction.normalize();
        let to = lamp.position - ray.origin;
        let distance = to.length();
        if distance <= lamp.radius || hit.is_some_and(|hit| hit.distance * ray.direction.length() < distance) {
            return None;
        }
        let (towards, chord) = (to / distance, chord_of_sphere(lamp.radius / distance));
        let off = direction - towards;
        if off.length_squared() > (chord + MAX_ANGLE + FACET_BLUR * alpha).powi(2) {
            return None;
        }
        let sides = if *alpha > 0.0 {
            let (a, b) = direction.any_orthonormal_pair();
            Some([a, b].map(|side| FACET_BLUR * alpha * side))
        } else {
            let side = |other: Ray| {
                let change = other.direction.normalize() - (lamp.position - other.origin).normalize() - off;
                change - change.dot(direction) * direction
            };
            beside.map(|beside| beside.map(side))
        };
        let passed = medium.map_or(Vec3::ONE, |medium| medium.transmittance(distance));
        Some(Passing {
            point: *point,
            key: key.wrapping_mul(1_000_003) ^ number,
            direction,
            towards,
            chord,
            radiance: passed * *throughput * lamp.radiance_at(ray.origin),
            is_background: *key == 0,
            sides,
        })
    })
}

/// Whether the outline of a lamp runs through a pixel: lamps are so much brighter than what is beside them that such a pixel has to be
/// tone-mapped point by point. The rays are those through its centre, which meets this, and through a corner.
pub(super) fn shows_outline(lamps: &[Lamp], [centre, corner]: [&Ray; 2], hit: Option<&Hit>) -> bool {
    let direction = centre.direction.normalize();
    let turn = corner.direction.normalize().distance(direction);
    lamps.iter().any(|lamp| {
        let to = lamp.position - centre.origin;
        let distance = to.length();
        let is_hidden = hit.is_some_and(|hit| hit.distance * centre.direction.length() < distance - lamp.radius);
        if distance <= lamp.radius || is_hidden {
            return false;
        }
        let off_outline = direction.distance(to / distance) - chord_of_sphere(lamp.radius / distance);
        off_outline.abs() < turn + corner.origin.distance(centre.origin) / distance
    })
}

impl PixelPaths {
    /// Adds the lamps that its paths see; the points of the pixel are `columns` a row.
    pub(super) fn add_lamps(&mut self, passing: &[Passing], columns: u32) {
        let mut by_point = vec![Vec::new(); usize::from(self.points)];
        for (term, lamp) in passing.iter().enumerate() {
            let escape = Escape { term, key: lamp.key, direction: lamp.direction - lamp.towards };
            by_point[usize::from(lamp.point)].push(escape);
        }
        for (index, by_neighbours) in footprints(&by_point, columns as usize) {
            let lamp = &passing[index];
            let sides = lamp.sides.unwrap_or(by_neighbours);
            let part = filled_part(lamp.direction, sides, lamp.towards, lamp.chord);
            if part > 0.0 {
                self.add(lamp.point, part * lamp.radiance, Source::Emitter(Vec3::ONE), lamp.is_background);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A lamp of radius 1 at a distance of 10, and pixels of .01 around its outline.
    #[test]
    fn outlines_run_through_pixels_at_the_edge_of_a_lamp_that_is_seen() {
        let position = Vec3::new(0.0, 0.0, 10.0);
        let lamp =
            Lamp { name: String::new(), position, radius: 1.0, intensity: Vec3::ONE, beam: None, is_distant: false };
        let ray = |x: f32| Ray { origin: Vec3::ZERO, direction: Vec3::new(x, 0.0, 1.0).normalize() };
        let lamps = [lamp];
        let shows = |x: f32, hit: Option<&Hit>| shows_outline(&lamps, [&ray(x), &ray(x + 0.005)], hit);
        let edge = 1.0 / 99f32.sqrt();
        assert!(shows(edge, None) && shows(edge - 0.004, None) && shows(edge + 0.004, None));
        assert!(!shows(0.0, None) && !shows(edge + 0.02, None));
        let wall = |distance: f32| {
            let normal = Vec3::NEG_Z;
            Hit { object: 0, position: Vec3::ZERO, distance, normal, face_normal: normal, front: true }
        };
        assert!(shows(edge, Some(&wall(20.0))) && !shows(edge, Some(&wall(5.0))));
    }
}
