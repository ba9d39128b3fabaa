//! The refinement criterion of block–cell pairs: how much a pair may contribute, and how wrong interpolating it would be.
//!
//! The bounds are estimates: they hold to first order in the sizes of block and cell over their distance. How often they
//! are exceeded is measured (`tests/engine/hierarchy.rs`).

use std::f32::consts::FRAC_PI_2;

use glam::Vec3;

use super::super::lamp::LampLight;
use super::super::medium::{max_relative_phase, phase_slope};
use super::blocks::{Block, Kind};
use crate::environment::{Bound, LightBounds};
use crate::lanes::{F, Simd, SimdBase, SimdFloat};
use crate::pinhole::cell::Cell;
use crate::pinhole::constants::{
    COHERENT_ERROR_SHARE, CONTRAST_ERROR_SCALE, FOOTPRINT_BEND, FOOTPRINT_RADIUS, INTERPOLATION_ERROR_SCALE,
    MIN_MINOR_SHARE, NEAR_FIELD_SIZES, NEGLIGIBLE_SHARE, PAIR_ERROR_SHARE, POINT_SPACING, TAPS_PER_ERROR_BUDGET,
    WEIGHT_ERROR_SCALE,
};
use crate::pinhole::interface::CrossingBounds;
use crate::pinhole::{GatherUniforms, Interface, Surroundings};
use crate::scene::{Medium, Sides};

/// What to do with a pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Decision {
    /// It contributes nothing that counts.
    Drop,
    /// It may be evaluated as it is.
    Accept(Accepted),
    /// Its cell is too large.
    RefineCell,
    /// Its block is too large.
    RefineBlock,
}

/// A pair that may be evaluated as it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accepted {
    /// What it contributes differs by so much within it, W/m²: below the error budget one look-up is enough.
    pub contribution_range: f32,
    /// It contributes no more than this, W/m².
    pub max_contribution: f32,
    /// It may be interpolated even if part of the environment is occluded.
    pub allows_partial_sky: bool,
}

