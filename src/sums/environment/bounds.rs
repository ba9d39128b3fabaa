//! How bright the environment is at most within a cone of directions, and how much its radiance differs there.
//!
//! A pyramid of extremes beside the cube's mips. Every texel knows those of its 3×3 neighbourhood, across the faces' seams,
//! so that one read bounds a cone.

use fearless_simd::{Select, Simd, SimdBase, SimdFloat, SimdInt, f32x16, u32x16};
use glam::{Vec2, Vec3, Vec4};

use super::FIRST_BOUNDED_MIP;
use super::cube::{CubeMap, FACES, face_of_direction, fill_borders, fill_rows, padded_len, rows};
use super::strips::ArcBounds;
use crate::parallel;

/// What is known of the radiance from a set of directions, W/(m²·sr).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bound {
    /// No channel is brighter.
    pub max: f32,
    /// In no channel do two directions differ by more.
    pub contrast: f32,
}

/// Bounds of a cube map's radiance, and of the radiance of its mips.
#[derive(Clone, Debug)]
pub struct LightBounds {
    /// Of the light itself and of its mips from [`FIRST_BOUNDED_MIP`] on, then from the level with as many texels as the mip to that with one.
    pyramids: Vec<Vec<Level>>,
    /// Of all levels; the last is that of all directions.
    texels: Vec<Bound>,
    /// Of means along arcs.
    along_arcs: ArcBounds,
}

#[derive(Clone, Copy, Debug)]
struct Level {
    offset: usize,
    size: usize,
}

/// The finest level has at most so many texels along an edge: 50 MB of bounds.
pub const FINEST_BOUNDS: u32 = 1024;

/// The least and the greatest radiance, channel by channel.
#[derive(Clone, Copy, Default)]
struct Extremes {
    low: Vec3,
    high: Vec3,
}

impl Extremes {
    fn join(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn bound(self) -> Bound {
        Bound { max: self.high.max_element(), contrast: (self.high - self.low).max_element() }
    }
}

/// The mip that a pyramid bounds.
pub fn mip_of_pyramid(pyramid: u32) -> u32 {
    if pyramid == 0 { 0 } else { pyramid + FIRST_BOUNDED_MIP - 1 }
}

impl LightBounds {
    /// Bounds of a cube map.
    pub fn new(cube: &CubeMap) -> Self {
        Self::with_finest(cube, FINEST_BOUNDS)
    }

    /// The same, the finest level having at most so many texels along an edge.
    pub fn with_finest(cube: &CubeMap, finest: u32) -> Self {
        let mut size = cube.size();
        let mut level = extremes_of(cube, 0);
        while size > finest {
            (level, size) = (downsample(&level, size), size / 2);
        }
        let first_mip = cube.size().ilog2() - size.ilog2();
        let mut bounds = Self { pyramids: Vec::new(), texels: Vec::new(), along_arcs: ArcBounds::new(cube) };
        let everywhere = bounds.add_pyramid(level, size).bound();
        for mip in first_mip + FIRST_BOUNDED_MIP..cube.level_count() {
            bounds.add_pyramid(extremes_of(cube, mip), cube.size() >> mip);
        }
        bounds.texels.push(everywhere);
        bounds
    }

    /// Adds the levels above one; returns the extremes of everything.
    fn add_pyramid(&mut self, mut level: Vec<Extremes>, mut size: u32) -> Extremes {
        let mut levels = Vec::new();
        loop {
            levels.push(Level { offset: self.texels.len(), size: size as usize });
            self.texels.extend(dilated(&level, size));
            if size == 1 {
                break;
            }
            (level, size) = (downsample(&level, size), size / 2);
        }
        self.pyramids.push(levels);
        rows(&level, size).flatten().copied().reduce(Extremes::join).expect("six faces")
    }

    /// How bright the mean along an arc of such a length, radians, is at most in any channel, if bright sets of directions are round.
    #[inline]
    pub(crate) fn along_arc(&self, length: f32) -> f32 {
        self.along_arcs.at(length)
    }

    /// These bounds for arcs of 2⁻¹² radians, twice that and so on up to 1.
    pub fn along_arcs(&self) -> &[f32] {
        self.along_arcs.steps()
    }

    /// Texels along an edge of the finest level.
    pub fn size(&self) -> u32 {
        self.pyramids[0][0].size as u32
    }

    /// The levels of each pyramid, the finest first: texels along an edge, and those of all faces.
    pub fn pyramids(&self) -> impl Iterator<Item = impl Iterator<Item = (u32, &[Bound])>> {
        let of_level = |l: &Level| (l.size as u32, &self.texels[l.offset..][..FACES * l.size * l.size]);
        self.pyramids.iter().map(move |levels| levels.iter().map(of_level))
    }

    /// The pyramid that bounds look-ups of light that is blurred over a width, radians.
    #[inline]
    pub fn pyramid(&self, blur: f32) -> usize {
        let texels = self.half_size() * blur;
        if texels < 1.0 {
            return 0;
        }
        let exponent = (texels.to_bits() >> 23) - 127;
        ((exponent + 1).saturating_sub(FIRST_BOUNDED_MIP) as usize).min(self.pyramids.len() - 1)
    }

