//! The size of a splat by the lens equation: how a bundle of rays has widened or narrowed where it meets a receiver.
//!
//! In terms of vergences: a bundle from a distance d has −1/d, a surface of power P adds P, and on the way its width changes in proportion to
//! 1 − l·V. That is Wyman and Dachsbacher 2006, Equations 2 to 7, without their poles.

use super::constants::SMOOTH_LENS_COSINE;
use super::photons::{Photon, PhotonGrid, SurfacePoint};
use crate::scene::Object;

/// How light through a closed object is described.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lens {
    /// Both surfaces are at the same place.
    Thin,
    /// There is a way between them.
    Thick,
}

/// The width of a photon's bundle at the receiver, relative to what it would be without mirrors and interfaces; `None` where the curvature
/// is unknown, as the photon has no neighbours.
pub fn lens_factor(grid: &PhotonGrid, index: usize, objects: &[Object], lens: Lens) -> Option<f64> {
    let photon = &grid.photons[index];
    let way = &photon.way;
    let [before, within, beyond] = [way.before, way.within, way.beyond].map(f64::from);
    let front = mean_curvature(grid, index, |photon| photon.way.first)?;
    let refractor = objects[photon.caster as usize].refractor;
    let is_reflected = photon.direction.dot(way.last.normal) > 0.0;
    let factor = match refractor {
        None => single(before, beyond, -2.0 * front, 1.0),
        Some(_) if is_reflected => single(before, beyond, -2.0 * front, 1.0),
        Some(refractor) => {
            let n = refractor.eta.y;
            if within == 0.0 {
                single(before, beyond, (n - 1.0) * front, n)
            } else {
                // Normals inside a convex object diverge towards its surface.
                let back = -mean_curvature(grid, index, |photon| photon.way.last)?;
                let powers = [(n - 1.0) * front, (n - 1.0) * back];
                double([before, within, beyond], powers, n, lens)
            }
        }
    };
    Some(factor)
}

/// One surface of a power, 1/m; behind it the refractive index is `n`.
fn single(before: f64, beyond: f64, power: f64, n: f64) -> f64 {
    let vergence = (power - 1.0 / before) / n;
    (1.0 - beyond * vergence).abs() * undistorted(before, beyond)
}

/// Two surfaces of these powers, 1/m, with the refractive index `n` between them.
fn double([before, within, beyond]: [f64; 3], powers: [f64; 2], n: f64, lens: Lens) -> f64 {
    match lens {
        Lens::Thin => single(before, beyond, powers[0] + powers[1], 1.0),
        Lens::Thick => {
            let vergence = powers[0] - 1.0 / before;
            let narrowed = 1.0 - within * vergence / n;
            (narrowed - beyond * (vergence + narrowed * powers[1])).abs() * undistorted(before, within + beyond)
        }
    }
}

/// The reciprocal of the width that a bundle from a distance gains on its way.
fn undistorted(before: f64, beyond: f64) -> f64 {
    if before.is_finite() { before / (before + beyond) } else { 1.0 }
}

/// The mean curvature of a surface that photons meet, from their neighbours: positive where normals diverge, 1/m.
fn mean_curvature(grid: &PhotonGrid, index: usize, point: impl Fn(&Photon) -> SurfacePoint) -> Option<f64> {
    let is_neighbour = |one: usize, other: usize| {
        let [one, other] = [one, other].map(|index| &grid.photons[index]);
        one.caster == other.caster && point(one).normal.dot(point(other).normal) > SMOOTH_LENS_COSINE
    };
    let position = |index: usize| point(&grid.photons[index]).position.as_dvec3();
    let normal = |index: usize| point(&grid.photons[index]).normal.as_dvec3();
    let [Some(pu), Some(pv)] = grid.differences(index, is_neighbour, position) else { return None };
    let [Some(nu), Some(nv)] = grid.differences(index, is_neighbour, normal) else { return None };
    // The fundamental forms (do Carmo, Differential Geometry of Curves and Surfaces, Section 3-3).
    let (e, f, g) = (pu.dot(pu), pu.dot(pv), pv.dot(pv));
    let (l, m, n) = (nu.dot(pu), 0.5 * (nu.dot(pv) + nv.dot(pu)), nv.dot(pv));
    let determinant = e * g - f * f;
    (determinant > 0.0).then(|| (e * n - 2.0 * f * m + g * l) / (2.0 * determinant))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without power the width is what it would be; at the focal distance of a thin lens it is D₀ d_f/(d_f + d_b); everything is finite.
    #[test]
    fn lenses_have_their_closed_forms() {
        assert!((single(3.0, 2.0, 0.0, 1.0) - 1.0).abs() < 1e-12);
        assert!((double([3.0, 0.5, 2.0], [0.0; 2], 1.0, Lens::Thick) - 1.0).abs() < 1e-12);
        // Light from the focus leaves in parallel.
        let power = 0.5;
        assert!((single(2.0, 7.0, power, 1.0) - 2.0 / 9.0).abs() < 1e-12);
        // A ball of glass focuses parallel light at n R / (2 (n − 1)) from its middle.
        let (n, radius) = (1.5, 0.4);
        let powers = [(n - 1.0) / radius; 2];
        let focus = n * radius / (2.0 * (n - 1.0)) - radius;
        assert!(double([f64::INFINITY, 2.0 * radius, focus], powers, n, Lens::Thick) < 1e-12);
        for k in 0..1_000_000u32 {
            let [a, b, c, d] = sobol_burley::sample_4d(k & 0xffff, 0, k >> 16).map(f64::from);
            let lengths = [1e-6 + 1e3 * a * a, 10.0 * b, 1e3 * c * c];
            let powers = [100.0 * (d - 0.5), 100.0 * (a - 0.5)];
            assert!(
                double(lengths, powers, 1.5, Lens::Thick).is_finite()
                    && single(lengths[0], lengths[2], powers[0], 1.5).is_finite()
            );
        }
    }
}
