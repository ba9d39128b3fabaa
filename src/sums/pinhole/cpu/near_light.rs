//! Flat sums of light that is not infinitely far away: of lamps, and of surfaces in their light.

use glam::Vec4;

use super::filters::CpuFilter;
use super::lamp::LampLight;
use super::pair::ReceiverCellPair;
use super::receiver::Receiver;
use super::surroundings::SurroundingLight;
use super::visibility::VisibilityMap;
use super::{Gather, Source, gather_from};
use crate::lanes::{F, LANES, Simd, SimdBase, V3, bits, lanes, splat3};
use crate::pinhole::{GatherUniforms, Params, PinholeParts, PinholeSample, Pinholes, Receivers, Surroundings};
use crate::progress::Progress;
use crate::scene::Lamp;

/// As [`gather`](super::gather) for the light of a lamp, which takes no filter: the part of a footprint that the lamp fills is exact.
pub fn gather_lamp(
    receivers: &Receivers,
    pinholes: &Pinholes,
    lamp: &Lamp,
    params: &Params,
    progress: &dyn Progress,
) -> Vec<[f32; 4]> {
    let uniforms = GatherUniforms::for_near_light(params, pinholes, 0.0);
    let source = Source::Lamp(LampLight::new(lamp, pinholes.shapes));
    gather_from(receivers, (pinholes, source, uniforms, params), CpuFilter::None, progress)
}

/// The same for the light of surfaces.
pub fn gather_surroundings(
    receivers: &Receivers,
    pinholes: &Pinholes,
    surroundings: &Surroundings,
    params: &Params,
    progress: &dyn Progress,
) -> Vec<[f32; 4]> {
    let uniforms = GatherUniforms::for_near_light(params, pinholes, surroundings.texel_rad());
    let source = Source::Surroundings(SurroundingLight(surroundings));
    gather_from(receivers, (pinholes, source, uniforms, params), CpuFilter::None, progress)
}

impl Gather<'_> {
    /// Adds what one sample contributes of light that is not infinitely far away.
    #[inline(never)]
    pub(super) fn add_near_light<S: Simd>(
        &self,
        simd: S,
        packed: &PinholeSample,
        (pair, receiver): (&ReceiverCellPair<S>, &Receiver<S>),
        (weight, lit): (F<S>, u32),
        sum: &mut [Vec4; LANES],
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                let sample = &PinholeParts::from(packed);
                let taps = F::splat(simd, self.uniforms.taps as f32);
                let (mut weight, mut lit) = (weight, lit);
                if let Some(maps) = &self.pinholes.visibility {
                    let l = receiver.position - splat3(simd, sample.position);
                    let of_receivers = VisibilityMap::of_receivers(maps, packed, pair.dn);
                    weight *= lanes(simd, of_receivers.visible_fraction(simd, l, None, lit).0);
                    lit &= bits(weight.simd_gt(0.0));
                }
                if lit == 0 {
                    return;
                }
                let Some((radiance, to_light)) = self.near_light(simd, (sample, pair), taps, lit) else { return };
                if let Some(maps) = &self.pinholes.visibility {
                    let of_light = VisibilityMap::of_sky(maps, packed, pair.dn);
                    weight *= lanes(simd, of_light.visible_fraction(simd, to_light, None, lit).0);
                }
                self.add(sample, pair, receiver, (weight, &radiance, lit), sum);
            },
        );
    }

    /// Mean radiance over a sample's footprint of light that is not infinitely far away, w = fetches, and the places from which it comes,
    /// relative to the sample; `None` for the environment.
    #[inline(always)]
    pub(super) fn near_light<S: Simd>(
        &self,
        simd: S,
        (sample, pair): (&PinholeParts, &ReceiverCellPair<S>),
        taps: F<S>,
        lit: u32,
    ) -> Option<([Vec4; LANES], V3<S>)> {
        match &self.source {
            Source::Environment(_) => None,
            Source::Lamp(lamp) => {
                let to_light = lamp.middle_of_shared(simd, sample, pair);
                let mut radiance = lamp.mean_radiance(simd, sample, pair, lit);
                if self.lamps_in_medium {
                    let passed = self.passed_from_lamp(sample, lamp.offset_from(sample.position).length()).extend(1.0);
                    for radiance in &mut radiance {
                        *radiance *= passed;
                    }
                }
                Some((radiance, to_light))
            }
            Source::Surroundings(surfaces) => Some(surfaces.arriving(simd, (sample, pair), taps, lit)),
        }
    }
}
