//! Occlusion by maps and rays: what the samples' maps leave in doubt, and what counts, is traced.

use glam::{Vec3, Vec4};

use super::super::Source;
use super::super::pair::ReceiverCellPair;
use super::super::receiver::Receiver;
use super::super::sky::{OccludedSky, SkyRays, directions_and_lengths};
use super::super::visibility::{Coverage, VisibilityMap, sky_behind};
use super::evaluation::CellAtReceivers;
use super::tile::{TileGather, map_towards};
use crate::lanes::{ALL, F, LANES, Simd, SimdBase, V3, bits, lanes, set_bits, splat};
use crate::pinhole::cell::Cell;
use crate::pinhole::constants::{MIN_TRACED_SHARE, MIN_TRACED_SHARE_OF_INTERFACES, MIN_TRACED_SKY_SHARE};
use crate::pinhole::{PinholeParts, PinholeSample, VisibilityMaps};

/// Which of sixteen receivers the sample sees whose cells are being visited, as far as its map tells.
pub struct VisibleReceivers<S: Simd> {
    pub sample_node: u32,
    /// Visible fraction.
    pub fraction: F<S>,
    /// Receivers that may be seen.
    pub lanes: u32,
    /// Of these, the ones that the map is not certain about.
    pub doubtful: u32,
}

impl<S: Simd> VisibleReceivers<S> {
    /// Before any sample.
    #[inline(always)]
    pub fn all(simd: S) -> Self {
        Self { sample_node: u32::MAX, fraction: splat(simd, 1.0), lanes: ALL, doubtful: 0 }
    }

    #[inline(always)]
    pub fn new(
        simd: S,
        maps: &VisibilityMaps,
        (samples, sample): (&[PinholeSample], u32),
        receiver: &Receiver<S>,
        objects: Option<&[u32; LANES]>,
    ) -> Self {
        let (map, l) = map_towards(simd, maps, &samples[sample as usize], receiver);
        let known = |fraction: f32, lanes: u32| Self {
            sample_node: sample,
            fraction: splat(simd, fraction),
            lanes,
            doubtful: 0,
        };
        match map.receiver_coverage(simd, l, objects, receiver.occupied()) {
            Coverage::Full => known(1.0, ALL),
            Coverage::None => known(0.0, 0),
            Coverage::Partial => {
                let (fraction, doubtful) = map.visible_fraction(simd, l, objects, ALL);
                let fraction = lanes(simd, fraction);
                Self { fraction, doubtful, ..known(0.0, bits(fraction.simd_gt(0.0)) | doubtful) }
            }
        }
    }
}

