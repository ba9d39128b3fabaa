//! What a lamp adds to a sum: the part of a cell's footprint that its disc fills, instead of a look-up in the environment.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Vec3, Vec4};

use super::filters::FootprintSides;
use super::pair::ReceiverCellPair;
use super::receiver::NO_OBJECT;
use super::visibility::VisibilityMap;
use crate::environment::Bound;
use crate::lanes::{ALL, F, LANES, Select, Simd, SimdBase, SimdFloat, V3, bits, lanes, set_bits, splat, splat3};
use crate::pinhole::cell_shapes::EvenSides;
use crate::pinhole::constants::{BLUR_RADIUS, FOOTPRINT_BEND, FOOTPRINT_RADIUS, LOBE_TAIL_WIDTH};
use crate::pinhole::disc::{chord_of_sphere, softly_filled_part, solid_angle_of};
use crate::pinhole::{CellShapes, PinholeParts};
use crate::scene::Lamp;

/// Widths of a rough mirror's lobe within which lamps are seen in it.
const TAIL_REACH: f32 = 0.75 * LOBE_TAIL_WIDTH;

/// A lamp, as sums see it.
#[derive(Clone, Copy, Debug)]
pub(super) struct LampLight<'a> {
    lamp: &'a Lamp,
    shapes: CellShapes,
    /// The largest radiance of any channel from anywhere.
    pub max_radiance: f32,
}

/// A lamp, seen from a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Unit vector.
    pub towards: Vec3,
    pub distance: f32,
    /// As in [`softly_filled_part`].
    pub chord: f32,
}

impl<'a> LampLight<'a> {
    pub fn new(lamp: &'a Lamp, shapes: CellShapes) -> Self {
        Self { lamp, shapes, max_radiance: lamp.max_radiance() }
    }

    /// From a point to the lamp, metres.
    pub fn offset_from(&self, point: Vec3) -> Vec3 {
        self.lamp.position - point
    }

    /// The lamp, seen from a point.
    #[inline]
    pub fn seen_from(&self, point: Vec3) -> Seen {
        let to = self.offset_from(point);
        let distance = to.length().max(f32::MIN_POSITIVE);
        let chord = chord_of_sphere((self.lamp.radius / distance).min(1.0));
        Seen { towards: to / distance, distance, chord }
    }

    /// Directions from any point of a cell to any point of the lamp are at most this far from that of the centres, radians.
    #[inline]
    pub fn spread(&self, cell: &PinholeParts, radius: f32) -> f32 {
        let distance = self.offset_from(cell.position).length();
        let nearest = distance - radius;
        let sine = (radius + self.lamp.radius) / nearest;
        // An arc is at most π/2 times its sine.
        if nearest > 0.0 && sine < 1.0 { sine * FRAC_PI_2 } else { PI }
    }

    /// How much farther than the footprint of a cell its blur reaches.
    pub fn blurred_reach(&self, cell: &PinholeParts) -> f32 {
        self.shapes.blurred_reach(cell.area)
    }

    /// How large a cell is for the lamp: its extent over their distance.
    pub fn relative_size(&self, cell: &PinholeParts, extent: f32) -> f32 {
        extent / self.offset_from(cell.position).length().max(f32::MIN_POSITIVE)
    }

    /// How the direction to the lamp turns along a side of a cell, for what is seen in a unit direction.
    pub fn parallax(seen: &Seen, direction: Vec3, side: Vec3) -> Vec3 {
        (side - side.dot(direction) * direction) / seen.distance
    }

    /// The footprint of directions to points at the lamp's distance, without a lobe: what is reflected turns along a cell, and the lamp
    /// is seen from another place.
    #[inline(always)]
    fn sharp_footprint<S: Simd>(
        simd: S,
        sample: &PinholeParts,
        pair: &ReceiverCellPair<S>,
        seen: &Seen,
    ) -> FootprintSides<S> {
        let inverse = 1.0 / seen.distance;
        let sharp = pair.sharp_footprint(simd, sample);
        let [v1, v2] = sample.sides;
        let (v1, v2) = (splat3(simd, v1 * inverse), splat3(simd, v2 * inverse));
        FootprintSides {
            r: sharp.r,
            v1: sharp.v1 + v1.plus(sharp.r, -v1.dot(sharp.r)),
            v2: sharp.v2 + v2.plus(sharp.r, -v2.dot(sharp.r)),
        }
    }

