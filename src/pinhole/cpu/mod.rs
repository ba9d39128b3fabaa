//! The gather on the CPU: the twin of `shaders/gather.wgsl`, step by step and name by name.
//!
//! Sixteen neighbouring receivers go through the loop together, one in each SIMD lane, as fragments do on a GPU;
//! rayon spreads the groups over the cores.

mod cube;
mod filters;
mod footprint;
mod hierarchical;
mod lanes;
mod visibility;

pub use cube::{CubeLookup, Lanes16};
pub use filters::probe;
pub use hierarchical::{Accuracy, Light, StillGather, StillSums, gather_hierarchical, typical_irradiance};

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use self::filters::{Sides, mean_over_footprint, single_look_up};
use self::footprint::{blurred, reflected_side};
use self::lanes::{F, LANES, Simd, SimdBase, SimdFloat, V3, bits, dispatch, lanes, level, set_bits, vector};
use self::visibility::{Sight, Surroundings, Unhindered};
use super::constants::{
    EVEN_LIGHT_SHARPNESS, FILTER_ANISOTROPIC, FILTER_EWA, FILTER_ISOTROPIC, FILTER_NONE, TAP_SHARPNESS,
};
use super::{BATCH_SIZE, CURVE_POINTS, Filter, GatherUniforms, Params, PinholeSample, Pinholes, Receivers};
use crate::brdf::Materials;
use crate::environment::CubeMap;

/// Groups of lanes between two reports of progress.
const GROUPS_PER_TASK: usize = 32;

/// Gathers the irradiance at every receiver, or the radiance that it reflects to its viewer: R, G, B in W/m² or
/// W/(m²·sr), and the number of fetches. `progress` is told, from any
/// thread, how many more receivers are done. [`Filter::Hardware`] needs a GPU and is not accepted here.
pub fn gather(
    receivers: &Receivers,
    pinholes: &Pinholes,
    environment: &CubeMap,
    params: &Params,
    progress: &(dyn Fn(u64) + Sync),
) -> Vec<[f32; 4]> {
    assert!(params.taps > 0, "a footprint needs one tap at least");
    let uniforms = GatherUniforms::for_cube(params, pinholes, environment);
    let materials = receivers.viewers.as_ref().map(|viewers| &*viewers.materials);
    let gather = Gather { pinholes, materials, environment: CubeLookup::rotated(environment, &uniforms), uniforms };
    let task: fn(&Gather, &Receivers, usize, &mut [[f32; 4]]) = match params.filter {
        Filter::None => |g, r, first, sums| dispatch!(level(), simd => task::<_, FILTER_NONE>(simd, g, r, first, sums)),
        Filter::Isotropic => {
            |g, r, first, sums| dispatch!(level(), simd => task::<_, FILTER_ISOTROPIC>(simd, g, r, first, sums))
        }
        Filter::Anisotropic => {
            |g, r, first, sums| dispatch!(level(), simd => task::<_, FILTER_ANISOTROPIC>(simd, g, r, first, sums))
        }
        Filter::Ewa => |g, r, first, sums| dispatch!(level(), simd => task::<_, FILTER_EWA>(simd, g, r, first, sums)),
        Filter::Hardware => panic!("the hardware filter needs a GPU"),
    };
    let mut sums = vec![[0.0; 4]; receivers.positions.len()];
    sums.par_chunks_mut(LANES * GROUPS_PER_TASK).enumerate().for_each(|(index, sums)| {
        task(&gather, receivers, index * LANES * GROUPS_PER_TASK, sums);
        progress(sums.len() as u64);
    });
    sums
}

/// How much each sample brings to the receivers by its area: the root of the sum of the squares of what it adds, over the
/// area. For those who decide where samples should be.
pub fn contributions(receivers: &Receivers, pinholes: &Pinholes, environment: &CubeMap, params: &Params) -> Vec<f32> {
    let uniforms = GatherUniforms::for_cube(params, pinholes, environment);
    let gather =
        Gather { pinholes, materials: None, environment: CubeLookup::rotated(environment, &uniforms), uniforms };
    let count = receivers.positions.len();
    let groups: Vec<Group> =
        (0..count).step_by(LANES).map(|start| load_receivers(receivers, start, LANES.min(count - start))).collect();
    let contribution = |sample| dispatch!(level(), simd => gather.contribution(simd, sample, &groups));
    pinholes.samples.par_iter().map(contribution).collect()
}

struct Gather<'a> {
    pinholes: &'a Pinholes,
    /// Of the receivers, if they have viewers.
    materials: Option<&'a Materials>,
    uniforms: GatherUniforms,
    environment: CubeLookup<'a>,
}

