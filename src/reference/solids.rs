//! Light through closed objects: refracted where it enters and, one straight way further, where it leaves (chain `TT`), or through two of them
//! (chain `TTTT`). Followed backwards, from the receiver; with bounds from which the density of points is made.

use std::f64::consts::PI;

use glam::DVec3;

use super::cone::Cone;
use super::domain::Receiver;
use super::reflector_light::{Numbers, Point};
use super::reflectors::Reflectors;
use super::refraction::{Interface, refract};
use super::seen::{Corner, Seen};
use super::tree::Bounds;
use crate::scene::Visibility;

/// Rays are followed from places so near to the corners of a triangle, in its extent: at edges they would meet its neighbours.
const TO_CORNERS: f64 = 0.95;
/// Where none of these rays comes through, and the triangle and its normals span less than this, radians, nothing else is likely to.
const SMALL: f64 = 0.2;
/// Triangles whose light leaves the object within this angle, radians, are bounded by where it goes;
const NARROW: f64 = 0.4;
/// so many times as widely, because they bend it,
const MARGIN: f64 = 1.5;
/// and with this part of the brightest light in addition, because they may have edges between their corners;
const UNFORESEEN: f64 = 1e-3;
/// of lamps, however small they are, with the mean radiance that this part of their light would have from all directions.
const UNFORESEEN_OF_LAMPS: f64 = 0.05;

/// A ray that has left a closed object, backwards along the light.
struct Left {
    point: Point,
    direction: DVec3,
    /// The part of the light that passes both interfaces.
    passed: f64,
}

