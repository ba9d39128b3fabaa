//! Mean radiance over a footprint; twin of `shaders/shared/filters.wgsl`.

use glam::{Vec3, Vec4};

use super::cube::{CubeLookup, level_of, texel_width};
use super::footprint::{FootprintAxes, footprint_axes};
use super::lanes::{F, V3, clamp, splat};
use crate::environment::CubeMap;
use crate::pinhole::{Filter, Probe};

const LANES: usize = 8;

pub(super) const FILTER_NONE: u32 = 0;
pub(super) const FILTER_ISOTROPIC: u32 = 1;
pub(super) const FILTER_ANISOTROPIC: u32 = 2;
pub(super) const FILTER_EWA: u32 = 4;

/// A tap's width over the footprint's, and the ellipse's measures; see the shader.
const SHARPNESS: f32 = 0.9;
const EWA_RADIUS: f32 = std::f32::consts::FRAC_1_SQRT_2;
const EWA_TEXEL: f32 = 0.5;
const EWA_COLUMNS: f32 = 256.0;

/// A footprint: the unit direction of its centre, and its sides.
pub(super) struct Sides {
    pub r: V3,
    pub v1: V3,
    pub v2: V3,
}

/// Sum of radiance over the taps of a footprint, and the number of taps.
#[inline(always)]
pub(super) fn mean_over_footprint<const FILTER: u32>(
    environment: &CubeLookup,
    sides: &Sides,
    most_taps: f32,
    lit: u32,
) -> ([Vec4; LANES], F) {
    let mut sum = [Vec4::ZERO; LANES];
    let r = sides.r;
    if FILTER == FILTER_NONE {
        environment.fetch(r, F::ZERO, lit, &mut sum);
        return (sum, F::ONE);
    }
    let axes = footprint_axes(sides.v1, sides.v2);
    let texel = texel_width(r, environment.texel_rad());
    if FILTER == FILTER_ISOTROPIC {
        environment.fetch(r, level_of(axes.major, texel), lit, &mut sum);
        return (sum, F::ONE);
    }
    if FILTER == FILTER_EWA {
        return mean_over_ellipse(environment, r, &axes, texel, lit);
    }
    let sharpness = splat(SHARPNESS);
    let taps = clamp((axes.major / (sharpness * axes.minor).max(texel)).ceil(), F::ONE, splat(most_taps));
    let level = level_of(sharpness * axes.minor.max(axes.major / taps), texel);
    let mut k = 0.5;
    loop {
        let active = lit & taps.simd_gt(splat(k)).to_bitmask();
        if active == 0 {
            return (sum, taps);
        }
        let offset = splat(k) / taps - splat(0.5);
        environment.fetch(r + axes.direction * offset, level, active, &mut sum);
        k += 1.0;
    }
}

/// The elliptical weighted average, scaled so that dividing by the number of fetches gives the mean.
fn mean_over_ellipse(environment: &CubeLookup, r: V3, axes: &FootprintAxes, texel: F, lit: u32) -> ([Vec4; LANES], F) {
    let diameter = splat(2.0 * EWA_RADIUS);
    let width = (splat(EWA_TEXEL) * axes.minor).max(texel).max(diameter * axes.major / splat(EWA_COLUMNS));
    let level = level_of(width, texel);
    let columns = (diameter * axes.major / width).ceil().max(F::ONE);
    let rows = (diameter * axes.minor / width).ceil().max(F::ONE);
    let across = r.cross(axes.direction) * (axes.minor / axes.major.max(splat(1e-20)));
    let (mut sum, mut weights, mut fetches) = ([Vec4::ZERO; LANES], F::ZERO, F::ZERO);
    let mut j = 0.5;
    loop {
        let in_rows = lit & rows.simd_gt(splat(j)).to_bitmask();
        if in_rows == 0 {
            break;
        }
        let y = splat(2.0 * j) / rows - F::ONE;
        let mut i = 0.5;
        loop {
            let in_columns = in_rows & columns.simd_gt(splat(i)).to_bitmask();
            if in_columns == 0 {
                break;
            }
            let x = splat(2.0 * i) / columns - F::ONE;
            let weight = F::ONE - x * x - y * y;
            let active = in_columns & weight.simd_gt(F::ZERO).to_bitmask();
            let mut value = [Vec4::ZERO; LANES];
            environment.fetch(r + (axes.direction * x + across * y) * splat(EWA_RADIUS), level, active, &mut value);
            let weight = weight.to_array();
            let (mut w, mut n) = (weights.to_array(), fetches.to_array());
            for lane in (0..LANES).filter(|lane| active & (1 << lane) != 0) {
                sum[lane] += weight[lane] * value[lane];
                w[lane] += weight[lane];
                n[lane] += 1.0;
            }
            (weights, fetches) = (F::new(w), F::new(n));
            i += 1.0;
        }
        j += 1.0;
    }
    let fetches = fetches.max(F::ONE);
    let scale = (fetches / weights.max(splat(1e-20))).to_array();
    sum.iter_mut().zip(scale).for_each(|(sum, scale)| *sum *= scale);
    (sum, fetches)
}

type MeanOverFootprint = fn(&CubeLookup, &Sides, f32, u32) -> ([Vec4; LANES], F);

/// Means over given footprints: rgb, and the number of fetches. [`Filter::Hardware`] is not accepted here.
pub fn probe(environment: &CubeMap, filter: Filter, most_taps: u32, probes: &[Probe]) -> Vec<[f32; 4]> {
    let lookup = CubeLookup::new(environment);
    let mean: MeanOverFootprint = match filter {
        Filter::None => mean_over_footprint::<FILTER_NONE>,
        Filter::Isotropic => mean_over_footprint::<FILTER_ISOTROPIC>,
        Filter::Anisotropic => mean_over_footprint::<FILTER_ANISOTROPIC>,
        Filter::Ewa => mean_over_footprint::<FILTER_EWA>,
        Filter::Hardware => panic!("the hardware filter needs a GPU"),
    };
    let mut means = Vec::with_capacity(probes.len());
    for group in probes.chunks(LANES) {
        let lanes = |of: fn(&Probe) -> Vec3| {
            let lane =
                |axis: usize| F::new([0, 1, 2, 3, 4, 5, 6, 7].map(|k: usize| of(&group[k.min(group.len() - 1)])[axis]));
            V3([lane(0), lane(1), lane(2)])
        };
        let sides = Sides { r: lanes(|p| p.direction), v1: lanes(|p| p.sides[0]), v2: lanes(|p| p.sides[1]) };
        let (sums, fetches) = mean(&lookup, &sides, most_taps as f32, 0xff);
        let fetches = fetches.to_array();
        means.extend((0..group.len()).map(|k| {
            let mean = sums[k] / fetches[k];
            [mean.x, mean.y, mean.z, fetches[k]]
        }));
    }
    means
}
