//! The exact mean over a footprint: the bilinear level 0 of the cube, integrated over the parallelogram.

use glam::Vec3;

use super::footprints::Case;
use crate::environment::CubeMap;
use crate::parallel;
use crate::pinhole::Probe;

/// Points per texel along each side; with 8, answers change by less than 1e-3 of a pattern's deviation.
const PER_TEXEL: f64 = 4.0;

/// The means of the red channel.
pub(super) fn means(cube: &CubeMap, cases: &[Case]) -> Vec<f64> {
    parallel::map(cases, &|case| mean(cube, &case.probe, case.texels))
}

/// The mean over `direction + a·side_1 + b·side_2`, a and b in [−½, ½], by the midpoint rule.
pub(super) fn mean(cube: &CubeMap, probe: &Probe, texels: [f64; 2]) -> f64 {
    let [columns, rows] = texels.map(|t| (t * PER_TEXEL).ceil().max(4.0) as usize);
    let [v1, v2] = probe.sides.map(Vec3::as_dvec3);
    let centre = probe.direction.as_dvec3();
    let middle = |k: usize, count: usize| (k as f64 + 0.5) / count as f64 - 0.5;
    let mut sum = 0.0;
    for j in 0..rows {
        for i in 0..columns {
            let direction = centre + middle(i, columns) * v1 + middle(j, rows) * v2;
            sum += f64::from(cube.fetch(direction.as_vec3(), 0.0).x);
        }
    }
    sum / (columns * rows) as f64
}