    /// The same with the bend of the surface, and along parts of rays.
    #[inline(always)]
    fn footprint<S: Simd>(
        simd: S,
        sample: &PinholeParts,
        pair: &ReceiverCellPair<S>,
        seen: &Seen,
    ) -> FootprintSides<S> {
        let sharp = Self::sharp_footprint(simd, sample, pair, seen);
        pair.widened(simd, sharp, pair.turn_along_segment(simd), sample.lobe)
    }

    /// Whether the map of what a place sees leaves in doubt that it sees the whole lamp, or nothing of it: by its centre and places at its edge.
    pub fn is_partly_seen<S: Simd>(&self, simd: S, place: Vec3, map: &VisibilityMap) -> bool {
        let to = self.offset_from(place);
        let (u, v) = to.normalize_or_zero().any_orthonormal_pair();
        let at = |lane: usize| {
            let (sine, cosine) = (lane as f32 * (TAU / (LANES - 1) as f32)).sin_cos();
            let off = if lane == 0 { Vec3::ZERO } else { cosine * u + sine * v };
            to + self.lamp.radius * off
        };
        let places: [Vec3; LANES] = std::array::from_fn(at);
        let component = |axis: usize| lanes(simd, places.map(|place| place[axis]));
        let towards = V3([component(0), component(1), component(2)]);
        let (fraction, doubtful) = map.visible_fraction(simd, towards, Some(&[NO_OBJECT; LANES]), ALL);
        // Interpolation may round.
        doubtful != 0 || fraction.iter().any(|part| (part - fraction[0]).abs() > 1e-4 || (1e-4..0.9999).contains(part))
    }

    /// At most the part of a cell's footprint that the lamp fills.
    #[inline(always)]
    pub fn max_part<S: Simd>(&self, simd: S, sample: &PinholeParts, pair: &ReceiverCellPair<S>) -> F<S> {
        let seen = self.seen_from(sample.position);
        let FootprintSides { v1: a, v2: b, .. } = Self::footprint(simd, sample, pair, &seen);
        let across = a.cross(b);
        let area = across.dot(across).sqrt().max(f32::MIN_POSITIVE);
        (splat(simd, solid_angle_of(seen.chord)) / area).min(1.0)
    }

    /// At most the part of a segment of a ray, along which the light turns so far, from which any point of a cell mirrors the lamp.
    #[inline(always)]
    pub fn max_part_of_segment<S: Simd>(
        &self,
        simd: S,
        sample: &PinholeParts,
        pair: &ReceiverCellPair<S>,
        turn: F<S>,
    ) -> F<S> {
        let seen = self.seen_from(sample.position);
        let sharp = Self::sharp_footprint(simd, sample, pair, &seen);
        // Its disc is blurred.
        let width = (sharp.squares().sqrt() * (0.5 * (self.blurred_reach(sample) - 1.0)) + seen.chord) * 2.0;
        (width / turn.max(f32::MIN_POSITIVE)).min(1.0)
    }

    /// The chords of the lamp from the nearest and the farthest point within a radius of a cell's middle; `None` where it may be as near as
    /// its own radius.
    fn chords(&self, seen: &Seen, radius: f32) -> Option<[f32; 2]> {
        let chord = |distance: f32| chord_of_sphere(self.lamp.radius / distance);
        (seen.distance - radius > self.lamp.radius)
            .then(|| [chord(seen.distance - radius), chord(seen.distance + radius)])
    }

    /// Bounds of what cells of this radius see of the lamp within a radius of directions around one so far from that of its centre, radians,
    /// both from the same point of the cell: its radiance, the same all over the cell if `may_be_even`, or nothing.
    pub fn bound(
        &self,
        (cell, cell_radius): (&PinholeParts, f32),
        (apart, radius): (f32, f32),
        may_be_even: bool,
    ) -> Bound {
        let seen = self.seen_from(cell.position);
        let Some([largest, least]) = self.chords(&seen, cell_radius) else {
            return Bound { max: self.max_radiance, contrast: self.max_radiance };
        };
        if apart > radius + largest {
            return Bound { max: 0.0, contrast: 0.0 };
        }
        let is_even = may_be_even && self.lamp.beam.is_none() && apart + radius < least;
        Bound { max: self.max_radiance, contrast: if is_even { 0.0 } else { self.max_radiance } }
    }

