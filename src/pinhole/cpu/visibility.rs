//! Twin of `shaders/shared/visibility.wgsl`, and the sight of those who do not look: [`Unhindered`].

use super::lanes::{F, V3, abs, clamp, splat, vector};
use crate::pinhole::PinholeSample;
use crate::pinhole::visibility::{VisibilityMaps, frame};

const LANES: usize = 8;

/// What a sample sees of the environment.
pub(super) trait Sight {
    /// Whether nothing is ever hidden, so that nothing need be asked.
    const UNHINDERED: bool;

    /// The part of the environment around each direction that is not hidden; of use for `active` lanes only.
    fn open_part(&self, direction: V3, active: u32) -> [f32; LANES];
}

/// Nothing is hidden.
pub(super) struct Unhindered;

impl Sight for Unhindered {
    const UNHINDERED: bool = true;

    #[inline(always)]
    fn open_part(&self, _: V3, _: u32) -> [f32; LANES] {
        [1.0; LANES]
    }
}

/// A sample's frame and maps; lane by lane the side in question.
pub(super) struct Surroundings<'a> {
    maps: &'a VisibilityMaps,
    map: [u32; LANES],
    phase: [F; 2],
    axes: [V3; 3],
}

/// Four texels of a map.
struct MapPlace {
    i: [f32; LANES],
    j: [f32; LANES],
    part: [[f32; LANES]; 2],
}

impl<'a> Surroundings<'a> {
    /// Looks around on the side that `dn` (see `gather`) tells, where the sample has two.
    #[inline]
    pub fn new(maps: &'a VisibilityMaps, sample: &PinholeSample, dn: F) -> Self {
        let [t, b] = frame(sample.normal());
        let behind = dn.simd_gt(F::ZERO);
        let behind_bits = if sample.two_sided() { behind.to_bitmask() } else { 0 };
        let first = sample.map();
        let phase = sample.phase();
        let side = if sample.two_sided() { behind.bitselect(splat(-1.0), F::ONE) } else { F::ONE };
        Self {
            maps,
            map: std::array::from_fn(|lane| first + (behind_bits >> lane & 1)),
            phase: [splat(phase.x), splat(phase.y)],
            axes: [vector(t), vector(b), vector(sample.normal()) * side],
        }
    }

    #[inline(always)]
    fn local(&self, v: V3) -> V3 {
        V3(self.axes.each_ref().map(|axis| axis.dot(v)))
    }

    #[inline(always)]
    fn place(&self, V3([x, y, z]): V3) -> MapPlace {
        let scale = splat(0.5) / (abs(x) + abs(y) + z.max(F::ZERO));
        let n = splat(self.maps.resolution as f32);
        let texel = |sum: F, phase: F| clamp((sum * scale + splat(0.5)) * n - splat(0.5) - phase, F::ZERO, n - F::ONE);
        let (u, v) = (texel(x + y, self.phase[0]), texel(x - y, self.phase[1]));
        let last = n - splat(2.0);
        let (i, j) = (u.floor().min(last), v.floor().min(last));
        MapPlace { i: i.to_array(), j: j.to_array(), part: [(u - i).to_array(), (v - j).to_array()] }
    }

    /// The part of a receiver at l, metres from the sample on, that the sample sees.
    #[inline]
    pub fn visible_part(&self, l: V3, active: u32) -> [f32; LANES] {
        let local = self.local(l);
        let place = self.place(local);
        let [x, y, z] = local.0.map(F::to_array);
        let n = self.maps.resolution as usize;
        std::array::from_fn(|lane| {
            if active & (1 << lane) == 0 {
                return 0.0;
            }
            let first = (self.map[lane] as usize * n + place.j[lane] as usize) * n + place.i[lane] as usize;
            let planes = &self.maps.planes[first..first + n + 2];
            let in_front = |texel: usize| {
                let [a, b, c, behind] = planes[texel];
                f32::from(a * x[lane] + b * y[lane] + c * z[lane] <= 1.0 + behind)
            };
            let across = |texel: usize, part: f32, shift: u32| {
                let bits = planes[texel][3].to_bits() >> shift;
                let (edge, half) = ((bits >> 2 & 63) as f32 / 64.0, 0.125 * (1 << (bits & 3)) as f32);
                let (low, high) = ((edge - half).max(0.0), (edge + half).min(1.0));
                ((part - low) / (high - low)).clamp(0.0, 1.0)
            };
            let (fx, fy) = (place.part[0][lane], place.part[1][lane]);
            let top = mix(in_front(0), in_front(1), across(0, fx, 8));
            let bottom = mix(in_front(n), in_front(n + 1), across(n, fx, 8));
            mix(top, bottom, mix(across(0, fy, 0), across(1, fy, 0), fx))
        })
    }
}

impl Sight for Surroundings<'_> {
    const UNHINDERED: bool = false;

    #[inline]
    fn open_part(&self, direction: V3, active: u32) -> [f32; LANES] {
        let place = self.place(self.local(direction));
        let n = self.maps.resolution;
        std::array::from_fn(|lane| {
            if active & (1 << lane) == 0 {
                return 0.0;
            }
            let row = (self.map[lane] * n) as usize + place.j[lane] as usize;
            let bit = |row: usize, k: u32| (self.maps.open[row] >> (place.i[lane] as u32 + k) & 1) as f32;
            bilinear([bit(row, 0), bit(row, 1), bit(row + 1, 0), bit(row + 1, 1)], &place, lane)
        })
    }
}

#[inline(always)]
fn bilinear([a, b, c, d]: [f32; 4], place: &MapPlace, lane: usize) -> f32 {
    let (fx, fy) = (place.part[0][lane], place.part[1][lane]);
    mix(mix(a, b, fx), mix(c, d, fx), fy)
}

#[inline(always)]
fn mix(a: f32, b: f32, part: f32) -> f32 {
    a + part * (b - a)
}
