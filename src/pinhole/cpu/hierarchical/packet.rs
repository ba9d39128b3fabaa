//! A block of 4×4: each of its points finds its own way down the tree, all sixteen in step.

use std::f32::consts::PI;

use glam::{Vec3, Vec4};

use super::super::Group;
use super::super::cube::{OnCube, on_cube};
use super::super::lanes::{ALL, F, LANES, Simd, SimdBase, SimdFloat, V3, bits, lanes, set_bits, splat, vector};
use super::super::visibility::{Outlook, Surroundings, Unhindered};
use super::super::{Pair, Receiver};
use super::bounds::unevenness;
use super::tile::TileGather;
use crate::pinhole::constants::{
    CONTRAST_ERROR_SCALE, FOOTPRINT_BEND, FOOTPRINT_RADIUS, MAX_QUARTERINGS, MAX_RELATIVE_SIZE, MIN_DISTANCE_RATIO,
    WEIGHT_ERROR_SCALE,
};
use crate::pinhole::{PinholeSample, VisibilityMaps};

/// A unit direction turned by an angle towards another one, or that one if it is nearer.
fn turned(from: Vec3, to: Vec3, angle: f32) -> Vec3 {
    let across = to - from.dot(to) * from;
    let sine = across.length();
    if angle >= sine.atan2(from.dot(to)) {
        return to;
    }
    angle.cos() * from + angle.sin() / sine * across
}

/// The part of the receivers that the root sees whose cells are being visited.
struct Seen<S: Simd> {
    root: u32,
    part: F<S>,
    lanes: u32,
}

impl<S: Simd> Seen<S> {
    #[inline(always)]
    fn of(simd: S, maps: &VisibilityMaps, root: &PinholeSample, number: u32, receiver: &Receiver<S>) -> Self {
        let l = receiver.position - vector(simd, root.position());
        let dn = -l.dot(vector(simd, root.normal()));
        let sight = Surroundings::new(maps, root, dn);
        let (part, lanes) = match sight.outlook(simd, l, receiver.there()) {
            Outlook::Clear => (splat(simd, 1.0), ALL),
            Outlook::Dark => (splat(simd, 0.0), 0),
            Outlook::Mixed => {
                let part = lanes(simd, sight.visible_part(simd, l, ALL));
                (part, bits(part.simd_gt(0.0)))
            }
        };
        Self { root: number, part, lanes }
    }
}

