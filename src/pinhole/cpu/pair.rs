//! A sample, or a cell, as sixteen receivers see it: geometry of the pair, and its footprint. Knows no light.

use super::crossing::Crossing;
use super::filters::FootprintSides;
use super::footprint::{blurred, reflected_side};
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
        let geometry_term = cos_at_sample * d.dot(receiver.normal).max(0.0) * inverse_l;
        let Some(interface) = sample.interface else {
            let r = d.plus(n, dn * -2.0) * inverse_l;
            return Self { d, n, dn, l2, inverse_l, cos_at_sample, geometry_term, r, crossing: None };
        };
        let crossing = Crossing::new(simd, interface, dn * inverse_l);
        let r = crossing.direction(d * inverse_l, n);
        let geometry_term = geometry_term * crossing.factor;
        Self { d, n, dn, l2, inverse_l, cos_at_sample, geometry_term, r, crossing: Some(crossing) }
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
        if sample.lobe > 0.0 { self.blurred(simd, &sharp, sample.lobe) } else { sharp }
    }

    /// The parts of its lobe, for look-ups: one narrower, one wider, both a little nearer to the normal.
    #[inline(always)]
    pub fn lobe_parts(&self, simd: S, sample: &PinholeParts) -> [FootprintSides<S>; 2] {
        let sharp = self.sharp_footprint(simd, sample);
        let tilt = sample.lobe * (LOBE_TILT + LOBE_TILT_GROWTH * sample.lobe);
        let behind = self.dn.simd_gt(0.0);
        let r = self.r.plus(self.n, behind.select(splat(simd, -tilt), splat(simd, tilt)));
        let r = r * (1.0 / r.dot(r).sqrt());
        let core = self.blurred(simd, &sharp, LOBE_CORE_WIDTH * sample.lobe);
        let tail = self.blurred(simd, &sharp, LOBE_TAIL_WIDTH * sample.lobe);
        [FootprintSides { r, ..core }, FootprintSides { r, ..tail }]
    }

    #[inline(always)]
    fn blurred(&self, simd: S, sharp: &FootprintSides<S>, lobe: f32) -> FootprintSides<S> {
        let lobe = match &self.crossing {
            // In the plane of incidence a turn of the normal turns the light more.
            None => (splat(simd, lobe), self.dn.abs() * self.inverse_l * lobe),
            Some(crossing) => crossing.blur(lobe),
        };
        let (v1, v2) = blurred(simd, sharp.v1, sharp.v2, self.r, self.n, lobe);
        FootprintSides { r: self.r, v1, v2 }
    }

    /// The footprint without the lobe's blur.
    #[inline(always)]
    fn sharp_footprint(&self, simd: S, sample: &PinholeParts) -> FootprintSides<S> {
        let Self { d, n, dn, inverse_l, r, .. } = *self;
        let PinholeParts { sides: [side_1, side_2], changes: [change_1, change_2], .. } = *sample;
        let [first, second] = [(side_1, change_1), (side_2, change_2)].map(|(s, c)| (splat3(simd, s), splat3(simd, c)));
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
