//! Trilinear, seamless cube-map look-ups of sixteen directions; twin of `shaders/shared/cube.wgsl` and of the GPU's sampler.

use fearless_simd::{SimdInt, SimdSplit, f32x4, f32x8, u32x16};
use glam::Vec4;

use crate::environment::CubeMap;
use crate::lanes::{
    ALL, F, LANES, Select, Simd, SimdBase, SimdFloat, V3, bits, dispatch, lanes, level, log2, set_bits, splat,
};
use crate::pinhole::GatherUniforms;

/// Width of a texel around a unit direction, radians. The solid angle of a texel is texel_rad² · m³ with m the largest
/// component.
#[inline(always)]
fn texel_width<S: Simd>(direction: V3<S>, texel_rad: f32) -> F<S> {
    let [x, y, z] = direction.0;
    let m = x.abs().max(y.abs()).max(z.abs());
    m * m.sqrt() * texel_rad
}

impl GatherUniforms {
    /// World directions in the frame of the environment. Without rotation they keep their bits.
    #[inline(always)]
    pub(super) fn light_from_world<S: Simd>(&self, direction: V3<S>) -> V3<S> {
        turned_back(direction, (self.rotation_cos, self.rotation_sin))
    }
}

/// Directions turned clockwise about +Y by an angle of this cosine and sine.
#[inline(always)]
fn turned_back<S: Simd>(V3([x, y, z]): V3<S>, (cos, sin): (f32, f32)) -> V3<S> {
    V3([x.mul_add(cos, z * -sin), y, z.mul_add(cos, x * sin)])
}

/// The level whose texels are `width` wide.
#[inline(always)]
pub(super) fn level_of<S: Simd>(width: F<S>, texel: F<S>) -> F<S> {
    // Clamped: the logarithm needs a normal number.
    log2((width / texel).max(1e-30)).max(0.0)
}

/// Sixteen directions, component by component: what [`CubeLookup::fetch16`] takes.
pub type Lanes16 = [[f32; LANES]; 3];

/// A cube map, as look-ups take it.
#[derive(Clone, Debug)]
pub struct CubeLookup<'a> {
    /// Level by level, six faces of (n + 2)² texels each: with borders.
    texels: &'a [Vec4],
    /// Texels along an edge of level 0, a power of two.
    size: u32,
    last_level: u32,
    rotation: Rotation,
}

/// Cosine and sine of the environment's rotation about +Y.
#[derive(Clone, Copy, Debug)]
struct Rotation {
    cos: f32,
    sin: f32,
}

/// What sixteen bilinear look-ups read, each in a level of its own: the numbers of the upper left and the lower left texel of four, and
/// the weights of the two on the right and of the two below.
struct Taps {
    upper: [u32; LANES],
    lower: [u32; LANES],
    right_weight: [f32; LANES],
    lower_weight: [f32; LANES],
}

/// Where directions intersect the cube: the face, and the place on it from 0 to 2.
pub(super) struct OnCube<S: Simd> {
    pub face: F<S>,
    pub s: F<S>,
    pub t: F<S>,
}

/// Directions of any length.
#[inline(always)]
pub(super) fn on_cube<S: Simd>(simd: S, V3([x, y, z]): V3<S>) -> OnCube<S> {
    let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
    let on_x = ax.simd_ge(ay) & ax.simd_ge(az);
    let on_y = ay.simd_ge(az);
    let main = on_x.select(x, on_y.select(y, z));
    let negative = main.simd_lt(0.0);
    let (flipped_x, flipped_z) = (negative.select(-x, x), negative.select(-z, z));
    let scale = 1.0 / main.abs();
    let s = scale * on_x.select(-flipped_z, on_y.select(x, flipped_x));
    let t = scale * on_x.select(-y, on_y.select(flipped_z, -y));
    let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
    let face = on_x.select(zero, on_y.select(splat(simd, 2.0), splat(simd, 4.0))) + negative.select(one, zero);
    OnCube { face, s: s + 1.0, t: t + 1.0 }
}

impl<'a> CubeLookup<'a> {
    /// Look-ups in a cube map.
    pub fn new(cube: &'a CubeMap) -> Self {
        Self {
            texels: cube.padded_texels(),
            size: cube.size(),
            last_level: cube.level_count() - 1,
            rotation: Rotation { cos: 1.0, sin: 0.0 },
        }
    }

    /// The same cube, rotated about +Y as a gather's uniforms say.
    pub(super) fn rotated(cube: &'a CubeMap, uniforms: &GatherUniforms) -> Self {
        let rotation = Rotation { cos: uniforms.rotation_cos, sin: uniforms.rotation_sin };
        Self { rotation, ..Self::new(cube) }
    }

    /// A world direction in the space of the cube. Without rotation it keeps its bits.
    #[inline(always)]
    pub(super) fn light_from_world<S: Simd>(&self, direction: V3<S>) -> V3<S> {
        turned_back(direction, (self.rotation.cos, self.rotation.sin))
    }

    /// Width of a texel of level 0 around a unit direction in the world, radians.
    #[inline(always)]
    pub(super) fn texel_width<S: Simd>(&self, direction: V3<S>) -> F<S> {
        texel_width(self.light_from_world(direction), self.texel_rad())
    }

    /// Width of a texel of level 0 at a face's centre, radians.
    pub(super) fn texel_rad(&self) -> f32 {
        2.0 / self.size as f32
    }

    /// Adds the radiance from sixteen directions (of any length) at sixteen levels to `sums`, for as long as `next` yields
    /// them; the fourth component counts.
    pub fn fetch16(&self, mut next: impl FnMut() -> Option<(Lanes16, [f32; LANES])>, sums: &mut [Vec4; LANES]) {
        dispatch!(level(), simd => self.fetch_all(simd, &mut next, sums));
    }