    /// Bounds of what look-ups find within `radius` radians of a direction of any length, if none of them is narrower than `blur`
    /// radians.
    #[inline]
    pub fn within(&self, direction: Vec3, radius: f32, blur: f32) -> Bound {
        let pyramid = self.pyramid(blur);
        let (face, st) = face_of_direction(direction);
        self.at(face, st + 1.0, self.reach(st.length_squared(), radius, pyramid), pyramid)
    }

    /// How far a cone around a place on a face reaches, texels of the finest level; `st2` is the square of the place's distance
    /// from the face's centre, whose edges are at 1. On a face's plane angles are stretched by 1 + s² + t² at most; a bilinear
    /// look-up reads a texel further.
    #[inline]
    fn reach(&self, st2: f32, radius: f32, pyramid: usize) -> f32 {
        radius * (1.0 + st2) * self.half_size() + Self::texel_width(pyramid)
    }

    /// Width of the texels of a pyramid's finest level, texels of the finest one of all.
    #[inline]
    pub(crate) fn texel_width(pyramid: usize) -> f32 {
        (1u32 << mip_of_pyramid(pyramid as u32)) as f32
    }

    /// Half a face's edge, texels of the finest level.
    #[inline]
    pub(crate) fn half_size(&self) -> f32 {
        0.5 * self.pyramids[0][0].size as f32
    }

    /// The bound around a place on a face, from 0 to 2, as far as `reach` texels of the finest level.
    #[inline]
    pub fn at(&self, face: usize, st: Vec2, reach: f32, pyramid: usize) -> Bound {
        // ⌈log₂ reach⌉ of what is 1 at least.
        let level = (((0.999_999 * reach).to_bits() >> 23) as usize).saturating_sub(126);
        let Some(&Level { offset, size }) = self.pyramids[pyramid].get(level - mip_of_pyramid(pyramid as u32) as usize)
        else {
            // What is wider than half the sphere, and NaN.
            return self.texels[self.texels.len() - 1];
        };
        let index = |s: f32| ((0.5 * s * size as f32) as usize).min(size - 1);
        self.texels[offset + (face * size + index(st.y)) * size + index(st.x)]
    }

    /// The same around sixteen places: the numbers of their bounds, for [`Self::texel`].
    #[inline(always)]
    pub(crate) fn texels_at<S: Simd>(&self, simd: S, [face, s, t, reach]: [f32x16<S>; 4], pyramid: usize) -> [u32; 16] {
        let levels = &self.pyramids[pyramid];
        let (last, first_mip) = (levels.len() as u32 - 1, mip_of_pyramid(pyramid as u32));
        let exponent: u32x16<S> = (reach * 0.999_999).to_bits() >> 23;
        let level = exponent.max(126 + first_mip) - (126 + first_mip);
        let is_too_wide = level.simd_gt(last);
        let level = level.min(last);
        let largest = u32x16::splat(simd, levels[0].size as u32);
        let size = largest >> level;
        let half_size = size.to_float::<f32x16<S>>() * 0.5;
        let (i, j) = ((s * half_size).to_int::<u32x16<S>>(), (t * half_size).to_int::<u32x16<S>>());
        // The sum of 6n² over the larger levels.
        let before = (largest * largest - size * size) * 8 + levels[0].offset as u32;
        let row = face.to_int::<u32x16<S>>() * size + j.min(size - 1);
        let everywhere = u32x16::splat(simd, self.texels.len() as u32 - 1);
        is_too_wide.select(everywhere, before + row * size + i.min(size - 1)).to_array()
    }

    /// A bound by its number.
    #[inline(always)]
    pub fn texel(&self, number: u32) -> Bound {
        self.texels[number as usize]
    }
}

/// The extremes of each texel of a cube's mip; with borders, as those of all levels.
fn extremes_of(cube: &CubeMap, mip: u32) -> Vec<Extremes> {
    let size = cube.size() >> mip;
    let texels = &cube.padded_texels()[cube.level_offset(mip) as usize..][..padded_len(size)];
    let of_texel = |t: &Vec4| Extremes { low: t.truncate(), high: t.truncate() };
    let mut level = parallel::map(texels, &of_texel);
    // A corner stands for all three texels that meet there, not for their mean.
    fill_borders(&mut level, size, join_corner);
    level
}

fn join_corner(a: Extremes, b: Extremes, c: Extremes) -> Extremes {
    a.join(b).join(c)
}

/// Each texel's bound over its 3×3 neighbourhood.
fn dilated(level: &[Extremes], size: u32) -> Vec<Bound> {
    let (n, w) = (size as usize, size as usize + 2);
    let mut bounds = vec![Bound::default(); FACES * n * n];
    parallel::for_each_chunk(&mut bounds, n, &|k, out| {
        let three_rows = &level[(k / n * w + k % n) * w..][..3 * w];
        let column = |x: usize| three_rows[x].join(three_rows[w + x]).join(three_rows[2 * w + x]);
        let (mut left, mut middle) = (column(0), column(1));
        for (x, bound) in out.iter_mut().enumerate() {
            let right = column(x + 2);
            *bound = left.join(middle).join(right).bound();
            (left, middle) = (middle, right);
        }
    });
    bounds
}

/// The next coarser level of one of `size`² texels a face.
fn downsample(level: &[Extremes], size: u32) -> Vec<Extremes> {
    let (n, w) = (size / 2, size as usize + 2);
    let mut coarser = vec![Extremes::default(); padded_len(n)];
    fill_rows(&mut coarser, n, |face, y, row| {
        let two_rows = &level[(face * w + 2 * y + 1) * w..][..2 * w];
        for (x, texel) in row.iter_mut().enumerate() {
            let pair = |dy: usize| two_rows[dy * w + 2 * x + 1].join(two_rows[dy * w + 2 * x + 2]);
            *texel = pair(0).join(pair(1));
        }
    });
    fill_borders(&mut coarser, n, join_corner);
    coarser
}

#[cfg(test)]
mod tests {
    use crate::lanes::{dispatch, level};