impl Reflectors<'_> {
    /// What a point of a closed object sends to a receiver in front of it of light that is refracted twice or four times, W/(m²·sr).
    pub(super) fn light_through_solid(&self, interface: &Interface, entry: &Point, numbers: Numbers) -> DVec3 {
        let is_followed = self.follows_two_solids;
        if !self.chains.refracted_twice && !is_followed {
            return DVec3::ZERO;
        }
        let light = |channel: usize| {
            let Some(left) = self.leave(interface, entry, interface.index(channel)) else { return DVec3::ZERO };
            let mut light = DVec3::ZERO;
            if self.chains.refracted_twice {
                light += self.light_from(&left.point, left.direction, numbers);
            }
            if is_followed && let Some(second) = self.leave_another(&left, channel) {
                light += second.passed * self.light_from(&second.point, second.direction, numbers);
            }
            left.passed * light
        };
        if interface.indices().len() == 1 && !is_followed {
            return light(0);
        }
        DVec3::from_array([0, 1, 2].map(|channel| light(channel)[channel]))
    }

    /// Follows a ray that has left a closed object through another one; `None` where it meets none or where nothing comes through.
    fn leave_another(&self, left: &Left, channel: usize) -> Option<Left> {
        let towards = left.direction;
        let hit = self.geometry.first_hit_of(left.point.position, towards, |id| id != left.point.id)?;
        let triangle = &self.geometry.triangles[hit.triangle as usize];
        let interface = self.closed_interface(triangle.object)?;
        let (position, normal) = (triangle.position(hit.barycentric), triangle.normal(hit.barycentric));
        let cosine = towards.dot(normal);
        // From the front.
        let entry = Point { id: hit.triangle, position, normal, towards, cosine };
        if cosine < 0.0 { self.leave(&interface, &entry, interface.index(channel)) } else { None }
    }

    /// Follows a ray from a receiver through an object; `None` where nothing comes through.
    fn leave(&self, interface: &Interface, entry: &Point, eta: f64) -> Option<Left> {
        let passed = interface.passed_from_front(-entry.cosine, eta);
        if passed == 0.0 {
            return None;
        }
        // Into the object, whose index is that behind the interface.
        let inside = refract(entry.towards, -entry.normal, 1.0 / eta);
        let object = self.geometry.triangles[entry.id as usize].object;
        let is_in_the_way = |id: u32| {
            let other = self.geometry.triangles[id as usize].object;
            id != entry.id && (other == object || self.visibility == Visibility::Full)
        };
        let hit = self.geometry.first_hit_of(entry.position, inside, is_in_the_way)?;
        let exit = &self.geometry.triangles[hit.triangle as usize];
        if exit.object != object {
            return None;
        }
        let (position, normal) = (exit.position(hit.barycentric), exit.normal(hit.barycentric));
        let cosine = inside.dot(normal);
        if cosine <= 0.0 {
            return None;
        }
        // The n² of radiance of one interface is undone by the other.
        let passed = passed * interface.factor(cosine, eta) / (eta * eta);
        let point = Point { id: hit.triangle, position, normal, towards: inside, cosine };
        (passed > 0.0).then(|| Left { point, direction: refract(inside, normal, eta), passed })
    }

    /// About the largest sum of the channels that a region of a closed object sends to a receiver by two refractions, over the attenuation.
    /// No bound between rays that were not followed, but positive wherever light may come from.
    pub(super) fn bound_through_solid(&self, interface: &Interface, seen: &Seen, receiver: &Receiver) -> f64 {
        let Seen { bounds, towards, received, .. } = seen;
        if !self.chains.refracted_twice && !self.follows_two_solids {
            return 0.0;
        }
        let facing = bounds.normals.largest_cosine(-towards.axis, towards.half_angle);
        let cosines = seen.cosines_on_one_side(facing, receiver).min(received * facing);
        if cosines == 0.0 {
            return 0.0;
        }
        let light = |eta: &f64| match self.foreseen_light(interface, (seen, receiver), *eta) {
            // What another object does to it is not foreseen.
            Some(foreseen) if !self.follows_two_solids => foreseen + self.unforeseen_light(bounds),
            _ => self.light_within(bounds, &Cone::everything()),
        };
        let light: f64 = interface.indices().iter().map(light).sum();
        cosines * light * self.most_transmittance(seen)
    }

    /// Some light from everywhere.
    fn unforeseen_light(&self, bounds: &Bounds) -> f64 {
        let of_lamps = self.lamps.bound_of_irradiance((bounds.centre, bounds.radius), &Cone::everything()) / PI;
        UNFORESEEN * (self.brightest + self.surfaces.brightest) + UNFORESEEN_OF_LAMPS * of_lamps
    }

    /// About the largest light around what leaves the object for the corners of a small triangle.
    fn foreseen_light(&self, interface: &Interface, (seen, receiver): (&Seen, &Receiver), eta: f64) -> Option<f64> {
        let (corners, id) = (seen.corners.as_ref()?, seen.triangle?);
        let middle = corners.iter().map(|corner| corner.offset).sum::<DVec3>() / 3.0;
        let of_corner = |corner: &Corner| {
            let offset = middle.lerp(corner.offset, TO_CORNERS);
            let towards = offset.normalize();
            let (position, cosine) = (receiver.position + offset, towards.dot(corner.normal));
            let entry = Point { id, position, normal: corner.normal, towards, cosine };
            self.leave(interface, &entry, eta)
        };
        let left: Vec<Left> = corners.iter().filter_map(of_corner).collect();
        if left.len() < 3 {
            let spanned = seen.towards.half_angle + seen.bounds.normals.half_angle;
            return (left.is_empty() && spanned < SMALL).then_some(0.0);
        }
        let around = Cone::around(&[left[0].direction, left[1].direction, left[2].direction]);
        if around.half_angle > NARROW {
            return None;
        }
        let cone = Cone { half_angle: MARGIN * around.half_angle + seen.swing, ..around };
        let centre = left.iter().map(|ray| ray.point.position).sum::<DVec3>() / 3.0;
        let radius = left.iter().map(|ray| ray.point.position.distance(centre)).fold(0.0, f64::max);
        Some(self.light_within(&Bounds { centre, radius: MARGIN * radius, ..seen.bounds }, &cone))
    }
}
