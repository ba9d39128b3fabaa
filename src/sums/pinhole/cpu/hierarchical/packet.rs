//! A block of 4×4 receivers: sixteen lanes traverse the tree in lockstep, each refining cells for itself.

use std::f32::consts::PI;

use glam::{Vec3, Vec4};

use super::super::Source;
use super::super::crossing::CrossingBounds;
use super::super::cube::{OnCube, on_cube};
use super::super::filters::FootprintSides;
use super::super::pair::{ReceiverCellPair, facing};
use super::super::receiver::{Receiver, ReceiverGroup};
use super::super::sky::OccludedSky;
use super::super::visibility::{Coverage, VisibilityMap};
use super::criterion::{SourceBounds, unevenness};
use super::evaluation::CellAtReceivers;
use super::inspection::TakenCell;
use super::occlusion::VisibleReceivers;
use super::tile::{FULLY_VISIBLE, TileGather};
use crate::environment::LightBounds;
use crate::lanes::{
    ALL, F, LANES, Mask, Select, Simd, SimdBase, SimdFloat, SimdMask, V3, bits, lanes, set_bits, splat,
};
use crate::pinhole::cell::Cell;
use crate::pinhole::constants::{
    CENTRAL_VISIBILITY_SHARE, CONTRAST_ERROR_SCALE, FOOTPRINT_BEND, FOOTPRINT_RADIUS, MAX_LEFT_ALONG_RAY,
    MAX_PIECE_SIZE, MAX_RELATIVE_SIZE, MAX_TURN_ALONG_RAY, MIN_DISTANCE_RATIO, WEIGHT_ERROR_SCALE,
};
use crate::pinhole::tree::NODE_MASK;

/// The largest weight of any point of a cell, without reflectance.
struct MaxWeight<S: Simd> {
    value: F<S>,
    /// Of a leaf, that of its middle.
    of_middle: Option<F<S>>,
    /// The lanes in which any point of the cell faces the receiver.
    facing: u32,
    /// The lanes in which only some do, or in which light from some of them is totally reflected.
    straddling_horizon: u32,
    /// What an interface does at most with the light.
    crossing: Option<CrossingBounds<S>>,
}

/// Bounds of what a cell contributes.
struct ContributionBounds<S: Simd> {
    /// Size of the cell relative to its distance, with the spread of its normals.
    size: F<S>,
    /// The same for the direction of the light: how far it turns over the cell, or half as far as normals turn that of a mirror.
    turned: F<S>,
    /// Upper bound, W/m².
    max: F<S>,
    /// How much the light makes it differ within the cell, W/m².
    range: F<S>,
    /// Error of the receivers' BRDFs, relative to `max`.
    gloss_error: F<S>,
    /// How much of the light's differences within the cell is left in the mean along a part of a ray.
    left_along_ray: F<S>,
}

