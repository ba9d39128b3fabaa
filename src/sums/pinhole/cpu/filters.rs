//! Mean radiance over a footprint; twin of `shaders/shared/filters.wgsl`. Footprints are in world space.

use glam::{Vec3, Vec4};

use super::cube::{CubeLookup, level_of};
use super::footprint::{FootprintAxes, footprint_axes};
use super::sky::{Occlusion, Unoccluded};
use crate::environment::CubeMap;
use crate::lanes::{ALL, F, LANES, Select, Simd, SimdBase, SimdFloat, V3, bits, dispatch, lanes, level, splat};
use crate::pinhole::constants::{EVEN_LIGHT_SHARPNESS, EWA_MAX_COLUMNS, EWA_RADIUS, EWA_TEXEL, TAP_SHARPNESS};
use crate::pinhole::{Filter, Probe};

/// A footprint: the unit direction of its centre, and its sides.
#[derive(Clone, Copy)]
pub(super) struct FootprintSides<S: Simd> {
    pub r: V3<S>,
    pub v1: V3<S>,
    pub v2: V3<S>,
}

/// The mean over a footprint that is mostly a lobe, `width` radians wide. `of_sky` returns the unoccluded radiance in the given lanes; it is
/// scaled by the visible fraction of the lobe.
#[inline(always)]
pub(super) fn through_lobe<S: Simd>(
    simd: S,
    (r, width): (V3<S>, f32),
    occlusion: &impl Occlusion,
    lit: u32,
    of_sky: impl FnOnce(u32) -> [Vec4; LANES],
) -> [Vec4; LANES] {
    let fraction = occlusion.lobe_fraction(simd, r, width, lit);
    let mut radiance = of_sky(lit & bits(fraction.simd_gt(0.0)));
    let fraction = fraction.to_array();
    radiance.iter_mut().zip(fraction).for_each(|(radiance, f)| *radiance *= Vec3::splat(f).extend(1.0));
    radiance
}

/// The mean over a footprint, or over both parts of a lobe, given that over each of them; w = fetches.
// A loop over one or two parts, so that `mean_of` is compiled once.
#[inline(always)]
pub(super) fn mean_over_parts<S: Simd>(
    parts: &[FootprintSides<S>],
    mean_of: impl Fn(&FootprintSides<S>) -> [Vec4; LANES],
) -> [Vec4; LANES] {
    let share = Vec3::splat(1.0 / parts.len() as f32).extend(1.0);
    let mut sum = [Vec4::ZERO; LANES];
    for part in parts {
        sum.iter_mut().zip(mean_of(part)).for_each(|(sum, mean)| *sum += mean * share);
    }
    sum
}

/// How a mean over a footprint is taken.
#[derive(Clone, Copy)]
pub(super) enum Kernel<S: Simd> {
    /// One look-up at its centre, in the finest level.
    Nearest,
    /// One look-up where the light changes little within it. Without a lobe it is narrow and in the nearest level: adjacent cells
    /// together do as well as a wide kernel and lose nothing over the mirrors' edges. A lobe's blur has to be kept.
    Even { is_blurred: bool },
    /// One look-up as wide as it is long.
    Isotropic,
    /// Up to so many look-ups along it.
    Anisotropic(F<S>),
    /// The elliptical weighted average.
    Elliptical,
}

impl<S: Simd> Kernel<S> {
    /// That of a filter, with up to so many look-ups along a footprint.
    #[inline(always)]
    pub fn new(filter: CpuFilter, max_taps: F<S>) -> Self {
        match filter {
            CpuFilter::None => Self::Nearest,
            CpuFilter::Isotropic => Self::Isotropic,
            CpuFilter::Anisotropic => Self::Anisotropic(max_taps),
            CpuFilter::Ewa => Self::Elliptical,
        }
    }
}

/// Equal look-ups at equal distances along a footprint.
struct LookupsAlong<S: Simd> {
    /// From one end to the other.
    axis: V3<S>,
    count: F<S>,
    level: F<S>,
    /// What each asks about occlusion, radians.
    width: F<S>,
}

