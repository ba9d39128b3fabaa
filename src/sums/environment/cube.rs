//! Cube maps with mips: geometry, prefiltering and the trilinear look-up.
//!
//! Every face of every level is stored with a border of one texel copied from its neighbours, so that bilinear
//! look-ups are seamless as WebGPU's are (a corner, where three faces meet, is the mean of the three).

use std::borrow::Cow;
use std::sync::OnceLock;

use glam::{Vec2, Vec3, Vec4};

use crate::parallel;

/// +X −X +Y −Y +Z −Z.
pub const FACES: usize = 6;

/// A cube map: RGB and a spare channel (1) a texel, 32-bit floats.
#[derive(Clone, Debug)]
pub struct CubeMap {
    size: u32,
    /// Where each level starts in `texels`.
    offsets: Vec<u32>,
    texels: Vec<Vec4>,
}

/// The direction of a point on a face, `s` and `t` in [−1, 1]; not normalised. WebGPU's orientation.
pub fn face_direction(face: usize, s: f32, t: f32) -> Vec3 {
    match face {
        0 => Vec3::new(1.0, -t, -s),
        1 => Vec3::new(-1.0, -t, s),
        2 => Vec3::new(s, 1.0, t),
        3 => Vec3::new(s, -1.0, -t),
        4 => Vec3::new(s, -t, 1.0),
        _ => Vec3::new(-s, -t, -1.0),
    }
}

/// The face that a direction meets and where, in [−1, 1]².
pub fn face_of_direction(d: Vec3) -> (usize, Vec2) {
    let a = d.abs();
    if a.x >= a.y && a.x >= a.z {
        let (s, t) = (-d.z / d.x, -d.y / a.x);
        (usize::from(d.x < 0.0), Vec2::new(s, t))
    } else if a.y >= a.z {
        let (s, t) = (d.x / a.y, d.z / d.y);
        (2 + usize::from(d.y < 0.0), Vec2::new(s, t))
    } else {
        let (s, t) = (d.x / d.z, -d.y / a.z);
        (4 + usize::from(d.z < 0.0), Vec2::new(s, t))
    }
}

/// Solid angle of texel (`x`, `y`) of a face of `size`² texels, sr; exact.
pub fn texel_solid_angle_sr(size: u32, x: u32, y: u32) -> f64 {
    let corner = |i: u32| 2.0 * f64::from(i) / f64::from(size) - 1.0;
    let (s0, s1, t0, t1) = (corner(x), corner(x + 1), corner(y), corner(y + 1));
    corner_term(s1, t1) - corner_term(s0, t1) - corner_term(s1, t0) + corner_term(s0, t0)
}

/// Sizes of faces whose solid angles are kept for the next cube map: powers of two up to 512, 1.4 MB.
const KEPT_SIZES: usize = 10;

/// [`texel_solid_angle_sr`] of all texels of a face, row by row.
pub(super) fn face_solid_angles_sr(size: u32) -> Cow<'static, [f32]> {
    static KEPT: [OnceLock<Vec<f32>>; KEPT_SIZES] = [const { OnceLock::new() }; KEPT_SIZES];
    match KEPT.get(size.ilog2() as usize) {
        Some(kept) if size.is_power_of_two() => Cow::Borrowed(kept.get_or_init(|| solid_angles_sr(size))),
        _ => Cow::Owned(solid_angles_sr(size)),
    }
}

/// The quarters of a face are alike, and texels share the terms of their corners.
fn solid_angles_sr(size: u32) -> Vec<f32> {
    if size < 2 {
        return vec![texel_solid_angle_sr(size, 0, 0) as f32];
    }
    let half = size as usize / 2;
    let corner = |i: usize| 2.0 * i as f64 / f64::from(size);
    let terms: Vec<Vec<f64>> =
        (0..=half).map(|y| (0..=half).map(|x| corner_term(corner(x), corner(y))).collect()).collect();
    let from_centre = |i: usize| if i < half { half - 1 - i } else { i - half };
    let texel = |y: usize, x: usize| terms[y + 1][x + 1] - terms[y + 1][x] - terms[y][x + 1] + terms[y][x];
    let row = |y: usize| (0..size as usize).map(move |x| texel(from_centre(y), from_centre(x)) as f32);
    (0..size as usize).flat_map(row).collect()
}

