//! How much of the environment a sample sees: all of it, or what its visibility map says and, where that is in doubt, rays.

use glam::Vec3;

use super::visibility::VisibilityMap;
use crate::lanes::{F, LANES, Simd, SimdBase, SimdFloat, V3, splat};
use crate::pinhole::PinholeParts;
use crate::pinhole::tree::Occluders;

/// What a sample sees of the environment.
pub(super) trait Occlusion {
    /// Whether nothing is ever occluded, so that look-ups can be skipped.
    const IS_UNOCCLUDED: bool;

    /// Fraction of the environment within `width` radians around each direction that is not occluded; valid in `active` lanes only.
    fn sky_fraction<S: Simd>(&self, simd: S, direction: V3<S>, width: F<S>, active: u32) -> [f32; LANES];

    /// Fraction of a lobe, `width` radians wide, that is not occluded.
    fn lobe_fraction<S: Simd>(&self, simd: S, direction: V3<S>, width: f32, active: u32) -> F<S>;
}

/// Nothing is occluded.
pub(super) struct Unoccluded;

impl Occlusion for Unoccluded {
    const IS_UNOCCLUDED: bool = true;

    #[inline(always)]
    fn sky_fraction<S: Simd>(&self, _: S, _: V3<S>, _: F<S>, _: u32) -> [f32; LANES] {
        [1.0; LANES]
    }

    #[inline(always)]
    fn lobe_fraction<S: Simd>(&self, simd: S, _: V3<S>, _: f32, _: u32) -> F<S> {
        splat(simd, 1.0)
    }
}

/// What a map shows of the environment and, where it is in doubt, rays.
pub(super) struct OccludedSky<'a> {
    pub map: &'a VisibilityMap<'a>,
    /// Without them, texels are interpolated.
    pub rays: Option<SkyRays<'a>>,
}

/// Rays from the middle of a cell to the environment.
pub(super) struct SkyRays<'a> {
    pub occluders: &'a Occluders,
    pub cell: &'a PinholeParts,
    /// The leaf that it is a piece of, or itself.
    pub leaf: &'a PinholeParts,
    /// The lanes whose light comes from behind the cell.
    pub behind: u32,
}

impl<'a> From<&'a VisibilityMap<'a>> for OccludedSky<'a> {
    fn from(map: &'a VisibilityMap<'a>) -> Self {
        Self { map, rays: None }
    }
}

impl SkyRays<'_> {
    /// The lanes in which a ray meets nothing.
    #[inline(always)]
    fn open<S: Simd>(&self, simd: S, direction: V3<S>, lanes: u32) -> u32 {
        let rays = (&directions_and_lengths(simd, direction).0, &[f32::INFINITY; LANES]);
        self.occluders.unoccluded_lanes((self.cell, self.leaf), self.behind, rays, lanes)
    }
}

impl Occlusion for OccludedSky<'_> {
    const IS_UNOCCLUDED: bool = false;

    #[inline(never)]
    fn sky_fraction<S: Simd>(&self, simd: S, direction: V3<S>, width: F<S>, active: u32) -> [f32; LANES] {
        simd.vectorize(
            #[inline(always)]
            || {
                self.map.sky_fraction_or(
                    simd,
                    direction,
                    width,
                    active,
                    #[inline(always)]
                    |lanes| {
                        let Some(rays) = &self.rays else { return None };
                        Some(rays.open(simd, direction, lanes))
                    },
                )
            },
        )
    }

    #[inline(always)]
    fn lobe_fraction<S: Simd>(&self, simd: S, direction: V3<S>, width: f32, active: u32) -> F<S> {
        self.map.lobe_fraction(simd, direction, width, active)
    }
}

/// Unit vectors and their lengths.
#[inline(always)]
pub(super) fn directions_and_lengths<S: Simd>(simd: S, l: V3<S>) -> ([Vec3; LANES], [f32; LANES]) {
    let length = l.dot(l).sqrt();
    let [x, y, z] = (l * (splat(simd, 1.0) / length)).to_arrays();
    (std::array::from_fn(|lane| Vec3::new(x[lane], y[lane], z[lane])), length.to_array())
}
