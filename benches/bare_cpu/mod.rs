//! Trilinear look-ups on the CPU and nothing else: what a gather is held against.

use glam::Vec4;
use pinspot::low_level::environment::CubeMap;
use pinspot::low_level::pinhole::cpu::CubeLookup;
use rayon::prelude::*;

/// So many look-ups for each of so many groups of sixteen neighbours, at levels from one to the other.
pub fn bare_cpu_loop(cube: &CubeMap, levels: [f32; 2], groups: u64, per_group: u64) -> f32 {
    let lookup = CubeLookup::new(cube);
    let sum: Vec4 = (0..groups)
        .into_par_iter()
        .map(|group| {
            let mut sums = [Vec4::ZERO; 16];
            // Sixteen neighbouring directions that wander over the cube as those of neighbouring pixels do from sample to sample.
            let (mut angle, mut done) = (group as f32 * 0.37, 0);
            let next = || {
                (angle, done) = (angle + 0.61, done + 1);
                let (x, z) = (angle * 0.13 % 2.0 - 1.0, angle * 0.29 % 2.0 - 1.0);
                let along = std::array::from_fn(|lane| x + 0.004 * lane as f32);
                let spread: [f32; 16] = std::array::from_fn(|lane| (angle * 0.31 + 0.05 * lane as f32).fract());
                let level = spread.map(|s| levels[0] + (levels[1] - levels[0]) * s);
                (done <= per_group).then_some(([along, [0.7; 16], [z; 16]], level))
            };
            lookup.fetch16(next, &mut sums);
            sums.into_iter().sum::<Vec4>()
        })
        .sum();
    sum.x
}
