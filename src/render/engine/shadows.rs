//! Shadows of the environment: which part of the irradiance on surfaces is not occluded.
//!
//! All points share one set of directions towards the light, so that neighbouring points differ smoothly and without noise. A
//! few points of a group trace all of their shadow rays. Directions in which they agree are settled for the whole group, and the
//! others trace only some of them, to check that nothing smaller than the group throws a shadow between its points. Then the
//! group is divided, and the same is done with the directions that are left.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};
use sobol_burley::sample_4d;

use crate::environment::LightSampler;
use crate::lanes::{ALL, LANES, set_bits};
use crate::parallel;
use crate::progress::Progress;
use crate::stages::PreparedLight;
use crate::tracing::{Hit, RayPacket, Tracer};

/// Directions that are drawn by their radiance; a power of two, which keeps the sequence balanced.
const BY_LIGHT: usize = 512;
/// Directions that are spread evenly, for surfaces that face away from most of the light.
const EVEN: usize = 512;
/// Where less than this part of the light arrives, as in a room with a window, few of the directions lead to it: each would show as a
/// shadow of its own.
const ENCLOSED_FRACTION: f32 = 0.15;
/// Times as many directions as usual there.
const ENCLOSED_FACTOR: usize = 4;
/// Scrambles the sequences of directions.
const SEEDS: [u32; 2] = [0x9E37_79B9, 0x85EB_CA6B];
/// Points of a group that trace all of their shadow rays.
const REPRESENTATIVES: usize = LANES;
/// Shadow rays that each of the others traces even where the representatives agree, each time that its group is divided.
const CHECKS: usize = 8;

/// Cosine of the angle around a direction within which a finding is not trusted, if a check says otherwise.
const REFUTED_COSINE: f32 = 0.97;

/// A direction towards the environment.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightDirection {
    /// Unit vector in the world.
    pub direction: Vec3,
    /// Radiance over the density of directions.
    pub radiance: Vec3,
}

/// Finds how much of the environment's light arrives at points of surfaces.
#[derive(Debug)]
pub(super) struct Shadows<'a> {
    directions: Vec<LightDirection>,
    tracer: &'a Tracer,
}

impl<'a> Shadows<'a> {
    /// With as many directions as surfaces need on which much of the light arrives.
    pub fn new(light: &PreparedLight, sampler: &LightSampler, tracer: &'a Tracer) -> Self {
        Self::with_directions(light, sampler, tracer, [BY_LIGHT, EVEN])
    }

    /// With as many directions as surfaces need on which little of the light arrives, see [`is_enclosed`].
    pub fn of_enclosed(light: &PreparedLight, sampler: &LightSampler, tracer: &'a Tracer) -> Self {
        Self::with_directions(light, sampler, tracer, [BY_LIGHT, EVEN].map(|count| ENCLOSED_FACTOR * count))
    }

    /// With about so many directions, most of them by light.
    pub fn of_few(light: &PreparedLight, sampler: &LightSampler, tracer: &'a Tracer, directions: usize) -> Self {
        let by_light = (3 * directions / 4).next_power_of_two();
        Self::with_directions(light, sampler, tracer, [by_light, (directions / 4).max(1)])
    }

    /// With so many directions that are drawn by their radiance, and so many that are spread evenly.
    fn with_directions(
        light: &PreparedLight,
        sampler: &LightSampler,
        tracer: &'a Tracer,
        [by_light, even]: [usize; 2],
    ) -> Self {
        let world_from_light = light.world_from_light();
        let place = |k: usize, seed: u32| {
            let [u, v, ..] = sample_4d(k as u32, 0, seed);
            Vec2::new(u, v)
        };
        let drawn_by_light = (0..by_light).map(|k| sampler.sample(place(k, SEEDS[0])).0);
        let drawn_evenly = (0..even).map(|k| on_sphere(place(k, SEEDS[1])));
        let one = |in_light: Vec3| {
            let density = by_light as f32 * sampler.pdf(in_light) + even as f32 / (4.0 * PI);
            let radiance = light.environment.radiance.radiance(in_light) / density;
            LightDirection { direction: world_from_light * in_light, radiance }
        };
        Self { directions: drawn_by_light.chain(drawn_evenly).map(one).collect(), tracer }
    }

    /// With these directions.
    #[cfg(feature = "gpu")]
    pub fn along(directions: &[LightDirection], tracer: &'a Tracer) -> Self {
        Self { directions: directions.to_vec(), tracer }
    }

    /// The directions of shadow rays.
    pub fn directions(&self) -> &[LightDirection] {
        &self.directions
    }

    /// The part of the irradiance that is not occluded, per channel, at points anywhere: all of their shadow rays are traced.
    pub fn unoccluded_fractions_apart(&self, points: &[&Hit]) -> Vec<Vec3> {
        let nothing_known = vec![None; self.directions.len()];
        parallel::map_chunks(points, LANES, &|points| self.fractions(points, &nothing_known)).concat()
    }

