//! Look-ups in visibility maps; twin of `shaders/shared/visibility.wgsl`.

use glam::{Vec2, Vec3};

use super::sky_texels::{Columns, SkyTexels};
use crate::lanes::{
    F, LANES, Mask, Select, Simd, SimdBase, SimdFloat, SimdInt, SimdMask, U, V3, bits, clamp, lanes, set_bits, splat,
    splat3,
};
use crate::pinhole::constants::{
    LOBE_CORE, LOBE_SHIFT, LOBE_TAIL, LOBE_TAIL_SHARE, MAX_INTERPOLATED_WIDTH, MIN_CERTAIN_SINE,
};
use crate::pinhole::visibility::{Doubt, VisibilityMaps, frame};
use crate::pinhole::{Interface, PinholeSample};
use crate::scene::Sides;

/// The lanes in which a place in a sample's frame is seen at so small an angle to the surface that its map is not certain about it.
#[inline(always)]
fn grazing_lanes<S: Simd>(simd: S, local: V3<S>) -> u32 {
    let [_, _, height] = local.0;
    bits((height * height).simd_lt(local.dot(local) * splat(simd, MIN_CERTAIN_SINE * MIN_CERTAIN_SINE)))
}

/// A sample's map and frame, and the lanes that concern its other side.
pub(super) struct VisibilityMap<'a> {
    maps: &'a VisibilityMaps,
    map: u32,
    /// The lanes in which the map of the sample's other side counts.
    behind: u32,
    texel_jitter: Vec2,
    axes: [Vec3; 2],
    normal: Vec3,
}

/// How much of a set of directions or points a sample sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coverage {
    /// All of it.
    Full,
    /// Nothing.
    None,
    /// A part, or unknown: it would take too many texels to tell.
    Partial,
}

/// The bits of four texels that all see something.
const ALL_CORNERS: u32 = 15;
/// Texels read for a [`Coverage`] at most.
const MAX_TEXELS: usize = 256;

/// A rectangle of texels of a map, first and last, both included.
struct MapRegion {
    i: [usize; 2],
    j: [usize; 2],
}

/// The four texels around a place on a map, and the place between them.
struct MapPlace {
    i: [f32; LANES],
    j: [f32; LANES],
    fraction: [[f32; LANES]; 2],
}

impl MapPlace {
    /// The place, in texels from the corner of the map.
    #[inline(always)]
    fn centre(&self, lane: usize) -> [f32; 2] {
        [self.i[lane] + self.fraction[0][lane] + 0.5, self.j[lane] + self.fraction[1][lane] + 0.5]
    }
}

/// Places on a map, in texels.
struct OnMap<S: Simd> {
    u: F<S>,
    v: F<S>,
}

/// The lanes whose light comes from behind a sample that lights both sides.
#[inline(always)]
pub(super) fn sky_behind<S: Simd>(interface: Option<Interface>, dn: F<S>) -> u32 {
    if interface.is_some() { 0 } else { bits(dn.simd_gt(0.0)) }
}

/// Edge lengths of a map per radian around directions in a sample's frame: a texel of n² subtends 2(|x| + |y| + z)³/n² sr.
#[inline(always)]
fn map_density<S: Simd>(local: V3<S>) -> F<S> {
    let [x, y, z] = local.0;
    let norm = (x.abs() + y.abs() + z.max(0.0)) / local.dot(local).sqrt();
    1.0 / (norm * norm * norm * 2.0).sqrt()
}

impl<'a> VisibilityMap<'a> {
    /// The map of a sample that shows receivers. Where it has two, the sign of `dn` (the distance along the normal from receiver to
    /// sample) tells which one counts.
    #[inline(always)]
    pub fn of_receivers<S: Simd>(maps: &'a VisibilityMaps, sample: &PinholeSample, dn: F<S>) -> Self {
        Self::new(maps, sample, if sample.has_two_maps() { bits(dn.simd_gt(0.0)) } else { 0 })
    }

    /// The map that shows the environment for these receivers: on the same side as they are, but always in front of an interface.
    #[inline(always)]
    pub fn of_sky<S: Simd>(maps: &'a VisibilityMaps, sample: &PinholeSample, dn: F<S>) -> Self {
        Self::new(maps, sample, if sample.lights() == Sides::Both { sky_behind(sample.interface(), dn) } else { 0 })
    }

