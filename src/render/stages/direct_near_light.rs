//! The direct light of lamps and of near emitters on surfaces, with soft shadows.

use std::f32::consts::TAU;
use std::ops::{AddAssign, Mul};

use glam::{Vec2, Vec3};

use super::PreparedLight;
use super::near_emitters::{EmitterPart, NearEmitter, NearEmitters};
use crate::brdf::Materials;
use crate::lanes::{ALL, LANES, set_bits};
use crate::pinhole::{chord_of_sphere, solid_angle_of};

use crate::scene::{Lamp, Medium};
use crate::tracing::{Hit, RayPacket, Tracer};

/// Shadow rays towards a lamp: first so many,
const FIRST_RAYS: usize = LANES;
/// and where some of them are blocked and others not, so many in all.
const RAYS: usize = 4 * LANES;

/// The direct light of lamps and near emitters.
#[derive(Debug)]
pub(crate) struct DirectNearLight<'a> {
    lamps: &'a [Lamp],
    /// With the factor on their radiance.
    emitters: Option<(&'a NearEmitters, f32)>,
    /// Whether emitters are divided into few parts.
    is_coarse: bool,
    medium: Option<Medium>,
    /// What throws shadows, if anything does.
    tracer: Option<&'a Tracer>,
}

/// A lamp above a receiver.
struct Seen<'a> {
    lamp: &'a Lamp,
    towards: Vec3,
    chord: f32,
}

/// Means over the directions of a lamp.
#[derive(Clone, Copy, Debug, Default)]
struct Means<T> {
    /// Over all of them,
    all: T,
    /// and with zero for those in which the lamp is hidden.
    open: T,
}

impl<'a> DirectNearLight<'a> {
    pub fn new(light: &'a PreparedLight, tracer: Option<&'a Tracer>) -> Self {
        let emitters = light.near_emitters.as_ref().map(|(emitters, factor)| (&**emitters, *factor));
        Self { lamps: &light.lamps, emitters, is_coarse: false, medium: light.medium, tracer }
    }

    /// The same from fewer parts of emitters, for what is seen in mirrors.
    pub fn coarse(light: &'a PreparedLight, tracer: Option<&'a Tracer>) -> Self {
        Self { is_coarse: true, ..Self::new(light, tracer) }
    }

    pub fn is_dark(&self) -> bool {
        self.lamps.is_empty() && self.emitters.is_none()
    }

    /// Irradiance, W/m².
    pub fn irradiance(&self, point: &Hit) -> Vec3 {
        let of_lamp = |seen: Seen| {
            let Means { all, open } = self.means(&seen, point, |direction| direction.dot(point.normal).max(0.0));
            if seen.is_whole(point) && all > 0.0 {
                // What arrives without shadows is known exactly.
                let cosine = seen.towards.dot(point.normal);
                return open / all * cosine * self.passed(&seen, point) * seen.lamp.irradiance_at(point.position);
            }
            open * solid_angle_of(seen.chord) * self.passed(&seen, point) * seen.lamp.radiance_at(point.position)
        };
        let of_lamps: Vec3 = self.above(point).map(of_lamp).sum();
        of_lamps + self.of_emitters(point, |direction| Vec3::splat(direction.dot(point.normal).max(0.0)))
    }

    /// Radiance that a glossy receiver reflects in a unit direction, W/(m²·sr).
    pub fn reflected(&self, materials: &Materials, hit: &Hit, view: Vec3) -> Vec3 {
        let of_lamp = |seen: Seen| {
            let radiance = self.passed(&seen, hit) * seen.lamp.radiance_at(hit.position) * solid_angle_of(seen.chord);
            let reflected = |direction: Vec3| {
                let cosine = direction.dot(hit.normal).max(0.0);
                cosine * materials.value(hit.object, hit.normal, direction, view, 0.0)
            };
            radiance * self.means(&seen, hit, reflected).open
        };
        let of_lamps: Vec3 = self.above(hit).map(of_lamp).sum();
        let reflected = |direction: Vec3| {
            let cosine = direction.dot(hit.normal).max(0.0);
            if cosine > 0.0 {
                cosine * materials.value(hit.object, hit.normal, direction, view, 0.0)
            } else {
                Vec3::ZERO
            }
        };
        of_lamps + self.of_emitters(hit, reflected)
    }

    /// The sum over the parts of all near emitters of radiance × solid angle × a factor by direction.
    fn of_emitters(&self, point: &Hit, factor: impl Fn(Vec3) -> Vec3) -> Vec3 {
        let Some((near, brightness)) = self.emitters else { return Vec3::ZERO };
        let of_emitter =
            |emitter: &NearEmitter| brightness * emitter.radiance * self.of_emitter(emitter, point, &factor);
        near.emitters.iter().map(of_emitter).sum()
    }