impl TileGather<'_> {
    /// Adds what cells, and those below them, contribute to sixteen receivers.
    #[inline(never)]
    pub(super) fn packet<S: Simd>(&mut self, simd: S, points: &ReceiverGroup, cells: &[u32], sum: &mut [Vec4; LANES]) {
        simd.vectorize(
            #[inline(always)]
            || {
                let receiver = points.in_lanes(simd);
                let occupied = receiver.occupied();
                let mut stack = std::mem::take(&mut self.packet_stack);
                stack.extend(cells.iter().map(|&cell| (cell, occupied)));
                let mut visible = VisibleReceivers::all(simd);
                // They count as fetches.
                let mut bound_lookups = splat(simd, 0.0);
                while let Some((item, lanes)) = stack.pop() {
                    let cell = self.context.pinholes.cell(item);
                    let (facing, refined) = self.visit(simd, (item, &cell), lanes, &receiver, &mut visible, sum);
                    if let Some(taken) = &mut self.taken_by_first {
                        taken.extend(TakenCell::new(&cell.sample, std::mem::take(&mut sum[0]).truncate()));
                    }
                    bound_lookups +=
                        Mask::from_bitmask(simd, u64::from(facing)).select(splat(simd, 1.0), splat(simd, 0.0));
                    if refined != 0 {
                        stack.extend(cell.children.map(|child| (child | item & !NODE_MASK, refined)));
                    }
                }
                self.packet_stack = stack;
                sum.iter_mut().zip(bound_lookups.to_array()).for_each(|(sum, lookups)| sum.w += lookups);
            },
        );
    }

    /// Adds what a cell contributes to the lanes for which it is small enough. Returns the lanes that it faces, for which bounds of its
    /// light are looked up, and those for which it is too large.
    #[inline(always)]
    fn visit<S: Simd>(
        &self,
        simd: S,
        (item, cell): (u32, &Cell),
        lanes: u32,
        receiver: &Receiver<S>,
        visible: &mut VisibleReceivers<S>,
        sum: &mut [Vec4; LANES],
    ) -> (u32, u32) {
        let pinholes = self.context.pinholes;
        // Maps tell which receivers are seen, unless all are.
        let maps = pinholes.sample_nodes.visibility.as_ref().filter(|_| item & FULLY_VISIBLE == 0);
        let is_cluster = self.has_visibility && pinholes.tree.is_cluster(item & NODE_MASK);
        let is_known = maps.is_none() || visible.sample_node == cell.sample_node;
        let lanes = if maps.is_some() && is_known && !is_cluster { lanes & visible.lanes } else { lanes };
        let pair = ReceiverCellPair::new(simd, &cell.sample, receiver);
        let max_weight = self.max_weight(simd, cell, &pair, receiver, lanes);
        let facing = max_weight.facing;
        if facing == 0 {
            return (0, 0);
        }
        let footprint = pair.footprint(simd, &cell.sample);
        let bounds = self.contribution_bounds(simd, cell, &pair, &footprint, receiver, &max_weight);
        let active = facing & bits(bounds.max.simd_gt(self.criterion.negligible * cell.sample.area));
        if active == 0 {
            return (facing, 0);
        }
        let mut accepted = active & self.accepted_lanes(cell, is_cluster, &bounds, max_weight.straddling_horizon);
        if receiver.length.is_some() && !pinholes.tree.is_cluster(item & NODE_MASK) {
            let relative_size = pair.inverse_l * cell.radius;
            let is_blurred =
                bounds.left_along_ray.simd_lt(MAX_LEFT_ALONG_RAY) & relative_size.simd_lt(MAX_RELATIVE_SIZE);
            // Next to total reflection light turns without bound; samples are small enough there, too.
            let normals = if cell.sample.interface.is_none() { cell.normal_radius } else { 0.0 };
            let turned = relative_size + normals;
            accepted |= active & bits(is_blurred | turned.simd_lt(MAX_TURN_ALONG_RAY));
        }
        let mut refined = active & !accepted;
        let mut fraction = splat(simd, 1.0);
        if let Some(maps) = maps.filter(|_| accepted != 0 || !is_cluster) {
            if !is_known {
                let sample = (&*pinholes.sample_nodes.samples, cell.sample_node);
                *visible = VisibleReceivers::new(simd, maps, sample, receiver, self.doubted(receiver));
            }
            let lanes = [accepted, refined];
            ([accepted, refined], fraction) =
                self.seen_lanes(simd, (cell, is_cluster), &pair, bounds.max, visible, lanes);
        }
        let in_parts = self.partly_lit_lanes(simd, cell, pair.dn, bounds.max, accepted);
        (accepted, refined) = (accepted & !in_parts, refined | in_parts);
        if cell.is_leaf() {
            let near = self.near_lanes(simd, cell.sample.area, (bounds.max, bounds.size), accepted);
            if near != 0 {
                // The most that reaches the receivers per weight.
                let light = bounds.max / max_weight.value;
                self.add_quarters(simd, cell, (near, light), receiver, fraction, sum);
            }
            accepted &= !near;
        }
        let lit = accepted & pair.lit();
        if lit != 0 {
            let weight = max_weight.of_middle.unwrap_or_else(
                #[inline(always)]
                || self.context.gather.weight(simd, &cell.sample, &pair, receiver),
            );
            let map = self.sky_map(cell, pair.dn);
            let weight = weight * fraction;
            let sample = &cell.sample;
            let cell = CellAtReceivers { sample, leaf: sample, receiver, pair: &pair, footprint: &footprint, weight };
            self.add_accepted(simd, &cell, map, &bounds, lit, sum);
        }
        (facing, refined)
    }

    /// Of the lanes that a cell is accepted and refined for, those in which it is seen, and the fractions of it that are.
    #[inline(always)]
    fn seen_lanes<S: Simd>(
        &self,
        simd: S,
        (cell, is_cluster): (&Cell, bool),
        pair: &ReceiverCellPair<S>,
        max_contribution: F<S>,
        visible: &VisibleReceivers<S>,
        [mut accepted, mut refined]: [u32; 2],
    ) -> ([u32; 2], F<S>) {
        let large = bits(max_contribution.simd_ge(splat(simd, self.criterion.error_budget_of(cell.sample.area))));
        accepted &= visible.lanes;
        // Of a cluster, other samples may see what its central one does not.
        refined &= if is_cluster { ALL } else { visible.lanes };
        if !cell.is_leaf() {
            // What is large and in doubt is taken leaf by leaf.
            let in_parts = accepted & visible.doubtful & large;
            (accepted, refined) = (accepted & !in_parts, refined | in_parts);
        }
        let found = (visible.fraction, accepted & visible.doubtful);
        let fraction = self.visible_fraction(simd, &cell.sample, pair, found, max_contribution);
        ([accepted & bits(fraction.simd_gt(0.0)), refined], fraction)
    }

    /// The map of what a cell sees of the environment, if there are maps; `dn` as in [`VisibilityMap::of_sky`].
    #[inline(always)]
    pub(super) fn sky_map<S: Simd>(&self, cell: &Cell, dn: F<S>) -> Option<VisibilityMap<'_>> {
        let pinholes = self.context.gather.pinholes;
        let maps = pinholes.visibility.as_ref()?;
        Some(VisibilityMap::of_sky(maps, &pinholes.samples[cell.sample_node as usize], dn))
    }

    #[inline(always)]
    fn max_weight<S: Simd>(
        &self,
        simd: S,
        cell: &Cell,
        pair: &ReceiverCellPair<S>,
        receiver: &Receiver<S>,
        lanes: u32,
    ) -> MaxWeight<S> {
        let gather = &self.context.gather;
        if !cell.is_leaf() {
            return self.max_weight_of_any_point(simd, cell, pair, receiver, lanes);
        }
        let of_middle = gather.weight(simd, &cell.sample, pair, receiver);
        let relative_size = pair.inverse_l * cell.radius;
        // Parts of a near leaf may light what its middle does not.
        let near =
            if self.accuracy.split_near { lanes & bits(relative_size.simd_gt(splat(simd, MAX_PIECE_SIZE))) } else { 0 };
        let facing = lanes & !near & pair.lit();
        if near == 0 {
            let crossing = crossing_bounds(simd, cell, pair, receiver);
            return MaxWeight { value: of_middle, of_middle: Some(of_middle), facing, straddling_horizon: 0, crossing };
        }
        let bound = self.max_weight_of_any_point(simd, cell, pair, receiver, near);
        let value = Mask::from_bitmask(simd, u64::from(near)).select(bound.value, of_middle);
        MaxWeight { value, of_middle: Some(of_middle), facing: facing | bound.facing, ..bound }
    }

    #[inline(always)]
    fn max_weight_of_any_point<S: Simd>(
        &self,
        simd: S,
        cell: &Cell,
        pair: &ReceiverCellPair<S>,
        receiver: &Receiver<S>,
        lanes: u32,
    ) -> MaxWeight<S> {
        let gather = &self.context.gather;
        // Cosines times l.
        let at_sample = facing(cell.sample.lights, pair.dn);
        let l = pair.l2 * pair.inverse_l;
        let at_receiver = if receiver.length.is_some() { l } else { pair.d.dot(receiver.normal) };
        let slack = l * cell.normal_radius + cell.radius;
        let mut straddling_horizon = bits(at_sample.simd_lt(slack) | at_receiver.simd_lt(cell.radius));
        let (at_sample, at_receiver) = (at_sample + slack, at_receiver + cell.radius);
        let mut facing = lanes & bits(at_sample.simd_gt(0.0) & at_receiver.simd_gt(0.0));
        let nearest = (l - cell.radius).max(l * MIN_DISTANCE_RATIO);
        let nearest2 = nearest * nearest;
        let cosines = at_sample.min(l) * at_receiver.min(l) / nearest2;
        let mut value = cosines * cell.sample.area * gather.max_attenuation(simd, nearest2, cell.sample.area);
        let crossing = crossing_bounds(simd, cell, pair, receiver);
        if let Some(crossing) = &crossing {
            value *= crossing.factor;
            facing &= bits(crossing.factor.simd_gt(0.0));
            straddling_horizon |= crossing.unbounded;
        }
        MaxWeight { value, of_middle: None, facing, straddling_horizon, crossing }
    }

    #[inline(always)]
    fn contribution_bounds<S: Simd>(
        &self,
        simd: S,
        cell: &Cell,
        pair: &ReceiverCellPair<S>,
        footprint: &FootprintSides<S>,
        receiver: &Receiver<S>,
        max_weight: &MaxWeight<S>,
    ) -> ContributionBounds<S> {
        let mut size = pair.inverse_l * cell.radius + cell.normal_radius;
        let mut cone_radius = if cell.is_creased {
            let along = match receiver.length {
                Some(length) => pair.inverse_l * length * FOOTPRINT_RADIUS,
                None => splat(simd, 0.0),
            };
            size + along + (cell.normal_radius + cell.sample.lobe)
        } else {
            footprint.squares().sqrt() * FOOTPRINT_RADIUS + (size * size * FOOTPRINT_BEND + unevenness(cell))
        };
        let (mut cone_axis, mut turned) = (pair.r, size);
        if let Some(crossing) = &max_weight.crossing {
            turned = crossing.per_direction * pair.inverse_l * cell.radius
                + crossing.per_normal * (0.5 * cell.normal_radius);
            (cone_axis, cone_radius) = crossed_light(simd, cell, (pair, receiver), footprint, turned, crossing);
            size *= crossing.per_cosine;
        }
        size = self.size_for_light(size, &cell.sample, cell.radius);
        let (mut max_radiance, mut contrast) = match &self.context.gather.source {
            Source::Lamp(lamp) if !cell.is_creased && max_weight.crossing.is_none() => {
                lamp.bounds_over_cell(simd, (&cell.sample, cell.radius), pair, (turned, unevenness(cell)))
            }
            _ => self.light_within(simd, cell, (cone_axis, cone_radius), max_weight.facing),
        };
        // How far the light's direction turns along a part of a ray.
        let turn = pair.turn_along_segment(simd).map(|turn| turn.dot(turn).sqrt());
        if let Some(turn) = turn {
            let most = self.light_along_ray(simd, cell, pair, turn, max_radiance);
            (max_radiance, contrast) = (most, contrast.min(most));
        }
        if let Source::Lamp(lamp) = &self.context.gather.source
            && cell.is_leaf()
        {
            // Where it is near, parts of it fill much less of the directions than all of it does to first order.
            let part = lamp.max_part(simd, &cell.sample, pair);
            let part = size.simd_lt(MAX_PIECE_SIZE).select(part, splat(simd, 1.0));
            max_radiance *= part;
            contrast *= part;
        }
        let mut weight = max_weight.value * cell.max_reflectance;
        let mut gloss_error = splat(simd, 0.0);
        if receiver.view.is_some() {
            let (max_gloss, error) = self.gloss_within(simd, pair, receiver, size, max_weight.facing);
            weight *= max_gloss;
            gloss_error = error;
        }
        if receiver.length.is_some() {
            let (max_scattered, error) =
                self.context.gather.scattered_within(simd, pair, receiver, size, max_weight.facing);
            weight *= max_scattered;
            gloss_error = error * CONTRAST_ERROR_SCALE;
        }
        let left_along_ray = match turn {
            Some(turn) => turned / (turned + turn).max(f32::MIN_POSITIVE),
            // Nothing averages out.
            None => splat(simd, 1.0),
        };
        ContributionBounds {
            left_along_ray,
            size,
            turned,
            max: weight * max_radiance,
            range: weight * contrast,
            gloss_error,
        }
    }

    /// Upper bound of the mean radiance along parts of rays over which the light's direction turns so far, of which none is brighter than
    /// `max`.
    #[inline(always)]
    fn light_along_ray<S: Simd>(
        &self,
        simd: S,
        cell: &Cell,
        pair: &ReceiverCellPair<S>,
        turn: F<S>,
        max: F<S>,
    ) -> F<S> {
        match (&self.context.gather.source, &self.criterion.light) {
            (Source::Lamp(lamp), _) => max * lamp.max_part_of_segment(simd, &cell.sample, pair, turn),
            (_, SourceBounds::Environment(light)) => {
                max.min(lanes(simd, turn.to_array().map(|turn| light.along_arc(turn))))
            }
            _ => max,
        }
    }

    /// The lanes for which a cell may be taken as one sample.
    #[inline(always)]
    fn accepted_lanes<S: Simd>(
        &self,
        cell: &Cell,
        is_occluded_cluster: bool,
        bounds: &ContributionBounds<S>,
        straddling_horizon: u32,
    ) -> u32 {
        if cell.is_leaf() {
            return ALL;
        }
        let ContributionBounds { size, turned, max, range, gloss_error, left_along_ray } = *bounds;
        let budget = self.criterion.error_budget_of(cell.sample.area);
        let weight_error = size * size * WEIGHT_ERROR_SCALE + gloss_error;
        let error = range * (turned * CONTRAST_ERROR_SCALE).min(1.0) * left_along_ray + max * weight_error;
        let is_small = bits(error.simd_lt(budget) & size.simd_lt(MAX_RELATIVE_SIZE));
        // Where the pair straddles a horizon, the cell's centroid is not representative.
        let accepted = is_small & !straddling_horizon | bits(max.simd_lt(budget)) & straddling_horizon;
        if is_occluded_cluster { accepted & bits(max.simd_lt(CENTRAL_VISIBILITY_SHARE * budget)) } else { accepted }
    }

    /// Adds what an accepted cell contributes, as far as the map of what it sees says that light arrives.
    #[inline(always)]
    fn add_accepted<S: Simd>(
        &self,
        simd: S,
        cell: &CellAtReceivers<S>,
        mut map: Option<VisibilityMap>,
        bounds: &ContributionBounds<S>,
        lit: u32,
        sum: &mut [Vec4; LANES],
    ) {
        let gather = &self.context.gather;
        let contribution_range = bounds.range;
        if !gather.source.is_environment() {
            let taps = self.criterion.taps(contribution_range);
            self.add_near_light(simd, cell, map.as_ref(), (taps, bounds.max), lit, sum);
            return;
        }
        if let Some(sky) = &map {
            match sky.sky_coverage(simd, cell.pair.r, cell.footprint.max_radius(cell.sample.lobe), lit) {
                Coverage::Full => map = None,
                Coverage::None => return,
                Coverage::Partial => {}
            }
        }
        let mut uneven = lit & bits(contribution_range.simd_ge(self.criterion.error_budget));
        let mut taps = self.criterion.taps(contribution_range);
        if cell.receiver.length.is_some() {
            // Along a part of a ray a sun is easily missed.
            (uneven, taps) = (lit, splat(simd, gather.uniforms.taps as f32));
        }
        let by_map = map.as_ref().map(OccludedSky::from);
        let by_rays = map.as_ref().and_then(|map| self.traced_sky(simd, cell, map, bounds.max));
        for (lit, taps) in [(lit & !uneven, None), (uneven, Some(taps))] {
            let traced = by_rays.as_ref().map_or(0, |(_, traced)| lit & traced);
            if let Some((sky, _)) = by_rays.as_ref().filter(|_| traced != 0) {
                gather.add_cell(simd, cell, Some(sky), taps, traced, sum);
            }
            if lit & !traced != 0 {
                gather.add_cell(simd, cell, by_map.as_ref(), taps, lit & !traced, sum);
            }
        }
    }

    /// Upper bound of π times the receivers' BRDFs, for light from a cell of this relative size; and the part of it by which they
    /// differ within the cell, scaled as an error.
    #[inline(always)]
    fn gloss_within<S: Simd>(
        &self,
        simd: S,
        pair: &ReceiverCellPair<S>,
        receiver: &Receiver<S>,
        size: F<S>,
        active: u32,
    ) -> (F<S>, F<S>) {
        let (Some(materials), Some(views)) = (self.context.gather.materials, receiver.view) else {
            return (splat(simd, 1.0), splat(simd, 0.0));
        };
        let (l, n) = ((pair.d * pair.inverse_l).to_arrays(), receiver.normal.to_arrays());
        let size = size.to_array();
        let (mut max, mut difference) = ([0.0; LANES], [0.0; LANES]);
        let vector = |v: &[[f32; LANES]; 3], lane: usize| Vec3::new(v[0][lane], v[1][lane], v[2][lane]);
        for lane in set_bits(active) {
            let (l, n, view) = (vector(&l, lane), vector(&n, lane), views[lane]);
            let value = |l: Vec3| PI * materials.value(receiver.object[lane], n, l, view, 0.0).max_element();
            let mirrored = 2.0 * n.dot(view) * n - view;
            let (at_centre, nearest) = (value(l), value(turned(l, mirrored, size[lane])));
            max[lane] = at_centre.max(nearest);
            difference[lane] = (nearest - at_centre).abs() / max[lane].max(f32::MIN_POSITIVE);
        }
        (lanes(simd, max), lanes(simd, difference) * CONTRAST_ERROR_SCALE)
    }

    /// Bounds of the light that arrives at a cell, blurred as its look-ups are, within cones around sixteen directions: the maximum and
    /// the contrast of its radiance.
    #[inline(always)]
    fn light_within<S: Simd>(
        &self,
        simd: S,
        cell: &Cell,
        (direction, radius): (V3<S>, F<S>),
        active: u32,
    ) -> (F<S>, F<S>) {
        let (light, direction, radius) = match &self.criterion.light {
            SourceBounds::Environment(light) => {
                (*light, self.context.gather.uniforms.light_from_world(direction), radius)
            }
            SourceBounds::Surroundings(surfaces) => {
                let view = surfaces.nearest(cell.sample.position, cell.sample.normal);
                (&view.bounds, direction, radius + view.spread(cell.sample.position, cell.radius))
            }
            SourceBounds::Lamp(lamp) => {
                let max = lamp.max_within(simd, (&cell.sample, cell.radius), direction, radius);
                return (max, max);
            }
        };
        let pyramid = light.pyramid(cell.blur);
        let OnCube { face, s, t } = on_cube(simd, direction);
        let (a, b) = (s - 1.0, t - 1.0);
        let reach = radius * (a * a + b * b + 1.0) * light.half_size() + LightBounds::texel_width(pyramid);
        let texels = light.texels_at(simd, [face, s, t, reach], pyramid);
        let (mut max, mut contrast) = ([0.0; LANES], [0.0; LANES]);
        for lane in set_bits(active) {
            let bound = light.texel(texels[lane]);
            (max[lane], contrast[lane]) = (bound.max, bound.contrast);
        }
        (lanes(simd, max), lanes(simd, contrast))
    }
}