    #[inline(always)]
    fn new(maps: &'a VisibilityMaps, sample: &PinholeSample, behind: u32) -> Self {
        let normal = sample.normal();
        Self { maps, map: sample.map(), behind, texel_jitter: sample.texel_jitter(), axes: frame(normal), normal }
    }

    #[inline(always)]
    fn local<S: Simd>(&self, simd: S, v: V3<S>) -> V3<S> {
        let (x, y) = (splat3(simd, self.axes[0]).dot(v), splat3(simd, self.axes[1]).dot(v));
        let z = splat3(simd, self.normal).dot(v);
        V3([x, y, Mask::from_bitmask(simd, u64::from(self.behind)).select(-z, z)])
    }

    #[inline(always)]
    fn on_map<S: Simd>(&self, V3([x, y, z]): V3<S>) -> OnMap<S> {
        let scale = 0.5 / (x.abs() + y.abs() + z.max(0.0));
        let n = self.maps.resolution as f32;
        let u = clamp(((x + y) * scale + 0.5) * n - (0.5 + self.texel_jitter.x), 0.0, n - 1.0);
        let v = clamp(((x - y) * scale + 0.5) * n - (0.5 + self.texel_jitter.y), 0.0, n - 1.0);
        OnMap { u, v }
    }

    #[inline(always)]
    fn place<S: Simd>(&self, direction: V3<S>) -> MapPlace {
        let OnMap { u, v } = self.on_map(direction);
        let last = self.maps.resolution as f32 - 2.0;
        let (i, j) = (u.floor().min(last), v.floor().min(last));
        MapPlace { i: i.to_array(), j: j.to_array(), fraction: [(u - i).to_array(), (v - j).to_array()] }
    }

    /// The bounding rectangle of the active lanes' places, extended by `margin` texels on every side; `None` if it is too large.
    #[inline(always)]
    fn region<S: Simd>(&self, simd: S, direction: V3<S>, active: u32, margin: f32) -> Option<MapRegion> {
        let OnMap { u, v } = self.on_map(direction);
        let active = Mask::from_bitmask(simd, u64::from(active));
        let last = self.maps.resolution as usize - 1;
        let (nothing, all) = (splat(simd, 0.0), splat(simd, last as f32));
        // Casts end at 0.
        let low = |min: f32| (min - margin) as usize;
        let high = |max: f32| ((max + margin) as usize + 1).min(last);
        let i = [low(active.select(u, all).reduce_min()), high(active.select(u, nothing).reduce_max())];
        let j = [low(active.select(v, all).reduce_min()), high(active.select(v, nothing).reduce_max())];
        ((i[1] + 1 - i[0]) * (j[1] + 1 - j[0]) <= MAX_TEXELS).then_some(MapRegion { i, j })
    }

    /// Coverage of receivers at `l`, metres from the sample, and of the region between them. `objects` are those that they lie on, if
    /// it counts where the map is in doubt.
    #[inline(never)]
    pub fn receiver_coverage<S: Simd>(
        &self,
        simd: S,
        l: V3<S>,
        objects: Option<&[u32; LANES]>,
        active: u32,
    ) -> Coverage {
        simd.vectorize(
            #[inline(always)]
            || {
                if self.behind & active != 0 && self.behind & active != active {
                    return Coverage::Partial;
                }
                let local = self.local(simd, l);
                if objects.is_some() && grazing_lanes(simd, local) & active != 0 {
                    return Coverage::Partial;
                }
                let Some(region) = self.region(simd, local, active, 0.0) else { return Coverage::Partial };
                let n = self.maps.resolution as usize;
                let map = self.map(active.trailing_zeros() as usize) as usize;
                let l2 = local.dot(local);
                let mut all = None;
                for j in region.j[0]..=region.j[1] {
                    let row = (map * n + j) * n;
                    let texels = row + region.i[0]..row + region.i[1] + 1;
                    let doubts = &self.maps.doubts[texels.clone()];
                    for (plane, doubt) in self.maps.planes[texels].iter().zip(doubts) {
                        let [a, b, c, behind] = *plane;
                        let [x, y, z] = local.0;
                        let depth = x * a + y * b + z * c;
                        let hidden = bits(depth.simd_gt(1.0 + behind)) & active;
                        let is_in_doubt = depth.simd_gt(doubt.from) | l2.simd_gt(doubt.from_distance_2);
                        let doubtful = bits(is_in_doubt) & active & !hidden;
                        let texel = match hidden {
                            _ if doubtful != 0 && doubt.concerns(objects, doubtful) => return Coverage::Partial,
                            0 => Coverage::Full,
                            hidden if hidden == active => Coverage::None,
                            _ => return Coverage::Partial,
                        };
                        if all.is_some_and(|all| all != texel) {
                            return Coverage::Partial;
                        }
                        all = Some(texel);
                    }
                }
                all.unwrap_or(Coverage::None)
            },
        )
    }