/// Solid angle of the part of a face between its centre and (`s`, `t`), sr, signed.
fn corner_term(s: f64, t: f64) -> f64 {
    (s * t).atan2((s * s + t * t + 1.0).sqrt())
}

impl CubeMap {
    /// Samples `radiance` on a cube of `size`² texels a face (rounded up to a power of two) and prefilters it. Where a texel is wider
    /// than `detail_rad`, it is the mean over a grid of directions in it.
    pub fn from_radiance(size: u32, detail_rad: Option<f32>, radiance: impl Fn(Vec3) -> Vec3 + Sync) -> Self {
        let of_all = |directions: &mut [Vec3]| directions.iter_mut().for_each(|d| *d = radiance(*d));
        Self::from_radiance_of_rows(size, detail_rad, of_all)
    }

    /// Samples `radiance` at the texels' centres, without mips.
    pub fn without_mips(size: u32, radiance: impl Fn(Vec3) -> Vec3 + Sync) -> Self {
        let of_all = |directions: &mut [Vec3]| directions.iter_mut().for_each(|d| *d = radiance(*d));
        Self::from_rows(size, false, |face, y, row| sample_row(face, y, 1, row, &of_all))
    }

    /// The same; `radiance` puts the radiance in place of each of many unit directions.
    pub fn from_radiance_of_rows(size: u32, detail_rad: Option<f32>, radiance: impl Fn(&mut [Vec3]) + Sync) -> Self {
        let size = size.max(1).next_power_of_two();
        let texel_rad = 2.0 / size as f32;
        let grid = detail_rad.map_or(1, |detail| match texel_rad / detail {
            // As fine as the detail: the centre will do.
            ratio if ratio <= 0.6 => 1,
            ratio => (3.0 * ratio).ceil().min(64.0) as u32,
        });
        Self::from_rows(size, true, |face, y, row| sample_row(face, y, grid, row, &radiance))
    }

    /// From the texels of the six faces, face by face and row by row; with all mips, or without any.
    pub fn from_texels(size: u32, base: &[Vec3], mips: bool) -> Self {
        let n = size as usize;
        assert!(size.is_power_of_two() && base.len() == FACES * n * n, "six square faces");
        Self::from_rows(size, mips, |face, y, row| {
            for (texel, value) in row.iter_mut().zip(&base[(face * n + y) * n..]) {
                *texel = value.extend(1.0);
            }
        })
    }

    /// The levels of at most so many texels along an edge.
    pub(super) fn coarser(&self, size: u32) -> Self {
        let level = (0..self.level_count()).find(|level| self.size >> level <= size).unwrap_or(self.level_count() - 1);
        let first = self.level_offset(level);
        Self {
            size: self.size >> level,
            offsets: self.offsets[level as usize..].iter().map(|offset| offset - first).collect(),
            texels: self.texels[first as usize..].to_vec(),
        }
    }

    /// A copy whose level 0 `change` has changed, row by row, with mips of its own.
    pub(super) fn with_base(&self, change: impl Fn(usize, usize, &mut [Vec4]) + Sync) -> Self {
        let (n, w) = (self.size as usize, self.size as usize + 2);
        Self::from_rows(self.size, true, |face, y, row| {
            row.copy_from_slice(&self.texels[(face * w + y + 1) * w + 1..][..n]);
            change(face, y, row);
        })
    }