impl<S: Simd> LookupsAlong<S> {
    /// `None` for the elliptical weighted average.
    #[inline(always)]
    fn new(simd: S, environment: &CubeLookup, kernel: Kernel<S>, sides: &FootprintSides<S>) -> Option<Self> {
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let single = Self { axis: V3([zero; 3]), count: one, level: zero, width: zero };
        let texel = environment.texel_width(sides.r);
        match kernel {
            Kernel::Nearest => Some(single),
            Kernel::Even { is_blurred } => {
                let width = ((sides.v1.dot(sides.v1) + sides.v2.dot(sides.v2)) * 0.5).sqrt();
                let sharpness = if is_blurred { TAP_SHARPNESS } else { EVEN_LIGHT_SHARPNESS };
                let level = level_of(width * sharpness, texel);
                Some(Self { level: if is_blurred { level } else { (level + 0.5).floor() }, width, ..single })
            }
            Kernel::Isotropic => {
                let FootprintAxes { major, .. } = footprint_axes(sides.v1, sides.v2);
                Some(Self { level: level_of(major, texel), ..single })
            }
            Kernel::Anisotropic(max) => {
                let FootprintAxes { major, minor, direction } = footprint_axes(sides.v1, sides.v2);
                let count = (major / (minor * TAP_SHARPNESS).max(texel)).ceil().max(1.0).min(max);
                let width = minor.max(major / count);
                Some(Self { axis: direction, count, level: level_of(width * TAP_SHARPNESS, texel), width })
            }
            Kernel::Elliptical => None,
        }
    }
}

/// Mean unoccluded radiance over a footprint; w = fetches.
#[inline(never)]
pub(super) fn mean_over_footprint<S: Simd, O: Occlusion>(
    simd: S,
    (environment, kernel): (&CubeLookup, Kernel<S>),
    sides: &FootprintSides<S>,
    occlusion: &O,
    lit: u32,
) -> [Vec4; LANES] {
    simd.vectorize(
        #[inline(always)]
        || {
            let Some(lookups) = LookupsAlong::new(simd, environment, kernel, sides) else {
                return mean_over_ellipse(simd, environment, sides, occlusion, lit);
            };
            let LookupsAlong { axis, count, level, width } = lookups;
            let mut sum = [Vec4::ZERO; LANES];
            let mut k = 0.5;
            loop {
                let active = lit & bits(count.simd_gt(k));
                if active == 0 {
                    return divided(sum, count);
                }
                let direction = sides.r.plus(axis, k / count - 0.5);
                k += 1.0;
                if O::IS_UNOCCLUDED {
                    environment.fetch(
                        simd,
                        direction,
                        level,
                        active,
                        #[inline(always)]
                        |lane, radiance| sum[lane] += radiance,
                    );
                    continue;
                }
                let fractions = match kernel {
                    Kernel::Isotropic => sky_fraction_of_footprint(simd, occlusion, sides, active),
                    _ => occlusion.sky_fraction(simd, direction, width, active),
                };
                add_weighted(simd, environment, direction, level, &fractions, active, &mut sum);
            }
        },
    )
}

/// The elliptical weighted average.
#[inline(always)]
fn mean_over_ellipse<S: Simd>(
    simd: S,
    environment: &CubeLookup,
    sides: &FootprintSides<S>,
    occlusion: &impl Occlusion,
    lit: u32,
) -> [Vec4; LANES] {
    let (r, axes, texel) = (sides.r, footprint_axes(sides.v1, sides.v2), environment.texel_width(sides.r));
    let diameter = 2.0 * EWA_RADIUS;
    let width = (axes.minor * EWA_TEXEL).max(texel).max(axes.major * (diameter / EWA_MAX_COLUMNS));
    let level = level_of(width, texel);
    let columns = (axes.major * diameter / width).ceil().max(1.0);
    let rows = (axes.minor * diameter / width).ceil().max(1.0);
    let across = r.cross(axes.direction) * (axes.minor / axes.major.max(1e-20));
    let (mut sum, mut weights) = ([Vec4::ZERO; LANES], splat(simd, 0.0));
    let mut j = 0.5;
    loop {
        let in_rows = lit & bits(rows.simd_gt(j));
        if in_rows == 0 {
            break;
        }
        let y = 2.0 * j / rows - 1.0;
        let mut i = 0.5;
        loop {
            let in_columns = in_rows & bits(columns.simd_gt(i));
            if in_columns == 0 {
                break;
            }
            let x = 2.0 * i / columns - 1.0;
            let inside = columns.simd_gt(i) & rows.simd_gt(j);
            let weight = inside.select((1.0 - x * x - y * y).max(0.0), splat(simd, 0.0));
            let active = in_columns & bits(weight.simd_gt(0.0));
            let direction = r + (axes.direction * x + across * y) * splat(simd, EWA_RADIUS);
            let fraction = lanes(simd, occlusion.sky_fraction(simd, direction, width, active));
            add_weighted(simd, environment, direction, level, &(weight * fraction).to_array(), active, &mut sum);
            weights += weight;
            i += 1.0;
        }
        j += 1.0;
    }
    divided(sum, weights.max(1e-20))
}