    /// The same bounds of a smooth cell of a mirror for sixteen receivers: maximum and contrast. `turned` is how large the cell is for
    /// them, with the spread of its normals; `uneven` how much farther than evenly these turn.
    #[inline(always)]
    pub fn bounds_over_cell<S: Simd>(
        &self,
        simd: S,
        (sample, radius): (&PinholeParts, f32),
        pair: &ReceiverCellPair<S>,
        (turned, uneven): (F<S>, f32),
    ) -> (F<S>, F<S>) {
        let (max, none) = (splat(simd, self.max_radiance), splat(simd, 0.0));
        let seen = self.seen_from(sample.position);
        let Some([largest, least]) = self.chords(&seen, radius) else { return (max, max) };
        let footprint = Self::footprint(simd, sample, pair, &seen);
        let size = turned + radius / seen.distance;
        let spread = footprint.squares().sqrt() * FOOTPRINT_RADIUS + (size * size * FOOTPRINT_BEND + uneven);
        let spread = spread * self.blurred_reach(sample);
        let off = pair.r - splat3(simd, seen.towards);
        let apart = off.dot(off).sqrt();
        let max = apart.simd_lt(spread + largest).select(max, none);
        // Lobes have tails, and beams differ by direction.
        if sample.lobe > 0.0 || self.lamp.beam.is_some() || pair.turn_along_segment(simd).is_some() {
            return (max, max);
        }
        (max, (apart + spread).simd_lt(least).select(none, max))
    }

    /// The largest radiance within a radius around directions from any point of a cell: that of the lamp, or nothing.
    #[inline(always)]
    pub fn max_within<S: Simd>(&self, simd: S, cell: (&PinholeParts, f32), direction: V3<S>, radius: F<S>) -> F<S> {
        let seen = self.seen_from(cell.0.position);
        let apart = direction - splat3(simd, seen.towards);
        let chord = apart.dot(apart).sqrt();
        // A chord is shorter than its arc.
        let reach = self.blurred_reach(cell.0);
        let is_met = chord.simd_le((radius + self.spread(cell.0, cell.1)) * reach);
        is_met.select(splat(simd, self.max_radiance), splat(simd, 0.0))
    }

    /// The lanes in which a piece of a cell, however near, may send light of the lamp to receivers.
    #[inline(always)]
    pub fn lanes_lit_by_piece<S: Simd>(&self, simd: S, piece: &PinholeParts, pair: &ReceiverCellPair<S>) -> u32 {
        let half = |[a, b]: [Vec3; 2]| 0.5 * (a.length() + b.length());
        let (radius, turn) = (half(piece.sides), 2.0 * half(piece.changes) + TAIL_REACH * piece.lobe);
        // An arc is at most π/2 times its sine; where there is no sine, light may come from anywhere.
        let spread = pair.inverse_l * (radius * FRAC_PI_2);
        let along = match pair.turn_along_segment(simd) {
            Some(turn) => turn.dot(turn).sqrt() * 0.5,
            None => splat(simd, 0.0),
        };
        let spread = spread.simd_lt(1.0).select(spread, splat(simd, PI)) + along + turn;
        // Refracted light turns without bound next to total reflection.
        let spread = if piece.interface.is_none() { spread } else { splat(simd, PI) };
        bits(self.max_within(simd, (piece, radius), pair.r, spread).simd_gt(0.0))
    }

    /// Where the light comes from, relative to the cell: the middle of what a footprint and the lamp's disc share, as if both were normal
    /// distributions of their variances. A wide footprint gets the lamp's light from its centre, a narrow one from where it points.
    #[inline(always)]
    pub fn middle_of_shared<S: Simd>(&self, simd: S, sample: &PinholeParts, pair: &ReceiverCellPair<S>) -> V3<S> {
        let seen = self.seen_from(sample.position);
        let squares = Self::sharp_footprint(simd, sample, pair, &seen).squares();
        // Of both directions together.
        let of_footprint = squares * (1.0 / 12.0) + 2.0 * sample.lobe * sample.lobe;
        let of_disc = (0.5 * seen.chord * seen.chord).max(f32::MIN_POSITIVE);
        let centre = splat3(simd, seen.towards);
        let off = pair.r - centre;
        let apart = off.dot(off).sqrt().max(f32::MIN_POSITIVE);
        // Not beyond the disc.
        let part = (splat(simd, of_disc) / (of_footprint + of_disc)).min(splat(simd, seen.chord) / apart);
        let middle = centre.plus(off, part);
        middle * (splat(simd, seen.distance) / middle.dot(middle).sqrt())
    }