    /// Coverage of the environment in these directions, between them and `reach` radians around them.
    #[inline(never)]
    pub fn sky_coverage<S: Simd>(&self, simd: S, direction: V3<S>, reach: f32, active: u32) -> Coverage {
        simd.vectorize(
            #[inline(always)]
            || {
                if self.behind & active != 0 && self.behind & active != active {
                    return Coverage::Partial;
                }
                let n = self.maps.resolution;
                // A half-space has 2π sr; texels are up to half as large again across.
                let margin = 1.5 * reach * n as f32 / std::f32::consts::TAU.sqrt();
                let local = self.local(simd, direction);
                let Some(region) = self.region(simd, local, active, margin) else { return Coverage::Partial };
                let map = self.map(active.trailing_zeros() as usize);
                let mask = (u64::MAX >> (63 - region.i[1]) & u64::MAX << region.i[0]) as u32;
                let rows = &self.maps.sky_mask[(map * n) as usize..][region.j[0]..=region.j[1]];
                let (mut any, mut all) = (0, u32::MAX);
                for row in rows {
                    (any, all) = (any | row, all & row);
                }
                match (any & mask, all & mask) {
                    (0, _) => Coverage::None,
                    (_, all) if all == mask => Coverage::Full,
                    _ => Coverage::Partial,
                }
            },
        )
    }

    #[inline(always)]
    fn map(&self, lane: usize) -> u32 {
        self.map + (self.behind >> lane & 1)
    }

    /// Visible fraction of receivers at `l`, metres from the sample, and the lanes that are in doubt, where the texels around them
    /// differ or their planes say too little. `objects` as above.
    #[inline(always)]
    pub fn visible_fraction<S: Simd>(
        &self,
        simd: S,
        l: V3<S>,
        objects: Option<&[u32; LANES]>,
        active: u32,
    ) -> ([f32; LANES], u32) {
        match objects {
            None => (self.fraction_without_doubt(simd, l, active), 0),
            Some(objects) => self.fraction_and_doubt(simd, l, objects, active),
        }
    }

    #[inline(never)]
    fn fraction_without_doubt<S: Simd>(&self, simd: S, l: V3<S>, active: u32) -> [f32; LANES] {
        simd.vectorize(
            #[inline(always)]
            || self.fraction_of(simd, l, None, active).0,
        )
    }

    #[inline(never)]
    fn fraction_and_doubt<S: Simd>(
        &self,
        simd: S,
        l: V3<S>,
        objects: &[u32; LANES],
        active: u32,
    ) -> ([f32; LANES], u32) {
        simd.vectorize(
            #[inline(always)]
            || self.fraction_of(simd, l, Some(objects), active),
        )
    }

    /// See [`Self::visible_fraction`].
    #[inline(always)]
    fn fraction_of<S: Simd>(
        &self,
        simd: S,
        l: V3<S>,
        objects: Option<&[u32; LANES]>,
        active: u32,
    ) -> ([f32; LANES], u32) {
        let local = self.local(simd, l);
        let mut doubtful = if objects.is_some() { grazing_lanes(simd, local) & active } else { 0 };
        let place = self.place(local);
        let ([x, y, z], l2) = (local.to_arrays(), local.dot(local).to_array());
        let n = self.maps.resolution as usize;
        let (mut seen, mut corners, mut differing) = ([0.0; LANES], [0; LANES], 0);
        for lane in set_bits(active) {
            let first = self.first_texel(lane, &place);
            let planes = &self.maps.planes[first..first + n + 2];
            let mut is_doubtful = false;
            // A loop: closures with several calls are compiled without vector instructions (see `lanes`).
            for (corner, texel) in [0, 1, n, n + 1].into_iter().enumerate() {
                let [a, b, c, behind] = planes[texel];
                let depth = a * x[lane] + b * y[lane] + c * z[lane];
                let is_seen = depth <= 1.0 + behind;
                corners[lane] |= u32::from(is_seen) << corner;
                if objects.is_some() && is_seen {
                    let doubt = self.maps.doubts[first + texel];
                    let is_in_doubt = depth > doubt.from || l2[lane] > doubt.from_distance_2;
                    is_doubtful |= is_in_doubt && doubt.concerns(objects, 1 << lane);
                }
            }
            seen[lane] = (corners[lane] & 1) as f32;
            if is_doubtful || !matches!(corners[lane], 0 | ALL_CORNERS) {
                doubtful |= u32::from(objects.is_some()) << lane;
                differing |= 1 << lane;
            }
        }
        if differing != 0 {
            let interpolated = self.interpolated(simd, &place, U::load_array(simd, corners), differing);
            let differing = Mask::from_bitmask(simd, u64::from(differing));
            seen = differing.select(interpolated, lanes(simd, seen)).to_array();
        }
        (seen, doubtful)
    }

