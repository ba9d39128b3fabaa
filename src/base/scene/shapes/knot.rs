//! Torus knots: a tube around a curve that winds around a torus.

use std::f64::consts::TAU;

use glam::DVec3;

use super::{Knot, Parts};

/// Segments along the curve, and around the tube.
const ALONG: u32 = 512;
const AROUND: u32 = 48;
/// The curve's distance from the circle around which it winds, relative to the circle's radius.
const WINDING: f64 = 0.4;

pub(super) fn knot(knot: &Knot) -> Parts {
    let (radius, tube) = (f64::from(knot.radius), f64::from(knot.tube));
    let [around_axis, around_circle] = knot.turns.map(f64::from);
    let curve = |t: f64| {
        let (sin, cos) = (TAU * around_axis * t).sin_cos();
        let (height, outwards) = (TAU * around_circle * t).sin_cos();
        let r = radius * (1.0 + WINDING * outwards);
        DVec3::new(r * cos, radius * WINDING * height, -r * sin)
    };
    let mut parts = Parts::default();
    for segment in 0..ALONG {
        const H: f64 = 1e-5;
        let t = f64::from(segment) / f64::from(ALONG);
        let tangent = (curve(t + H) - curve(t - H)).normalize();
        // Away from the axis: the same frame where the curve closes, and never along it.
        let (sin, cos) = (TAU * around_axis * t).sin_cos();
        let outwards = DVec3::new(cos, 0.0, -sin);
        let across = tangent.cross(outwards).normalize();
        let up = across.cross(tangent);
        for k in 0..AROUND {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(AROUND)).sin_cos();
            let normal = cos * up + sin * across;
            parts.vertex((curve(t) + tube * normal).as_vec3(), normal.as_vec3());
        }
    }
    let index = |segment: u32, k: u32| segment % ALONG * AROUND + k % AROUND;
    for segment in 0..ALONG {
        for k in 0..AROUND {
            let next = segment + 1;
            parts.quad([index(segment, k), index(segment, k + 1), index(next, k + 1), index(next, k)]);
        }
    }
    parts
}
