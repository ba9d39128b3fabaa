//! The spoon: an egg-shaped bowl and a slender, arched handle, one closed thin sheet.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::{Parts, Spoon, parametric::closed_surface};

pub(super) fn spoon(spoon: &Spoon) -> Parts {
    let lowest = lowest_point(spoon);
    closed_surface(|u, v| point(spoon, u, v) - DVec3::Y * lowest, 192, 96)
}

/// `u` runs along the spoon from the bowl's tip, `v` around the cross-section, a flat ellipse.
fn point(spoon: &Spoon, u: f64, v: f64) -> DVec3 {
    let (length, width) = (f64::from(spoon.length), f64::from(spoon.width));
    // Cosine spacing rounds both tips off.
    let s = 0.5 - 0.5 * (PI * u).cos();
    let tips = (PI * u).sin().max(0.0);
    // The normal turns over within a few degrees at the rim of the flat ellipse, which gets ten times as many columns.
    let around = TAU * v;
    let (sin, cos) = (around - 0.45 * (2.0 * around).sin()).sin_cos();
    let half_width = 0.5 * width * half_width(s) * rounding(tips);
    let half_thickness = 0.5 * f64::from(spoon.thickness) * rounding(tips);
    // The bowl is a paraboloid across; it fades out where the handle begins.
    let dish = f64::from(spoon.depth) * bowl(s) * (1.0 - cos * cos);
    let arch = 0.055 * length * smoothstep(0.30, 0.62, s) - 0.03 * length * smoothstep(0.6, 1.0, s);
    DVec3::new(length * (s - 0.5), arch - dish - half_thickness * sin, half_width * cos)
}

/// Width along the spoon, as a fraction of the bowl's: an egg, a neck, and a handle that broadens to its end.
fn half_width(s: f64) -> f64 {
    let handle = 0.16 + 0.16 * smoothstep(0.55, 0.95, s);
    handle + (1.0 - handle) * (1.0 - smoothstep(0.12, 0.36, s))
}

/// Depth along the bowl, 1 at its deepest.
fn bowl(s: f64) -> f64 {
    smoothstep(0.0, 0.17, s) * (1.0 - smoothstep(0.17, 0.36, s))
}

/// From a tip (0) up to the full section (1), upright at the tip.
fn rounding(tips: f64) -> f64 {
    (tips * (2.0 - tips)).max(0.0).powf(0.8)
}

fn smoothstep(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * t * (t * (6.0 * t - 15.0) + 10.0)
}

fn lowest_point(spoon: &Spoon) -> f64 {
    let samples = (0..=200).flat_map(|i| (0..=40).map(move |j| (f64::from(i) / 200.0, f64::from(j) / 40.0)));
    samples.map(|(u, v)| point(spoon, u, v).y).fold(f64::INFINITY, f64::min)
}
