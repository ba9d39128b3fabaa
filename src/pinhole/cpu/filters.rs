//! Mean radiance over a footprint; twin of `shaders/shared/filters.wgsl`.

use glam::{Vec3, Vec4};

use super::cube::{CubeLookup, level_of, texel_width};
use super::footprint::{FootprintAxes, footprint_axes};
use super::lanes::{F, V3, clamp, splat};
use super::visibility::{Sight, Unhindered};
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

/// Mean radiance over a footprint of what is seen; w = fetches.
#[inline(always)]
pub(super) fn mean_over_footprint<const FILTER: u32>(
    environment: &CubeLookup,
    sides: &Sides,
    sight: &impl Sight,
    most_taps: f32,
    lit: u32,
) -> [Vec4; LANES] {
    let r = sides.r;
    if FILTER == FILTER_NONE {
        return single_look_up(environment, r, sight, lit);
    }
    let axes = footprint_axes(sides.v1, sides.v2);
    let texel = texel_width(r, environment.texel_rad());
    if FILTER == FILTER_ISOTROPIC {
        let mut sum = [Vec4::ZERO; LANES];
        let open = open_part_of_footprint(sight, sides, lit);
        add_part(environment, r, level_of(axes.major, texel), &open, lit, &mut sum);
        return sum;
    }
    if FILTER == FILTER_EWA {
        return mean_over_ellipse(environment, r, &axes, texel, sight, lit);
    }
    let sharpness = splat(SHARPNESS);
    let taps = clamp((axes.major / (sharpness * axes.minor).max(texel)).ceil(), F::ONE, splat(most_taps));
    let level = level_of(sharpness * axes.minor.max(axes.major / taps), texel);
    let mut sum = [Vec4::ZERO; LANES];
    let mut k = 0.5;
    loop {
        let active = lit & taps.simd_gt(splat(k)).to_bitmask();
        if active == 0 {
            return divided(sum, taps);
        }
        let direction = r + axes.direction * (splat(k) / taps - splat(0.5));
        add_seen(environment, sight, direction, level, active, &mut sum);
        k += 1.0;
    }
}

/// Radiance from one direction each, in the finest level; w = fetches.
#[inline(always)]
pub(super) fn single_look_up(environment: &CubeLookup, r: V3, sight: &impl Sight, lit: u32) -> [Vec4; LANES] {
    let mut sum = [Vec4::ZERO; LANES];
    add_seen(environment, sight, r, F::ZERO, lit, &mut sum);
    sum
}

/// The elliptical weighted average.
fn mean_over_ellipse(
    environment: &CubeLookup,
    r: V3,
    axes: &FootprintAxes,
    texel: F,
    sight: &impl Sight,
    lit: u32,
) -> [Vec4; LANES] {
    let diameter = splat(2.0 * EWA_RADIUS);
    let width = (splat(EWA_TEXEL) * axes.minor).max(texel).max(diameter * axes.major / splat(EWA_COLUMNS));
    let level = level_of(width, texel);
    let columns = (diameter * axes.major / width).ceil().max(F::ONE);
    let rows = (diameter * axes.minor / width).ceil().max(F::ONE);
    let across = r.cross(axes.direction) * (axes.minor / axes.major.max(splat(1e-20)));
    let (mut sum, mut weights) = ([Vec4::ZERO; LANES], F::ZERO);
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
            let weight = (F::ONE - x * x - y * y).max(F::ZERO) & columns.simd_gt(splat(i)) & rows.simd_gt(splat(j));
            let active = in_columns & weight.simd_gt(F::ZERO).to_bitmask();
            let direction = r + (axes.direction * x + across * y) * splat(EWA_RADIUS);
            let open = F::new(sight.open_part(direction, active));
            add_part(environment, direction, level, &(weight * open).to_array(), active, &mut sum);
            weights += weight;
            i += 1.0;
        }
        j += 1.0;
    }
    divided(sum, weights.max(splat(1e-20)))
}

/// Adds what is seen of the radiance from a direction, and the fetch to w; where nothing is seen nothing is read.
#[inline(always)]
fn add_seen<S: Sight>(
    environment: &CubeLookup,
    sight: &S,
    direction: V3,
    level: F,
    active: u32,
    sums: &mut [Vec4; LANES],
) {
    if S::UNHINDERED {
        environment.fetch(direction, level, active, |lane, radiance| sums[lane] += radiance);
    } else {
        add_part(environment, direction, level, &sight.open_part(direction, active), active, sums);
    }
}

/// Adds so much of the radiance from a direction, and the fetch to w.
#[inline(always)]
fn add_part(
    environment: &CubeLookup,
    direction: V3,
    level: F,
    part: &[f32; LANES],
    active: u32,
    sums: &mut [Vec4; LANES],
) {
    let active = active & F::new(*part).simd_gt(F::ZERO).to_bitmask();
    environment.fetch(direction, level, active, |lane, radiance| {
        sums[lane] += radiance * Vec3::splat(part[lane]).extend(1.0);
    });
}

/// Radiance divided; w as it is.
#[inline(always)]
fn divided(sums: [Vec4; LANES], by: F) -> [Vec4; LANES] {
    let scale = (F::ONE / by).to_array();
    std::array::from_fn(|lane| sums[lane] * Vec3::splat(scale[lane]).extend(1.0))
}

/// The part of the environment that is seen within a footprint, from four places in it.
#[inline(always)]
fn open_part_of_footprint(sight: &impl Sight, sides: &Sides, lit: u32) -> [f32; LANES] {
    let quarter = splat(0.25);
    let (a, b) = ((sides.v1 + sides.v2) * quarter, (sides.v1 - sides.v2) * quarter);
    let places = [sides.r + a, sides.r - a, sides.r + b, sides.r - b];
    let open = places.map(|direction| F::new(sight.open_part(direction, lit)));
    ((open[0] + open[1] + open[2] + open[3]) * quarter).to_array()
}

type MeanOverFootprint = fn(&CubeLookup, &Sides, &Unhindered, f32, u32) -> [Vec4; LANES];

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
        let found = mean(&lookup, &sides, &Unhindered, most_taps as f32, 0xff);
        means.extend(found[..group.len()].iter().map(Vec4::to_array));
    }
    means
}