    /// Mean radiance over a cell's footprint, or over both parts of its lobe; w = 1, a fetch.
    #[inline(never)]
    pub fn mean_radiance<S: Simd>(
        &self,
        simd: S,
        sample: &PinholeParts,
        pair: &ReceiverCellPair<S>,
        lit: u32,
    ) -> [Vec4; LANES] {
        simd.vectorize(
            #[inline(always)]
            || {
                let mut sum = [Vec4::ZERO; LANES];
                let seen = self.seen_from(sample.position);
                let third = pair.turn_along_segment(simd);
                let sharp = Self::sharp_footprint(simd, sample, pair, &seen);
                // Segments of rays lie end to end exactly, and blur nothing.
                let even = EvenSides::new(sample.area, sample.sides, sample.changes, self.shapes);
                let [first, mixed, second] = [even.first[0], even.first[1], even.second].map(|part| splat(simd, part));
                let blur = [sharp.v1 * first + sharp.v2 * mixed, sharp.v2 * second];
                let (whole, halves);
                let parts = if sample.is_mostly_lobe() {
                    halves = pair.parts_of(simd, sample, &sharp, third);
                    &halves[..]
                } else {
                    whole = pair.widened(simd, sharp, third, sample.lobe);
                    std::slice::from_ref(&whole)
                };
                let weight = 1.0 / parts.len() as f32;
                for part in parts {
                    self.add_mean(simd, (sample, &seen), (part, &blur), (lit, weight), &mut sum);
                }
                sum
            },
        )
    }

    #[inline(always)]
    fn add_mean<S: Simd>(
        &self,
        simd: S,
        (sample, seen): (&PinholeParts, &Seen),
        (footprint, blur): (&FootprintSides<S>, &[V3<S>; 2]),
        (lit, weight): (u32, f32),
        sum: &mut [Vec4; LANES],
    ) {
        let half_1 = footprint.v1.dot(footprint.v1).sqrt() * 0.5;
        let half_2 = footprint.v2.dot(footprint.v2).sqrt() * 0.5;
        let off = footprint.r - splat3(simd, seen.towards);
        let blur_reach = (blur[0].dot(blur[0]) + blur[1].dot(blur[1])).sqrt() * BLUR_RADIUS;
        let reach = half_1 + half_2 + blur_reach + seen.chord;
        let met = lit & bits(off.dot(off).sqrt().simd_lt(reach));
        set_bits(lit & !met).for_each(|lane| sum[lane].w += 1.0);
        if met == 0 {
            return;
        }
        let (a, b) = (footprint.v1.to_arrays(), footprint.v2.to_arrays());
        let blur = blur.map(V3::to_arrays);
        let r = footprint.r.to_arrays();
        for lane in set_bits(met) {
            let vector = |v: &[[f32; LANES]; 3]| Vec3::new(v[0][lane], v[1][lane], v[2][lane]);
            let (direction, sides) = (vector(&r), [vector(&a), vector(&b)]);
            // What is blurred must not reach below the horizon.
            if direction.dot(sample.normal) * seen.towards.dot(sample.normal) <= 0.0 {
                sum[lane].w += 1.0;
                continue;
            }
            let part = softly_filled_part(direction, sides, blur.each_ref().map(vector), seen.towards, seen.chord);
            let mut mean = Vec3::ZERO;
            if part > 0.0 {
                mean = weight * part * self.lamp.radiance_at(self.lit_place(sample, direction, sides, seen.towards));
            }
            sum[lane] += mean.extend(1.0);
        }
    }

    /// The place on a cell from which light goes to the receiver.
    fn lit_place(&self, sample: &PinholeParts, direction: Vec3, [a, b]: [Vec3; 2], towards: Vec3) -> Vec3 {
        if self.lamp.beam.is_none() {
            return sample.position;
        }
        let off = towards - direction;
        let (aa, ab, bb) = (a.length_squared(), a.dot(b), b.length_squared());
        let determinant = (aa * bb - ab * ab).max(f32::MIN_POSITIVE);
        let x = (off.dot(a) * bb - off.dot(b) * ab) / determinant;
        let y = (off.dot(b) * aa - off.dot(a) * ab) / determinant;
        sample.position + x.clamp(-0.5, 0.5) * sample.sides[0] + y.clamp(-0.5, 0.5) * sample.sides[1]
    }
}
