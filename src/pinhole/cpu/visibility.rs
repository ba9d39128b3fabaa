//! Look-ups in visibility maps; twin of `shaders/shared/visibility.wgsl`. [`Unoccluded`] stands in where there are none.

use super::lanes::{
    F, LANES, Mask, Select, Simd, SimdBase, SimdFloat, SimdMask, V3, bits, clamp, set_bits, splat, splat3,
};
use glam::{Vec2, Vec3};

use crate::pinhole::PinholeSample;
use crate::pinhole::visibility::{Doubt, VisibilityMaps, frame};

/// What a sample sees of the environment.
pub(super) trait Occlusion {
    /// Whether nothing is ever occluded, so that look-ups can be skipped.
    const IS_UNOCCLUDED: bool;

    /// Fraction of the environment around each direction that is not occluded; valid in `active` lanes only.
    fn sky_fraction<S: Simd>(&self, simd: S, direction: V3<S>, active: u32) -> [f32; LANES];
}

/// Nothing is occluded.
pub(super) struct Unoccluded;

impl Occlusion for Unoccluded {
    const IS_UNOCCLUDED: bool = true;

    #[inline(always)]
    fn sky_fraction<S: Simd>(&self, _: S, _: V3<S>, _: u32) -> [f32; LANES] {
        [1.0; LANES]
    }
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

/// Places on a map, in texels.
struct OnMap<S: Simd> {
    u: F<S>,
    v: F<S>,
}

impl<'a> VisibilityMap<'a> {
    /// The map of a sample. Where it has two sides, the sign of `dn` (the distance along the normal from receiver to sample)
    /// tells which one counts.
    #[inline(always)]
    pub fn new<S: Simd>(maps: &'a VisibilityMaps, sample: &PinholeSample, dn: F<S>) -> Self {
        let behind = if sample.two_sided() { bits(dn.simd_gt(0.0)) } else { 0 };
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
        let mut doubtful = 0;
        let local = self.local(simd, l);
        let place = self.place(local);
        let ([x, y, z], l2) = (local.to_arrays(), local.dot(local).to_array());
        let n = self.maps.resolution as usize;
        let mut seen = [0.0; LANES];
        for lane in set_bits(active) {
            let first = (self.map(lane) as usize * n + place.j[lane] as usize) * n + place.i[lane] as usize;
            let fraction = [place.fraction[0][lane], place.fraction[1][lane]];
            let planes = &self.maps.planes[first..first + n + 2];
            let mut is_doubtful = false;
            let doubts = &self.maps.doubts[first..first + n + 2];
            let mut in_front = |texel: usize| {
                let [a, b, c, behind] = planes[texel];
                let depth = a * x[lane] + b * y[lane] + c * z[lane];
                let doubt = doubts[texel];
                let is_in_doubt = depth > doubt.from || l2[lane] > doubt.from_distance_2;
                is_doubtful |= is_in_doubt && depth <= 1.0 + behind && doubt.concerns(objects, 1 << lane);
                f32::from(depth <= 1.0 + behind)
            };
            let corners = [in_front(0), in_front(1), in_front(n), in_front(n + 1)];
            seen[lane] = corners[0];
            if is_doubtful || corners != [corners[0]; 4] {
                doubtful |= u32::from(objects.is_some()) << lane;
                seen[lane] = interpolated(planes, n, corners, fraction);
            }
        }
        (seen, doubtful)
    }
}

impl Doubt {
    /// Whether any of the lanes lies on another object.
    #[inline(always)]
    fn concerns(&self, objects: Option<&[u32; LANES]>, active: u32) -> bool {
        objects.is_some_and(|objects| set_bits(active).any(|lane| objects[lane] != self.object))
    }
}

impl Occlusion for VisibilityMap<'_> {
    const IS_UNOCCLUDED: bool = false;

    #[inline(always)]
    fn sky_fraction<S: Simd>(&self, simd: S, direction: V3<S>, active: u32) -> [f32; LANES] {
        self.sky_fraction_or(simd, direction, active, |_| None)
    }
}

impl VisibilityMap<'_> {
    /// Fraction of the environment around each direction that is not occluded. Lanes whose texels differ are asked from `exact`
    /// first.
    #[inline(always)]
    pub fn sky_fraction_or<S: Simd>(
        &self,
        simd: S,
        direction: V3<S>,
        active: u32,
        exact: impl Fn(usize) -> Option<f32>,
    ) -> [f32; LANES] {
        let place = self.place(self.local(simd, direction));
        let n = self.maps.resolution;
        let mut fractions = [0.0; LANES];
        for lane in set_bits(active) {
            let row = (self.map(lane) * n) as usize + place.j[lane] as usize;
            let pair = |row: usize| self.maps.sky_mask[row] >> place.i[lane] as u32 & 3;
            let bits = pair(row) | pair(row + 1) << 2;
            fractions[lane] = match bits {
                0 => 0.0,
                15 => 1.0,
                _ => exact(lane).unwrap_or_else(|| {
                    let n = n as usize;
                    let first = row * n + place.i[lane] as usize;
                    let fraction = [place.fraction[0][lane], place.fraction[1][lane]];
                    let corners = [0, 1, 2, 3].map(|k| (bits >> k & 1) as f32);
                    interpolated(&self.maps.planes[first..first + n + 2], n, corners, fraction)
                }),
            };
        }
        fractions
    }
}

/// Interpolates four texels of rows of `n`, each of which stores where its value changes to the next one's.
#[inline(always)]
fn interpolated(planes: &[[f32; 4]], n: usize, [a, b, c, d]: [f32; 4], [fx, fy]: [f32; 2]) -> f32 {
    let across = |texel: usize, fraction: f32, shift: u32| {
        let bits = planes[texel][3].to_bits() >> shift;
        let (edge, half) = ((bits >> 2 & 63) as f32 / 64.0, 0.125 * (1 << (bits & 3)) as f32);
        let (low, high) = ((edge - half).max(0.0), (edge + half).min(1.0));
        ((fraction - low) / (high - low)).clamp(0.0, 1.0)
    };
    let top = mix(a, b, across(0, fx, 8));
    let bottom = mix(c, d, across(n, fx, 8));
    mix(top, bottom, mix(across(0, fy, 0), across(1, fy, 0), fx))
}

#[inline(always)]
fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + t * (b - a)
}