    /// The first of the four texels around a place.
    #[inline(always)]
    fn first_texel(&self, lane: usize, place: &MapPlace) -> usize {
        let n = self.maps.resolution as usize;
        (self.map(lane) as usize * n + place.j[lane] as usize) * n + place.i[lane] as usize
    }

    /// Interpolates between four texels, whose bits are given, each of which stores where its value changes to the next one's; valid in
    /// the active lanes.
    #[inline(always)]
    fn interpolated<S: Simd>(&self, simd: S, place: &MapPlace, corners: U<S>, active: u32) -> F<S> {
        let n = self.maps.resolution as usize;
        // Of the texel itself, the one to its right, and the one below.
        let mut edges = [[0; LANES]; 3];
        for lane in set_bits(active) {
            let first = self.first_texel(lane, place);
            let planes = &self.maps.planes[first..=first + n];
            for (edge, texel) in edges.iter_mut().zip([0, 1, n]) {
                edge[lane] = planes[texel][3].to_bits();
            }
        }
        let [own, right, below] = edges.map(|words| U::load_array(simd, words));
        let [fx, fy] = place.fraction.map(|fraction| lanes(simd, fraction));
        let top = mixed(bit(corners, 0), bit(corners, 1), part_across(own >> 8, fx));
        let bottom = mixed(bit(corners, 2), bit(corners, 3), part_across(below >> 8, fx));
        mixed(top, bottom, mixed(part_across(own, fy), part_across(right, fy), fx))
    }
}

impl Doubt {
    /// Whether any of the lanes lies on another object.
    #[inline(always)]
    fn concerns(&self, objects: Option<&[u32; LANES]>, active: u32) -> bool {
        objects.is_some_and(|objects| set_bits(active).any(|lane| objects[lane] != self.object))
    }
}

