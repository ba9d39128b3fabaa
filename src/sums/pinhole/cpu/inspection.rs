//! The sum at one receiver taken apart: what each sample adds to it, and from which directions.

use glam::Vec3;

use super::filters::CpuFilter;
use super::pair::ReceiverCellPair;
use super::receiver::load_receivers;
use super::{Gather, Lights, ReceiverGroup, irradiance_of};
use crate::lanes::{Simd, V3, dispatch, level};
use crate::pinhole::{Params, PinholeParts, PinholeSample, Pinholes, Receivers};

/// What a sample adds to the irradiance of a receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contribution {
    /// W/m², for an environment of intensity 1.
    pub irradiance: Vec3,
    /// The unit direction in the world whose light the sample reflects to the receiver,
    pub direction: Vec3,
    /// and the full sides of the footprint around it, radians.
    pub sides: [Vec3; 2],
}

/// What each sample that faces it adds to a receiver of all lights, given by its position, unit normal and object. The parts add up to what
/// the sums of [`gather`](super::gather) and of near light return with the anisotropic filter.
pub fn contributions_to(
    receiver: (Vec3, Vec3, u32),
    pinholes: &Pinholes,
    lights: &Lights,
    params: &Params,
) -> Vec<Contribution> {
    let gathers = lights.gathers(pinholes, params);
    let group = load_receivers(&Receivers::from_points(&[receiver], 1), 0, 1);
    let part = |sample: &PinholeSample| dispatch!(level(), simd => contribution(simd, &gathers, sample, &group));
    pinholes.samples.iter().filter_map(part).collect()
}

#[inline(always)]
fn contribution<S: Simd>(
    simd: S,
    gathers: &[Gather],
    sample: &PinholeSample,
    group: &ReceiverGroup,
) -> Option<Contribution> {
    let receiver = group.in_lanes(simd);
    let parts = PinholeParts::from(sample);
    let pair = ReceiverCellPair::new(simd, &parts, &receiver);
    if pair.lit() & 1 == 0 {
        return None;
    }
    let sum = irradiance_of(simd, (gathers, CpuFilter::Anisotropic), sample, &receiver);
    let footprint = pair.footprint(simd, &parts);
    let [r, v1, v2] = [footprint.r, footprint.v1, footprint.v2].map(
        #[inline(always)]
        |v: V3<S>| Vec3::from(v.to_arrays().map(|lanes| lanes[0])),
    );
    Some(Contribution { irradiance: sum[0].truncate(), direction: r, sides: [v1, v2] })
}
