//! How large, and how wrong, a pair of a block and a cell may be.
//!
//! The bounds are estimates: they hold to first order in the sizes of block and cell over their distance. How often they
//! are exceeded is measured (README, *The hierarchy*).

use glam::Vec3;

use super::super::lanes::{F, Simd, SimdBase, SimdFloat};
use super::blocks::{Block, FINEST, Kind};
use crate::cell_tree::NodeGeometry;
use crate::environment::{Bound, LightBounds};
use crate::pinhole::GatherUniforms;
use crate::pinhole::constants::{
    CONTRAST_ERROR_SCALE, FOOTPRINT_BEND, FOOTPRINT_RADIUS, INTERPOLATION_ERROR_SCALE, MIN_MINOR_SHARE,
    NEAR_FIELD_SIZES, POINT_SPACING, TAPS_PER_ERROR_BUDGET, WEIGHT_ERROR_SCALE,
};

/// What to do with a pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// It adds nothing that counts.
    Drop,
    /// It may be added as it is.
    Add {
        /// What it adds differs by so much within it, W/m²: if less than the judge's share, one look-up will do.
        varies: f32,
        /// It may be added even if part of the environment is hidden from the cell.
        even_if_hidden: bool,
    },
    /// Its cell is too large.
    SplitCell,
    /// Its block is too large.
    SplitBlock,
}

/// What does not change from pair to pair.
#[derive(Clone, Copy, Debug)]
pub struct Judge<'a> {
    pub uniforms: &'a GatherUniforms,
    pub light: &'a LightBounds,
    /// Error that a pair may have, W/m².
    pub share: f32,
    /// What adds less than this by its area is dropped, W/m⁴.
    pub negligible: f32,
    /// Width of the narrowest look-up, radians.
    pub texel: f32,
    /// Width of a texel of a map of visibility, radians.
    pub map_texel: f32,
    /// Whether receivers reflect what they get to viewers.
    pub has_viewers: bool,
}

/// A cell in question.
#[derive(Clone, Copy, Debug)]
pub struct Cell<'a> {
    pub geometry: &'a NodeGeometry,
    pub two_sided: bool,
    /// No channel reflects more.
    pub reflects: f32,
    /// Width of the lobe that blurs its footprints, radians.
    pub lobe: f32,
    pub is_leaf: bool,
}

/// How much farther reflections go than a cell's footprint where its normals do not turn evenly from end to end, radians.
pub fn unevenness(cell: &NodeGeometry) -> f32 {
    let even = FOOTPRINT_RADIUS * (cell.changes[0].length_squared() + cell.changes[1].length_squared()).sqrt();
    2.0 * (cell.normal_radius - even).max(0.0)
}

