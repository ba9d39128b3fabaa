//! Twin of `shaders/shared/visibility.wgsl`, and the sight of those who do not look: [`Unhindered`].

use super::lanes::{
    F, LANES, Mask, Select, Simd, SimdBase, SimdFloat, SimdMask, V3, bits, clamp, set_bits, splat, vector,
};
use glam::{Vec2, Vec3};

use crate::pinhole::PinholeSample;
use crate::pinhole::visibility::{VisibilityMaps, frame};

/// What a sample sees of the environment.
pub(super) trait Sight {
    /// Whether nothing is ever hidden, so that nothing need be asked.
    const UNHINDERED: bool;

    /// The part of the environment around each direction that is not hidden; of use for `active` lanes only.
    fn open_part<S: Simd>(&self, simd: S, direction: V3<S>, active: u32) -> [f32; LANES];
}

/// Nothing is hidden.
pub(super) struct Unhindered;

impl Sight for Unhindered {
    const UNHINDERED: bool = true;

    #[inline(always)]
    fn open_part<S: Simd>(&self, _: S, _: V3<S>, _: u32) -> [f32; LANES] {
        [1.0; LANES]
    }
}

/// A sample's frame and maps, and in which lanes its other side is in question.
pub(super) struct Surroundings<'a> {
    maps: &'a VisibilityMaps,
    map: u32,
    /// The lanes for which the sample's other side counts.
    behind: u32,
    phase: Vec2,
    axes: [Vec3; 2],
    normal: Vec3,
}

/// What a sample sees of a number of places at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outlook {
    /// All of them.
    Clear,
    /// None.
    Dark,
    /// Some, or it would take too long to know.
    Mixed,
}

/// Texels that are looked at for an [`Outlook`] at most.
const MOST_TEXELS: usize = 256;

/// Texels of a map, from and to, both included.
struct MapRegion {
    i: [usize; 2],
    j: [usize; 2],
}

/// Four texels of a map.
struct MapPlace {
    i: [f32; LANES],
    j: [f32; LANES],
    part: [[f32; LANES]; 2],
}

/// Where on a map directions lie, texels.
struct OnMap<S: Simd> {
    u: F<S>,
    v: F<S>,
}

impl<'a> Surroundings<'a> {
    /// Looks around on the side that `dn` (see `gather`) tells, where the sample has two.
    #[inline(always)]
    pub fn new<S: Simd>(maps: &'a VisibilityMaps, sample: &PinholeSample, dn: F<S>) -> Self {
        let behind = if sample.two_sided() { bits(dn.simd_gt(0.0)) } else { 0 };
        let normal = sample.normal();
        Self { maps, map: sample.map(), behind, phase: sample.texel_jitter(), axes: frame(normal), normal }
    }

    #[inline(always)]
    fn local<S: Simd>(&self, simd: S, v: V3<S>) -> V3<S> {
        let (x, y) = (vector(simd, self.axes[0]).dot(v), vector(simd, self.axes[1]).dot(v));
        let z = vector(simd, self.normal).dot(v);
        V3([x, y, Mask::from_bitmask(simd, u64::from(self.behind)).select(-z, z)])
    }

    #[inline(always)]
    fn on_map<S: Simd>(&self, V3([x, y, z]): V3<S>) -> OnMap<S> {
        let scale = 0.5 / (x.abs() + y.abs() + z.max(0.0));
        let n = self.maps.resolution as f32;
        let u = clamp(((x + y) * scale + 0.5) * n - (0.5 + self.phase.x), 0.0, n - 1.0);
        let v = clamp(((x - y) * scale + 0.5) * n - (0.5 + self.phase.y), 0.0, n - 1.0);
        OnMap { u, v }
    }

    #[inline(always)]
    fn place<S: Simd>(&self, direction: V3<S>) -> MapPlace {
        let OnMap { u, v } = self.on_map(direction);
        let last = self.maps.resolution as f32 - 2.0;
        let (i, j) = (u.floor().min(last), v.floor().min(last));
        MapPlace { i: i.to_array(), j: j.to_array(), part: [(u - i).to_array(), (v - j).to_array()] }
    }

    /// The texels between the places of active lanes, and `margin` more on every side; `None` if they are too many.
    #[inline(always)]
    fn region<S: Simd>(&self, simd: S, direction: V3<S>, active: u32, margin: f32) -> Option<MapRegion> {
        let OnMap { u, v } = self.on_map(direction);
        let active = Mask::from_bitmask(simd, u64::from(active));
        let last = self.maps.resolution as usize - 1;
        let (nothing, all) = (splat(simd, 0.0), splat(simd, last as f32));
        // Casts end at 0.
        let low = |least: f32| (least - margin) as usize;
        let high = |most: f32| ((most + margin) as usize + 1).min(last);
        let i = [low(active.select(u, all).reduce_min()), high(active.select(u, nothing).reduce_max())];
        let j = [low(active.select(v, all).reduce_min()), high(active.select(v, nothing).reduce_max())];
        ((i[1] + 1 - i[0]) * (j[1] + 1 - j[0]) <= MOST_TEXELS).then_some(MapRegion { i, j })
    }

