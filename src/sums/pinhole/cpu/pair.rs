//! A sample, or a cell, as sixteen receivers see it: geometry of the pair, and its footprint. Knows no light.

use super::crossing::Crossing;
use super::filters::FootprintSides;
use super::footprint::{reflected_side, widened};
use super::receiver::Receiver;
use crate::lanes::{F, Select, Simd, SimdBase, SimdFloat, V3, bits, splat, splat3};
use crate::pinhole::PinholeParts;
use crate::pinhole::constants::{LOBE_CORE_WIDTH, LOBE_TAIL_WIDTH, LOBE_TILT, LOBE_TILT_GROWTH};
use crate::scene::Sides;

/// A sample or cell, and sixteen receivers; the names are the shader's.
pub(super) struct ReceiverCellPair<S: Simd> {
    /// From the receiver to the sample, metres.
    pub d: V3<S>,
    pub n: V3<S>,
    pub dn: F<S>,
    pub l2: F<S>,
    pub inverse_l: F<S>,
    /// ⟨n, −d̂⟩⁺; for samples that light receivers behind them ⟨n, d̂⟩⁺, for those that light both |⟨n, d̂⟩|.
    pub cos_at_sample: F<S>,
    /// The product of both cosines, without 1/l², and at an interface its factor on the radiance. Not positive (or not a number, where
    /// the sample lies on the receiver point) where nothing arrives.
    pub geometry_term: F<S>,
    /// The direction of the light that is reflected or refracted, unit length.
    pub r: V3<S>,
    /// What happens at an interface between two media.
    crossing: Option<Crossing<S>>,
    /// Where receivers are parts of rays: from one end to the other, metres.
    segment: Option<V3<S>>,
}

/// The cosine at a sample, times l, by the sides on which it lights receivers; `dn` is that along its normal.
#[inline(always)]
pub(super) fn facing<S: Simd>(lights: Sides, dn: F<S>) -> F<S> {
    match lights {
        Sides::Front => -dn,
        Sides::Back => dn,
        Sides::Both => dn.abs(),
    }
}

impl<S: Simd> ReceiverCellPair<S> {
    #[inline(always)]
    pub fn new(simd: S, sample: &PinholeParts, receiver: &Receiver<S>) -> Self {
        let n = splat3(simd, sample.normal);
        let d = splat3(simd, sample.position) - receiver.position;
        let l2 = d.dot(d);
        let dn = d.dot(n);
        let inverse_l = 1.0 / l2.sqrt();
        let cos_at_sample = facing(sample.lights, dn).max(0.0) * inverse_l;
        let segment = receiver.segment();
        let cos_at_receiver = match segment {
            None => d.dot(receiver.normal).max(0.0) * inverse_l,
            // Lanes without a receiver have no direction.
            Some(_) => receiver.normal.dot(receiver.normal),
        };
        let geometry_term = cos_at_sample * cos_at_receiver;
        let Some(interface) = sample.interface else {
            let r = d.plus(n, dn * -2.0) * inverse_l;
            return Self { d, n, dn, l2, inverse_l, cos_at_sample, geometry_term, r, crossing: None, segment };
        };
        let crossing = Crossing::new(simd, interface, dn * inverse_l);
        let r = crossing.direction(d * inverse_l, n);
        let geometry_term = geometry_term * crossing.factor;
        Self { d, n, dn, l2, inverse_l, cos_at_sample, geometry_term, r, crossing: Some(crossing), segment }
    }

    /// The lanes in which the sample and the receiver face each other.
    #[inline(always)]
    pub fn lit(&self) -> u32 {
        bits(self.geometry_term.simd_gt(0.0))
    }

    /// The sample's footprint around the direction of the light.
    #[inline(always)]
    pub fn footprint(&self, simd: S, sample: &PinholeParts) -> FootprintSides<S> {
        let sharp = self.sharp_footprint(simd, sample);
        self.widened(simd, sharp, self.turn_along_segment(simd), sample.lobe)
    }