    fn of_emitter(&self, emitter: &NearEmitter, point: &Hit, factor: impl Fn(Vec3) -> Vec3) -> Vec3 {
        let lit = emitter.parts_from(point.position, self.is_coarse).filter_map(|part| {
            let value = part.solid_angle * factor(part.direction);
            (value != Vec3::ZERO).then_some((part, value))
        });
        let lit: Vec<(EmitterPart, Vec3)> = lit.collect();
        let of_packet = |packet: &[(EmitterPart, Vec3)]| -> Vec3 {
            let passed = |lane: usize| {
                let (part, value) = packet[lane];
                value * self.medium.map_or(Vec3::ONE, |medium| medium.transmittance(part.distance))
            };
            set_bits(self.open_parts(packet, point)).map(passed).sum()
        };
        lit.chunks(LANES).map(of_packet).sum()
    }

    /// The lanes, of up to sixteen, in which nothing lies before a part of an emitter.
    fn open_parts(&self, parts: &[(EmitterPart, Vec3)], point: &Hit) -> u32 {
        let lanes = u32::MAX >> (32 - parts.len());
        let Some(tracer) = self.tracer else { return lanes };
        let part = |lane: usize| parts[lane.min(parts.len() - 1)].0;
        let origins = point.position.to_array().map(|x| [x; LANES]);
        let directions = [0, 1, 2].map(|axis| std::array::from_fn(|lane| part(lane).direction[axis]));
        let ends = std::array::from_fn(|lane| part(lane).distance);
        lanes & !tracer.occluded_lanes(&RayPacket { origins, directions, ends, lanes })
    }

    /// The part of a lamp's light that comes through the medium.
    fn passed(&self, seen: &Seen, point: &Hit) -> Vec3 {
        self.medium.map_or(Vec3::ONE, |medium| medium.transmittance(seen.lamp.position.distance(point.position)))
    }

    /// The lamps of which any part is above a receiver.
    fn above(&self, point: &Hit) -> impl Iterator<Item = Seen<'a>> {
        let (position, normal) = (point.position, point.normal);
        self.lamps.iter().filter_map(move |lamp| {
            let to = lamp.position - position;
            let distance = to.length();
            let is_above = to.dot(normal) > -lamp.radius && distance > lamp.radius;
            is_above.then(|| Seen { lamp, towards: to / distance, chord: chord_of_sphere(lamp.radius / distance) })
        })
    }

    /// The means of a factor over a lamp's directions.
    fn means<T>(&self, seen: &Seen, point: &Hit, factor: impl Fn(Vec3) -> T) -> Means<T>
    where
        T: Default + AddAssign + Mul<f32, Output = T> + Copy,
    {
        let frame = seen.towards.any_orthonormal_pair();
        let packet = |means: &mut Means<T>, first: usize, count: usize| {
            let directions = std::array::from_fn(|lane| seen.direction(frame, first + lane, count));
            let open = self.open_lanes(seen, point, &directions);
            means.add(directions.map(|direction| factor(direction) * (1.0 / count as f32)), open);
            open
        };
        let mut few = Means::default();
        let open = packet(&mut few, 0, FIRST_RAYS);
        if open == ALL || open == 0 {
            return few;
        }
        let mut more = Means::default();
        for first in (0..RAYS).step_by(LANES) {
            packet(&mut more, first, RAYS);
        }
        more
    }

    /// The directions in which nothing lies before the lamp.
    fn open_lanes(&self, seen: &Seen, point: &Hit, directions: &[Vec3; LANES]) -> u32 {
        let Some(tracer) = self.tracer else { return ALL };
        let distance = seen.lamp.position.distance(point.position);
        ALL & !tracer.hidden_lanes(point.position, directions, distance)
    }
}

impl<T: AddAssign + Copy> Means<T> {
    fn add(&mut self, values: [T; LANES], open: u32) {
        for (lane, value) in values.into_iter().enumerate() {
            self.all += value;
            if open >> lane & 1 != 0 {
                self.open += value;
            }
        }
    }
}

impl Seen<'_> {
    /// Whether all of it is above a receiver.
    fn is_whole(&self, point: &Hit) -> bool {
        (self.lamp.position - point.position).dot(point.normal) >= self.lamp.radius
    }

    /// One of so many directions that are spread evenly over the disc, along Vogel's spiral.
    fn direction(&self, (across, around): (Vec3, Vec3), k: usize, count: usize) -> Vec3 {
        const GOLDEN_TURN: f32 = 0.381_966;
        let chord = self.chord * ((k as f32 + 0.5) / count as f32).sqrt();
        let turn = TAU * (k as f32 * GOLDEN_TURN).fract();
        // Lambert's projection, backwards.
        let from_axis = chord * (1.0 - 0.25 * chord * chord).sqrt();
        let place = from_axis * Vec2::from_angle(turn);
        (1.0 - 0.5 * chord * chord) * self.towards + place.x * across + place.y * around
    }
}