impl TileGather<'_> {
    /// Adds what cells, and those below them, bring to sixteen points.
    #[inline(always)]
    pub(super) fn packet<S: Simd>(&mut self, simd: S, points: &Group, cells: &[u32], sum: &mut [Vec4; LANES]) {
        let receiver = points.in_lanes(simd);
        let there = receiver.there();
        let mut stack = std::mem::take(&mut self.pending);
        stack.extend(cells.iter().map(|&cell| (cell, there)));
        let mut seen = Seen { root: u32::MAX, part: splat(simd, 1.0), lanes: ALL };
        while let Some((index, mask)) = stack.pop() {
            let further = self.visit(simd, index, mask, &receiver, &mut seen, sum);
            if further != 0 {
                let children = self.scene.pinholes.tree.node(index).children();
                stack.extend(children.map(|child| (child, further)));
            }
        }
        self.pending = stack;
    }

    /// Adds what a cell brings to the lanes for which it is small enough, and returns those for which it is not.
    #[inline(always)]
    fn visit<S: Simd>(
        &self,
        simd: S,
        index: u32,
        mask: u32,
        receiver: &Receiver<S>,
        seen: &mut Seen<S>,
        sum: &mut [Vec4; LANES],
    ) -> u32 {
        let (gather, share) = (&self.scene.gather, self.judge.share);
        let node = self.scene.pinholes.tree.node(index);
        let g = node.geometry();
        let sample = self.scene.pinholes.sample(node, &g);
        let maps = gather.pinholes.visibility.as_ref();
        let of_many = maps.is_some() && self.scene.pinholes.tree.is_above_roots(index);
        let root = &gather.pinholes.samples[node.root() as usize];
        let reflects = self.scene.pinholes.mirror(sample.object()).most;
        let is_leaf = node.children().is_empty();
        let pair = Pair::new(simd, &sample, receiver);
        let l = pair.l2 * pair.inverse_l;
        let facing = if sample.two_sided() { pair.facing } else { -pair.dn };
        let receiving = pair.d.dot(receiver.normal);
        let is_known = maps.is_none() || seen.root == node.root();
        let mask = if is_known { mask & seen.lanes } else { mask };
        let lit = mask & bits(pair.cosines.simd_gt(0.0));
        // The greatest weight of any point of the cell.
        let (alive, weight, straddles) = if is_leaf {
            (lit, gather.weight(simd, &sample, &pair, receiver), 0)
        } else {
            let slack = l * g.normal_radius + g.radius;
            let straddles = bits(facing.simd_lt(slack) | receiving.simd_lt(g.radius));
            let (facing, receiving) = (facing + slack, receiving + g.radius);
            let alive = mask & bits(facing.simd_gt(0.0) & receiving.simd_gt(0.0));
            let nearest = (l - g.radius).max(l * MIN_DISTANCE_RATIO);
            let nearest2 = nearest * nearest;
            let cosines = facing.min(l) * receiving.min(l) / nearest2;
            (alive, cosines * g.area * gather.most_attenuation(simd, nearest2, g.area), straddles)
        };
        if alive == 0 {
            return 0;
        }
        let sides = pair.footprint(simd, &sample);
        let squares = sides.v1.dot(sides.v1) + sides.v2.dot(sides.v2);
        let size = pair.inverse_l * g.radius + g.normal_radius;
        let radius = if g.creased {
            size + (g.normal_radius + sample.lobe())
        } else {
            squares.sqrt() * FOOTPRINT_RADIUS + (size * size * FOOTPRINT_BEND + unevenness(&g))
        };
        let (most, contrast) = self.light_within(simd, pair.r, radius, alive);
        let mut weight_bound = weight * reflects;
        let mut of_gloss = splat(simd, 0.0);
        if receiver.view.is_some() {
            let (towards_viewers, changes) = self.gloss(simd, &pair, receiver, size, alive);
            weight_bound *= towards_viewers;
            of_gloss = changes;
        }
        let (top, varies) = (weight_bound * most, weight_bound * contrast);
        sum.iter_mut().enumerate().for_each(|(lane, s)| s.w += (alive >> lane & 1) as f32);
        let mut alive = alive & bits(top.simd_gt(self.judge.negligible * g.area));
        if alive == 0 {
            return 0;
        }
        if let (Some(maps), false, false) = (maps, of_many, is_known) {
            *seen = Seen::of(simd, maps, root, node.root(), receiver);
            alive &= seen.lanes;
        }
        let (taken, further) = if is_leaf {
            let near = top * size * size * WEIGHT_ERROR_SCALE;
            let near = if self.accuracy.split_near { alive & bits(near.simd_gt(share)) } else { 0 };
            if near != 0 {
                self.near(simd, &sample, root, near, (receiver, seen), sum);
            }
            (alive & !near, 0)
        } else {
            let error =
                varies * (size * CONTRAST_ERROR_SCALE).min(1.0) + top * (size * size * WEIGHT_ERROR_SCALE + of_gloss);
            let whole = bits(error.simd_lt(share) & size.simd_lt(MAX_RELATIVE_SIZE));
            // Where part of the cell does not count, its centre does not speak for all.
            let taken = alive & (whole & !straddles | bits(top.simd_lt(share)) & straddles);
            // What several roots see together is not known.
            let taken = if of_many { 0 } else { taken };
            (taken, alive & !taken)
        };
        let taken = taken & lit & alive;
        if taken == 0 {
            return further;
        }
        let mut weight = if is_leaf { weight } else { gather.weight(simd, &sample, &pair, receiver) };
        let sight = maps.map(|maps| Surroundings::new(maps, root, pair.dn));
        let mut outlook = Outlook::Clear;
        if let Some(sight) = &sight {
            weight *= seen.part;
            outlook = sight.sky(simd, pair.r, FOOTPRINT_RADIUS * squares.reduce_max().sqrt(), taken);
            if outlook == Outlook::Dark {
                return further;
            }
        }
        let is_blurred = sample.lobe() > 0.0;
        let uneven = taken & bits(varies.simd_ge(share));
        let taps = self.judge.taps(varies);
        for (lanes, taps) in [(taken & !uneven, None), (uneven, Some(taps))] {
            if lanes == 0 {
                continue;
            }
            let radiance = match &sight {
                Some(sight) if outlook == Outlook::Mixed => {
                    gather.cell_radiance(simd, &sides, is_blurred, sight, taps, lanes)
                }
                _ => gather.cell_radiance(simd, &sides, is_blurred, &Unhindered, taps, lanes),
            };
            gather.add(&sample, &pair, receiver, (weight, &radiance, lanes), sum);
        }
        further
    }

    /// Adds what a leaf brings to receivers so near to it that it is not one sample for them: its parallelogram is quartered
    /// until each piece is, or is too small to matter.
    #[inline(always)]
    fn near<S: Simd>(
        &self,
        simd: S,
        leaf: &PinholeSample,
        root: &PinholeSample,
        mask: u32,
        (receiver, seen): (&Receiver<S>, &Seen<S>),
        sum: &mut [Vec4; LANES],
    ) {
        let gather = &self.scene.gather;
        let taps = Some(splat(simd, gather.uniforms.taps as f32));
        let mut pieces: Vec<(PinholeSample, u32, u32)> = leaf.quarters().map(|q| (q, mask, 1)).to_vec();
        while let Some((piece, mask, depth)) = pieces.pop() {
            let pair = Pair::new(simd, &piece, receiver);
            let lit = mask & bits(pair.cosines.simd_gt(0.0));
            let size = pair.inverse_l * (0.5 * (piece.side_1().length() + piece.side_2().length()));
            let further = if depth < MAX_QUARTERINGS { mask & bits(size.simd_gt(MAX_RELATIVE_SIZE)) } else { 0 };
            if further != 0 {
                pieces.extend(piece.quarters().map(|q| (q, further, depth + 1)));
            }
            let taken = lit & !further;
            if taken == 0 {
                continue;
            }
            let weight = gather.weight(simd, &piece, &pair, receiver) * seen.part;
            let sides = pair.footprint(simd, &piece);
            let radiance = match &gather.pinholes.visibility {
                None => gather.cell_radiance(simd, &sides, piece.lobe() > 0.0, &Unhindered, taps, taken),
                Some(maps) => {
                    let sight = Surroundings::new(maps, root, pair.dn);
                    gather.cell_radiance(simd, &sides, piece.lobe() > 0.0, &sight, taps, taken)
                }
            };
            gather.add(&piece, &pair, receiver, (weight, &radiance, taken), sum);
        }
    }

    /// What receivers reflect to their viewers of the light from a cell of this relative size, at most: in π times their function;
    /// and what part of that is not so all over the cell.
    #[inline(always)]
    fn gloss<S: Simd>(&self, simd: S, pair: &Pair<S>, receiver: &Receiver<S>, size: F<S>, active: u32) -> (F<S>, F<S>) {
        let (Some(materials), Some(views)) = (self.scene.gather.materials, receiver.view) else {
            return (splat(simd, 1.0), splat(simd, 0.0));
        };
        let (l, n) = ((pair.d * pair.inverse_l).to_arrays(), receiver.normal.to_arrays());
        let size = size.to_array();
        let (mut most, mut part) = ([0.0; LANES], [0.0; LANES]);
        let vector = |v: &[[f32; LANES]; 3], lane: usize| Vec3::new(v[0][lane], v[1][lane], v[2][lane]);
        for lane in set_bits(active) {
            let (l, n, view) = (vector(&l, lane), vector(&n, lane), views[lane]);
            let value = |l: Vec3| PI * materials.value(receiver.object[lane], n, l, view, 0.0).max_element();
            let mirrored = 2.0 * n.dot(view) * n - view;
            let (at_centre, nearest) = (value(l), value(turned(l, mirrored, size[lane])));
            most[lane] = at_centre.max(nearest);
            part[lane] = (nearest - at_centre).abs() / most[lane].max(f32::MIN_POSITIVE);
        }
        (lanes(simd, most), lanes(simd, part) * CONTRAST_ERROR_SCALE)
    }

    /// Bounds of the light within cones around sixteen directions.
    #[inline(always)]
    fn light_within<S: Simd>(&self, simd: S, r: V3<S>, radius: F<S>, active: u32) -> (F<S>, F<S>) {
        let OnCube { face, s, t } = on_cube(simd, self.scene.gather.environment.direction_in_cube(r));
        let (a, b) = (s - 1.0, t - 1.0);
        let reach = radius * (a * a + b * b + 1.0) * self.judge.light.half_size() + 1.0;
        let (face, s, t, reach) = (face.to_array(), s.to_array(), t.to_array(), reach.to_array());
        let (mut most, mut contrast) = ([0.0; LANES], [0.0; LANES]);
        for lane in set_bits(active) {
            let bound = self.judge.light.at(face[lane] as usize, glam::Vec2::new(s[lane], t[lane]), reach[lane]);
            (most[lane], contrast[lane]) = (bound.most, bound.contrast);
        }
        (lanes(simd, most), lanes(simd, contrast))
    }
}
