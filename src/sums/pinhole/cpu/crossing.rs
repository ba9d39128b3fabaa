//! What an interface between two media does with the light for sixteen receivers; twin of `shaders/shared/interface.wgsl`. The formulas
//! are those of [`Interface`].

use crate::lanes::{F, Mask, Select, Simd, SimdBase, SimdFloat, SimdMask, V3, bits, splat};
use crate::pinhole::Interface;
use crate::pinhole::constants::{
    AZIMUTH_PER_SINE, CONE_PER_AXES, HALF_ANGLE_PER_CHORD, MAX_AZIMUTH_SINE, MAX_REFRACTED_BLUR, MIN_REFRACTED_COSINE,
    WHOLE_SPHERE_RAD,
};

/// Lane by lane as [`Crossing`](crate::pinhole::interface::Crossing), with the factor on the radiance.
#[derive(Clone, Copy)]
pub(super) struct Crossing<S: Simd> {
    pub ratio: F<S>,
    pub bend: F<S>,
    pub slope: F<S>,
    pub factor: F<S>,
}

/// Lane by lane as [`CrossingBounds`](crate::pinhole::interface::CrossingBounds).
pub(super) struct CrossingBounds<S: Simd> {
    pub per_direction: F<S>,
    pub per_normal: F<S>,
    pub per_cosine: F<S>,
    pub factor: F<S>,
    /// The lanes that may see both sides, or total reflection.
    pub unbounded: u32,
    /// The lanes that are behind the interface.
    behind: u32,
    /// The cosines to the normal of the steepest and of the flattest refracted direction.
    steep: F<S>,
    flat: F<S>,
}

impl<S: Simd> Crossing<S> {
    /// For receivers that see the interface at these cosines ω·n.
    #[inline(always)]
    pub fn new(simd: S, interface: Interface, cosine: F<S>) -> Self {
        let behind = cosine.simd_gt(0.0);
        let refracted = refracted_cosine(interface.eta, cosine);
        let ratio = behind.select(splat(simd, interface.eta), splat(simd, 1.0));
        let refracted_cosine = behind.select(refracted, -cosine);
        let bend = refracted_cosine - ratio * cosine;
        let slope = ratio * bend / refracted_cosine.max(MIN_REFRACTED_COSINE) * -1.0;
        Self { ratio, bend, slope, factor: factor(simd, interface, cosine) }
    }

    /// The unit directions to the light.
    #[inline(always)]
    pub fn direction(&self, towards: V3<S>, normal: V3<S>) -> V3<S> {
        (towards * self.ratio).plus(normal, self.bend)
    }

    /// How they change along a side of a cell.
    #[inline(always)]
    pub fn side(&self, (side, change): (V3<S>, V3<S>), (towards, normal): (V3<S>, V3<S>), inverse_l: F<S>) -> V3<S> {
        let turn = side.plus(towards, -towards.dot(side)) * inverse_l;
        let cosine_change = turn.dot(normal) + towards.dot(change);
        (turn * self.ratio).plus(change, self.bend).plus(normal, self.slope * cosine_change)
    }

    /// The blur of a bend, as a mirror has it, in the plane of incidence and across it: second orders are as strong as first ones.
    #[inline(always)]
    pub fn blur(&self, lobe: f32) -> (F<S>, F<S>) {
        let scale = (self.slope.abs() * 0.5).min(MAX_REFRACTED_BLUR) * lobe;
        (scale, self.bend.abs() * 0.5 * lobe)
    }
}

impl<S: Simd> CrossingBounds<S> {
    /// For receivers that see the interface at cosines between these.
    #[inline(always)]
    pub fn new(simd: S, interface: Interface, least: F<S>, most: F<S>) -> Self {
        let nothing = splat(simd, 0.0);
        let in_front = least.simd_lt(0.0);
        let behind = most.simd_gt(0.0);
        let reflected = in_front.select(factor(simd, interface, most.min(0.0)), nothing);
        let refracted = behind.select(factor(simd, interface, most), nothing);
        let flat = refracted_cosine(interface.eta, least.max(0.0));
        let steep = refracted_cosine(interface.eta, most.max(0.0));
        let unbounded = bits(behind & (in_front | flat.simd_le(MIN_REFRACTED_COSINE)));
        let of_flat = turns(interface.eta, least.max(0.0), flat);
        let of_steep = turns(interface.eta, most.max(0.0), steep);
        let bounded = behind & !in_front;
        let per_direction = bounded.select(of_flat.0.max(of_steep.0), splat(simd, 1.0));
        let per_normal = bounded.select(of_flat.1.max(of_steep.1), splat(simd, 2.0));
        let per_cosine = bounded.select((per_direction * (1.0 / interface.eta)).max(1.0), splat(simd, 1.0));
        let (factor, behind) = (reflected.max(refracted), bits(bounded));
        Self { per_direction, per_normal, per_cosine, factor, unbounded, behind, steep, flat }
    }