/// Sixteen receivers, lane by lane, in memory.
struct Group {
    position: [[f32; LANES]; 3],
    normal: [[f32; LANES]; 3],
    object: [u32; LANES],
    /// Towards the viewer, where there is one.
    view: Option<[Vec3; LANES]>,
}

/// The same in registers.
struct Receiver<'a, S: Simd> {
    position: V3<S>,
    normal: V3<S>,
    object: &'a [u32; LANES],
    view: Option<&'a [Vec3; LANES]>,
}

impl Group {
    #[inline(always)]
    fn in_lanes<S: Simd>(&self, simd: S) -> Receiver<'_, S> {
        Receiver {
            position: V3::load(simd, &self.position),
            normal: V3::load(simd, &self.normal),
            object: &self.object,
            view: self.view.as_ref(),
        }
    }
}

impl<S: Simd> Receiver<'_, S> {
    /// The lanes that have a receiver.
    #[inline(always)]
    fn there(&self) -> u32 {
        (0..LANES).filter(|&lane| self.object[lane] != u32::MAX).fold(0, |bits, lane| bits | 1 << lane)
    }
}

/// A sample and sixteen receivers; the names are the shader's.
struct Pair<S: Simd> {
    d: V3<S>,
    n: V3<S>,
    dn: F<S>,
    l2: F<S>,
    inverse_l: F<S>,
    /// ⟨n, −d⟩⁺, or without a sign for two-sided samples.
    facing: F<S>,
    /// Both cosines; not positive (or not a number, where the sample lies on the receiver point) where nothing arrives.
    cosines: F<S>,
    r: V3<S>,
}

impl<S: Simd> Pair<S> {
    #[inline(always)]
    fn new(simd: S, sample: &PinholeSample, receiver: &Receiver<S>) -> Self {
        let n = vector(simd, sample.normal());
        let d = vector(simd, sample.position()) - receiver.position;
        let l2 = d.dot(d);
        let dn = d.dot(n);
        let facing = if sample.two_sided() { dn.abs() } else { (-dn).max(0.0) };
        let inverse_l = 1.0 / l2.sqrt();
        let cosines = facing * d.dot(receiver.normal).max(0.0) * inverse_l * inverse_l;
        let r = d.plus(n, dn * -2.0) * inverse_l;
        Self { d, n, dn, l2, inverse_l, facing, cosines, r }
    }

    /// The sample's footprint around the reflected direction.
    #[inline(always)]
    fn footprint(&self, simd: S, sample: &PinholeSample) -> Sides<S> {
        let Self { d, n, dn, inverse_l, r, .. } = *self;
        let (m1, m2) = (vector(simd, sample.change_1()), vector(simd, sample.change_2()));
        let v1 = reflected_side(vector(simd, sample.side_1()), m1, d, n, dn, inverse_l, r);
        let v2 = reflected_side(vector(simd, sample.side_2()), m2, d, n, dn, inverse_l, r);
        let lobe = sample.lobe();
        let (v1, v2) = if lobe > 0.0 { blurred(simd, v1, v2, r, n, dn.abs() * inverse_l, lobe) } else { (v1, v2) };
        Sides { r, v1, v2 }
    }
}

#[inline(always)]
fn task<S: Simd, const FILTER: u32>(
    simd: S,
    gather: &Gather,
    receivers: &Receivers,
    first: usize,
    sums: &mut [[f32; 4]],
) {
    for (group, sums) in sums.chunks_mut(LANES).enumerate() {
        let start = first + group * LANES;
        let group = load_receivers(receivers, start, sums.len());
        if group.object.iter().all(|&object| object == u32::MAX) {
            continue;
        }
        let receiver = group.in_lanes(simd);
        let mut totals = [Vec4::ZERO; LANES];
        for batch in gather.pinholes.samples.chunks(BATCH_SIZE as usize) {
            let sum = gather.gather_batch::<S, FILTER>(simd, batch, &receiver);
            totals.iter_mut().zip(sum).for_each(|(total, sum)| *total += sum);
        }
        sums.iter_mut().zip(totals).for_each(|(sum, total)| *sum = total.to_array());
    }
}

/// Sixteen receivers in a row, or what there is of them.
fn load_receivers(receivers: &Receivers, start: usize, count: usize) -> Group {
    load_at(receivers, |lane| (lane < count).then_some(start + lane))
}

