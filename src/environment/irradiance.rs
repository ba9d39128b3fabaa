//! Irradiance by normal: E(n) = ∫ L(ω) max(0, n·ω) dω, unoccluded.
//!
//! The radiance is first summed into cells, each as the vector ∫ L ω dω per channel. The integral is then a sum of
//! clamped dot products: exact but for the few cells that the horizon cuts.

use fearless_simd::{Level, Simd, SimdBase, SimdFloat, dispatch, f32x16};
use glam::Vec3;
use rayon::prelude::*;

use super::cube::{CubeMap, FACES, face_direction, face_solid_angles_sr};

/// Face size of the result, and of the cells that are summed over.
const SIZE: u32 = 32;

/// Cells that are summed side by side.
const LANES: usize = 16;

/// ∫ L ω dω over a cell, for R, G and B, component by component: of sixteen cells.
type VectorIrradiance = [[[f32; LANES]; 3]; 3];

/// The irradiance of an unoccluded receiver for every normal, W/m², as a cube map with one level.
pub fn irradiance_map(radiance: &CubeMap) -> CubeMap {
    let cells = cells(radiance);
    let level = Level::new();
    let centre = |i: u32| 2.0 * (i as f32 + 0.5) / SIZE as f32 - 1.0;
    let texel = |k: u32| {
        let face = (k / (SIZE * SIZE)) as usize;
        let normal = face_direction(face, centre(k % SIZE), centre(k / SIZE % SIZE)).normalize();
        dispatch!(level, simd => lambert_sum(simd, normal, &cells))
    };
    let texels: Vec<Vec3> = (0..FACES as u32 * SIZE * SIZE).into_par_iter().map(texel).collect();
    CubeMap::from_texels(SIZE, &texels, false)
}

/// Σ max(0, n·v) over all cells, channel by channel.
#[inline(always)]
fn lambert_sum<S: Simd>(simd: S, normal: Vec3, cells: &[VectorIrradiance]) -> Vec3 {
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

fn cells(radiance: &CubeMap) -> Vec<VectorIrradiance> {
    let n = radiance.size();
    let per_cell = (n / SIZE).max(1);
    let per_edge = n / per_cell;
    let mut cells = vec![[[[0.0; LANES]; 3]; 3]; (FACES * (per_edge * per_edge) as usize).div_ceil(LANES)];
    let solid_angles = face_solid_angles_sr(n);
    let centre = |i: u32| 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
    for (row, k) in radiance.rows(0).zip(0..) {
        let (face, y) = (k / n, k % n);
        let (first, angles) = ((face * per_edge + y / per_cell) * per_edge, &solid_angles[(y * n) as usize..]);
        for ((texel, angle), x) in row.iter().zip(angles).zip(0..) {
            let vector = *angle * face_direction(face as usize, centre(x), centre(y)).normalize();
            let cell = (first + x / per_cell) as usize;
            for (channel, radiance) in texel.truncate().to_array().into_iter().enumerate() {
                for (component, value) in vector.to_array().into_iter().enumerate() {
                    cells[cell / LANES][channel][component][cell % LANES] += radiance * value;
                }
            }
        }
    }
    cells
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
