//! Cube maps with mips: geometry, prefiltering and the trilinear look-up.
//!
//! Every face of every level is stored with a border of one texel copied from its neighbours, so that bilinear
//! look-ups are seamless as WebGPU's are (a corner, where three faces meet, is the mean of the three).

use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

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

/// [`texel_solid_angle_sr`] of all texels of a face, row by row; neighbours share the corners' terms.
pub(super) fn face_solid_angles_sr(size: u32) -> Vec<f32> {
    let corner = |i: u32| 2.0 * f64::from(i) / f64::from(size) - 1.0;
    let corner_row = |y: u32| -> Vec<f64> { (0..=size).map(|x| corner_term(corner(x), corner(y))).collect() };
    let row = |y: u32| -> Vec<f32> {
        let (upper, lower) = (corner_row(y), corner_row(y + 1));
        let columns = upper.windows(2).zip(lower.windows(2));
        columns.map(|(u, l)| (l[1] - l[0] - u[1] + u[0]) as f32).collect()
    };
    (0..size).into_par_iter().flat_map_iter(row).collect()
}

/// Solid angle of the part of a face between its centre and (`s`, `t`), sr, signed.
fn corner_term(s: f64, t: f64) -> f64 {
    (s * t).atan2((s * s + t * t + 1.0).sqrt())
}

impl CubeMap {
    /// Samples `radiance` on a cube of `size`² texels a face (a power of two) and prefilters it. Where a texel is wider
    /// than `detail_rad`, it is the mean over a grid of directions in it.
    pub fn from_radiance(size: u32, detail_rad: Option<f32>, radiance: impl Fn(Vec3) -> Vec3 + Sync) -> Self {
        let texel_rad = 2.0 / size as f32;
        let grid = detail_rad.map_or(1, |detail| match texel_rad / detail {
            // As fine as the detail: the centre will do.
            ratio if ratio <= 0.6 => 1,
            ratio => (3.0 * ratio).ceil().min(64.0) as u32,
        });
        let row = |(face, y): (usize, u32)| -> Vec<Vec3> {
            (0..size).map(|x| texel_mean(face, x, y, size, grid, &radiance)).collect()
        };
        let rows: Vec<(usize, u32)> = (0..FACES).flat_map(|face| (0..size).map(move |y| (face, y))).collect();
        let base: Vec<Vec3> = rows.into_par_iter().flat_map_iter(row).collect();
        Self::from_texels(size, base, true)
    }

    /// From the texels of the six faces, face by face and row by row; with all mips, or without any.
    pub fn from_texels(size: u32, base: Vec<Vec3>, mips: bool) -> Self {
        assert!(size.is_power_of_two() && base.len() == FACES * (size * size) as usize, "six square faces");
        let (mut offsets, mut texels) = (Vec::new(), Vec::new());
        let (mut level, mut n) = (base, size);
        loop {
            offsets.push(texels.len() as u32);
            texels.extend(padded(&level, n));
            if n == 1 || !mips {
                break;
            }
            level = halved(&level, n);
            n /= 2;
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
    pub fn level(&self, level: u32) -> Vec<Vec4> {
        let n = (self.size >> level) as usize;
        let w = n + 2;
        let start = self.level_offset(level) as usize;
        let rows = (0..FACES).flat_map(|face| (0..n).map(move |y| start + (face * w + y + 1) * w + 1));
        rows.flat_map(|row| &self.texels[row..row + n]).copied().collect()
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

fn texel_mean(face: usize, x: u32, y: u32, size: u32, grid: u32, radiance: &impl Fn(Vec3) -> Vec3) -> Vec3 {
    let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
    for k in 0..grid * grid {
        let within = |i: u32, k: u32| 2.0 * (i as f32 + (k as f32 + 0.5) / grid as f32) / size as f32 - 1.0;
        let d = face_direction(face, within(x, k % grid), within(y, k / grid));
        // Solid angle per area of the face is 1/|d|³.
        let w = d.length_squared().powf(-1.5);
        sum += w * radiance(d.normalize());
        weight += w;
    }
    sum / weight
}

/// The next level: means over 2×2 texels, weighted by solid angle.
fn halved(level: &[Vec3], n: u32) -> Vec<Vec3> {
    let half = n / 2;
    let weights = face_solid_angles_sr(n);
    let texel = |k: u32| {
        let (face, y, x) = (k / (half * half), k / half % half, k % half);
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let i = (2 * y + dy) * n + 2 * x + dx;
            sum += weights[i as usize] * level[(face * n * n + i) as usize];
            total += weights[i as usize];
        }
        sum / total
    };
    (0..FACES as u32 * half * half).into_par_iter().map(texel).collect()
}

/// One level with a border of one texel around every face.
fn padded(level: &[Vec3], n: u32) -> Vec<Vec4> {
    with_borders(level, n, |a, b, c| (a + b + c) / 3.0).into_iter().map(|t| t.extend(1.0)).collect()
}

/// Texels of six faces with a border of one texel around each, copied from its neighbours; `corner` makes those where three
/// faces meet.
pub(super) fn with_borders<T: Copy>(level: &[T], n: u32, corner: impl Fn(T, T, T) -> T) -> Vec<T> {
    let w = n + 2;
    let texel = |face: usize, x: u32, y: u32| level[face * (n * n) as usize + (y * n + x) as usize];
    // A point just outside a face lies on its neighbour; the edge's own texel coordinate is kept.
    let neighbour = |face: usize, x: i32, y: i32| {
        let centre = |i: i32| (2.0 * (i as f32 + 0.5) / n as f32 - 1.0).clamp(-1.0, 1.0);
        let outside = |i: i32| i < 0 || i >= n as i32;
        let push = |i: i32| if outside(i) { centre(i) * 1.0001 } else { centre(i) * 0.9999 };
        let (other, st) = face_of_direction(face_direction(face, push(x), push(y)));
        let index = |s: f32| ((0.5 * (s + 1.0) * n as f32) as u32).min(n - 1);
        texel(other, index(st.x), index(st.y))
    };
    let mut out = Vec::with_capacity(FACES * (w * w) as usize);
    for face in 0..FACES {
        for j in -1..=n as i32 {
            for i in -1..=n as i32 {
                let inside = |k: i32| k.clamp(0, n as i32 - 1);
                out.push(match (inside(i) != i, inside(j) != j) {
                    (false, false) => texel(face, i as u32, j as u32),
                    (true, true) => {
                        let (x, y) = (inside(i), inside(j));
                        corner(texel(face, x as u32, y as u32), neighbour(face, i, y), neighbour(face, x, j))
                    }
                    _ => neighbour(face, i, j),
                });
            }
        }
    }
    out
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
            let all: f64 = face_solid_angles_sr(n).into_iter().map(f64::from).sum();
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