impl Judge<'_> {
    /// Look-ups that a pair is worth whose radiance differs by so much, by weight, within it: the fewer, the coarser they are.
    #[inline(always)]
    pub fn taps<S: Simd>(&self, varies: F<S>) -> F<S> {
        (varies * (TAPS_PER_ERROR_BUDGET / self.share)).ceil().max(1.0).min(self.uniforms.taps as f32)
    }

    /// A direction in the world as the light's bounds have it.
    fn direction_in_light(&self, d: Vec3) -> Vec3 {
        let (cos, sin) = (self.uniforms.rotation_cos, self.uniforms.rotation_sin);
        Vec3::new(cos * d.x - sin * d.z, d.y, sin * d.x + cos * d.z)
    }

    /// 1/l² at most, as the gather keeps it finite.
    fn attenuation(&self, l2: f32, area: f32) -> f32 {
        let u = self.uniforms;
        if u.attenuation == 0 { 1.0 } else { 1.0 / (l2 + u.epsilon_scale * area + u.epsilon).max(1e-20) }
    }

    /// Judges a pair.
    pub fn judge(&self, block: &Block, level: usize, cell: &Cell) -> Verdict {
        let g = cell.geometry;
        let may_split_block = level < FINEST;
        let d = g.centroid - block.centre;
        let l2 = d.length_squared();
        let l = l2.sqrt();
        let sizes = block.radius + g.radius;
        let dn = d.dot(g.normal);
        let facing = if cell.two_sided { dn.abs() } else { -dn };
        let receiving = d.dot(block.normal);
        let (f_slack, r_slack) = (sizes + g.normal_radius * l, sizes + block.normal_radius * l);
        // Some points of it may look at each other, others not.
        let straddles = facing < f_slack || receiving < r_slack;
        let (facing, receiving) = (facing + f_slack, receiving + r_slack);
        if facing <= 0.0 || receiving <= 0.0 {
            return Verdict::Drop;
        }
        let finer = |of_cell: bool| match (cell.is_leaf, may_split_block) {
            (false, true) => {
                if of_cell {
                    Verdict::SplitCell
                } else {
                    Verdict::SplitBlock
                }
            }
            (false, false) => Verdict::SplitCell,
            (true, true) => Verdict::SplitBlock,
            (true, false) => Verdict::Add { varies: f32::INFINITY, even_if_hidden: true },
        };
        if l < NEAR_FIELD_SIZES * sizes {
            return finer(g.radius >= block.radius);
        }
        let nearest = l - sizes;
        let weight = g.area * facing.min(l + sizes) * receiving.min(l + sizes) / (nearest * nearest)
            * self.attenuation(nearest * nearest, g.area)
            * cell.reflects;

        let r = (d - 2.0 * dn * g.normal) / l;
        let side = |side: Vec3, change: Vec3| {
            let v = side - 2.0 * d.dot(change) * g.normal - 2.0 * dn * change;
            (v - r.dot(v) * r) / l
        };
        let (v1, v2) = (side(g.sides[0], g.changes[0]), side(g.sides[1], g.changes[1]));
        let lobe2 = cell.lobe * cell.lobe;
        let (g11, g12, g22) = (v1.length_squared() + lobe2, v1.dot(v2), v2.length_squared() + lobe2);
        let spread = ((g11 - g22) * (g11 - g22) + 4.0 * g12 * g12).sqrt();
        let minor2 = (0.5 * (g11 + g22 - spread)).max((g11 + g22) * MIN_MINOR_SHARE);
        let (of_block, of_cell) = (block.radius / l, g.radius / l + g.normal_radius);
        let footprint = if g.creased {
            g.radius / l + 2.0 * g.normal_radius
        } else {
            FOOTPRINT_RADIUS * (g11 + g22).sqrt() + FOOTPRINT_BEND * of_cell * (of_block + of_cell) + unevenness(g)
        };
        let Bound { most, contrast } = self.light.within(self.direction_in_light(r), of_block + footprint);
        let (top, varies) = (weight * most, weight * contrast);
        // What glossy receivers make of it they know one by one.
        if top <= self.negligible * g.area && (top == 0.0 || !self.has_viewers) {
            return Verdict::Drop;
        }
        if may_split_block && block.kind != Kind::Smooth {
            return Verdict::SplitBlock;
        }
        let block_error = if may_split_block {
            // The points' distance over the width of what is interpolated.
            let step = POINT_SPACING * of_block / minor2.sqrt().max(self.texel);
            let step2 = step * step;
            let of_weight = if straddles { 1.0 } else { WEIGHT_ERROR_SCALE * of_block.powi(3) };
            varies * (INTERPOLATION_ERROR_SCALE * step2 * step2).min(1.0) + top * of_weight
        } else {
            0.0
        };
        let cell_error = if cell.is_leaf {
            0.0
        } else {
            let of_weight = if straddles { 1.0 } else { WEIGHT_ERROR_SCALE * of_cell * of_cell };
            varies * (CONTRAST_ERROR_SCALE * of_cell).min(1.0) + top * of_weight
        };
        if block_error + cell_error < self.share {
            // Hidden or not: contrast as strong as the light is bright, smooth over a texel of the map.
            let step = POINT_SPACING * of_block / minor2.sqrt().max(self.map_texel);
            let of_hidden = if may_split_block { (INTERPOLATION_ERROR_SCALE * step.powi(4)).min(1.0) } else { 0.0 };
            return Verdict::Add { varies, even_if_hidden: block_error + cell_error + top * of_hidden < self.share };
        }
        if block_error == 0.0 && cell_error == 0.0 {
            return Verdict::Add { varies: f32::INFINITY, even_if_hidden: true };
        }
        finer(cell_error >= block_error)
    }
}