/// Adds weighted radiance from a direction, out of a level, and 1 to w; nothing is read where the weight is 0.
#[inline(always)]
fn add_weighted<S: Simd>(
    simd: S,
    environment: &CubeLookup,
    direction: V3<S>,
    level: F<S>,
    weights: &[f32; LANES],
    active: u32,
    sums: &mut [Vec4; LANES],
) {
    let active = active & bits(lanes(simd, *weights).simd_gt(0.0));
    environment.fetch(
        simd,
        direction,
        level,
        active,
        #[inline(always)]
        |lane, radiance| sums[lane] += radiance * Vec3::splat(weights[lane]).extend(1.0),
    );
}

/// Divides the radiance, but not w.
#[inline(always)]
fn divided<S: Simd>(sums: [Vec4; LANES], by: F<S>) -> [Vec4; LANES] {
    let scale = (1.0 / by).to_array();
    std::array::from_fn(|lane| sums[lane] * Vec3::splat(scale[lane]).extend(1.0))
}

/// Sky fraction of a footprint, from four directions in it.
#[inline(always)]
fn sky_fraction_of_footprint<S: Simd>(
    simd: S,
    occlusion: &impl Occlusion,
    sides: &FootprintSides<S>,
    lit: u32,
) -> [f32; LANES] {
    let quarter = splat(simd, 0.25);
    let (a, b) = ((sides.v1 + sides.v2) * quarter, (sides.v1 - sides.v2) * quarter);
    let width = sides.v1.dot(sides.v1).min(sides.v2.dot(sides.v2)).sqrt() * 0.5;
    let mut sum = splat(simd, 0.0);
    for direction in [sides.r + a, sides.r - a, sides.r + b, sides.r - b] {
        sum += lanes(simd, occlusion.sky_fraction(simd, direction, width, lit));
    }
    (sum * 0.25).to_array()
}

/// The filters that exist on the CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CpuFilter {
    None,
    Isotropic,
    Anisotropic,
    Ewa,
}

/// [`Filter::Hardware`] was asked of the CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the hardware filter exists on GPUs only")]
pub struct HardwareFilterError;

impl TryFrom<Filter> for CpuFilter {
    type Error = HardwareFilterError;
    fn try_from(filter: Filter) -> Result<Self, Self::Error> {
        match filter {
            Filter::None => Ok(Self::None),
            Filter::Isotropic => Ok(Self::Isotropic),
            Filter::Anisotropic => Ok(Self::Anisotropic),
            Filter::Ewa => Ok(Self::Ewa),
            Filter::Hardware => Err(HardwareFilterError),
        }
    }
}

/// Means over given footprints: rgb, and the number of fetches.
pub fn probe(
    environment: &CubeMap,
    filter: Filter,
    max_taps: u32,
    probes: &[Probe],
) -> Result<Vec<[f32; 4]>, HardwareFilterError> {
    let filter = CpuFilter::try_from(filter)?;
    let (lookup, taps) = (CubeLookup::new(environment), max_taps.max(1) as f32);
    let mean = |group: &[Probe]| dispatch!(level(), simd => mean_of_group(simd, (&lookup, filter), group, taps));
    let mut means = Vec::with_capacity(probes.len());
    for group in probes.chunks(LANES) {
        means.extend(mean(group)[..group.len()].iter().map(Vec4::to_array));
    }
    Ok(means)
}

#[inline(always)]
fn mean_of_group<S: Simd>(
    simd: S,
    (environment, filter): (&CubeLookup, CpuFilter),
    group: &[Probe],
    max_taps: f32,
) -> [Vec4; LANES] {
    let probe = |lane: usize| &group[lane.min(group.len() - 1)];
    let values = |of: fn(&Probe) -> Vec3| [0, 1, 2].map(|axis| std::array::from_fn(|lane| of(probe(lane))[axis]));
    let [r, v1, v2] = [values(|p| p.direction), values(|p| p.sides[0]), values(|p| p.sides[1])];
    let sides = FootprintSides { r: V3::load(simd, &r), v1: V3::load(simd, &v1), v2: V3::load(simd, &v2) };
    let kernel = Kernel::new(filter, splat(simd, max_taps));
    mean_over_footprint(simd, (environment, kernel), &sides, &Unoccluded, ALL)
}