    /// The same at points that are close to each other; 1 at those that are left once it is cancelled.
    pub fn unoccluded_fractions(&self, points: &[&Hit], progress: &dyn Progress) -> Vec<Vec3> {
        let mut fractions = vec![Vec3::ONE; points.len()];
        let everything = Group { members: (0..points.len()).collect(), findings: vec![None; self.directions.len()] };
        let mut groups = vec![everything];
        while let Some(mut group) = groups.pop().filter(|_| !progress.is_cancelled()) {
            let own: Vec<&Hit> = group.members.iter().map(|&index| points[index]).collect();
            if own.len() > LANES {
                self.settle(&own, &mut group.findings);
            }
            if own.len() <= LANES || group.findings.iter().all(Option::is_some) {
                let found = own.chunks(LANES).flat_map(|points| self.fractions(points, &group.findings));
                group.members.iter().zip(found).for_each(|(&index, fraction)| fractions[index] = fraction);
            } else {
                groups.extend(group.quarters(points));
            }
        }
        fractions
    }

    /// Finds out in which of the directions that are not settled yet all points of a group see the same. Directions around those
    /// for which a check says that the representatives do not represent the others stay open.
    fn settle(&self, points: &[&Hit], findings: &mut [Option<bool>]) {
        let representatives = PointPacket::new(&spread(points));
        let open: Vec<usize> = (0..findings.len()).filter(|&index| findings[index].is_none()).collect();
        let agreed = |&index: &usize| Some((index, self.agreed(&representatives, self.directions[index].direction)?));
        let settled: Vec<(usize, bool)> = open.iter().filter_map(agreed).collect();
        let mut refuted: Vec<Vec3> = Vec::new();
        for (k, some) in points.chunks(LANES).enumerate() {
            let some = PointPacket::new(some);
            for check in 0..CHECKS.min(settled.len()) {
                let (index, agreed) = settled[(check * settled.len() / CHECKS + 7 * k) % settled.len()];
                let direction = self.directions[index].direction;
                let facing = some.facing(direction);
                if self.blocked(&some, direction, facing) != if agreed { facing } else { 0 } {
                    refuted.push(direction);
                }
            }
        }
        for (index, agreed) in settled {
            let direction = self.directions[index].direction;
            if refuted.iter().all(|other| other.dot(direction) < REFUTED_COSINE) {
                findings[index] = Some(agreed);
            }
        }
    }

    /// What shadow rays from the points that face a direction find, if all find the same.
    fn agreed(&self, points: &PointPacket, direction: Vec3) -> Option<bool> {
        let facing = points.facing(direction);
        let blocked = self.blocked(points, direction, facing);
        (facing != 0 && (blocked == 0 || blocked == facing)).then_some(blocked != 0)
    }

    /// The part of the irradiance that arrives at up to sixteen points; shadow rays are traced where nothing is known.
    fn fractions(&self, points: &[&Hit], findings: &[Option<bool>]) -> Vec<Vec3> {
        if findings.iter().all(|finding| *finding == Some(false)) {
            return vec![Vec3::ONE; points.len()];
        }
        let packet = PointPacket::new(points);
        let mut sums = vec![(Vec3::ZERO, Vec3::ZERO); points.len()];
        for (light, finding) in self.directions.iter().zip(findings) {
            let facing = packet.facing(light.direction);
            let blocked = match finding {
                Some(false) => 0,
                Some(true) => facing,
                None => self.blocked(&packet, light.direction, facing),
            };
            for lane in set_bits(facing) {
                let irradiance = light.direction.dot(points[lane].normal) * light.radiance;
                let (arriving, all) = &mut sums[lane];
                *all += irradiance;
                if blocked >> lane & 1 == 0 {
                    *arriving += irradiance;
                }
            }
        }
        // Where there is no light, there is no shadow.
        let fraction = |(arriving, all)| Vec3::select(Vec3::cmpgt(all, Vec3::ZERO), arriving / all, Vec3::ONE);
        sums.into_iter().map(fraction).collect()
    }

    /// The lanes, of those asked for, in which a direction is blocked.
    fn blocked(&self, points: &PointPacket, direction: Vec3, lanes: u32) -> u32 {
        if lanes == 0 {
            return 0;
        }
        let directions = direction.to_array().map(|x| [x; LANES]);
        self.tracer.occluded_lanes(&RayPacket {
            origins: points.positions,
            directions,
            ends: [f32::INFINITY; LANES],
            lanes,
        })
    }
}

/// Whether so little of the irradiance arrives at points, by its unoccluded fractions, that more directions are needed.
pub(super) fn is_enclosed(fractions: &[Vec3]) -> bool {
    let sum: f32 = fractions.iter().map(|fraction| fraction.max_element()).sum();
    sum < ENCLOSED_FRACTION * fractions.len() as f32
}

/// Up to sixteen points, component by component.
struct PointPacket {
    positions: [[f32; LANES]; 3],
    normals: [[f32; LANES]; 3],
    /// The lanes that hold points, as bits.
    lanes: u32,
}