    /// `fill` makes a row of a face of level 0.
    fn from_rows(size: u32, mips: bool, fill: impl Fn(usize, usize, &mut [Vec4]) + Sync) -> Self {
        let levels = if mips { size.ilog2() + 1 } else { 1 };
        let mut offsets = vec![0];
        for level in 0..levels {
            offsets.push(offsets[level as usize] + padded_len(size >> level) as u32);
        }
        let mut texels = vec![Vec4::ZERO; offsets.pop().expect("there is a level") as usize];
        for level in 0..levels {
            let (finer, rest) = texels.split_at_mut(offsets[level as usize] as usize);
            let n = size >> level;
            let own = &mut rest[..padded_len(n)];
            if level == 0 {
                fill_rows(own, n, &fill);
            } else {
                downsample(&finer[offsets[level as usize - 1] as usize..], own, n);
            }
            fill_borders(own, n, |a, b, c| (a + b + c) / 3.0);
        }
        Self { size, offsets, texels }
    }

    /// Texels along a face's edge at level 0.
    pub fn size(&self) -> u32 {
        self.size
    }

    /// Number of levels.
    pub fn level_count(&self) -> u32 {
        self.offsets.len() as u32
    }

    /// All texels, faces padded; see [`Self::level_offset`].
    pub fn padded_texels(&self) -> &[Vec4] {
        &self.texels
    }

    /// Where a level starts in [`Self::padded_texels`]: six faces of (n + 2)² texels, n = size >> level.
    pub fn level_offset(&self, level: u32) -> u32 {
        self.offsets[level as usize]
    }

    /// One level's texels without borders, face by face and row by row.
    pub fn rows(&self, level: u32) -> impl Iterator<Item = &[Vec4]> {
        let n = self.size >> level;
        rows(&self.texels[self.level_offset(level) as usize..][..padded_len(n)], n)
    }

    /// The same in one piece.
    pub fn level(&self, level: u32) -> Vec<Vec4> {
        self.rows(level).flatten().copied().collect()
    }

    /// Trilinear look-up, seamless; `lod` is clamped to the levels there are.
    pub fn fetch(&self, direction: Vec3, lod: f32) -> Vec3 {
        let (face, st) = face_of_direction(direction);
        let last = self.level_count() - 1;
        let lod = lod.clamp(0.0, last as f32);
        let level = lod as u32;
        let fine = self.bilinear(level, face, st);
        let coarse = self.bilinear((level + 1).min(last), face, st);
        fine.lerp(coarse, lod - level as f32).truncate()
    }

    fn bilinear(&self, level: u32, face: usize, st: Vec2) -> Vec4 {
        let n = self.size >> level;
        let w = (n + 2) as usize;
        // Border coordinates: texel i of the face is column i + 1, its centre at i + 1.
        let at = (st + Vec2::ONE) * (0.5 * n as f32) + Vec2::splat(0.5);
        let cell = at.floor().clamp(Vec2::ZERO, Vec2::splat(n as f32));
        let f = at - cell;
        let i = self.level_offset(level) as usize + (face * w + cell.y as usize) * w + cell.x as usize;
        let t = &self.texels;
        t[i].lerp(t[i + 1], f.x).lerp(t[i + w].lerp(t[i + w + 1], f.x), f.y)
    }
}

/// Makes row `y` of a face: means over `grid`² directions in each texel, weighted by solid angle.
fn sample_row(face: usize, y: usize, grid: u32, row: &mut [Vec4], radiance: &impl Fn(&mut [Vec3])) {
    let count = row.len() as u32 * grid;
    let (mut directions, mut weights) = (vec![Vec3::ZERO; count as usize], vec![0.0; count as usize]);
    let within = |texel: u32, k: u32| 2.0 * (texel as f32 + (k as f32 + 0.5) / grid as f32) / row.len() as f32 - 1.0;
    let columns: Vec<f32> = (0..count).map(|k| within(k / grid, k % grid)).collect();
    let mut sums = vec![Vec4::ZERO; row.len()];
    for j in 0..grid {
        let t = within(y as u32, j);
        for ((direction, weight), s) in directions.iter_mut().zip(&mut weights).zip(&columns) {
            let towards = face_direction(face, *s, t);
            let per_length = towards.length_recip();
            // Solid angle per area of the face is 1/|d|³.
            (*direction, *weight) = (per_length * towards, per_length * per_length * per_length);
        }
        radiance(&mut directions);
        let in_texels = directions.chunks_exact(grid as usize).zip(weights.chunks_exact(grid as usize));
        for (sum, (radiance, weights)) in sums.iter_mut().zip(in_texels) {
            for (radiance, weight) in radiance.iter().zip(weights) {
                *sum += *weight * radiance.extend(1.0);
            }
        }
    }
    for (texel, sum) in row.iter_mut().zip(sums) {
        *texel = (sum.truncate() / sum.w).extend(1.0);
    }
}