    use super::*;
    use crate::environment::face_direction;

    fn spotted() -> CubeMap {
        // Bright spots on a face, on a seam and at a corner.
        let spots = [Vec3::X, Vec3::new(1.0, 1.0, 0.2), Vec3::ONE].map(Vec3::normalize);
        CubeMap::from_radiance(64, None, move |d| {
            let brightest = spots.iter().map(|s| (200.0 * (d.dot(*s) - 1.0)).exp()).fold(0.0, f32::max);
            Vec3::new(0.5 + 9.0 * brightest, 1.0, 2.0 + d.y)
        })
    }

    #[test]
    fn look_ups_keep_within_the_bounds_of_their_cone() {
        let cube = spotted();
        let bounds = LightBounds::new(&cube);
        let mut tight = 0;
        for k in 0..4000u32 {
            // Every other look-up is blurred.
            let lod = if k % 2 == 0 { 0.0 } else { 5.0 * (k as f32 * 0.324_718).fract() };
            let at = |s: f32| (k as f32 * s).fract() * 2.0 - 1.0;
            let centre = face_direction(k as usize % FACES, at(0.618_034), at(0.754_878)).normalize();
            let radius = 0.5 * (k as f32 * 0.569_84).fract().powi(3);
            let blur = if lod == 0.0 { 0.0 } else { lod.exp2() * 2.0 / cube.size() as f32 };
            let bound = bounds.within(centre, radius, blur);
            let (u, v) = centre.any_orthonormal_pair();
            let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            for step in 0..64 {
                let (turn, part) = (step as f32 * 2.4, (step as f32 / 63.0).sqrt());
                let d = centre + (radius * part).tan() * (turn.cos() * u + turn.sin() * v);
                let value = cube.fetch(d, lod);
                (low, high) = (low.min(value), high.max(value));
            }
            assert!(high.max_element() <= bound.max * 1.0001, "{centre} {radius}: {high} > {}", bound.max);
            let contrast = (high - low).max_element();
            assert!(contrast <= bound.contrast * 1.0001 + 1e-5, "{centre} {radius}: {contrast} > {}", bound.contrast);
            tight += usize::from(bound.contrast < 2.0 * contrast + 0.2);
        }
        assert!(tight > 1500, "bounds should be of use: {tight}");
    }

    #[test]
    fn sixteen_bounds_equal_single_ones() {
        let bounds = LightBounds::new(&spotted());
        let part = |k: usize, step: f32| (k as f32 * step).fract();
        for pyramid in 0..bounds.pyramids.len() {
            let face: [f32; 16] = std::array::from_fn(|k| (k % FACES) as f32);
            let [s, t] = [0.618_034, 0.754_878].map(|step| std::array::from_fn(|k| 2.0 * part(k + pyramid, step)));
            // From the finest level to wider than all, and NaN.
            let reach: [f32; 16] = std::array::from_fn(|k| LightBounds::texel_width(pyramid) * 1.7f32.powi(k as i32));
            let reach = std::array::from_fn(|k| if k == 15 { f32::NAN } else { reach[k] });
            let numbers = dispatch!(level(), simd => {
                bounds.texels_at(simd, [face, s, t, reach].map(|values| f32x16::load_array(simd, values)), pyramid)
            });
            for k in 0..16 {
                let single = bounds.at(face[k] as usize, Vec2::new(s[k], t[k]), reach[k], pyramid);
                assert_eq!(bounds.texel(numbers[k]), single, "pyramid {pyramid}, place {k}");
            }
        }
    }

    #[test]
    fn a_constant_has_no_contrast_and_a_wide_cone_sees_all() {
        let even = LightBounds::new(&CubeMap::from_radiance(16, None, |_| Vec3::splat(2.0)));
        assert_eq!(even.within(Vec3::Y, 0.3, 0.0), Bound { max: 2.0, contrast: 0.0 });
        let cube = spotted();
        let bounds = LightBounds::new(&cube);
        for radius in [2.0, 4.0, f32::INFINITY, f32::NAN] {
            assert!(bounds.within(-Vec3::X, radius, 0.0).max > 9.0);
        }
    }
}