/// What bounds the light of a sum.
#[derive(Clone, Copy, Debug)]
pub enum SourceBounds<'a> {
    Environment(&'a LightBounds),
    Lamp(LampLight<'a>),
    Surroundings(&'a Surroundings),
}

/// What does not change from pair to pair.
#[derive(Clone, Copy, Debug)]
pub struct RefinementCriterion<'a> {
    pub uniforms: &'a GatherUniforms,
    pub light: SourceBounds<'a>,
    /// Error that a pair may have, W/m².
    pub error_budget: f32,
    /// The same for light whose errors have one sign where it is focused, W/m⁴: by the cell's area.
    pub coherent_error: f32,
    /// Cells that contribute less than this, by their area, are dropped, W/m⁴.
    pub negligible: f32,
    /// Width of the narrowest look-up, radians.
    pub texel_rad: f32,
    /// Width of a texel of the visibility maps, radians.
    pub map_texel_rad: f32,
    /// Whether receivers reflect towards viewers.
    pub has_view_directions: bool,
    /// What is between cells and receivers.
    pub medium: Option<&'a Medium>,
    /// Whether receivers are parts of rays.
    pub along_rays: bool,
}

/// A block and a cell.
struct BlockPair {
    /// From the middle of the block to the cell's centroid, metres, and its length.
    d: Vec3,
    l: f32,
    /// Both radii together.
    sizes: f32,
    dn: f32,
    /// The largest cosines at any point of the cell and of the block, times l.
    max_cos_at_sample_l: f32,
    max_cos_at_receiver_l: f32,
    /// Only some points of the cell and the block face each other, or light is totally reflected between some of them.
    straddles_horizon: bool,
    /// What an interface does at most with the light.
    crossing: Option<CrossingBounds>,
    /// Sizes relative to the distance; the cell's with the spread of its normals.
    block_size: f32,
    cell_size: f32,
    /// How far the light's direction turns over the block, and over the cell half as far: the same for mirrors, whose normals turn the light
    /// twice as far.
    turned_block: f32,
    turned_cell: f32,
    /// Of what a medium does on the way: an upper bound, and how much faster than directions it changes.
    passed: f32,
    phase_slope: f32,
}

/// The cone of light that a cell reflects or refracts to a block.
struct Cone {
    direction: Vec3,
    radius: f32,
    /// The minor axis of a footprint within it.
    minor: f32,
    /// It holds directions relative to that of a lamp from the same point of the cell; else those from anywhere on it.
    is_towards_lamp: bool,
}

/// How much farther than a footprint reflections spread where a cell's normals do not turn evenly from end to end, radians.
pub fn unevenness(cell: &Cell) -> f32 {
    let [a, b] = cell.sample.changes;
    let even = FOOTPRINT_RADIUS * (a.length_squared() + b.length_squared()).sqrt();
    2.0 * (cell.normal_radius - even).max(0.0)
}

impl BlockPair {
    fn new(block: &Block, cell: &Cell, criterion: &RefinementCriterion) -> Self {
        let d = cell.sample.position - block.centre;
        let l = d.length();
        let sizes = block.radius + cell.radius;
        let dn = d.dot(cell.sample.normal);
        let at_sample = match cell.sample.lights {
            Sides::Front => -dn,
            Sides::Back => dn,
            Sides::Both => dn.abs(),
        };
        let sample_slack = sizes + cell.normal_radius * l;
        let (at_receiver, receiver_slack) =
            if criterion.along_rays { (l, 0.0) } else { (d.dot(block.normal), sizes + block.normal_radius * l) };
        let (passed, phase_slope) = criterion.medium.map_or((1.0, 1.0), |medium| {
            let passed = (-medium.extinction().min_element() * (l - sizes).max(0.0)).exp();
            let passed = if cell.sample.interface.is_some_and(|_| dn <= sample_slack) { 1.0 } else { passed };
            if !criterion.along_rays {
                return (passed, 1.0);
            }
            let spread = sizes / l * FRAC_PI_2 + block.normal_radius;
            (passed * max_relative_phase(medium, -d.dot(block.normal) / l, spread), phase_slope(medium))
        });
        let crossing = cell.sample.interface.map(|interface| {
            let (cosine, slack) = (dn / l, sizes / l + cell.normal_radius);
            interface.bounds((cosine - slack).max(-1.0), (cosine + slack).min(1.0))
        });
        let is_unbounded = crossing.is_some_and(|crossing| crossing.is_unbounded);
        let (block_size, cell_size) = (block.radius / l, cell.radius / l + cell.normal_radius);
        let (turned_block, turned_cell) = crossing.map_or((block_size, cell_size), |crossing| {
            let CrossingBounds { per_direction, per_normal, .. } = crossing;
            (per_direction * block_size, per_direction * cell.radius / l + 0.5 * per_normal * cell.normal_radius)
        });
        Self {
            d,
            l,
            sizes,
            dn,
            max_cos_at_sample_l: at_sample + sample_slack,
            max_cos_at_receiver_l: at_receiver + receiver_slack,
            straddles_horizon: at_sample < sample_slack || at_receiver < receiver_slack || is_unbounded,
            crossing,
            block_size,
            cell_size,
            turned_block,
            turned_cell,
            passed,
            phase_slope,
        }
    }

    fn is_below_horizon(&self) -> bool {
        self.max_cos_at_sample_l <= 0.0
            || self.max_cos_at_receiver_l <= 0.0
            || self.crossing.is_some_and(|crossing| crossing.factor == 0.0)
    }

    /// The largest factor on the radiance beside the cell's reflectance.
    fn max_factor(&self) -> f32 {
        self.crossing.map_or(1.0, |crossing| crossing.factor) * self.passed
    }

    fn is_unbounded(&self) -> bool {
        self.crossing.is_some_and(|crossing| crossing.is_unbounded)
    }

    /// How much faster than the cosines at the interface its factor changes, or the phase function.
    fn per_cosine(&self) -> f32 {
        self.crossing.map_or(1.0, |crossing| crossing.per_cosine).max(self.phase_slope)
    }

    fn light_cone(&self, cell: &Cell, light: &SourceBounds) -> Cone {
        match (cell.sample.interface, &self.crossing, light) {
            (Some(interface), Some(bounds), _) => self.crossed_cone(cell, interface, bounds),
            (_, _, SourceBounds::Lamp(lamp)) if !cell.is_creased => self.reflected_cone(cell, Some(lamp)),
            _ => self.reflected_cone(cell, None),
        }
    }

    /// The cone of light that an interface reflects or refracts.
    fn crossed_cone(&self, cell: &Cell, interface: Interface, bounds: &CrossingBounds) -> Cone {
        let Self { d, l, dn, block_size, turned_block, turned_cell, .. } = *self;
        let (n, [t1, t2], [m1, m2]) = (cell.sample.normal, cell.sample.sides, cell.sample.changes);
        let (towards, crossing) = (d / l, interface.crossing(dn / l));
        let direction = crossing.direction(towards, n);
        let side = |side: Vec3, change: Vec3| crossing.side((side, change), (towards, n), l);
        let Cone { minor, radius: footprint, .. } =
            footprint_cone(direction, [side(t1, m1), side(t2, m2)], crossing.blur(cell.sample.lobe));
        let (axis, most) = bounds.cone(&crossing, (towards, n), block_size + cell.radius / l, cell.normal_radius);
        let curved = turned_block
            + footprint
            + FOOTPRINT_BEND * turned_cell * (turned_block + turned_cell)
            + 0.5 * bounds.per_normal * unevenness(cell);
        if !cell.is_creased && !bounds.is_unbounded && curved < most {
            return Cone { direction, radius: curved, minor, is_towards_lamp: false };
        }
        Cone { direction: axis, radius: most, minor, is_towards_lamp: false }
    }

    fn reflected_cone(&self, cell: &Cell, lamp: Option<&LampLight>) -> Cone {
        let Self { d, l, dn, block_size, cell_size, .. } = *self;
        let (n, [t1, t2], [m1, m2]) = (cell.sample.normal, cell.sample.sides, cell.sample.changes);
        let direction = (d - 2.0 * dn * n) / l;
        let seen = lamp.map(|lamp| lamp.seen_from(cell.sample.position));
        let reflected_side = |side: Vec3, change: Vec3| {
            let v = side - 2.0 * d.dot(change) * n - 2.0 * dn * change;
            let turn = (v - direction.dot(v) * direction) / l;
            turn + seen.map_or(Vec3::ZERO, |seen| LampLight::parallax(&seen, direction, side))
        };
        let cell_size = cell_size + seen.map_or(0.0, |seen| cell.radius / seen.distance);
        let sides = [reflected_side(t1, m1), reflected_side(t2, m2)];
        let Cone { minor, radius: footprint, .. } = footprint_cone(direction, sides, cell.sample.lobe);
        let footprint = if cell.is_creased {
            cell.radius / l + 2.0 * cell.normal_radius
        } else {
            footprint + FOOTPRINT_BEND * cell_size * (block_size + cell_size) + unevenness(cell)
        };
        Cone { direction, radius: block_size + footprint, minor, is_towards_lamp: lamp.is_some() }
    }

    /// Error of interpolating between the block's points: of the light, and of the weight.
    fn interpolation_error(&self, width: f32, max_contribution: f32, contribution_range: f32) -> f32 {
        let light_error = self.interpolated_share(width);
        let size = self.per_cosine() * self.block_size;
        let weight_error = if self.straddles_horizon { 1.0 } else { WEIGHT_ERROR_SCALE * size.powi(3) };
        contribution_range * light_error + max_contribution * weight_error
    }

    /// The part of the contrast that interpolation gets wrong, of something that changes over an angle of `width`.
    fn interpolated_share(&self, width: f32) -> f32 {
        // The distance of the points over the width of what is interpolated.
        let step = POINT_SPACING * self.turned_block / width;
        (INTERPOLATION_ERROR_SCALE * step.powi(4)).min(1.0)
    }

    /// Error of evaluating the cell as one sample; leaves are samples.
    fn cell_error(&self, cell: &Cell, max_contribution: f32, contribution_range: f32) -> f32 {
        if cell.is_leaf() {
            return 0.0;
        }
        let size = self.per_cosine() * self.cell_size;
        let weight_error = if self.straddles_horizon { 1.0 } else { WEIGHT_ERROR_SCALE * size * size };
        contribution_range * (CONTRAST_ERROR_SCALE * self.turned_cell).min(1.0) + max_contribution * weight_error
    }
}

/// The cone that holds a footprint, blurred by a lobe, to first order.
fn footprint_cone(direction: Vec3, [v1, v2]: [Vec3; 2], lobe: f32) -> Cone {
    let lobe2 = lobe * lobe;
    let (g11, g12, g22) = (v1.length_squared() + lobe2, v1.dot(v2), v2.length_squared() + lobe2);
    let spread = ((g11 - g22) * (g11 - g22) + 4.0 * g12 * g12).sqrt();
    let minor2 = (0.5 * (g11 + g22 - spread)).max((g11 + g22) * MIN_MINOR_SHARE);
    Cone { direction, radius: FOOTPRINT_RADIUS * (g11 + g22).sqrt(), minor: minor2.sqrt(), is_towards_lamp: false }
}

impl RefinementCriterion<'_> {
    /// Sets the error that is allowed for a point, W/m², in the sum over cells of this area in all, m².
    pub fn allow(&mut self, error: f32, area: f32) {
        self.error_budget = PAIR_ERROR_SHARE * error;
        self.coherent_error = COHERENT_ERROR_SHARE * error / area;
        self.negligible = NEGLIGIBLE_SHARE * error / area;
    }

    /// Error that a pair may have with a cell of this area, W/m².
    #[inline(always)]
    pub fn error_budget_of(&self, area: f32) -> f32 {
        match self.light {
            SourceBounds::Lamp(_) => self.error_budget.min(self.coherent_error * area),
            _ => self.error_budget,
        }
    }

    /// Taps for a pair whose radiance, weighted, differs by so much within it: the fewer, the coarser they are.
    #[inline(always)]
    pub fn taps<S: Simd>(&self, contribution_range: F<S>) -> F<S> {
        let taps = (contribution_range * (TAPS_PER_ERROR_BUDGET / self.error_budget)).ceil();
        taps.max(1.0).min(self.uniforms.taps as f32)
    }

    /// Bounds of the radiance that arrives at a cell in a cone of directions.
    fn light_within(&self, cone: &Cone, cell: &Cell) -> Bound {
        match &self.light {
            SourceBounds::Environment(bounds) => {
                bounds.within(self.light_from_world(cone.direction), cone.radius, cell.blur)
            }
            SourceBounds::Surroundings(surfaces) => {
                let view = surfaces.nearest(cell.sample.position, cell.sample.normal);
                let radius = cone.radius + view.spread(cell.sample.position, cell.radius);
                view.bounds.within(cone.direction, radius, cell.blur)
            }
            SourceBounds::Lamp(lamp) => {
                let apart = cone.direction.distance(lamp.seen_from(cell.sample.position).towards);
                // A chord is shorter than its arc.
                let reach = lamp.blurred_reach(&cell.sample);
                if cone.is_towards_lamp {
                    let radius = reach * cone.radius;
                    let may_be_even = cell.sample.lobe == 0.0 && !self.along_rays;
                    return lamp.bound((&cell.sample, cell.radius), (apart, radius), may_be_even);
                }
                let is_met = apart <= reach * (cone.radius + lamp.spread(&cell.sample, cell.radius));
                let max = if is_met { lamp.max_radiance } else { 0.0 };
                Bound { max, contrast: max }
            }
        }
    }

    /// A world direction in the space of the light's bounds.
    fn light_from_world(&self, d: Vec3) -> Vec3 {
        let (cos, sin) = (self.uniforms.rotation_cos, self.uniforms.rotation_sin);
        Vec3::new(cos * d.x - sin * d.z, d.y, sin * d.x + cos * d.z)
    }

    /// Upper bound of 1/l², kept finite as in the gather.
    fn max_attenuation(&self, l2: f32, area: f32) -> f32 {
        let u = self.uniforms;
        if u.attenuation == 0 { 1.0 } else { 1.0 / (l2 + u.epsilon_scale * area + u.epsilon).max(1e-20) }
    }

    /// The largest weight of any point of the cell at any point of the block.
    fn max_weight(&self, cell: &Cell, pair: &BlockPair) -> f32 {
        let (nearest, farthest) = (pair.l - pair.sizes, pair.l + pair.sizes);
        let cosines = pair.max_cos_at_sample_l.min(farthest) * pair.max_cos_at_receiver_l.min(farthest);
        cell.sample.area * cosines / (nearest * nearest)
            * self.max_attenuation(nearest * nearest, cell.sample.area)
            * cell.max_reflectance
            * pair.max_factor()
    }

    /// Decides about a pair of a cell and a block, which can be refined.
    pub fn decide(&self, block: &Block, cell: &Cell) -> Decision {
        let pair = BlockPair::new(block, cell, self);
        if pair.is_below_horizon() {
            return Decision::Drop;
        }
        let refined = |prefers_cell: bool| {
            if prefers_cell && !cell.is_leaf() { Decision::RefineCell } else { Decision::RefineBlock }
        };
        if pair.l < NEAR_FIELD_SIZES * pair.sizes {
            return refined(cell.radius >= block.radius);
        }
        let cone = pair.light_cone(cell, &self.light);
        let Bound { max, contrast } = self.light_within(&cone, cell);
        let max_weight = self.max_weight(cell, &pair);
        let (max_contribution, contribution_range) = (max_weight * max, max_weight * contrast);
        // Glossy receivers weight it one by one.
        let is_negligible = max_contribution <= self.negligible * cell.sample.area;
        if is_negligible && (max_contribution == 0.0 || !self.has_view_directions) {
            return Decision::Drop;
        }
        if block.kind != Kind::Smooth {
            return Decision::RefineBlock;
        }
        let width = cone.minor.max(self.texel_rad);
        let block_error = pair.interpolation_error(width, max_contribution, contribution_range);
        let cell_error = pair.cell_error(cell, max_contribution, contribution_range);
        let error = block_error + cell_error;
        let error_budget = self.error_budget_of(cell.sample.area);
        if error >= error_budget || error.is_nan() {
            // Next to total reflection both errors are unknown, and the larger of the two is refined.
            let prefers_cell =
                if pair.is_unbounded() { pair.cell_size >= pair.block_size } else { cell_error >= block_error };
            return refined(prefers_cell);
        }
        // Occlusion: a contrast as strong as the light, smooth over a texel of the map.
        let occlusion_error = max_contribution * pair.interpolated_share(cone.minor.max(self.map_texel_rad));
        Decision::Accept(Accepted {
            contribution_range,
            max_contribution,
            allows_partial_sky: error + occlusion_error < error_budget,
        })
    }
}
