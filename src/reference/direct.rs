//! Light without a mirror: from the environment and from lamps.
//!
//! The regions of a lamp tile the unit disc, which stands for the disc that the lamp looks like from the receiver.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::domain::{Domain, Fineness, Lighting, ON_SURFACES, Place, Receiver};
use super::lamps::{Lamps, Source};
use super::sky::{self, Sky};
use crate::scene::Visibility;

/// The environment, and the lamps before it.
pub(super) struct Direct<'a> {
    pub sky: Sky<'a>,
    pub lamps: &'a Lamps,
}

/// A box of directions to the environment, or a part of a lamp.
#[derive(Clone, Copy)]
pub(super) enum Region {
    Sky(sky::Region),
    Lamp(Part),
}

/// A part of a unit disc: all points whose squared radii, and whose parts of a turn, lie between these.
#[derive(Clone, Copy)]
pub(super) struct Part {
    lamp: u32,
    squares: [f64; 2],
    turns: [f64; 2],
    depth: u8,
    path: u64,
}

const MAX_DEPTH: u8 = 12;

impl Part {
    fn halves(&self) -> [Self; 2] {
        let between = |[a, b]: [f64; 2]| [[a, 0.5 * (a + b)], [0.5 * (a + b), b]];
        [0, 1].map(|k| {
            let (mut squares, mut turns) = (self.squares, self.turns);
            let halved = if self.depth.is_multiple_of(2) { &mut turns } else { &mut squares };
            *halved = between(*halved)[k];
            Self { squares, turns, depth: self.depth + 1, path: self.path << 1 | k as u64, ..*self }
        })
    }

    fn measure(&self) -> f64 {
        PI * (self.squares[1] - self.squares[0]) * (self.turns[1] - self.turns[0])
    }
}

impl Direct<'_> {
    fn lamp(&self, part: &Part) -> &Source {
        &self.lamps.sources()[part.lamp as usize]
    }

    fn arriving_from(&self, part: &Part, [u, v]: [f64; 2], receiver: &Receiver) -> DVec3 {
        let lamp = self.lamp(part);
        let to = lamp.position - receiver.position;
        let distance = to.length();
        let sine = lamp.radius / distance;
        if sine >= 1.0 {
            return DVec3::ZERO;
        }
        // The disc in which the cone around the sphere touches it.
        let axis = to / distance;
        let (across, around) = axis.any_orthonormal_pair();
        let disc_radius = lamp.radius * (1.0 - sine * sine).sqrt();
        let between = |[a, b]: [f64; 2], t: f64| a + (b - a) * t;
        let (radius, turn) = (disc_radius * between(part.squares, u).sqrt(), TAU * between(part.turns, v));
        let point = to - lamp.radius * sine * axis + radius * (turn.cos() * across + turn.sin() * around);
        let squared = point.length_squared();
        let direction = point / squared.sqrt();
        let received = receiver.received(direction);
        if received <= 0.0
            || self.sky.visibility == Visibility::Full
                && self.sky.geometry.blocks_segment(
                    receiver.position,
                    receiver.position + point,
                    [receiver.triangle(); 2],
                )
        {
            return DVec3::ZERO;
        }
        let per_measure = received * direction.dot(axis) * disc_radius * disc_radius / squared;
        lamp.radiance_at(receiver.position) * per_measure
    }
}

impl Domain for Direct<'_> {
    type Region = Region;
    type Receiver = Receiver;

    fn fineness(&self) -> Fineness {
        ON_SURFACES
    }

    fn roots(&self, visit: &mut dyn FnMut(Region)) {
        self.sky.roots(&mut |root| visit(Region::Sky(root)));
        for lamp in 0..self.lamps.sources().len() as u32 {
            visit(Region::Lamp(Part { lamp, squares: [0.0, 1.0], turns: [0.0, 1.0], depth: 0, path: 0 }));
        }
    }

    fn measure(&self, region: &Region) -> f64 {
        match region {
            Region::Sky(region) => self.sky.measure(region),
            Region::Lamp(part) => part.measure(),
        }
    }

    fn bound(&self, region: &Region, receiver: &Receiver) -> f64 {
        let part = match region {
            Region::Sky(region) => return self.sky.bound(region, receiver),
            Region::Lamp(part) => part,
        };
        let lamp = self.lamp(part);
        let points = (receiver.position, receiver.half_length());
        let received = receiver.most_received(&lamp.seen_from(points));
        let (brightest, nearest) = match receiver.place {
            Place::Surface { .. } => {
                (lamp.radiance_at(receiver.position).element_sum(), lamp.position.distance(receiver.position))
            }
            // Some points of a piece may lie in the lamp; next to it the disc is too near for any bound.
            Place::Medium { half_length, .. } => {
                let least = lamp.radius + 0.25 * half_length.min(lamp.radius);
                (lamp.brightest_at(points), receiver.distance(lamp.position).max(least * (1.0 + 1e-9)))
            }
        };
        let sine = lamp.radius / nearest;
        if sine >= 1.0 {
            return 0.0;
        }
        // The nearest point of the disc is its middle.
        received * brightest * sine * sine / (1.0 - sine * sine)
    }

    fn split(&self, region: &Region, receiver: &Receiver, visit: &mut dyn FnMut(Region)) {
        match region {
            Region::Sky(region) => self.sky.split(region, receiver, &mut |part| visit(Region::Sky(part))),
            Region::Lamp(part) if part.depth < MAX_DEPTH => {
                part.halves().into_iter().for_each(|half| visit(Region::Lamp(half)));
            }
            Region::Lamp(_) => {}
        }
    }

    fn order(&self, region: &Region) -> u64 {
        match region {
            Region::Sky(region) => self.sky.order(region),
            Region::Lamp(part) => 1 << 63 | u64::from(part.lamp) << MAX_DEPTH | part.path << (MAX_DEPTH - part.depth),
        }
    }

    fn needs_all_numbers(&self) -> bool {
        false
    }

    fn integrand(&self, region: &Region, u: [f64; 8], receiver: &Receiver) -> DVec3 {
        match region {
            Region::Sky(region) => self.sky.integrand(region, u, receiver),
            Region::Lamp(part) => self.arriving_from(part, [u[1], u[2]], receiver),
        }
    }
}

impl Lighting for Direct<'_> {
    fn angles(&self, region: &Region, piece: &Receiver) -> [f64; 2] {
        let part = match region {
            Region::Sky(region) => return self.sky.angles(region, piece),
            Region::Lamp(part) => part,
        };
        let lamp = self.lamp(part);
        let distance = piece.distance(lamp.position).max(lamp.radius);
        [0.5 * lamp.radius * part.measure().sqrt() / distance, piece.half_length() / distance]
    }
}
