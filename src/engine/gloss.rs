//! How the camera sees rough mirrors: each of a pixel's points meets another facet, and what that mirrors of the environment
//! is blurred as far as the facets lie apart. The sum of the caustic has its own way (`pinhole`).

use glam::Vec3;

use crate::environment::CubeMap;

/// The blur of a look-up, relative to the lobe's width: sixteen facets are four to a side.
const BLUR: f32 = 0.25;
/// Facets of a GGX surface are drawn up to this part of them all; the rest lie too far out for sixteen.
const PART_OF_FACETS: f32 = 0.98;

/// A facet's unit normal on a GGX surface of width `alpha` (Walter et al. 2007, Equations 35 and 36).
pub(super) fn facet_of(normal: Vec3, alpha: f32, [u, v]: [f32; 2]) -> Vec3 {
    let tan = alpha * (u / (1.0 - u)).sqrt();
    let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
    let (t, b) = normal.any_orthonormal_pair();
    (normal + tan * (cos * t + sin * b)).normalize()
}

/// The same, but for the facets that lie farthest out.
pub(super) fn likely_facet(normal: Vec3, alpha: f32, [u, v]: [f32; 2]) -> Vec3 {
    facet_of(normal, alpha, [PART_OF_FACETS * u, v])
}

/// The environment around a unit direction, blurred for a mirror of width `alpha`.
pub(super) fn blurred_radiance(cube: &CubeMap, direction: Vec3, alpha: f32) -> Vec3 {
    // Texels shrink towards a face's corners.
    let texel = 2.0 / cube.size() as f32 * direction.abs().max_element().powf(1.5);
    let width = BLUR * 4.0 * alpha;
    cube.fetch(direction, (width / texel).log2().max(0.0))
}
