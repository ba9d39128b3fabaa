//! What a medium does with light on its way: it attenuates it between cells and receivers and, where receivers are parts of rays,
//! scatters it towards the viewer.

use std::f32::consts::PI;

use glam::{Vec3, Vec4};

use super::Gather;
use super::pair::ReceiverCellPair;
use super::receiver::Receiver;
use crate::lanes::{F, LANES, Simd, SimdBase, lanes, set_bits, splat};
use crate::pinhole::PinholeParts;
use crate::scene::Medium;

/// 4π times the phase function: 1 where light is scattered evenly.
#[inline]
pub(super) fn relative_phase(medium: &Medium, cosine: f32) -> f32 {
    if medium.g == 0.0 { 1.0 } else { 4.0 * PI * medium.phase(cosine) }
}

/// The largest of these where light is turned by the angle of a cosine, or by one that differs so much from it, radians.
#[inline]
pub(super) fn max_relative_phase(medium: &Medium, cosine: f32, angle: f32) -> f32 {
    if medium.g == 0.0 {
        return 1.0;
    }
    // It falls from one end to the other.
    let own = cosine.clamp(-1.0, 1.0).acos();
    let brightest = if medium.g > 0.0 { (own - angle).max(0.0) } else { (own + angle).min(PI) };
    relative_phase(medium, brightest.cos())
}

/// How much faster than directions the phase function changes with them.
pub(super) fn phase_slope(medium: &Medium) -> f32 {
    1.0 / (1.0 - medium.g.abs())
}

impl Gather<'_> {
    /// The part of a lamp's light that comes through the medium to a cell at a distance, metres.
    pub(super) fn passed_from_lamp(&self, sample: &PinholeParts, distance: f32) -> Vec3 {
        let medium = self.medium.as_ref().filter(|_| self.lamps_in_medium && sample.interface.is_none());
        medium.map_or(Vec3::ONE, |medium| medium.transmittance(distance))
    }

    /// Upper bound of what a medium leaves of light and scatters of it, for cells of a relative size; and the part of it by which that
    /// differs within the cell, scaled as an error.
    #[inline(always)]
    pub(super) fn scattered_within<S: Simd>(
        &self,
        simd: S,
        pair: &ReceiverCellPair<S>,
        receiver: &Receiver<S>,
        size: F<S>,
        active: u32,
    ) -> (F<S>, F<S>) {
        let Some(medium) = self.medium.as_ref().filter(|medium| medium.g != 0.0) else {
            return (splat(simd, 1.0), splat(simd, 0.0));
        };
        let turned = (pair.d.dot(receiver.normal) * pair.inverse_l).to_array();
        let size = size.to_array();
        let (mut max, mut difference) = ([0.0; LANES], [0.0; LANES]);
        for lane in set_bits(active) {
            let at_centre = relative_phase(medium, -turned[lane]);
            max[lane] = max_relative_phase(medium, -turned[lane], size[lane]);
            difference[lane] = (max[lane] - at_centre) / max[lane];
        }
        (lanes(simd, max), lanes(simd, difference))
    }
}

/// Multiplies by the part of the light that comes through the medium and, for parts of rays, by that which is scattered.
#[inline(always)]
pub(super) fn pass_medium<S: Simd>(
    medium: &Medium,
    (sample, pair): (&PinholeParts, &ReceiverCellPair<S>),
    receiver: &Receiver<S>,
    lit: u32,
    factors: &mut [Vec4; LANES],
) {
    let (l, dn) = ((pair.l2 * pair.inverse_l).to_array(), pair.dn.to_array());
    let turned = (pair.d.dot(receiver.normal) * pair.inverse_l).to_array();
    let is_even = medium.g == 0.0 || receiver.length.is_none();
    // In front of an interface there is no medium.
    let behind = sample.interface.map(|_| &dn);
    attenuate(medium, (&l, behind), (!is_even).then_some(&turned), lit, factors);
}

/// Multiplies by the transmittance over distances, where `behind` is positive if it is given, and by the phase function of cosines.
#[cold]
fn attenuate(
    medium: &Medium,
    (distances, behind): (&[f32; LANES], Option<&[f32; LANES]>),
    turned: Option<&[f32; LANES]>,
    lit: u32,
    factors: &mut [Vec4; LANES],
) {
    for lane in set_bits(lit) {
        if behind.is_none_or(|behind| behind[lane] > 0.0) {
            factors[lane] *= medium.transmittance(distances[lane]).extend(1.0);
        }
        if let Some(turned) = turned {
            factors[lane] *= relative_phase(medium, -turned[lane]);
        }
    }
}