impl PointPacket {
    fn new(points: &[&Hit]) -> Self {
        let of = |lane: usize| points[lane.min(points.len() - 1)];
        let load = |value: fn(&Hit) -> Vec3| [0, 1, 2].map(|axis| std::array::from_fn(|lane| value(of(lane))[axis]));
        Self { positions: load(|p| p.position), normals: load(|p| p.normal), lanes: ALL >> (LANES - points.len()) }
    }

    /// The points that face a direction.
    fn facing(&self, direction: Vec3) -> u32 {
        let [x, y, z] = &self.normals;
        let cosine = |lane: usize| x[lane] * direction.x + y[lane] * direction.y + z[lane] * direction.z;
        self.lanes & (0..LANES).fold(0, |bits, lane| bits | u32::from(cosine(lane) > 0.0) << lane)
    }
}

/// A direction on the unit sphere, uniformly.
fn on_sphere(place: Vec2) -> Vec3 {
    let y = 1.0 - 2.0 * place.x;
    let radius = (1.0 - y * y).max(0.0).sqrt();
    let (sin, cos) = (TAU * place.y).sin_cos();
    Vec3::new(radius * cos, y, radius * sin)
}

/// Points of a group as far from each other as they can be: each is the farthest from those before it.
fn spread<'h>(points: &[&'h Hit]) -> Vec<&'h Hit> {
    let centre = points.iter().map(|p| p.position).sum::<Vec3>() / points.len() as f32;
    let mut distances: Vec<f32> = points.iter().map(|p| p.position.distance_squared(centre)).collect();
    let mut chosen: Vec<&Hit> = Vec::with_capacity(REPRESENTATIVES);
    while chosen.len() < REPRESENTATIVES {
        let farthest = (0..points.len()).max_by(|&a, &b| distances[a].total_cmp(&distances[b])).unwrap_or(0);
        let is_first = chosen.is_empty();
        chosen.push(points[farthest]);
        for (distance, point) in distances.iter_mut().zip(points) {
            let own = point.position.distance_squared(points[farthest].position);
            *distance = if is_first { own } else { distance.min(own) };
        }
    }
    chosen
}

/// Points whose shadows are found together.
struct Group {
    /// Indices of the points.
    members: Vec<usize>,
    /// For each direction: whether it is blocked for all points; `None` where they differ, or nothing is known.
    findings: Vec<Option<bool>>,
}

impl Group {
    fn quarters(self, points: &[&Hit]) -> impl Iterator<Item = Self> {
        let halves = halves(points, self.members).map(|half| halves(points, half));
        let findings = self.findings;
        halves.into_iter().flatten().map(move |members| Self { members, findings: findings.clone() })
    }
}

/// Indices of points cut in two across the points' longest extent.
fn halves(points: &[&Hit], mut members: Vec<usize>) -> [Vec<usize>; 2] {
    let positions = || members.iter().map(|&index| points[index].position);
    let (low, high) = (positions().fold(Vec3::INFINITY, Vec3::min), positions().fold(Vec3::NEG_INFINITY, Vec3::max));
    let axis = (high - low).max_position();
    members.sort_by(|&a, &b| points[a].position[axis].total_cmp(&points[b].position[axis]));
    let second = members.split_off(members.len() / 2);
    [members, second]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(position: Vec3) -> Hit {
        Hit { object: 0, position, distance: 1.0, normal: Vec3::Y, face_normal: Vec3::Y, front: true }
    }

    #[test]
    fn representatives_include_the_corners() {
        let hits: Vec<Hit> = (0..64).map(|k| at(Vec3::new((k % 8) as f32, 0.0, (k / 8) as f32))).collect();
        let chosen = spread(&hits.iter().collect::<Vec<_>>());
        assert_eq!(chosen.len(), REPRESENTATIVES);
        for corner in [Vec3::ZERO, Vec3::X * 7.0, Vec3::Z * 7.0, Vec3::new(7.0, 0.0, 7.0)] {
            assert!(chosen.iter().any(|hit| hit.position == corner), "{corner}");
        }
        let nearest = |hit: &Hit| chosen.iter().map(|c| c.position.distance(hit.position)).fold(f32::MAX, f32::min);
        assert!(hits.iter().all(|hit| nearest(hit) < 3.0));
    }

    #[test]
    fn groups_are_cut_across_their_longest_extent() {
        let hits: Vec<Hit> = (0..6).map(|k| at(Vec3::new((k % 2) as f32, 0.0, (k / 2) as f32))).collect();
        let [near, far] = halves(&hits.iter().collect::<Vec<_>>(), (0..6).collect());
        assert_eq!((near.len(), far.len()), (3, 3));
        let highest = near.iter().map(|&k| hits[k].position.z).fold(0.0, f32::max);
        assert!(far.iter().all(|&k| hits[k].position.z >= highest));
    }
}