/// Texels of a level whose faces have borders of one texel.
pub(super) fn padded_len(n: u32) -> usize {
    FACES * (n as usize + 2).pow(2)
}

/// The rows of a padded level without borders, face by face.
pub(super) fn rows<T>(padded: &[T], n: u32) -> impl Iterator<Item = &[T]> {
    let (n, w) = (n as usize, n as usize + 2);
    padded.chunks_exact(w * w).flat_map(move |face| face[w..w * (w - 1)].chunks_exact(w).map(move |row| &row[1..=n]))
}

/// Makes the rows of a padded level, but not its borders: `fill` takes a face and a row of it.
pub(super) fn fill_rows<T: Send>(padded: &mut [T], n: u32, fill: impl Fn(usize, usize, &mut [T]) + Sync) {
    let (n, w) = (n as usize, n as usize + 2);
    parallel::for_each_chunk(padded, w, &|k, row| {
        let (face, y) = (k / w, k % w);
        if (1..=n).contains(&y) {
            fill(face, y - 1, &mut row[1..=n]);
        }
    });
}

/// Makes the rows of a level of `n`² texels a face from the next finer one: means over 2×2 texels, weighted by solid angle.
fn downsample(finer: &[Vec4], padded: &mut [Vec4], n: u32) {
    let weights = face_solid_angles_sr(2 * n);
    let (finer_n, finer_w) = (2 * n as usize, 2 * n as usize + 2);
    fill_rows(padded, n, |face, y, row| {
        let texels = |dy: usize| &finer[(face * finer_w + 2 * y + dy + 1) * finer_w + 1..][..finer_n];
        let weights = |dy: usize| &weights[(2 * y + dy) * finer_n..][..finer_n];
        let pairs = |dy: usize| texels(dy).chunks_exact(2).zip(weights(dy).chunks_exact(2));
        for ((texel, (t, w)), (u, v)) in row.iter_mut().zip(pairs(0)).zip(pairs(1)) {
            let sum = w[0] * t[0] + w[1] * t[1] + v[0] * u[0] + v[1] * u[1];
            *texel = (sum.truncate() / (w[0] + w[1] + v[0] + v[1])).extend(1.0);
        }
    });
}

/// Makes the borders of a padded level whose rows are there, from the neighbours of each face; `corner` makes the texels where three
/// faces meet.
pub(super) fn fill_borders<T: Copy>(padded: &mut [T], n: u32, corner: impl Fn(T, T, T) -> T) {
    let (w, last) = (n as usize + 2, n as usize + 1);
    let index = |face: usize, x: usize, y: usize| (face * w + y) * w + x;
    for face in 0..FACES {
        for k in 1..=n as usize {
            for (x, y) in [(k, 0), (k, last), (0, k), (last, k)] {
                let (other, [u, v]) = across_edge(face, x, y, n);
                padded[index(face, x, y)] = padded[index(other, u, v)];
            }
        }
        for (x, y) in [(0, 0), (last, 0), (0, last), (last, last)] {
            let (inner_x, inner_y) = (x.clamp(1, last - 1), y.clamp(1, last - 1));
            let at = |x: usize, y: usize| padded[index(face, x, y)];
            padded[index(face, x, y)] = corner(at(inner_x, inner_y), at(x, inner_y), at(inner_x, y));
        }
    }
}