impl TileGather<'_> {
    /// Adds what a lamp or lit surfaces contribute by way of a cell, in lit lanes. `map` is that of what the cell sees on the light's side,
    /// if anything is occluded. A map misses what is narrower than its texels, and all light of a lamp may come through that: rays to the
    /// light are traced from the middle of the cell.
    #[inline(never)]
    pub fn add_near_light<S: Simd>(
        &self,
        simd: S,
        cell: &CellAtReceivers<S>,
        map: Option<&VisibilityMap>,
        (taps, max_contribution): (F<S>, F<S>),
        lit: u32,
        sum: &mut [Vec4; LANES],
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                let gather = &self.context.gather;
                let Some((radiance, towards)) = gather.near_light(simd, (cell.sample, cell.pair), taps, lit) else {
                    return;
                };
                let lit = set_bits(lit)
                    .filter(|lane| radiance[*lane].truncate() != Vec3::ZERO)
                    .fold(0, |lit, k| lit | 1 << k);
                let mut weight = cell.weight;
                if let Some(map) = map.filter(|_| lit != 0) {
                    let (fraction, _) = map.visible_fraction(simd, towards, None, lit);
                    let behind = sky_behind(cell.sample.interface, cell.pair.dn);
                    let found = (lanes(simd, fraction), lit);
                    let worth = self.worth_tracing(simd, (max_contribution, cell.sample.area), MIN_TRACED_SHARE);
                    weight *= self.traced_fraction(simd, (cell.sample, cell.leaf, behind), towards, found, worth);
                }
                gather.add(cell.sample, cell.pair, cell.receiver, (weight, &radiance, lit), sum);
            },
        );
    }

    /// The lanes in which a contribution of up to `max` is worth a ray from one of these.
    #[inline(always)]
    fn worth_tracing<S: Simd>(&self, simd: S, (max, area): (F<S>, f32), share: f32) -> u32 {
        bits(max.simd_ge(splat(simd, share * self.criterion.error_budget_of(area))))
    }

    /// The objects that receivers lie on, if what the maps leave in doubt is traced. Along a part of a ray edges of shadows are blurred:
    /// there maps know enough of them.
    #[inline(always)]
    pub fn doubted<'r, S: Simd>(&self, receiver: &Receiver<'r, S>) -> Option<&'r [u32; LANES]> {
        let is_traced = self.context.pinholes.occluders.is_some() && receiver.length.is_none();
        is_traced.then_some(receiver.object)
    }

    /// The visible fraction of receivers; those in doubt that contribute enough are traced from the middle of the cell.
    #[inline(always)]
    pub fn visible_fraction<S: Simd>(
        &self,
        simd: S,
        cell: &PinholeParts,
        pair: &ReceiverCellPair<S>,
        (fraction, doubtful): (F<S>, u32),
        max_contribution: F<S>,
    ) -> F<S> {
        let behind = bits(pair.dn.simd_gt(0.0));
        let towards = pair.d * splat(simd, -1.0);
        let share = if cell.interface.is_some() { MIN_TRACED_SHARE_OF_INTERFACES } else { MIN_TRACED_SHARE };
        let worth = self.worth_tracing(simd, (max_contribution, cell.area), share);
        self.traced_fraction(simd, (cell, cell, behind), towards, (fraction, doubtful), worth)
    }

    /// The lanes for which a cell that may be divided contributes much, and sees part of a lamp. `dn` as in [`VisibilityMap::of_sky`].
    #[inline(always)]
    pub fn partly_lit_lanes<S: Simd>(
        &self,
        simd: S,
        cell: &Cell,
        dn: F<S>,
        max_contribution: F<S>,
        accepted: u32,
    ) -> u32 {
        let Source::Lamp(lamp) = &self.context.gather.source else { return 0 };
        let budget = self.criterion.error_budget_of(cell.sample.area);
        let large = accepted & bits(max_contribution.simd_ge(splat(simd, budget)));
        if cell.is_leaf() || large == 0 {
            return 0;
        }
        let map = self.sky_map(cell, dn).filter(|map| lamp.is_partly_seen(simd, cell.sample.position, map));
        if map.is_some() { large } else { 0 }
    }

    /// The visible fraction of points that lie `towards` these from the middle of a cell, which may be a piece of a leaf; those in doubt that
    /// are `worth` it are traced. `behind` are the lanes that concern the cell's back.
    #[inline(always)]
    fn traced_fraction<S: Simd>(
        &self,
        simd: S,
        (cell, leaf, behind): (&PinholeParts, &PinholeParts, u32),
        towards: V3<S>,
        (fraction, doubtful): (F<S>, u32),
        worth: u32,
    ) -> F<S> {
        let traced = doubtful & worth;
        let Some(occluders) = self.context.pinholes.occluders.as_ref().filter(|_| traced != 0) else { return fraction };
        let (directions, distances) = directions_and_lengths(simd, towards);
        let open = occluders.unoccluded_lanes((cell, leaf), behind, (&directions, &distances), traced);
        let mut fraction = fraction.to_array();
        set_bits(traced).for_each(|lane| fraction[lane] = (open >> lane & 1) as f32);
        lanes(simd, fraction)
    }

    /// What a cell sees of the environment by its map and rays, and the lanes in which to ask that instead of the map alone: where the
    /// footprint is as narrow as a texel of the map and contributes enough.
    #[inline(always)]
    pub fn traced_sky<'s, S: Simd>(
        &'s self,
        simd: S,
        cell: &CellAtReceivers<'s, S>,
        map: &'s VisibilityMap<'s>,
        max_contribution: F<S>,
    ) -> Option<(OccludedSky<'s>, u32)> {
        let occluders = self.context.pinholes.occluders.as_ref().filter(|_| cell.receiver.length.is_none())?;
        let texel = self.criterion.map_texel_rad;
        let [v1, v2] = [cell.footprint.v1, cell.footprint.v2];
        let is_narrow = bits(v1.dot(v1).min(v2.dot(v2)).simd_lt(splat(simd, texel * texel)));
        let traced = is_narrow & self.worth_tracing(simd, (max_contribution, cell.sample.area), MIN_TRACED_SKY_SHARE);
        let behind = sky_behind(cell.sample.interface, cell.pair.dn);
        let rays = SkyRays { occluders, cell: cell.sample, leaf: cell.leaf, behind };
        (traced != 0).then_some((OccludedSky { map, rays: Some(rays) }, traced))
    }
}