/// The cones in which the light comes that a cell of an interface sends to receivers. `turned` as in [`ContributionBounds`].
#[inline(always)]
fn crossed_light<S: Simd>(
    simd: S,
    cell: &Cell,
    (pair, receiver): (&ReceiverCellPair<S>, &Receiver<S>),
    footprint: &FootprintSides<S>,
    turned: F<S>,
    crossing: &CrossingBounds<S>,
) -> (V3<S>, F<S>) {
    let frame = (pair.d * pair.inverse_l, pair.n);
    let directions = pair.inverse_l * extent(simd, cell, receiver);
    let (axis, most) = crossing.cones(simd, pair.r, frame, directions, cell.normal_radius);
    let curved = footprint.squares().sqrt() * FOOTPRINT_RADIUS
        + (turned * turned * FOOTPRINT_BEND + crossing.per_normal * (0.5 * unevenness(cell)));
    let may_curve = if cell.is_creased { 0 } else { ALL & !crossing.unbounded };
    let is_curved = Mask::from_bitmask(simd, u64::from(may_curve)) & curved.simd_lt(most);
    (V3::select(is_curved, pair.r, axis), is_curved.select(curved, most))
}

/// The radius of a cell and, where receivers are parts of rays, half their length, metres.
#[inline(always)]
fn extent<S: Simd>(simd: S, cell: &Cell, receiver: &Receiver<S>) -> F<S> {
    match receiver.length {
        Some(length) => splat(simd, cell.radius) + length * 0.5,
        None => splat(simd, cell.radius),
    }
}

/// What a cell of an interface does at most with the light.
#[inline(always)]
fn crossing_bounds<S: Simd>(
    simd: S,
    cell: &Cell,
    pair: &ReceiverCellPair<S>,
    receiver: &Receiver<S>,
) -> Option<CrossingBounds<S>> {
    let interface = cell.sample.interface?;
    let slack = pair.inverse_l * extent(simd, cell, receiver) + cell.normal_radius;
    let cosine = pair.dn * pair.inverse_l;
    Some(CrossingBounds::new(simd, interface, (cosine - slack).max(-1.0), (cosine + slack).min(1.0)))
}

/// A unit direction turned by an angle towards another one, or that one if it is nearer.
fn turned(from: Vec3, to: Vec3, angle: f32) -> Vec3 {
    let across = to - from.dot(to) * from;
    let sine = across.length();
    if angle >= sine.atan2(from.dot(to)) {
        return to;
    }
    angle.cos() * from + angle.sin() / sine * across
}