/// The receivers at sixteen places. Lanes without one get a normal of zero, so that nothing reaches them.
fn load_at(receivers: &Receivers, place: impl Fn(usize) -> Option<usize>) -> Group {
    let mut group = Group {
        position: [[0.0; LANES]; 3],
        normal: [[0.0; LANES]; 3],
        object: [u32::MAX; LANES],
        view: receivers.viewers.as_ref().map(|_| [Vec3::ZERO; LANES]),
    };
    for lane in 0..LANES {
        let Some(index) = place(lane).filter(|&index| receivers.positions[index][3] >= 0.0) else { continue };
        let (p, n) = (receivers.positions[index], receivers.normals[index]);
        // Rounded: a rasteriser's interpolation may leave 0.9999999.
        group.object[lane] = (p[3] + 0.5) as u32;
        for axis in 0..3 {
            group.position[axis][lane] = p[axis];
            group.normal[axis][lane] = n[axis];
        }
        if let (Some(views), Some(viewers)) = (&mut group.view, &receivers.viewers) {
            views[lane] = Vec3::from_slice(&viewers.directions[index]);
        }
    }
    group
}

/// Multiplies by what the receivers reflect from a unit direction, and so many sr around it, to their viewers, 1/sr.
#[cold]
fn reflect_to_viewers<S: Simd>(
    materials: &Materials,
    receiver: &Receiver<S>,
    views: &[Vec3; LANES],
    (d, solid_angle): (V3<S>, F<S>),
    lit: u32,
    factors: &mut [Vec4; LANES],
) {
    let vectors = |v: V3<S>| {
        let [x, y, z] = v.to_arrays();
        std::array::from_fn::<_, LANES, _>(|lane| Vec3::new(x[lane], y[lane], z[lane]))
    };
    let (normals, directions, solid_angle) = (vectors(receiver.normal), vectors(d), solid_angle.to_array());
    for lane in (0..LANES).filter(|lane| lit & (1 << lane) != 0) {
        let value =
            materials.value(receiver.object[lane], normals[lane], directions[lane], views[lane], solid_angle[lane]);
        factors[lane] *= value.extend(1.0);
    }
}

