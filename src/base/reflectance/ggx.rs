//! Rough mirrors: the directional albedo of a GGX microfacet surface (Walter et al.,
//! *Microfacet Models for Refraction through Rough Surfaces*, EGSR 2007), single scattering, Smith's masking.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

/// Points along each side of the grid of random numbers that microfacets are sampled with.
const POINTS: usize = 24;

/// The directional albedo at a cosine of incidence in (0, 1], for microfacets whose reflectance is a function of the
/// cosine at the microfacet. `alpha` is the width of their distribution.
pub fn directional_albedo(cosine: f64, alpha: f64, facet: impl Fn(f64) -> DVec3) -> DVec3 {
    // At grazing incidence, as close as floating point allows.
    let cosine = cosine.max(1e-4);
    let out = DVec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine);
    let middle = |k: usize| (k as f64 + 0.5) / POINTS as f64;
    let mut sum = DVec3::ZERO;
    for (i, j) in (0..POINTS).flat_map(|j| (0..POINTS).map(move |i| (i, j))) {
        let normal = visible_facet(out, alpha, DVec2::new(middle(i), middle(j)));
        let along = out.dot(normal);
        let mirrored = 2.0 * along * normal - out;
        if mirrored.z > 0.0 {
            // G₂ / G₁ for height-correlated masking.
            let (lambda_out, lambda_in) = (lambda(out.z, alpha), lambda(mirrored.z, alpha));
            sum += facet(along) * ((1.0 + lambda_out) / (1.0 + lambda_out + lambda_in));
        }
    }
    sum / (POINTS * POINTS) as f64
}

/// Smith's Λ for GGX.
fn lambda(cosine: f64, alpha: f64) -> f64 {
    let tan2 = (1.0 - cosine * cosine) / (cosine * cosine);
    0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
}

/// Samples the normals of microfacets visible from `out`, +Z up (Heitz, *Sampling the GGX Distribution of Visible
/// Normals*, JCGT 7(4), 2018).
fn visible_facet(out: DVec3, alpha: f64, u: DVec2) -> DVec3 {
    let stretched = DVec3::new(alpha * out.x, alpha * out.y, out.z).normalize();
    let across = DVec3::new(-stretched.y, stretched.x, 0.0).try_normalize().unwrap_or(DVec3::X);
    let up = stretched.cross(across);
    let (radius, angle) = (u.x.sqrt(), TAU * u.y);
    let (a, mut b) = (radius * angle.cos(), radius * angle.sin());
    let seen = 0.5 * (1.0 + stretched.z);
    b = (1.0 - seen) * (1.0 - a * a).max(0.0).sqrt() + seen * b;
    let facet = a * across + b * up + (1.0 - a * a - b * b).max(0.0).sqrt() * stretched;
    DVec3::new(alpha * facet.x, alpha * facet.y, facet.z.max(0.0)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// By brute force over all directions of the light.
    fn brute_force(cosine: f64, alpha: f64) -> f64 {
        let out = DVec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
        let steps = 900;
        let mut sum = 0.0;
        let part = |k: u32| (f64::from(k) + 0.5) / f64::from(steps);
        for (i, j) in (0..steps).flat_map(|j| (0..steps).map(move |i| (i, j))) {
            // Equal areas of the unit disc, which projects directions by their cosine.
            let (radius, angle) = (part(i).sqrt(), TAU * part(j));
            let light = DVec3::new(radius * angle.cos(), radius * angle.sin(), (1.0 - radius * radius).sqrt());
            let half = (out + light).normalize();
            let cos2 = half.z * half.z;
            let bump = alpha * alpha / (PI * (cos2 * (alpha * alpha - 1.0) + 1.0).powi(2));
            let masking = 1.0 / (1.0 + lambda(out.z, alpha) + lambda(light.z, alpha));
            sum += PI * bump * masking / (4.0 * out.z * light.z);
        }
        sum / f64::from(steps * steps)
    }

    #[test]
    fn it_is_the_integral_over_all_directions() {
        for alpha in [0.2, 0.5] {
            for cosine in [0.2, 0.6, 1.0] {
                let found = directional_albedo(cosine, alpha, |_| DVec3::ONE).x;
                let expected = brute_force(cosine, alpha);
                assert!((found - expected).abs() < 3e-3, "α {alpha}, cosine {cosine}: {found}, not {expected}");
            }
        }
    }

    #[test]
    fn smooth_mirrors_lose_nothing() {
        for cosine in [0.1, 0.5, 1.0] {
            assert!((directional_albedo(cosine, 1e-3, |_| DVec3::ONE).x - 1.0).abs() < 1e-4);
        }
    }
}