    /// What the sample sees of receivers at l, metres from it on, and of what lies between them.
    #[inline(always)]
    pub fn outlook<S: Simd>(&self, simd: S, l: V3<S>, active: u32) -> Outlook {
        if self.behind & active != 0 && self.behind & active != active {
            return Outlook::Mixed;
        }
        let local = self.local(simd, l);
        let Some(region) = self.region(simd, local, active, 0.0) else { return Outlook::Mixed };
        let n = self.maps.resolution as usize;
        let map = self.map(active.trailing_zeros() as usize) as usize;
        let mut all = None;
        for j in region.j[0]..=region.j[1] {
            for plane in &self.maps.planes[(map * n + j) * n..][region.i[0]..=region.i[1]] {
                let [a, b, c, behind] = *plane;
                let [x, y, z] = local.0;
                let seen = bits((x * a + y * b + z * c).simd_le(1.0 + behind)) & active;
                let one = match seen {
                    0 => Outlook::Dark,
                    seen if seen == active => Outlook::Clear,
                    _ => return Outlook::Mixed,
                };
                if all.is_some_and(|all| all != one) {
                    return Outlook::Mixed;
                }
                all = Some(one);
            }
        }
        all.unwrap_or(Outlook::Dark)
    }

    /// What the sample sees of the environment in these directions, between them and `reach` radians around them.
    #[inline(always)]
    pub fn sky<S: Simd>(&self, simd: S, direction: V3<S>, reach: f32, active: u32) -> Outlook {
        if self.behind & active != 0 && self.behind & active != active {
            return Outlook::Mixed;
        }
        let n = self.maps.resolution;
        // A half-space has 2π sr; texels are up to half as large again across.
        let margin = 1.5 * reach * n as f32 / std::f32::consts::TAU.sqrt();
        let local = self.local(simd, direction);
        let Some(region) = self.region(simd, local, active, margin) else { return Outlook::Mixed };
        let map = self.map(active.trailing_zeros() as usize);
        let mask = (u64::MAX >> (63 - region.i[1]) & u64::MAX << region.i[0]) as u32;
        let rows = &self.maps.open[(map * n) as usize..][region.j[0]..=region.j[1]];
        let (mut any, mut all) = (0, u32::MAX);
        for row in rows {
            (any, all) = (any | row, all & row);
        }
        match (any & mask, all & mask) {
            (0, _) => Outlook::Dark,
            (_, open) if open == mask => Outlook::Clear,
            _ => Outlook::Mixed,
        }
    }

    fn map(&self, lane: usize) -> u32 {
        self.map + (self.behind >> lane & 1)
    }

    /// The part of a receiver at l, metres from the sample on, that the sample sees.
    #[inline(always)]
    pub fn visible_part<S: Simd>(&self, simd: S, l: V3<S>, active: u32) -> [f32; LANES] {
        let local = self.local(simd, l);
        let place = self.place(local);
        let [x, y, z] = local.to_arrays();
        let n = self.maps.resolution as usize;
        let mut seen = [0.0; LANES];
        for lane in set_bits(active) {
            let first = (self.map(lane) as usize * n + place.j[lane] as usize) * n + place.i[lane] as usize;
            let part = [place.part[0][lane], place.part[1][lane]];
            seen[lane] = visible_part(&self.maps.planes[first..first + n + 2], n, [x[lane], y[lane], z[lane]], part);
        }
        seen
    }
}

impl Sight for Surroundings<'_> {
    const UNHINDERED: bool = false;

    #[inline(always)]
    fn open_part<S: Simd>(&self, simd: S, direction: V3<S>, active: u32) -> [f32; LANES] {
        let place = self.place(self.local(simd, direction));
        let n = self.maps.resolution;
        let mut open = [0.0; LANES];
        for lane in set_bits(active) {
            let row = (self.map(lane) * n) as usize + place.j[lane] as usize;
            let pair = |row: usize| self.maps.open[row] >> place.i[lane] as u32 & 3;
            let bits = pair(row) | pair(row + 1) << 2;
            open[lane] = match bits {
                0 => 0.0,
                15 => 1.0,
                _ => {
                    let n = n as usize;
                    let first = row * n + place.i[lane] as usize;
                    let part = [place.part[0][lane], place.part[1][lane]];
                    let corners = [0, 1, 2, 3].map(|k| (bits >> k & 1) as f32);
                    between(&self.maps.planes[first..first + n + 2], n, corners, part)
                }
            };
        }
        open
    }
}

/// The part of a receiver that is seen, from four texels of rows of `n`.
#[inline(always)]
fn visible_part(planes: &[[f32; 4]], n: usize, [x, y, z]: [f32; 3], [fx, fy]: [f32; 2]) -> f32 {
    let in_front = |texel: usize| {
        let [a, b, c, behind] = planes[texel];
        f32::from(a * x + b * y + c * z <= 1.0 + behind)
    };
    between(planes, n, [in_front(0), in_front(1), in_front(n), in_front(n + 1)], [fx, fy])
}

/// What lies between four texels of rows of `n`, each of which says where its value gives way to the next one's.
#[inline(always)]
fn between(planes: &[[f32; 4]], n: usize, [a, b, c, d]: [f32; 4], [fx, fy]: [f32; 2]) -> f32 {
    let across = |texel: usize, part: f32, shift: u32| {
        let bits = planes[texel][3].to_bits() >> shift;
        let (edge, half) = ((bits >> 2 & 63) as f32 / 64.0, 0.125 * (1 << (bits & 3)) as f32);
        let (low, high) = ((edge - half).max(0.0), (edge + half).min(1.0));
        ((part - low) / (high - low)).clamp(0.0, 1.0)
    };
    let top = mix(a, b, across(0, fx, 8));
    let bottom = mix(c, d, across(n, fx, 8));
    mix(top, bottom, mix(across(0, fy, 0), across(1, fy, 0), fx))
}

#[inline(always)]
fn mix(a: f32, b: f32, part: f32) -> f32 {
    a + part * (b - a)
}