    /// Cones around the light for bundles of directions and normals of these radii: their axes and radii. `r` are the directions of the
    /// light for the axes of both.
    #[inline(always)]
    pub fn cones(
        &self,
        simd: S,
        r: V3<S>,
        (towards, normal): (V3<S>, V3<S>),
        directions: F<S>,
        normals: f32,
    ) -> (V3<S>, F<S>) {
        let unbounded = Mask::from_bitmask(simd, u64::from(self.unbounded));
        let radius = (self.per_direction * directions + self.per_normal * normals).min(WHOLE_SPHERE_RAD);
        let radius = unbounded.select(splat(simd, WHOLE_SPHERE_RAD), radius);
        let across = towards.plus(normal, -towards.dot(normal));
        let sine = across.dot(across).sqrt().max(f32::MIN_POSITIVE);
        let (steep_sine, flat_sine) = (sine_of(self.steep), sine_of(self.flat));
        let (x, y) = (steep_sine + flat_sine, self.steep + self.flat);
        let scale = 1.0 / (x * x + y * y).sqrt();
        let axis = (across * (x * scale / sine)).plus(normal, y * scale);
        let (dx, dy) = (steep_sine - flat_sine, self.steep - self.flat);
        let half = (dx * dx + dy * dy).sqrt() * (0.5 * HALF_ANGLE_PER_CHORD);
        let azimuth = (directions + normals) / sine;
        let wide = azimuth * AZIMUTH_PER_SINE;
        let of_angles = (half * half + wide * wide).sqrt() * CONE_PER_AXES + normals;
        let is_narrower = Mask::from_bitmask(simd, u64::from(self.behind))
            & azimuth.simd_le(MAX_AZIMUTH_SINE)
            & of_angles.simd_lt(radius);
        (V3::select(is_narrower, axis, r), is_narrower.select(of_angles, radius))
    }
}

/// How much more than the direction and than the normal that of the light turns.
#[inline(always)]
fn turns<S: Simd>(eta: f32, cosine: F<S>, refracted: F<S>) -> (F<S>, F<S>) {
    let along = cosine * eta / refracted.max(MIN_REFRACTED_COSINE);
    (along.max(eta), (along - 1.0).abs().max((refracted - cosine * eta).abs()))
}

#[inline(always)]
fn sine_of<S: Simd>(cosine: F<S>) -> F<S> {
    (1.0 - cosine * cosine).max(0.0).sqrt()
}

#[inline(always)]
fn refracted_cosine<S: Simd>(eta: f32, cosine: F<S>) -> F<S> {
    (1.0 - (1.0 - cosine * cosine) * (eta * eta)).max(0.0).sqrt()
}

#[inline(always)]
fn factor<S: Simd>(simd: S, interface: Interface, cosine: F<S>) -> F<S> {
    let eta = interface.eta;
    let is_behind = cosine.simd_gt(0.0);
    let nothing = splat(simd, 0.0);
    let all_of_it = splat(simd, eta * eta);
    let passed = refracted_cosine(eta, cosine);
    if !interface.fresnel {
        return (is_behind & passed.simd_gt(0.0)).select(all_of_it, nothing);
    }
    let front = is_behind.select(passed, -cosine);
    let behind = is_behind.select(cosine, refracted_cosine(1.0 / eta, cosine));
    let s = (front - behind * eta) / (front + behind * eta).max(f32::MIN_POSITIVE);
    let p = (front * eta - behind) / (front * eta + behind).max(f32::MIN_POSITIVE);
    let is_total = front.simd_le(0.0) | behind.simd_le(0.0);
    let reflected = is_total.select(splat(simd, 1.0), (s * s + p * p) * 0.5);
    is_behind.select((1.0 - reflected) * all_of_it, reflected)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::{LANES, dispatch, lanes, level, splat3};
    use glam::Vec3;

    #[test]
    fn lanes_are_the_formulas_one_by_one() {
        for interface in [(1.333, true), (1.333, false), (0.7, true), (1.8, true)] {
            let interface = Interface { eta: interface.0, fresnel: interface.1 };
            let cosines: [f32; LANES] = std::array::from_fn(|lane| (lane as f32 - 7.4) / 8.7);
            let mosts = cosines.map(|cosine| (cosine + 0.15).min(1.0));
            let (crossing, bounds) = dispatch!(level(), simd => {
                let crossing = Crossing::new(simd, interface, lanes(simd, cosines));
                let bounds = CrossingBounds::new(simd, interface, lanes(simd, cosines), lanes(simd, mosts));
                let arrays = [crossing.ratio, crossing.bend, crossing.slope, crossing.factor];
                let towards = V3([lanes(simd, cosines.map(|c| (1.0 - c * c).sqrt())), splat(simd, 0.0), lanes(simd, cosines)]);
                let normal = splat3(simd, Vec3::Z);
                let r = crossing.direction(towards, normal);
                let (axis, radius) = bounds.cones(simd, r, (towards, normal), splat(simd, 0.05), 0.03);
                let of_bounds = [bounds.factor, bounds.per_cosine, radius, axis.0[0], axis.0[2]];
                (arrays.map(SimdBase::to_array), of_bounds.map(SimdBase::to_array))
            });
            for lane in 0..LANES {
                let one = interface.crossing(cosines[lane]);
                let expected = [one.ratio, one.bend, one.slope, interface.factor(cosines[lane])];
                for (found, expected) in crossing.iter().map(|a| a[lane]).zip(expected) {
                    assert!((found - expected).abs() <= 1e-5 * (1.0 + expected.abs()), "{found} {expected}");
                }
                let bound = interface.bounds(cosines[lane], mosts[lane]);
                let towards = Vec3::new((1.0 - cosines[lane] * cosines[lane]).sqrt(), 0.0, cosines[lane]);
                let (axis, radius) = bound.cone(&one, (towards, Vec3::Z), 0.05, 0.03);
                let expected = [bound.factor, bound.per_cosine, radius, axis.x, axis.z];
                for (found, expected) in bounds.iter().map(|a| a[lane]).zip(expected) {
                    assert!((found - expected).abs() <= 1e-4 * (1.0 + expected.abs()), "{found} {expected}");
                }
            }
        }
    }
}
