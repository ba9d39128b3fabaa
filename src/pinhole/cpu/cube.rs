//! Trilinear, seamless cube-map look-ups of eight directions; twin of `shaders/shared/cube.wgsl` and of the GPU's sampler.

use glam::Vec4;
use wide::f32x8;

use super::lanes::{F, V3, splat};
use crate::environment::CubeMap;

/// Width of a texel around a unit direction, radians. The solid angle of a texel is texel_rad² · m³ with m the largest
/// component.
#[inline(always)]
pub(super) fn texel_width(direction: V3, texel_rad: f32) -> F {
    let [x, y, z] = direction.0.map(F::abs);
    let m = x.max(y).max(z);
    splat(texel_rad) * m * m.sqrt()
}

/// The level whose texels are `width` wide.
#[inline(always)]
pub(super) fn level_of(width: F, texel: F) -> F {
    ((width / texel).ln() * splat(std::f32::consts::LOG2_E)).max(F::ZERO)
}

/// Eight directions, component by component: what [`CubeLookup::fetch8`] takes.
pub type Lanes8 = [[f32; 8]; 3];

/// A cube map, laid out for look-ups.
#[derive(Clone, Debug)]
pub struct CubeLookup<'a> {
    texels: &'a [Vec4],
    levels: Vec<Level>,
    last: f32,
}

#[derive(Clone, Copy, Debug)]
struct Level {
    offset: usize,
    /// Texels from one row to the next, borders included.
    pitch: usize,
    face: usize,
    half_size: f32,
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
        Self { texels: cube.padded_texels(), levels: (0..count).map(level).collect(), last: (count - 1) as f32 }
    }

    /// Width of a texel of level 0 at a face's centre, radians.
    pub(super) fn texel_rad(&self) -> f32 {
        1.0 / self.levels[0].half_size
    }

    /// Adds the radiance from eight directions (of any length) at eight levels to `sums`; the fourth component counts.
    pub fn fetch8(&self, directions: &Lanes8, levels: &[f32; 8], sums: &mut [Vec4; 8]) {
        let add = |lane: usize, radiance| sums[lane] += radiance;
        self.fetch(V3(directions.map(f32x8::new)), f32x8::new(*levels), 0xff, add);
    }

    /// Calls `take` with each lane whose bit is set in `active`, and the radiance from its direction at its level, w = 1.
    #[inline(always)]
    pub(super) fn fetch(&self, direction: V3, level: F, active: u32, mut take: impl FnMut(usize, Vec4)) {
        let [x, y, z] = direction.0;
        let [ax, ay, az] = direction.0.map(F::abs);
        let on_x = ax.simd_ge(ay) & ax.simd_ge(az);
        let on_y = ay.simd_ge(az);
        let main = on_x.bitselect(x, on_y.bitselect(y, z));
        let negative = main.simd_lt(F::ZERO);
        let flip = |v: F| negative.bitselect(-v, v);
        let scale = F::ONE / main.abs();
        let s = scale * on_x.bitselect(flip(-z), on_y.bitselect(x, flip(x)));
        let t = scale * on_x.bitselect(-y, on_y.bitselect(flip(z), -y));
        let face = on_x.bitselect(F::ZERO, on_y.bitselect(splat(2.0), splat(4.0))) + (negative & F::ONE);
        let level = level.min(splat(self.last));
        let blended = level.simd_gt(level.floor()).to_bitmask();
        let (s, t) = ((s + F::ONE).to_array(), (t + F::ONE).to_array());
        let (face, level) = (face.to_array(), level.to_array());
        for lane in 0..8 {
            if active & (1 << lane) == 0 {
                continue;
            }
            let (face, fine) = (face[lane] as usize, level[lane] as usize);
            let mut value = self.bilinear(fine, face, s[lane], t[lane]);
            if blended & (1 << lane) != 0 {
                let coarse = self.bilinear(fine + 1, face, s[lane], t[lane]);
                value += (level[lane] - fine as f32) * (coarse - value);
            }
            take(lane, value);
        }
    }

    /// `s` and `t` from 0 to 2 across a face.
    #[inline(always)]
    fn bilinear(&self, level: usize, face: usize, s: f32, t: f32) -> Vec4 {
        let Level { offset, pitch, face: face_texels, half_size } = self.levels[level];
        // Border coordinates: texel i of the face is column i + 1.
        let (x, y) = (s * half_size + 0.5, t * half_size + 0.5);
        let (i, j) = ((x as usize).min(pitch - 2), (y as usize).min(pitch - 2));
        let (fx, fy) = (x - i as f32, y - j as f32);
        let start = offset + face * face_texels + j * pitch + i;
        let upper = &self.texels[start..start + pitch + 2];
        let top = upper[0] + fx * (upper[1] - upper[0]);
        let bottom = upper[pitch] + fx * (upper[pitch + 1] - upper[pitch]);
        top + fy * (bottom - top)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn eight_look_ups_are_eight_single_ones() {
        let cube = CubeMap::from_radiance(32, None, |d| Vec3::new(1.0 + d.x, (5.0 * d.y).sin(), d.z * d.x));
        let lookup = CubeLookup::new(&cube);
        let directions: Lanes8 = [
            [0.3, -0.9, 0.1, 0.2, 0.5, 0.5, -0.7, 1.0],
            [0.9, 0.2, -0.8, 0.1, 0.5, -0.5, 0.7, 0.999],
            [-0.1, 0.3, 0.2, -0.9, 0.9, 0.4, 0.1, -0.998],
        ];
        let levels = [0.0, 0.5, 1.0, 2.25, 3.7, 4.9, 5.0, 9.0];
        let mut sums = [Vec4::ZERO; 8];
        lookup.fetch8(&directions, &levels, &mut sums);
        for lane in 0..8 {
            let d = Vec3::new(directions[0][lane], directions[1][lane], directions[2][lane]);
            let expected = cube.fetch(d, levels[lane]);
            assert!(sums[lane].truncate().abs_diff_eq(expected, 1e-4), "lane {lane}: {} {expected}", sums[lane]);
            assert!((sums[lane].w - 1.0).abs() < 1e-5);
        }
    }
}
