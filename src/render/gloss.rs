//! How the camera sees rough mirrors: each of a pixel's points meets another facet, and what that mirrors of the environment
//! is blurred as far as the facets lie apart. A picture's device; the caustics have their own (`pinhole`).

use glam::Vec3;

use crate::environment::CubeMap;
use crate::pinhole::{Filter, Probe, cpu};

/// The blur of a look-up, as a part of the lobe's width: sixteen facets are four to a side.
const BLUR: f32 = 0.25;
/// Facets of a GGX surface are drawn up to this part of them all; the rest lie too far out for sixteen.
const MOST_OF_FACETS: f32 = 0.98;

/// A facet's unit normal on a GGX surface of width `alpha` (Walter et al. 2007, Equations 35 and 36).
pub(super) fn facet(normal: Vec3, alpha: f32, [u, v]: [f32; 2]) -> Vec3 {
    let u = MOST_OF_FACETS * u;
    let tan = alpha * (u / (1.0 - u)).sqrt();
    let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
    let (t, b) = normal.any_orthonormal_pair();
    (normal + tan * (cos * t + sin * b)).normalize()
}

/// The environment around a direction, blurred for a mirror of width `alpha`.
pub(super) fn blurred_radiance(cube: &CubeMap, direction: Vec3, alpha: f32) -> Vec3 {
    let (a, b) = direction.any_orthonormal_pair();
    let side = BLUR * 4.0 * alpha;
    let probe = Probe { direction, sides: [side * a, side * b] };
    let [r, g, b, _] = cpu::probe(cube, Filter::Isotropic, 1, &[probe])[0];
    Vec3::new(r, g, b)
}