    #[inline(always)]
    fn fetch_all<S: Simd>(
        &self,
        simd: S,
        next: &mut impl FnMut() -> Option<(Lanes16, [f32; LANES])>,
        sums: &mut [Vec4; LANES],
    ) {
        while let Some((directions, levels)) = next() {
            let direction = V3::load(simd, &directions);
            self.fetch(
                simd,
                direction,
                lanes(simd, levels),
                ALL,
                #[inline(always)]
                |lane, radiance| sums[lane] += radiance,
            );
        }
    }

    /// Calls `take` with each lane whose bit is set in `active`, and the radiance from its world direction at its level, w = 1.
    #[inline(always)]
    pub(super) fn fetch<S: Simd>(
        &self,
        simd: S,
        direction: V3<S>,
        level: F<S>,
        active: u32,
        mut take: impl FnMut(usize, Vec4),
    ) {
        let place = on_cube(simd, self.light_from_world(direction));
        let level = level.max(0.0).min(self.last_level as f32);
        let fine = level.to_int::<u32x16<S>>().min(self.last_level);
        let coarse_weight = level - fine.to_float::<F<S>>();
        let taps = self.taps(simd, &place, fine);
        if active & bits(coarse_weight.simd_gt(0.0)) == 0 {
            for lane in set_bits(active) {
                take(lane, Vec4::from_array(self.bilinear(simd, &taps, lane).to_array()));
            }
            return;
        }
        let coarse_taps = self.taps(simd, &place, (fine + 1).min(self.last_level));
        let coarse_weight = coarse_weight.to_array();
        for lane in set_bits(active) {
            let value = self.bilinear(simd, &taps, lane);
            let coarse = self.bilinear(simd, &coarse_taps, lane);
            take(lane, Vec4::from_array((coarse - value).mul_add(coarse_weight[lane], value).to_array()));
        }
    }

    #[inline(always)]
    fn taps<S: Simd>(&self, simd: S, place: &OnCube<S>, level: u32x16<S>) -> Taps {
        let largest = u32x16::splat(simd, self.size);
        let size = largest >> level;
        let (half_size, pitch) = (size.to_float::<F<S>>() * 0.5, size + 2);
        // Border coordinates: texel i of the face is column i + 1.
        let (x, y) = (place.s * half_size + 0.5, place.t * half_size + 0.5);
        let (i, j) = (x.to_int::<u32x16<S>>().min(size), y.to_int::<u32x16<S>>().min(size));
        let face = place.face.to_int::<u32x16<S>>();
        let upper = level_offset(largest, size, level) + (face * pitch + j) * pitch + i;
        Taps {
            upper: upper.to_array(),
            lower: (upper + pitch).to_array(),
            right_weight: (x - i.to_float::<F<S>>()).to_array(),
            lower_weight: (y - j.to_float::<F<S>>()).to_array(),
        }
    }

    #[inline(always)]
    fn bilinear<S: Simd>(&self, simd: S, taps: &Taps, lane: usize) -> f32x4<S> {
        let (upper, lower) = (self.two_texels(simd, taps.upper[lane]), self.two_texels(simd, taps.lower[lane]));
        let (left, right) = (lower - upper).mul_add(taps.lower_weight[lane], upper).split();
        (right - left).mul_add(taps.right_weight[lane], left)
    }

    #[inline(always)]
    fn two_texels<S: Simd>(&self, simd: S, first: u32) -> f32x8<S> {
        let first = first as usize;
        f32x8::from_slice(simd, bytemuck::cast_slice(&self.texels[first..first + 2]))
    }
}

/// Where a level starts whose faces have `size`² texels: the sum of 6(n + 2)² over the larger ones. Twin of [`CubeMap::level_offset`].
#[inline(always)]
fn level_offset<S: Simd>(largest: u32x16<S>, size: u32x16<S>, level: u32x16<S>) -> u32x16<S> {
    (largest * largest - size * size) * 8 + (largest - size) * 48 + level * 24
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn sixteen_fetches_equal_single_ones() {
        let cube = CubeMap::from_radiance(32, None, |d| Vec3::new(1.0 + d.x, (5.0 * d.y).sin(), d.z * d.x));
        let lookup = CubeLookup::new(&cube);
        let x = [0.3, -0.9, 0.1, 0.2, 0.5, 0.5, -0.7, 1.0, 0.0, 1.0, -1.0, 0.2, 0.3, 0.4, -0.6, 0.1];
        let y = [0.9, 0.2, -0.8, 0.1, 0.5, -0.5, 0.7, 0.999, 0.0, 0.0, 1.0, -0.3, 0.1, 0.9, 0.6, 0.1];
        let z = [-0.1, 0.3, 0.2, -0.9, 0.9, 0.4, 0.1, -0.998, 1.0, 0.0, 0.0, 0.7, -0.8, 0.4, 0.6, 0.1];
        let levels = [0.0, 0.5, 1.0, 2.25, 3.7, 4.9, 5.0, 9.0, 0.0, 0.1, 4.0, 0.2, 1.5, 2.5, 3.5, 4.5];
        let mut sums = [Vec4::ZERO; LANES];
        let mut once = Some(([x, y, z], levels));
        lookup.fetch16(|| once.take(), &mut sums);
        for lane in 0..LANES {
            let expected = cube.fetch(Vec3::new(x[lane], y[lane], z[lane]), levels[lane]);
            assert!(sums[lane].truncate().abs_diff_eq(expected, 1e-4), "lane {lane}: {} {expected}", sums[lane]);
            assert!((sums[lane].w - 1.0).abs() < 1e-5);
        }
    }
}
