//! How bright the environment is at most in the mean along an arc, about: a sun fills little of a long one.

use super::cube::{CubeMap, face_solid_angles_sr};
use std::f32::consts::PI;

/// Lengths of arcs, from 2^-12 to 1 radian.
pub const ARC_STEPS: u32 = 13;

const STEPS: usize = ARC_STEPS as usize;

/// Faces are resolved into at most this many texels along an edge.
const FINEST: u32 = 256;

/// Estimates of the largest mean radiance along arcs by their lengths, W/(m²·sr), as if every set of directions that are brighter than some
/// radiance were a disc.
#[derive(Clone, Debug)]
pub(super) struct ArcBounds([f32; STEPS]);

impl ArcBounds {
    /// Of a cube map's radiance.
    pub fn new(cube: &CubeMap) -> Self {
        let level = (0..cube.level_count()).find(|l| cube.size() >> l <= FINEST).unwrap_or(0);
        let size = cube.size() >> level;
        let angles = face_solid_angles_sr(size);
        let rows = cube.rows(level).zip(angles.chunks_exact(size as usize).cycle());
        let mut texels: Vec<(f32, f32)> = rows
            .flat_map(|(row, angles)| row.iter().zip(angles))
            .map(|(texel, solid_angle)| (texel.truncate().max_element(), *solid_angle))
            .collect();
        texels.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
        let mut bounds = [0.0f64; STEPS];
        let mut area = 0.0f64;
        for (k, (radiance, solid_angle)) in texels.iter().enumerate() {
            area += f64::from(*solid_angle);
            // All layers between this texel's radiance and the next one's are as wide.
            let layer = f64::from(radiance - texels.get(k + 1).map_or(0.0, |next| next.0));
            let diameter = 2.0 * (area / f64::from(PI)).sqrt();
            for (step, bound) in bounds.iter_mut().enumerate() {
                *bound += layer * (diameter / length_of(step)).min(1.0);
            }
        }
        Self(bounds.map(|bound| bound as f32))
    }

    /// All bounds, those of the shortest arcs first.
    pub fn steps(&self) -> &[f32] {
        &self.0
    }

    /// The bound for arcs of a length, radians, or of longer ones.
    #[inline]
    pub fn at(&self, length: f32) -> f32 {
        // The exponent of the next power of two below.
        let exponent = (length.to_bits() >> 23) as i32 - 127;
        if exponent < 1 - STEPS as i32 {
            return f32::INFINITY;
        }
        self.0[(exponent.min(0) + STEPS as i32 - 1) as usize]
    }
}

fn length_of(step: usize) -> f64 {
    (step as f64 + 1.0 - STEPS as f64).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn a_sun_fills_little_of_a_long_arc() {
        let radius = 0.05f32;
        let sun = |d: Vec3| if d.angle_between(Vec3::new(0.3, 0.9, 0.2).normalize()) < radius { 100.0 } else { 1.0 };
        let cube = CubeMap::from_radiance(256, None, |d| Vec3::splat(sun(d)));
        let bounds = ArcBounds::new(&cube);
        for length in [0.25f32, 0.5, 1.0] {
            let expected = 1.0 + 99.0 * 2.0 * radius / length;
            assert!((bounds.at(length) / expected - 1.0).abs() < 0.05, "{length}: {}", bounds.at(length));
            assert!(bounds.at(1.9 * length) >= bounds.at(2.0 * length));
        }
        assert!((bounds.at(0.03) - 100.0).abs() < 0.01);
        assert_eq!(bounds.at(0.0), f32::INFINITY);
    }
}