impl Gather<'_> {
    #[inline(always)]
    fn gather_batch<S: Simd, const FILTER: u32>(
        &self,
        simd: S,
        batch: &[PinholeSample],
        receiver: &Receiver<S>,
    ) -> [Vec4; LANES] {
        let mut sum = [Vec4::ZERO; LANES];
        for sample in batch {
            self.sample_irradiance::<S, FILTER>(simd, sample, receiver, &mut sum);
        }
        sum
    }

    /// What every n-th sample brings to a group.
    #[inline(always)]
    fn sum_of_some<S: Simd>(&self, simd: S, samples: &[PinholeSample], every: usize, group: &Group) -> [Vec4; LANES] {
        let mut sum = [Vec4::ZERO; LANES];
        let receiver = group.in_lanes(simd);
        for sample in samples.iter().step_by(every) {
            self.sample_irradiance::<S, FILTER_ISOTROPIC>(simd, sample, &receiver, &mut sum);
        }
        sum
    }

    #[inline(always)]
    fn contribution<S: Simd>(&self, simd: S, sample: &PinholeSample, groups: &[Group]) -> f32 {
        let mut squares = 0.0f32;
        for group in groups {
            let mut sum = [Vec4::ZERO; LANES];
            self.sample_irradiance::<S, FILTER_ISOTROPIC>(simd, sample, &group.in_lanes(simd), &mut sum);
            squares += sum.iter().map(|s| s.truncate().length_squared()).sum::<f32>();
        }
        squares.sqrt() / sample.area()
    }

    /// Adds what one sample contributes: rgb = irradiance, w = fetches.
    #[inline(always)]
    fn sample_irradiance<S: Simd, const FILTER: u32>(
        &self,
        simd: S,
        sample: &PinholeSample,
        receiver: &Receiver<S>,
        sum: &mut [Vec4; LANES],
    ) {
        let pair = Pair::new(simd, sample, receiver);
        let lit = bits(pair.cosines.simd_gt(0.0));
        if lit == 0 {
            return;
        }
        let weight = self.weight(simd, sample, &pair, receiver);
        let (weight, lit, radiance) = match &self.pinholes.visibility {
            None => (weight, lit, self.filtered_radiance::<S, FILTER>(simd, sample, &pair, &Unhindered, lit)),
            Some(maps) => {
                let sight = Surroundings::new(maps, sample, pair.dn);
                let l = receiver.position - vector(simd, sample.position());
                let visible = lanes(simd, sight.visible_part(simd, l, lit));
                let lit = lit & bits(visible.simd_gt(0.0));
                if lit == 0 {
                    return;
                }
                (weight * visible, lit, self.filtered_radiance::<S, FILTER>(simd, sample, &pair, &sight, lit))
            }
        };
        self.add(sample, &pair, receiver, (weight, &radiance, lit), sum);
    }

    /// Weight of a pair, all but reflectance and visibility.
    #[inline(always)]
    fn weight<S: Simd>(&self, simd: S, sample: &PinholeSample, pair: &Pair<S>, receiver: &Receiver<S>) -> F<S> {
        pair.cosines * sample.area() * self.attenuation(simd, pair.l2, sample, receiver.object)
    }

    /// Adds radiance, weighted and reflected, of lit lanes; w = fetches.
    #[inline(always)]
    fn add<S: Simd>(
        &self,
        sample: &PinholeSample,
        pair: &Pair<S>,
        receiver: &Receiver<S>,
        (weight, radiance, lit): (F<S>, &[Vec4; LANES], u32),
        sum: &mut [Vec4; LANES],
    ) {
        let Pair { d, facing, inverse_l, .. } = *pair;
        let mut reflectance = self.reflectance(sample, facing * inverse_l);
        if let (Some(materials), Some(views)) = (self.materials, receiver.view) {
            let solid_angle = facing * inverse_l * inverse_l * inverse_l * sample.area();
            reflect_to_viewers(materials, receiver, views, (d * inverse_l, solid_angle), lit, &mut reflectance);
        }
        let weight = weight.to_array();
        for lane in set_bits(lit) {
            let fetches = radiance[lane].w * Vec4::W;
            sum[lane] += weight[lane] * reflectance[lane] * radiance[lane] + fetches;
        }
    }

    /// Reflectance, w = 0, at a cosine of the angle of incidence.
    #[inline(always)]
    fn reflectance<S: Simd>(&self, sample: &PinholeSample, cosine: F<S>) -> [Vec4; LANES] {
        let Some(curve) = sample.curve() else {
            return [sample.reflectance().extend(0.0); LANES];
        };
        let curve = &self.pinholes.curves[curve];
        cosine.to_array().map(|cosine| {
            let place = cosine.min(1.0) * (CURVE_POINTS - 1) as f32;
            let first = (place as usize).min(CURVE_POINTS - 2);
            let (a, b) = (Vec4::from(curve[first]), Vec4::from(curve[first + 1]));
            a + (b - a) * (place - first as f32)
        })
    }

    /// 1/l², kept finite (WS-7).
    #[inline(always)]
    fn attenuation<S: Simd>(&self, simd: S, l2: F<S>, sample: &PinholeSample, objects: &[u32; LANES]) -> F<S> {
        let u = &self.uniforms;
        if u.attenuation == 0 {
            return F::splat(simd, 1.0);
        }
        let (own, least) = (sample.object(), u.own_scale * sample.area());
        let least = lanes(simd, std::array::from_fn(|lane| if objects[lane] == own { least } else { 0.0 }));
        1.0 / (l2 + (u.epsilon_scale * sample.area() + u.epsilon)).max(least)
    }

    /// Mean radiance over the sample's footprint around r; w = fetches.
    #[inline(always)]
    fn filtered_radiance<S: Simd, const FILTER: u32>(
        &self,
        simd: S,
        sample: &PinholeSample,
        pair: &Pair<S>,
        sight: &impl Sight,
        lit: u32,
    ) -> [Vec4; LANES] {
        if FILTER == FILTER_NONE {
            return single_look_up(simd, &self.environment, pair.r, sight, lit);
        }
        let footprint = pair.footprint(simd, sample);
        let taps = F::splat(simd, self.uniforms.taps as f32);
        mean_over_footprint::<S, FILTER>(simd, &self.environment, &footprint, sight, taps, lit)
    }

    /// Width of a texel of the maps of visibility, radians: a half-space has 2π sr.
    fn map_texel(&self) -> f32 {
        std::f32::consts::TAU.sqrt() / self.uniforms.map_resolution.max(1) as f32
    }

    /// 1/l² at most, for a cell.
    #[inline(always)]
    fn most_attenuation<S: Simd>(&self, simd: S, l2: F<S>, area: f32) -> F<S> {
        let u = &self.uniforms;
        if u.attenuation == 0 {
            return F::splat(simd, 1.0);
        }
        1.0 / (l2 + (u.epsilon_scale * area + u.epsilon))
    }

    /// Mean radiance over a cell's footprint, which may have been blurred; from one look-up where the light is even, else from so many
    /// at most.
    #[inline(always)]
    fn cell_radiance<S: Simd>(
        &self,
        simd: S,
        footprint: &Sides<S>,
        is_blurred: bool,
        sight: &impl Sight,
        taps: Option<F<S>>,
        lit: u32,
    ) -> [Vec4; LANES] {
        let Some(taps) = taps else {
            // Cells side by side are as good as a wide kernel, and lose nothing over their mirrors' edges; blur has to be there.
            let part = if is_blurred { TAP_SHARPNESS } else { EVEN_LIGHT_SHARPNESS };
            return filters::even_light(simd, &self.environment, footprint, part, sight, lit);
        };
        mean_over_footprint::<S, FILTER_ANISOTROPIC>(simd, &self.environment, footprint, sight, taps, lit)
    }
}
