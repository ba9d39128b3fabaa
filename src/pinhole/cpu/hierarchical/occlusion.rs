//! Occlusion by maps and rays: what the samples' maps leave in doubt, and what counts, is traced.

use glam::Vec3;

use super::super::lanes::{ALL, F, LANES, Simd, SimdBase, V3, bits, lanes, set_bits, splat};
use super::super::visibility::{Coverage, Occlusion, VisibilityMap};
use super::super::{Receiver, ReceiverCellPair};
use super::evaluation::CellAtReceivers;
use super::tile::{TileGather, map_towards};
use crate::pinhole::tree::Occluders;
use crate::pinhole::{PinholeParts, PinholeSample, VisibilityMaps};

/// What is in doubt is traced where it contributes more than this part of the error budget of a pair.
const MIN_TRACED_SHARE: f32 = 0.1;
/// The same for the environment, where the sum of several look-ups is less in doubt.
const MIN_TRACED_SKY_SHARE: f32 = 1.0;

/// Which of sixteen receivers the sample sees whose cells are being visited, as far as its map tells.
pub struct VisibleReceivers<S: Simd> {
    pub sample_node: u32,
    /// Visible fraction.
    pub fraction: F<S>,
    /// Receivers that may be seen.
    pub lanes: u32,
    /// Of these, the ones that the map is not certain about.
    pub doubtful: u32,
    /// Of these, the ones that see some of the sample's quarters and others not.
    probed: u32,
}

impl<S: Simd> VisibleReceivers<S> {
    /// Before any sample.
    pub fn all(simd: S) -> Self {
        Self { sample_node: u32::MAX, fraction: splat(simd, 1.0), lanes: ALL, doubtful: 0, probed: 0 }
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
            probed: 0,
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

    /// Traces doubtful lanes from the four quarters of the sample: where these agree, it is settled for all of its cells.
    fn probe(&mut self, simd: S, occluders: &Occluders, sample: &PinholeParts, receiver: &Receiver<S>, which: u32) {
        let [x, y, z] = receiver.position.to_arrays();
        let quarters = sample.quarters();
        let mut fraction = self.fraction.to_array();
        for lane in set_bits(which & !self.probed) {
            let position = Vec3::new(x[lane], y[lane], z[lane]);
            let seen = quarters.each_ref().map(|quarter| {
                let l = position - quarter.position;
                let is_behind = sample.two_sided && l.dot(quarter.normal) < 0.0;
                occluders.is_open(quarter, is_behind, l.normalize(), l.length())
            });
            if seen.iter().any(|&s| s != seen[0]) {
                self.probed |= 1 << lane;
                continue;
            }
            fraction[lane] = f32::from(seen[0]);
            self.doubtful &= !(1 << lane);
            if !seen[0] {
                self.lanes &= !(1 << lane);
            }
        }
        self.fraction = lanes(simd, fraction);
    }
}

/// What a cell sees of the environment: by its sample's map and, where that is in doubt, by rays.
pub struct TracedSky<'a> {
    map: &'a VisibilityMap<'a>,
    occluders: &'a Occluders,
    cell: &'a PinholeParts,
    /// As in [`VisibilityMap::new`].
    dn: [f32; LANES],
}

impl Occlusion for TracedSky<'_> {
    const IS_UNOCCLUDED: bool = false;

    #[inline(always)]
    fn sky_fraction<S: Simd>(&self, simd: S, direction: V3<S>, active: u32) -> [f32; LANES] {
        let [x, y, z] = direction.to_arrays();
        self.map.sky_fraction_or(simd, direction, active, |lane| {
            let direction = Vec3::new(x[lane], y[lane], z[lane]).normalize();
            Some(f32::from(self.occluders.is_open(self.cell, self.dn[lane] > 0.0, direction, f32::INFINITY)))
        })
    }
}

impl TileGather<'_> {
    /// The lanes in which a contribution of up to `max` is worth a ray from one of these.
    #[inline(always)]
    fn worth_tracing<S: Simd>(&self, simd: S, max: F<S>, share: f32) -> u32 {
        bits(max.simd_ge(splat(simd, share * self.criterion.error_budget)))
    }

    /// The objects that receivers lie on, if what the maps leave in doubt is traced.
    #[inline(always)]
    pub fn doubted<'r, S: Simd>(&self, receiver: &Receiver<'r, S>) -> Option<&'r [u32; LANES]> {
        self.context.pinholes.occluders.as_ref().map(|_| receiver.object)
    }

    /// Settles, where that is possible at once, what the sample of the visited cell sees of doubtful receivers.
    #[inline(always)]
    pub fn probe<S: Simd>(&self, simd: S, visible: &mut VisibleReceivers<S>, receiver: &Receiver<S>, which: u32) {
        if let Some(occluders) = &self.context.pinholes.occluders {
            let sample = &self.context.gather.pinholes.samples[visible.sample_node as usize];
            visible.probe(simd, occluders, &PinholeParts::from(sample), receiver, which);
        }
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
        let traced = doubtful & self.worth_tracing(simd, max_contribution, MIN_TRACED_SHARE);
        let Some(occluders) = self.context.pinholes.occluders.as_ref().filter(|_| traced != 0) else { return fraction };
        let ([x, y, z], dn, mut fraction) = (pair.d.to_arrays(), pair.dn.to_array(), fraction.to_array());
        for lane in set_bits(traced) {
            let d = Vec3::new(x[lane], y[lane], z[lane]);
            let l = d.length();
            fraction[lane] = f32::from(occluders.is_open(cell, dn[lane] > 0.0, -d / l, l));
        }
        lanes(simd, fraction)
    }

    /// What a cell sees of the environment, and the lanes in which to ask that instead of the map: where the footprint is as narrow as
    /// a texel of the map and contributes enough.
    #[inline(always)]
    pub fn traced_sky<'s, S: Simd>(
        &'s self,
        simd: S,
        cell: &CellAtReceivers<'s, S>,
        map: &'s VisibilityMap<'s>,
        max_contribution: F<S>,
    ) -> Option<(TracedSky<'s>, u32)> {
        let occluders = self.context.pinholes.occluders.as_ref()?;
        let texel = self.criterion.map_texel_rad;
        let [v1, v2] = [cell.footprint.v1, cell.footprint.v2];
        let is_narrow = bits(v1.dot(v1).min(v2.dot(v2)).simd_lt(splat(simd, texel * texel)));
        let traced = is_narrow & self.worth_tracing(simd, max_contribution, MIN_TRACED_SKY_SHARE);
        let sky = || TracedSky { map, occluders, cell: cell.sample, dn: cell.pair.dn.to_array() };
        (traced != 0).then(|| (sky(), traced))
    }
}
