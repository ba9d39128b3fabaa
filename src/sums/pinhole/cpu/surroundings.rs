//! What lit surfaces add to a sum: look-ups in the views from viewpoints near the cells.

use glam::{Vec3, Vec4};

use super::cube::CubeLookup;
use super::filters::{FootprintSides, Kernel, mean_over_footprint, mean_over_parts};
use super::pair::ReceiverCellPair;
use super::sky::Unoccluded;
use crate::lanes::{F, LANES, Simd, SimdBase, SimdFloat, V3, splat, splat3};
use crate::pinhole::PinholeParts;
use crate::pinhole::surroundings::{SurroundingView, Surroundings};

/// Look-ups of the surface that a cell sees in a direction, each towards the place that the one before found.
const LOOKUPS: usize = 3;
/// What is farther than this many metres is taken to be that far away.
const FARTHEST: f32 = 1e4;
/// And what is nearer than this, that near.
const NEAREST: f32 = 1e-6;
/// What is seen at a distance is visible if nothing lies before this part of it: planes are interpolated at edges.
const BEFORE_SURFACE: f32 = 0.9;

/// Lit surfaces, as sums see them.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurroundingLight<'a>(pub &'a Surroundings);

/// Surfaces in sixteen directions, seen from a cell.
pub(super) struct SeenSurfaces<'a, S: Simd> {
    view: &'a SurroundingView,
    /// The footprint without a lobe and along a part of a ray, as they are seen from the viewpoint.
    sides: FootprintSides<S>,
    third: Option<V3<S>>,
    /// From the cell to shortly before the surfaces.
    pub towards: V3<S>,
}

impl<'a> SurroundingLight<'a> {
    /// Mean radiance over a cell's footprint, or over both parts of its lobe, w = fetches; and the places from which it comes, or shortly
    /// before those, relative to the cell.
    #[inline(never)]
    pub fn arriving<S: Simd>(
        &self,
        simd: S,
        (cell, pair): (&PinholeParts, &ReceiverCellPair<S>),
        taps: F<S>,
        lit: u32,
    ) -> ([Vec4; LANES], V3<S>) {
        simd.vectorize(
            #[inline(always)]
            || {
                let sharp = pair.sharp_footprint(simd, cell);
                let third = pair.turn_along_segment(simd);
                let seen = self.seen(simd, cell, &sharp, third, lit);
                let light = (&CubeLookup::new(&seen.view.radiance), Kernel::Anisotropic(taps));
                let (whole, halves);
                let parts = if cell.is_mostly_lobe() {
                    halves = pair.parts_of(simd, cell, &seen.sides, seen.third);
                    &halves[..]
                } else {
                    whole = pair.widened(simd, seen.sides, seen.third, cell.lobe);
                    std::slice::from_ref(&whole)
                };
                let mean = mean_over_parts(
                    parts,
                    #[inline(always)]
                    |part| mean_over_footprint(simd, light, part, &Unoccluded, lit),
                );
                (mean, seen.towards)
            },
        )
    }

    /// What lies in the directions of a footprint of a cell.
    #[inline(never)]
    fn seen<S: Simd>(
        &self,
        simd: S,
        cell: &PinholeParts,
        footprint: &FootprintSides<S>,
        third: Option<V3<S>>,
        active: u32,
    ) -> SeenSurfaces<'a, S> {
        simd.vectorize(
            #[inline(always)]
            || {
                let view = self.0.nearest(cell.position, cell.normal);
                let planes = SeenPlanes {
                    lookup: &CubeLookup::new(&view.planes),
                    shift: splat3(simd, cell.position - view.viewpoint.position),
                    r: footprint.r,
                    active,
                };
                let (mut place, mut distance) = (footprint.r, splat(simd, 0.0));
                for _ in 0..LOOKUPS {
                    distance = planes.distance(simd, place);
                    place = planes.place(distance);
                }
                let inverse = 1.0 / place.dot(place).sqrt().max(f32::MIN_POSITIVE);
                let direction = place * inverse;
                let seen_side = SeenSide { direction, distance, inverse };
                let third = third.map(
                    #[inline(always)]
                    |change| seen_side.of(simd, Vec3::ZERO, change),
                );
                let v1 = seen_side.of(simd, cell.sides[0], footprint.v1);
                let v2 = seen_side.of(simd, cell.sides[1], footprint.v2);
                let sides = FootprintSides { r: direction, v1, v2 };
                SeenSurfaces { view, sides, third, towards: footprint.r * (distance * BEFORE_SURFACE) }
            },
        )
    }
}

/// The planes that are seen from a viewpoint, met by rays from a cell beside it.
struct SeenPlanes<'a, S: Simd> {
    lookup: &'a CubeLookup<'a>,
    /// From the viewpoint to the cell.
    shift: V3<S>,
    /// The rays' directions, unit length.
    r: V3<S>,
    active: u32,
}

impl<S: Simd> SeenPlanes<'_, S> {
    /// Along the rays to the planes that are seen from the viewpoint in these directions, metres.
    #[inline(always)]
    fn distance(&self, simd: S, direction: V3<S>) -> F<S> {
        let mut plane = [[0.0; LANES]; 3];
        self.lookup.fetch(
            simd,
            direction,
            splat(simd, 0.0),
            self.active,
            #[inline(always)]
            |lane, texel| (plane[0][lane], plane[1][lane], plane[2][lane]) = (texel.x, texel.y, texel.z),
        );
        let plane = V3::load(simd, &plane);
        let before = 1.0 - plane.dot(self.shift);
        let approach = plane.dot(self.r).max(1.0 / FARTHEST);
        (before / approach).max(NEAREST).min(FARTHEST)
    }

    /// From the viewpoint to so far along the rays.
    #[inline(always)]
    fn place(&self, distance: F<S>) -> V3<S> {
        self.shift.plus(self.r, distance)
    }
}

/// Where a cell's rays end, seen from a viewpoint.
struct SeenSide<S: Simd> {
    /// Unit length.
    direction: V3<S>,
    /// From the cell, metres.
    distance: F<S>,
    /// One over the distance from the viewpoint.
    inverse: F<S>,
}

impl<S: Simd> SeenSide<S> {
    /// A side of a footprint, radians, given the side of the cell, metres, and that of its directions.
    #[inline(always)]
    fn of(&self, simd: S, side: Vec3, change: V3<S>) -> V3<S> {
        let moved = splat3(simd, side).plus(change, self.distance);
        moved.plus(self.direction, -self.direction.dot(moved)) * self.inverse
    }
}
