//! What a cell contributes to sixteen receivers, once it is small enough.

use glam::Vec4;

use super::super::filters::{
    CpuFilter, FootprintSides, mean_over_footprint, mean_over_parts, smooth_light, through_lobe,
};
use super::super::pair::ReceiverCellPair;
use super::super::receiver::Receiver;
use super::super::visibility::{Occlusion, Unoccluded, VisibilityMap};
use super::super::{CubeLookup, Gather, Source};
use super::occlusion::TracedSky;
use crate::lanes::{F, LANES, Simd, SimdBase};
use crate::pinhole::PinholeParts;
use crate::pinhole::constants::{FOOTPRINT_RADIUS, LOBE_TAIL};

/// A cell, taken as one sample, and sixteen receivers.
pub struct CellAtReceivers<'a, S: Simd> {
    pub sample: &'a PinholeParts,
    pub receiver: &'a Receiver<'a, S>,
    pub pair: &'a ReceiverCellPair<S>,
    pub footprint: &'a FootprintSides<S>,
    /// Without reflectance.
    pub weight: F<S>,
}

/// What a cell sees of the environment.
#[derive(Clone, Copy)]
pub enum Sky<'a> {
    /// All of it.
    Open,
    /// What the map of its sample says.
    Mapped(&'a VisibilityMap<'a>),
    /// The same, and rays where that map is in doubt.
    Traced(&'a TracedSky<'a>),
}

impl<'a> From<Option<&'a VisibilityMap<'a>>> for Sky<'a> {
    fn from(map: Option<&'a VisibilityMap<'a>>) -> Self {
        map.map_or(Self::Open, Self::Mapped)
    }
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
    /// even. Light that is nearer is for [`TileGather::add_near_light`](super::tile::TileGather).
    #[inline(never)]
    pub fn add_cell<S: Simd>(
        &self,
        simd: S,
        cell: &CellAtReceivers<S>,
        sky: Sky,
        taps: Option<F<S>>,
        lit: u32,
        sum: &mut [Vec4; LANES],
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                let radiance = match sky {
                    Sky::Open => self.radiance_under(simd, cell, &Unoccluded, taps, lit),
                    Sky::Mapped(map) => self.radiance_under(simd, cell, map, taps, lit),
                    Sky::Traced(sky) => self.radiance_under(simd, cell, sky, taps, lit),
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
        if O::IS_UNOCCLUDED || !cell.sample.is_wide_lobe(self.map_texel_rad()) {
            return cell_radiance(simd, environment, cell, sky, taps, lit);
        }
        through_lobe(
            simd,
            (cell.pair.r, cell.sample.lobe),
            sky,
            lit,
            #[inline(always)]
            |lit| cell_radiance(simd, environment, cell, &Unoccluded, taps, lit),
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
    environment: &CubeLookup,
    cell: &CellAtReceivers<S>,
    occlusion: &impl Occlusion,
    taps: Option<F<S>>,
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
                |part| footprint_radiance(simd, environment, (cell, part), occlusion, taps, lit),
            )
        },
    )
}

/// Mean radiance over a footprint of a cell, or over a part of its lobe; w = fetches.
#[inline(always)]
fn footprint_radiance<S: Simd>(
    simd: S,
    environment: &CubeLookup,
    (cell, footprint): (&CellAtReceivers<S>, &FootprintSides<S>),
    occlusion: &impl Occlusion,
    taps: Option<F<S>>,
    lit: u32,
) -> [Vec4; LANES] {
    let Some(taps) = taps else {
        return smooth_light(simd, environment, footprint, cell.sample.lobe > 0.0, occlusion, lit);
    };
    mean_over_footprint(simd, (environment, CpuFilter::Anisotropic), footprint, occlusion, taps, lit)
}