impl VisibilityMap<'_> {
    /// Fraction of a lobe, `width` radians wide, that is not occluded.
    #[inline(never)]
    pub fn lobe_fraction<S: Simd>(&self, simd: S, direction: V3<S>, width: f32, active: u32) -> F<S> {
        simd.vectorize(
            #[inline(always)]
            || {
                let V3([x, y, z]) = self.local(simd, direction);
                let local = V3([x, y, z + LOBE_SHIFT * width]);
                let (place, density) = (self.place(local), map_density(local).to_array());
                let n = self.maps.resolution as f32;
                let mut fractions = [0.0; LANES];
                for lane in set_bits(active) {
                    // A loop, as in `visible_fraction`.
                    let mut parts = [0.0; 2];
                    for (part, scale) in parts.iter_mut().zip([LOBE_CORE, LOBE_TAIL]) {
                        let texels = (scale * width * density[lane] * n).max(1.0);
                        *part = self.sky_fraction_of_square(self.map(lane), place.centre(lane), texels);
                    }
                    fractions[lane] = mix(parts[0], parts[1], LOBE_TAIL_SHARE);
                }
                lanes(simd, fractions)
            },
        )
    }

    /// Fraction of the environment within `width` radians around each direction that is not occluded. Where the four texels around a
    /// direction differ, `exact` may return the lanes that see the environment; if it returns `None`, the texels are interpolated.
    #[inline(always)]
    pub fn sky_fraction_or<S: Simd>(
        &self,
        simd: S,
        direction: V3<S>,
        width: F<S>,
        active: u32,
        exact: impl FnOnce(u32) -> Option<u32>,
    ) -> [f32; LANES] {
        let local = self.local(simd, direction);
        let place = self.place(local);
        let n = self.maps.resolution;
        let texels = width * map_density(local) * n as f32;
        let wide = bits(texels.simd_gt(MAX_INTERPOLATED_WIDTH)) & active;
        let (mut fractions, texels) = ([0.0; LANES], texels.to_array());
        for lane in set_bits(wide) {
            fractions[lane] = self.sky_fraction_of_square(self.map(lane), place.centre(lane), texels[lane]);
        }
        let mut rows = [[0; LANES]; 2];
        for lane in set_bits(active & !wide) {
            let row = (self.map(lane) * n) as usize + place.j[lane] as usize;
            let pair = &self.maps.sky_mask[row..row + 2];
            (rows[0][lane], rows[1][lane]) = (pair[0], pair[1]);
        }
        let column: U<S> = lanes(simd, place.i).to_int();
        let [upper, lower] = rows.map(|row| U::load_array(simd, row));
        let corners = (upper >> column & 3) | (lower >> column & 3) << 2;
        let (all, none) = (corners.simd_eq(ALL_CORNERS), corners.simd_eq(0));
        let fractions = all.select(splat(simd, 1.0), lanes(simd, fractions));
        let differing = active & !wide & !bits(all | none);
        if differing == 0 {
            return fractions.to_array();
        }
        let found = match exact(differing) {
            Some(open) => Mask::from_bitmask(simd, u64::from(open)).select(splat(simd, 1.0), splat(simd, 0.0)),
            None => self.interpolated(simd, &place, corners, differing),
        };
        Mask::from_bitmask(simd, u64::from(differing)).select(found, fractions).to_array()
    }

    /// The part of a square of a map that sees the environment, estimated from eight lines across it. The square is clipped to the map:
    /// a lobe's energy is that above the horizon.
    #[inline(always)]
    fn sky_fraction_of_square(&self, map: u32, centre: [f32; 2], width: f32) -> f32 {
        let n = self.maps.resolution;
        let [[left, right], [top, bottom]] =
            centre.map(|c| [(c - 0.5 * width).max(0.0), (c + 0.5 * width).min(n as f32)]);
        let columns = Columns::new(left, right);
        // Not a sum over an iterator: its closure is compiled without vector instructions (see `lanes`).
        let mut texels = SkyTexels::default();
        for k in 0..LINES {
            let row = (top + (k as f32 + 0.5) / LINES as f32 * (bottom - top)) as u32;
            columns.count(self.maps.sky_mask[(map * n + row.min(n - 1)) as usize], &mut texels);
        }
        columns.length(&texels) / (LINES as f32 * (right - left))
    }
}

/// Lines across a square of a map that stand for it.
const LINES: u32 = 8;

/// How far the value of a texel has changed to that of the next one, at a place on the way, given the byte of the edge between them.
#[inline(always)]
fn part_across<S: Simd>(edge: U<S>, place: F<S>) -> F<S> {
    let middle = (edge >> 2 & 63).to_float::<F<S>>() * (1.0 / 64.0);
    // 2ˢ/8, by its exponent.
    let half = F::from_bits(((edge & 3) + (127 - 3)) << 23);
    let (low, high) = ((middle - half).max(0.0), (middle + half).min(1.0));
    clamp((place - low) / (high - low), 0.0, 1.0)
}

/// A bit as 0 or 1.
#[inline(always)]
fn bit<S: Simd>(word: U<S>, index: u32) -> F<S> {
    (word >> index & 1).to_float()
}

#[inline(always)]
fn mixed<S: Simd>(a: F<S>, b: F<S>, t: F<S>) -> F<S> {
    a + t * (b - a)
}

#[inline(always)]
fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + t * (b - a)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half of a map sees the environment; squares that reach over its edge count what lies on it.
    #[test]
    fn squares_see_the_mean_of_their_texels() {
        let maps = VisibilityMaps { resolution: 4, sky_mask: vec![0b0011; 4], ..VisibilityMaps::default() };
        let normal = Vec3::Y;
        let map =
            VisibilityMap { maps: &maps, map: 0, behind: 0, texel_jitter: Vec2::ZERO, axes: frame(normal), normal };
        assert_eq!(map.sky_fraction_of_square(0, [2.0, 2.0], 2.0), 0.5);
        assert_eq!(map.sky_fraction_of_square(0, [1.0, 2.0], 1.0), 1.0);
        assert_eq!(map.sky_fraction_of_square(0, [3.0, 0.0], 3.0), 0.2);
        assert_eq!(map.sky_fraction_of_square(0, [2.0, 2.0], 99.0), 0.5);
    }
}