    /// The parts of its lobe, for look-ups: one narrower, one wider, both a little nearer to the normal.
    #[inline(always)]
    pub fn lobe_parts(&self, simd: S, sample: &PinholeParts) -> [FootprintSides<S>; 2] {
        let sharp = self.sharp_footprint(simd, sample);
        self.parts_of(simd, sample, &sharp, self.turn_along_segment(simd))
    }

    /// The parts of its lobe, from the footprint without it and what widens this.
    #[inline(always)]
    pub fn parts_of(
        &self,
        simd: S,
        sample: &PinholeParts,
        sharp: &FootprintSides<S>,
        third: Option<V3<S>>,
    ) -> [FootprintSides<S>; 2] {
        let tilt = sample.lobe * (LOBE_TILT + LOBE_TILT_GROWTH * sample.lobe);
        let behind = self.dn.simd_gt(0.0);
        let r = sharp.r.plus(self.n, behind.select(splat(simd, -tilt), splat(simd, tilt)));
        let r = r * (1.0 / r.dot(r).sqrt());
        let core = self.widened(simd, *sharp, third, LOBE_CORE_WIDTH * sample.lobe);
        let tail = self.widened(simd, *sharp, third, LOBE_TAIL_WIDTH * sample.lobe);
        [FootprintSides { r, ..core }, FootprintSides { r, ..tail }]
    }

    /// A footprint with a third side and the blur of a lobe.
    #[inline(always)]
    pub fn widened(&self, simd: S, sharp: FootprintSides<S>, third: Option<V3<S>>, lobe: f32) -> FootprintSides<S> {
        if lobe == 0.0 && third.is_none() {
            return sharp;
        }
        let lobe = match &self.crossing {
            // In the plane of incidence a turn of the normal turns the light more.
            None => (splat(simd, lobe), self.dn.abs() * self.inverse_l * lobe),
            Some(crossing) => crossing.blur(lobe),
        };
        let (v1, v2) = widened(simd, [sharp.v1, sharp.v2], third, (sharp.r, self.n), lobe);
        FootprintSides { r: sharp.r, v1, v2 }
    }

    /// How far the direction of the light turns from one end of the part of a ray to the other: the light that crosses a segment of a ray
    /// comes from a strip of the environment.
    #[inline(always)]
    pub fn turn_along_segment(&self, simd: S) -> Option<V3<S>> {
        let Self { d, n, inverse_l, r, .. } = *self;
        let moved = self.segment? * splat(simd, -1.0);
        if let Some(crossing) = &self.crossing {
            let nothing = splat3(simd, glam::Vec3::ZERO);
            return Some(crossing.side((moved, nothing), (d * inverse_l, n), inverse_l));
        }
        let mirrored = moved.plus(n, moved.dot(n) * -2.0);
        Some(mirrored.plus(r, -r.dot(mirrored)) * inverse_l)
    }

    /// The footprint without the lobe's blur, and at one place of a part of a ray.
    #[inline(always)]
    pub fn sharp_footprint(&self, simd: S, sample: &PinholeParts) -> FootprintSides<S> {
        let Self { d, n, dn, inverse_l, r, .. } = *self;
        let PinholeParts { sides: [side_1, side_2], changes: [change_1, change_2], .. } = *sample;
        let first = (splat3(simd, side_1), splat3(simd, change_1));
        let second = (splat3(simd, side_2), splat3(simd, change_2));
        if let Some(crossing) = &self.crossing {
            let frame = (d * inverse_l, n);
            return FootprintSides {
                r,
                v1: crossing.side(first, frame, inverse_l),
                v2: crossing.side(second, frame, inverse_l),
            };
        }
        let v1 = reflected_side(first.0, first.1, d, n, dn, inverse_l, r);
        let v2 = reflected_side(second.0, second.1, d, n, dn, inverse_l, r);
        FootprintSides { r, v1, v2 }
    }
}
