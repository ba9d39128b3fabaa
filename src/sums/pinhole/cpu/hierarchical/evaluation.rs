//! What a cell contributes to sixteen receivers, once it is small enough.

use glam::Vec4;

use super::super::filters::{FootprintSides, Kernel, mean_over_footprint, mean_over_parts, through_lobe};
use super::super::pair::ReceiverCellPair;
use super::super::receiver::Receiver;
use super::super::sky::{OccludedSky, Occlusion, Unoccluded};
use super::super::{CubeLookup, Gather, Source};
use crate::lanes::{F, LANES, Simd, SimdBase};
use crate::pinhole::PinholeParts;
use crate::pinhole::constants::{FOOTPRINT_RADIUS, LOBE_TAIL};

/// A cell, taken as one sample, and sixteen receivers.
pub struct CellAtReceivers<'a, S: Simd> {
    pub sample: &'a PinholeParts,
    /// The leaf that it is a piece of, or itself.
    pub leaf: &'a PinholeParts,
    pub receiver: &'a Receiver<'a, S>,
    pub pair: &'a ReceiverCellPair<S>,
    pub footprint: &'a FootprintSides<S>,
    /// Without reflectance.
    pub weight: F<S>,
}

impl<S: Simd> FootprintSides<S> {
    /// The sum of the sides' squares.
    #[inline(always)]
    pub fn squares(&self) -> F<S> {
        self.v1.dot(self.v1) + self.v2.dot(self.v2)
    }

    /// Nothing that counts of any lane's footprint is farther from its centre, radians.
    #[inline(always)]
    pub fn max_radius(&self, lobe: f32) -> f32 {
        (FOOTPRINT_RADIUS * self.squares().reduce_max().sqrt()).max(FOOTPRINT_RADIUS * LOBE_TAIL * lobe)
    }
}

impl Gather<'_> {
    /// Adds what a cell contributes of the environment in lit lanes: from up to so many taps, or from a single look-up where the light is
    /// even. Where there is no `sky`, nothing is occluded. Light that is nearer is for [`TileGather::add_near_light`](super::tile::TileGather).
    #[inline(never)]
    pub fn add_cell<S: Simd>(
        &self,
        simd: S,
        cell: &CellAtReceivers<S>,
        sky: Option<&OccludedSky>,
        taps: Option<F<S>>,
        lit: u32,
        sum: &mut [Vec4; LANES],
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                let radiance = match sky {
                    None => self.radiance_under(simd, cell, &Unoccluded, taps, lit),
                    Some(sky) => self.radiance_under(simd, cell, sky, taps, lit),
                };
                self.add(cell.sample, cell.pair, cell.receiver, (cell.weight, &radiance, lit), sum);
            },
        );
    }

    /// Mean radiance of the environment over a cell's footprint; w = fetches.
    #[inline(always)]
    fn radiance_under<S: Simd, O: Occlusion>(
        &self,
        simd: S,
        cell: &CellAtReceivers<S>,
        sky: &O,
        taps: Option<F<S>>,
        lit: u32,
    ) -> [Vec4; LANES] {
        let Source::Environment(environment) = &self.source else { return [Vec4::ZERO; LANES] };
        let kernel = taps.map_or(Kernel::Even { is_blurred: cell.sample.lobe > 0.0 }, Kernel::Anisotropic);
        let environment = (environment, kernel);
        if O::IS_UNOCCLUDED || !cell.sample.is_wide_lobe(self.map_texel_rad()) {
            return cell_radiance(simd, environment, cell, sky, lit);
        }
        through_lobe(
            simd,
            (cell.pair.r, cell.sample.lobe),
            sky,
            lit,
            #[inline(always)]
            |lit| cell_radiance(simd, environment, cell, &Unoccluded, lit),
        )
    }

    /// Upper bound of 1/l² for a cell.
    #[inline(always)]
    pub fn max_attenuation<S: Simd>(&self, simd: S, l2: F<S>, area: f32) -> F<S> {
        let u = &self.uniforms;
        if u.attenuation == 0 {
            return F::splat(simd, 1.0);
        }
        1.0 / (l2 + (u.epsilon_scale * area + u.epsilon))
    }

    /// Width of a texel of the visibility maps, radians: a half-space has 2π sr.
    pub fn map_texel_rad(&self) -> f32 {
        std::f32::consts::TAU.sqrt() / self.uniforms.map_resolution.max(1) as f32
    }
}

/// Mean radiance over a cell's footprint; w = fetches.
#[inline(never)]
fn cell_radiance<S: Simd>(
    simd: S,
    environment: (&CubeLookup, Kernel<S>),
    cell: &CellAtReceivers<S>,
    occlusion: &impl Occlusion,
    lit: u32,
) -> [Vec4; LANES] {
    simd.vectorize(
        #[inline(always)]
        || {
            let halves;
            let parts = if cell.sample.is_mostly_lobe() {
                halves = cell.pair.lobe_parts(simd, cell.sample);
                &halves[..]
            } else {
                std::slice::from_ref(cell.footprint)
            };
            mean_over_parts(
                parts,
                #[inline(always)]
                |part| mean_over_footprint(simd, environment, part, occlusion, lit),
            )
        },
    )
}
