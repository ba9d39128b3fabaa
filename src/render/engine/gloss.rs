//! Rough mirrors as the camera sees them: each of a pixel's points samples another microfacet, and its reflection of
//! the environment is blurred to fill the gaps between the samples. Caustics of rough mirrors are computed in
//! `pinhole`.

use glam::Vec3;

use crate::environment::CubeMap;
use crate::pinhole::constants::PART_OF_FACETS;

/// Blur of a look-up relative to the lobe's width: sixteen microfacets sample the lobe four by four.
const BLUR: f32 = 0.25;

/// A microfacet's unit normal on a GGX surface of width `alpha` (Walter et al. 2007, Equations 35 and 36), which is seen along
/// a direction: with that direction and the surface, the microfacets turn smoothly.
pub(super) fn facet_of(normal: Vec3, direction: Vec3, alpha: f32, [u, v]: [f32; 2]) -> Vec3 {
    let tan = alpha * (u / (1.0 - u)).sqrt();
    let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
    let [t, b] = tangents(normal, direction);
    (normal + tan * (cos * t + sin * b)).normalize()
}

/// Tangents of a surface: in the plane of incidence of a direction, and across it.
pub(super) fn tangents(normal: Vec3, direction: Vec3) -> [Vec3; 2] {
    let in_plane = direction - direction.dot(normal) * normal;
    let tangent = in_plane.try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector());
    [tangent, normal.cross(tangent)]
}

/// Like [`facet_of`], without the tail of the distribution.
pub(super) fn likely_facet(normal: Vec3, direction: Vec3, alpha: f32, [u, v]: [f32; 2]) -> Vec3 {
    facet_of(normal, direction, alpha, [PART_OF_FACETS * u, v])
}

/// The environment's radiance in a unit direction, blurred for a rough mirror of width `alpha`.
pub(super) fn blurred_radiance(cube: &CubeMap, direction: Vec3, alpha: f32) -> Vec3 {
    // Texels cover a smaller solid angle towards a face's corners.
    let texel = 2.0 / cube.size() as f32 * direction.abs().max_element().powf(1.5);
    let width = BLUR * 4.0 * alpha;
    cube.fetch(direction, (width / texel).log2().max(0.0))
}
