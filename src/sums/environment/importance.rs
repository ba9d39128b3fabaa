//! Directions drawn in proportion to the light that comes from them, for those who trace rays to it.

use glam::{Vec2, Vec3, Vec4};

use super::cube::{CubeMap, FACES, face_direction, face_of_direction, face_solid_angles_sr};

/// Faces are resolved into at most this many texels along an edge.
const FINEST: u32 = 256;
/// The same for a light that is different in the next frame.
const FINEST_OF_FRAME: u32 = 128;

/// A piecewise constant density over the texels of a cube map.
#[derive(Clone, Debug)]
pub struct LightSampler {
    size: u32,
    /// Sums of the texels' power from the first row of the first face on: of whole rows, and of the texels of each.
    rows: Vec<f32>,
    texels: Vec<f32>,
}

impl LightSampler {
    /// Prepares a light for drawing. A light of zero is drawn from evenly.
    pub fn new(cube: &CubeMap) -> Self {
        Self::resolving(cube, FINEST)
    }

    /// The same less finely, in a quarter of the time.
    pub fn of_frame(cube: &CubeMap) -> Self {
        Self::resolving(cube, FINEST_OF_FRAME)
    }

    /// With faces of at most so many texels along an edge.
    fn resolving(cube: &CubeMap, finest: u32) -> Self {
        let level = (0..cube.level_count()).find(|l| cube.size() >> l <= finest).unwrap_or(0);
        let size = cube.size() >> level;
        let solid_angles = face_solid_angles_sr(size);
        let count = (FACES as u32 * size * size) as f32;
        let sum = cube.rows(level).map(|row| row.iter().map(|t| t.max_element().max(0.0)).sum::<f32>()).sum::<f32>();
        let floor = 1e-3 * sum / count;
        // Never nothing: bilinear look-ups reach from one texel into the next.
        let power = |(texel, solid_angle): (&Vec4, &f32)| {
            texel.truncate().max_element().max(floor).max(f32::MIN_POSITIVE) * solid_angle
        };
        let mut sampler = Self { size, rows: Vec::new(), texels: Vec::new() };
        let mut total = 0.0f64;
        for (row, angles) in cube.rows(level).zip(solid_angles.chunks_exact(size as usize).cycle()) {
            let mut sum = 0.0f64;
            for texel in row.iter().zip(angles) {
                sum += f64::from(power(texel));
                sampler.texels.push(sum as f32);
            }
            total += sum;
            sampler.rows.push(total as f32);
        }
        sampler
    }

    /// A unit direction and its density per steradian, for a point of the unit square.
    pub fn sample(&self, u: Vec2) -> (Vec3, f32) {
        let (row, t) = invert(&self.rows, u.y);
        let n = self.size as usize;
        let (x, s) = invert(&self.texels[row * n..(row + 1) * n], u.x);
        let place = |k: usize, part: f32| 2.0 * (k as f32 + part) / n as f32 - 1.0;
        let (s, t) = (place(x, s), place(row % n, t));
        (face_direction(row / n, s, t).normalize(), self.density(row, x, Vec2::new(s, t)))
    }

    /// The density of a unit direction, per steradian.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        let (face, place) = face_of_direction(direction);
        let n = self.size as usize;
        let texel = |c: f32| ((0.5 * (c + 1.0) * n as f32) as usize).min(n - 1);
        self.density(face * n + texel(place.y), texel(place.x), place)
    }

    fn density(&self, row: usize, x: usize, place: Vec2) -> f32 {
        let n = self.size as usize;
        let sums = &self.texels[row * n..(row + 1) * n];
        let power = sums[x] - if x == 0 { 0.0 } else { sums[x - 1] };
        let row_power = self.rows[row] - if row == 0 { 0.0 } else { self.rows[row - 1] };
        // Both as they are drawn: the row by its own difference, the texel within it.
        let probability = power / sums[n - 1] * row_power / self.rows[self.rows.len() - 1];
        let area = (2.0 / n as f32).powi(2) / (1.0 + place.length_squared()).powf(1.5);
        probability / area
    }
}

/// Where u falls among cumulative sums, and where within that step.
fn invert(sums: &[f32], u: f32) -> (usize, f32) {
    let target = u * sums[sums.len() - 1];
    let k = sums.partition_point(|s| *s <= target).min(sums.len() - 1);
    let below = if k == 0 { 0.0 } else { sums[k - 1] };
    (k, ((target - below) / (sums[k] - below)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean of f / pdf is the integral of f.
    #[test]
    fn drawn_directions_integrate_the_sphere_and_the_light() {
        let light = |d: Vec3| 0.1 + 50.0 * (-40.0 * (d - Vec3::new(0.6, 0.0, 0.8)).length_squared()).exp();
        let sampler = LightSampler::new(&CubeMap::from_radiance(64, None, |d| Vec3::splat(light(d))));
        let (mut solid_angle, mut power, mut near) = (0.0f64, 0.0f64, 0);
        let n = 1 << 14;
        for k in 0..n {
            let [u, v, ..] = sobol_burley::sample_4d(k, 0, 7);
            let (d, pdf) = sampler.sample(Vec2::new(u, v));
            near += u32::from((sampler.pdf(d) / pdf - 1.0).abs() < 1e-3);
            solid_angle += f64::from(1.0 / pdf);
            power += f64::from(light(d) / pdf);
        }
        let mean = |sum: f64| sum / f64::from(n);
        assert!((mean(solid_angle) / (4.0 * std::f64::consts::PI) - 1.0).abs() < 0.02, "{}", mean(solid_angle));
        // ∫ exp(−40|d − c|²) dω = 2π ∫ exp(−80(1 − x)) dx = π/40, but for exp(−160).
        let expected = 0.4 * std::f64::consts::PI + 50.0 * std::f64::consts::PI / 40.0;
        assert!((mean(power) / expected - 1.0).abs() < 2e-3, "{} {expected}", mean(power));
        // A direction on a texel's edge may be found in the next one.
        assert!(near > n - n / 1000, "{near} of {n}");
    }
}
