//! Trilinear, seamless cube-map look-ups of sixteen directions; twin of `shaders/shared/cube.wgsl` and of the GPU's sampler.

use fearless_simd::{SimdSplit, f32x4, f32x8};
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

/// The level whose texels are `width` wide.
#[inline(always)]
pub(super) fn level_of<S: Simd>(width: F<S>, texel: F<S>) -> F<S> {
    // Clamped: the logarithm needs a normal number.
    log2((width / texel).max(1e-30)).max(0.0)
}

/// Sixteen directions, component by component: what [`CubeLookup::fetch16`] takes.
pub type Lanes16 = [[f32; LANES]; 3];

/// A cube map, laid out for look-ups.
#[derive(Clone, Debug)]
pub struct CubeLookup<'a> {
    /// Four numbers a texel.
    texels: &'a [f32],
    levels: Vec<Level>,
    last: f32,
    rotation: Rotation,
}

/// Cosine and sine of the environment's rotation about +Y.
#[derive(Clone, Copy, Debug)]
struct Rotation {
    cos: f32,
    sin: f32,
}

#[derive(Clone, Copy, Debug)]
struct Level {
    offset: usize,
    /// Texels from one row to the next, borders included.
    pitch: usize,
    face: usize,
    half_size: f32,
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
    /// Prepares a cube map.
    pub fn new(cube: &'a CubeMap) -> Self {
        let level = |l: u32| {
            let n = (cube.size() >> l) as usize;
            Level {
                offset: cube.level_offset(l) as usize,
                pitch: n + 2,
                face: (n + 2) * (n + 2),
                half_size: 0.5 * n as f32,
            }
        };
        let count = cube.level_count();
        Self {
            texels: bytemuck::cast_slice(cube.padded_texels()),
            levels: (0..count).map(level).collect(),
            last: (count - 1) as f32,
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
    pub(super) fn light_from_world<S: Simd>(&self, V3([x, y, z]): V3<S>) -> V3<S> {
        let Rotation { cos, sin } = self.rotation;
        V3([x.mul_add(cos, z * -sin), y, z.mul_add(cos, x * sin)])
    }

    /// Width of a texel of level 0 around a unit direction in the world, radians.
    #[inline(always)]
    pub(super) fn texel_width<S: Simd>(&self, direction: V3<S>) -> F<S> {
        texel_width(self.light_from_world(direction), self.texel_rad())
    }

    /// Width of a texel of level 0 at a face's centre, radians.
    pub(super) fn texel_rad(&self) -> f32 {
        1.0 / self.levels[0].half_size
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
            self.fetch(simd, direction, lanes(simd, levels), ALL, |lane, radiance| sums[lane] += radiance);
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
        let OnCube { face, s, t } = on_cube(simd, self.light_from_world(direction));
        let level = level.min(self.last);
        let blended = bits(level.simd_gt(level.floor()));
        let (s, t) = (s.to_array(), t.to_array());
        let (face, level) = (face.to_array(), level.to_array());
        for lane in set_bits(active) {
            let (face, fine) = (face[lane] as usize, level[lane] as usize);
            let mut value = self.bilinear(simd, fine, face, s[lane], t[lane]);
            if blended & (1 << lane) != 0 {
                let coarse = self.bilinear(simd, fine + 1, face, s[lane], t[lane]);
                value = (coarse - value).mul_add(level[lane] - fine as f32, value);
            }
            take(lane, Vec4::from_array(value.to_array()));
        }
    }

    /// `s` and `t` from 0 to 2 across a face.
    #[inline(always)]
    fn bilinear<S: Simd>(&self, simd: S, level: usize, face: usize, s: f32, t: f32) -> f32x4<S> {
        let Level { offset, pitch, face: face_texels, half_size } = self.levels[level];
        // Border coordinates: texel i of the face is column i + 1.
        let (x, y) = (s * half_size + 0.5, t * half_size + 0.5);
        let (i, j) = ((x as usize).min(pitch - 2), (y as usize).min(pitch - 2));
        let (fx, fy) = (x - i as f32, y - j as f32);
        let start = 4 * (offset + face * face_texels + j * pitch + i);
        let upper = &self.texels[start..start + 4 * pitch + 8];
        // Two texels at a time.
        let top = f32x8::from_slice(simd, &upper[..8]);
        let bottom = f32x8::from_slice(simd, &upper[4 * pitch..]);
        let (left, right) = (bottom - top).mul_add(fy, top).split();
        (right - left).mul_add(fx, left)
    }
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
