//! Irradiance by normal: E(n) = ∫ L(ω) max(0, n·ω) dω, unoccluded.
//!
//! The radiance is first summed into cells, each as the vector ∫ L ω dω per channel. The integral is then a sum of
//! clamped dot products: exact but for the few cells that the horizon cuts.

use fearless_simd::{Simd, SimdBase, SimdFloat, f32x16};
use glam::{Vec3, Vec4};

use super::cube::{CubeMap, FACES, face_direction, face_solid_angles_sr};
use crate::lanes::{dispatch, level};
use crate::parallel;

/// Face size of the cells that are summed over, and of the result.
const SIZE: u32 = 32;
/// The same, and that of the light, for a light that is different in the next frame.
const FRAME_SIZE: u32 = 16;
const FRAME_LIGHT_SIZE: u32 = 128;

/// Cells that are summed side by side.
const LANES: usize = 16;

/// ∫ L ω dω over a cell, for R, G and B, component by component.
type VectorIrradiance = [[f32; 3]; 3];
/// The same of sixteen cells.
type VectorIrradiances = [[[f32; LANES]; 3]; 3];

/// The irradiance of an unoccluded receiver for every normal, W/m², as a cube map with one level.
pub fn irradiance_map(radiance: &CubeMap) -> CubeMap {
    irradiance_by_normal(&cells(radiance, 0), SIZE)
}

/// The same less finely and in a quarter of the time, for a light that is different in the next frame.
pub fn irradiance_map_of_frame(radiance: &CubeMap) -> CubeMap {
    let level = (0..radiance.level_count()).find(|level| radiance.size() >> level <= FRAME_LIGHT_SIZE).unwrap_or(0);
    irradiance_by_normal(&cells(radiance, level), FRAME_SIZE)
}

fn irradiance_by_normal(cells: &[VectorIrradiances], size: u32) -> CubeMap {
    let level = level();
    let centre = |i: u32| 2.0 * (i as f32 + 0.5) / size as f32 - 1.0;
    let texel = |k: u32| {
        let face = (k / (size * size)) as usize;
        let normal = face_direction(face, centre(k % size), centre(k / size % size)).normalize();
        dispatch!(level, simd => lambert_sum(simd, normal, cells))
    };
    let texels = parallel::collect(FACES * (size * size) as usize, &|k| texel(k as u32));
    CubeMap::from_texels(size, &texels, false)
}

/// Σ max(0, n·v) over all cells, channel by channel.
#[inline(always)]
fn lambert_sum<S: Simd>(simd: S, normal: Vec3, cells: &[VectorIrradiances]) -> Vec3 {
    let mut sums = [f32x16::splat(simd, 0.0); 3];
    for cells in cells {
        for (sum, [x, y, z]) in sums.iter_mut().zip(cells) {
            let load = |lanes: &[f32; LANES]| f32x16::load_array(simd, *lanes);
            let dot = load(x).mul_add(normal.x, load(y).mul_add(normal.y, load(z) * normal.z));
            *sum += dot.max(0.0);
        }
    }
    Vec3::from_array(sums.map(|sum| sum.to_array().iter().sum()))
}

/// The light of a level of a cube map, summed into cells.
fn cells(radiance: &CubeMap, level: u32) -> Vec<VectorIrradiances> {
    let n = radiance.size() >> level;
    let per_cell = (n / SIZE).max(1);
    let solid_angles = face_solid_angles_sr(n);
    let rows: Vec<&[Vec4]> = radiance.rows(level).collect();
    // Rows of cells.
    let of_rows = |row: usize| {
        let (face, top) = (row as u32 * per_cell / n, row as u32 * per_cell % n);
        let mut cells = vec![[[0.0; 3]; 3]; (n / per_cell) as usize];
        for (y, texels) in (top..).zip(&rows[row * per_cell as usize..]).take(per_cell as usize) {
            add_row(&mut cells, texels, &solid_angles[(y * n) as usize..], (face as usize, y));
        }
        cells
    };
    let cells: Vec<Vec<VectorIrradiance>> = parallel::collect(rows.len().div_ceil(per_cell as usize), &of_rows);
    cells.concat().chunks(LANES).map(side_by_side).collect()
}

/// Adds a row of texels to the row of cells that it lies in.
fn add_row(cells: &mut [VectorIrradiance], texels: &[Vec4], solid_angles_sr: &[f32], (face, y): (usize, u32)) {
    let (n, per_cell) = (texels.len(), texels.len() / cells.len());
    let centre = |i: usize| 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
    let towards_row = centre(y as usize);
    for (x, (texel, angle)) in texels.iter().zip(solid_angles_sr).enumerate() {
        let vector = *angle * face_direction(face, centre(x), towards_row).normalize();
        for (sum, radiance) in cells[x / per_cell].iter_mut().zip(texel.truncate().to_array()) {
            sum.iter_mut().zip(vector.to_array()).for_each(|(sum, value)| *sum += radiance * value);
        }
    }
}

fn side_by_side(cells: &[VectorIrradiance]) -> VectorIrradiances {
    [0, 1, 2].map(|channel| {
        [0, 1, 2].map(|axis| std::array::from_fn(|lane| cells.get(lane).map_or(0.0, |cell| cell[channel][axis])))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::PI;

    #[test]
    fn constant_radiance_gives_pi_times_it() {
        let cube = CubeMap::from_radiance(64, None, |_| Vec3::new(1.0, 2.0, 0.0));
        let map = irradiance_map(&cube);
        for n in [Vec3::X, Vec3::Y, Vec3::new(0.3, -0.8, 0.5).normalize()] {
            assert!(map.fetch(n, 0.0).abs_diff_eq(Vec3::new(PI, 2.0 * PI, 0.0), 0.01), "{}", map.fetch(n, 0.0));
        }
    }

    /// The quick map of a light that moves is nearly the same.
    #[test]
    fn maps_of_frames_are_close() {
        let towards = Vec3::new(-0.4, 0.7, 0.6).normalize();
        let lamp = |d: Vec3| Vec3::new(1.0, if d.distance(towards) < 0.15 { 100.0 } else { 1.0 }, 1.0 + d.y);
        let cube = CubeMap::from_radiance(256, None, lamp);
        let (exact, quick) = (irradiance_map(&cube), irradiance_map_of_frame(&cube));
        for k in 0..500 {
            let (y, turn) = (1.0 - (k as f32 + 0.5) / 250.0, 2.4 * k as f32);
            let n = ((1.0 - y * y).sqrt() * Vec3::new(turn.cos(), 0.0, turn.sin())).with_y(y);
            let (a, b) = (exact.fetch(n, 0.0), quick.fetch(n, 0.0));
            assert!(a.distance(b) < 0.01 * exact.fetch(towards, 0.0).y, "{n}: {a} {b}");
        }
    }

    #[test]
    fn a_small_light_follows_lamberts_cosine() {
        let towards = Vec3::new(0.2, 0.9, 0.4).normalize();
        let spot = |d: Vec3| Vec3::splat((-((d - towards).length() / 0.02).powi(2)).exp());
        let map = irradiance_map(&CubeMap::from_radiance(256, Some(0.02), spot));
        let full = map.fetch(towards, 0.0).x;
        for n in [Vec3::Y, Vec3::X, Vec3::new(0.5, 0.5, -0.6).normalize()] {
            let expected = full * n.dot(towards).max(0.0);
            assert!((map.fetch(n, 0.0).x - expected).abs() < 0.01 * full, "{n}");
        }
    }
}
