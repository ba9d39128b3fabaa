//! Rough mirrors for the ground truth: facets drawn from the GGX distribution itself (Walter et al. 2007, Section 5.2), so that
//! nothing is shared with the engine's tables but the reflectance of a facet.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

/// Where light comes from that a facet mirrors.
pub(super) struct Facet {
    /// Unit direction towards the light.
    pub towards_light: DVec3,
    /// Cosine on the facet.
    pub cosine: f64,
    /// What the light is multiplied by, besides the facet's reflectance.
    pub weight: f64,
}

/// Draws a facet of a surface with unit normal `n` that mirrors light to the unit direction `out`, on n's side; `None` where
/// it mirrors nothing there. The mean of weight × reflectance × radiance is the mirrored radiance.
pub(super) fn facet(n: DVec3, out: DVec3, alpha: f64, [u, v]: [f64; 2]) -> Option<Facet> {
    let (t, b) = n.any_orthonormal_pair();
    let tan = alpha * (u / (1.0 - u)).sqrt();
    let cos = (1.0 + tan * tan).sqrt().recip();
    let angle = TAU * v;
    let normal = cos * n + cos * tan * (angle.cos() * t + angle.sin() * b);
    let cosine = out.dot(normal);
    let towards_light = 2.0 * cosine * normal - out;
    let (cos_out, cos_in) = (out.dot(n), towards_light.dot(n));
    if cosine <= 0.0 || cos_in <= 0.0 || cos_out <= 0.0 {
        return None;
    }
    let weight = masking(cos_out, cos_in, alpha) * cosine / (cos_out * cos);
    Some(Facet { towards_light, cosine, weight })
}

/// The facets that mirror light from a unit direction to another one: the weight is the BRDF × the cosine of incidence, 1/sr, without the
/// facets' reflectance; `None` where they mirror nothing there.
pub(super) fn facets_towards(n: DVec3, out: DVec3, alpha: f64, towards_light: DVec3) -> Option<Facet> {
    let (cos_out, cos_in) = (out.dot(n), towards_light.dot(n));
    let normal = (out + towards_light).try_normalize()?;
    let cosine = out.dot(normal);
    if cosine <= 0.0 || cos_in <= 0.0 || cos_out <= 0.0 {
        return None;
    }
    let cos2 = n.dot(normal).powi(2);
    let density = alpha * alpha / (PI * (cos2 * (alpha * alpha - 1.0) + 1.0).powi(2));
    Some(Facet { towards_light, cosine, weight: masking(cos_out, cos_in, alpha) * density / (4.0 * cos_out) })
}

/// Smith's height-correlated masking and shadowing.
fn masking(cos_out: f64, cos_in: f64, alpha: f64) -> f64 {
    let lambda = |c: f64| 0.5 * ((1.0 + alpha * alpha * (1.0 - c * c) / (c * c)).sqrt() - 1.0);
    1.0 / (1.0 + lambda(cos_out) + lambda(cos_in))
}