/// The face and the texel of it that lie at a texel of another face's border, both in border coordinates. A point just outside a face
/// lies on its neighbour; the coordinate along the edge is kept.
fn across_edge(face: usize, x: usize, y: usize, n: u32) -> (usize, [usize; 2]) {
    let place = |i: usize| {
        let centre = (2.0 * (i as f32 - 0.5) / n as f32 - 1.0).clamp(-1.0, 1.0);
        if i == 0 || i > n as usize { centre * 1.0001 } else { centre * 0.9999 }
    };
    let (other, st) = face_of_direction(face_direction(face, place(x), place(y)));
    let index = |s: f32| ((0.5 * (s + 1.0) * n as f32) as usize).min(n as usize - 1) + 1;
    (other, [index(st.x), index(st.y)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_and_directions_are_inverse() {
        for face in 0..FACES {
            for (s, t) in [(0.3, -0.7), (-0.9, 0.2), (0.0, 0.0), (0.99, 0.98)] {
                let (f, st) = face_of_direction(face_direction(face, s, t) * 3.0);
                assert_eq!(f, face);
                assert!(st.abs_diff_eq(Vec2::new(s, t), 1e-6));
            }
        }
    }

    #[test]
    fn texels_cover_the_sphere() {
        for n in [1, 2, 16] {
            let face: f64 = (0..n).flat_map(|y| (0..n).map(move |x| texel_solid_angle_sr(n, x, y))).sum();
            assert!((6.0 * face - 4.0 * std::f64::consts::PI).abs() < 1e-9);
            let all: f64 = face_solid_angles_sr(n).iter().copied().map(f64::from).sum();
            assert!((all / face - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn look_ups_are_continuous_across_every_seam_at_every_level() {
        let smooth = |d: Vec3| Vec3::new(1.0 + d.x, 1.0 + d.y * d.z, (3.0 * d.z).sin());
        let cube = CubeMap::from_radiance(32, None, smooth);
        for lod in 0..cube.level_count() {
            for a in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y] {
                for b in [Vec3::Z, Vec3::NEG_Z] {
                    for along in [-0.95, -0.5, 0.0, 0.3, 0.99] {
                        let edge = a + b + along * a.cross(b);
                        let (one, other) = (edge + 1e-5 * a, edge + 1e-5 * b);
                        let (x, y) = (cube.fetch(one, lod as f32), cube.fetch(other, lod as f32));
                        assert!(x.abs_diff_eq(y, 1e-3), "level {lod}, {edge}: {x} {y}");
                    }
                }
            }
        }
    }

    #[test]
    fn mips_keep_the_energy() {
        let cube = CubeMap::from_radiance(64, None, |d| Vec3::new((8.0 * d.x).sin().abs(), d.y.max(0.0), 1.0));
        let total = |level: u32| -> Vec3 {
            let n = cube.size() >> level;
            let face = (n * n) as usize;
            let weigh = |(i, t): (usize, &Vec4)| {
                let k = (i % face) as u32;
                t.truncate() * texel_solid_angle_sr(n, k % n, k / n) as f32
            };
            cube.level(level).iter().enumerate().map(weigh).sum()
        };
        for level in 1..cube.level_count() {
            assert!(total(level).abs_diff_eq(total(0), 2e-3 * total(0).max_element()), "level {level}");
        }
    }

    #[test]
    fn a_smooth_field_is_looked_up_where_it_is() {
        let smooth = |d: Vec3| Vec3::new(2.0 + d.x, 2.0 + d.y, 2.0 + d.z);
        let cube = CubeMap::from_radiance(128, None, smooth);
        for d in [Vec3::new(0.3, 0.9, -0.2), Vec3::new(-1.0, 0.99, 0.98), Vec3::new(0.1, -0.4, 0.7)] {
            let d = d.normalize();
            assert!(cube.fetch(d, 0.0).abs_diff_eq(smooth(d), 2e-3), "{d}");
        }
    }
}
