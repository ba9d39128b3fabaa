//! Irradiance by normal: E(n) = ∫ L(ω) max(0, n·ω) dω, unoccluded.
//!
//! The radiance is first summed into cells, each as the vector ∫ L ω dω per channel. The integral is then a sum of
//! clamped dot products: exact but for the few cells that the horizon cuts.

use glam::Vec3;
use rayon::prelude::*;

use super::cube::{CubeMap, FACES, face_direction, face_solid_angles_sr};

/// Face size of the result, and of the cells that are summed over.
const SIZE: u32 = 32;

/// ∫ L ω dω over a cell, for R, G and B.
type VectorIrradiance = [Vec3; 3];

/// The irradiance of an unoccluded receiver for every normal, W/m², as a cube map with one level.
pub fn irradiance_map(radiance: &CubeMap) -> CubeMap {
    let cells = cells(radiance);
    let texels = (0..FACES as u32 * SIZE * SIZE)
        .into_par_iter()
        .map(|k| {
            let centre = |i: u32| 2.0 * (i as f32 + 0.5) / SIZE as f32 - 1.0;
            let face = (k / (SIZE * SIZE)) as usize;
            let normal = face_direction(face, centre(k % SIZE), centre(k / SIZE % SIZE)).normalize();
            let mut sum = Vec3::ZERO;
            for [r, g, b] in &cells {
                sum += Vec3::new(normal.dot(*r), normal.dot(*g), normal.dot(*b)).max(Vec3::ZERO);
            }
            sum
        })
        .collect();
    CubeMap::from_texels(SIZE, texels, false)
}

fn cells(radiance: &CubeMap) -> Vec<VectorIrradiance> {
    let n = radiance.size();
    let per_cell = (n / SIZE).max(1);
    let cells_per_edge = n / per_cell;
    let mut cells = vec![[Vec3::ZERO; 3]; FACES * (cells_per_edge * cells_per_edge) as usize];
    let solid_angles = face_solid_angles_sr(n);
    for (k, texel) in radiance.level(0).iter().enumerate() {
        let k = k as u32;
        let (face, y, x) = (k / (n * n), k / n % n, k % n);
        let centre = |i: u32| 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
        let direction = face_direction(face as usize, centre(x), centre(y)).normalize();
        let vector = direction * solid_angles[(y * n + x) as usize];
        let cell = &mut cells[((face * cells_per_edge + y / per_cell) * cells_per_edge + x / per_cell) as usize];
        cell[0] += texel.x * vector;
        cell[1] += texel.y * vector;
        cell[2] += texel.z * vector;
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
