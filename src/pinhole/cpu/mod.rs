//! The gather on the CPU: the twin of `shaders/gather.wgsl`, step by step and name by name.
//!
//! Eight neighbouring receivers go through the loop together, one in each SIMD lane, as fragments do on a GPU;
//! rayon spreads the groups over the cores.

mod cube;
mod filters;
mod footprint;
mod lanes;
mod visibility;

pub use cube::{CubeLookup, Lanes8};
pub use filters::probe;

use glam::{Vec3, Vec4};
use rayon::prelude::*;
use wide::f32x8;

use self::filters::{
    FILTER_ANISOTROPIC, FILTER_EWA, FILTER_ISOTROPIC, FILTER_NONE, Sides, mean_over_footprint, single_look_up,
};
use self::footprint::{blurred, reflected_side};
use self::lanes::{F, V3, abs, splat, splat3};
use self::visibility::{Sight, Surroundings, Unhindered};
use super::{BATCH_SIZE, CURVE_POINTS, Filter, GatherUniforms, Params, PinholeSample, Pinholes, Receivers};
use crate::brdf::Materials;
use crate::environment::CubeMap;

/// Receivers that go through the loop together.
const LANES: usize = 8;
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
    let gather = Gather { pinholes, materials, uniforms, environment: CubeLookup::new(environment) };
    let task: fn(&Gather, &Receivers, usize, &mut [[f32; 4]]) = match params.filter {
        Filter::None => task::<FILTER_NONE>,
        Filter::Isotropic => task::<FILTER_ISOTROPIC>,
        Filter::Anisotropic => task::<FILTER_ANISOTROPIC>,
        Filter::Ewa => task::<FILTER_EWA>,
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
    let gather = Gather { pinholes, materials: None, uniforms, environment: CubeLookup::new(environment) };
    let count = receivers.positions.len();
    let groups: Vec<Receiver> =
        (0..count).step_by(LANES).map(|start| load_receivers(receivers, start, LANES.min(count - start))).collect();
    let contribution = |sample: &PinholeSample| {
        let mut squares = 0.0f32;
        for receiver in &groups {
            let mut sum = [Vec4::ZERO; LANES];
            gather.sample_irradiance::<FILTER_ISOTROPIC>(sample, receiver, &mut sum);
            squares += sum.iter().map(|s| s.truncate().length_squared()).sum::<f32>();
        }
        squares.sqrt() / sample.area()
    };
    pinholes.samples.par_iter().map(contribution).collect()
}

struct Gather<'a> {
    pinholes: &'a Pinholes,
    /// Of the receivers, if they have viewers.
    materials: Option<&'a Materials>,
    uniforms: GatherUniforms,
    environment: CubeLookup<'a>,
}

/// Eight receivers, lane by lane.
struct Receiver {
    position: V3,
    normal: V3,
    object: [u32; LANES],
    /// Towards the viewer, where there is one.
    view: Option<[Vec3; LANES]>,
}

/// A sample and eight receivers; the names are the shader's.
struct Pair {
    d: V3,
    n: V3,
    dn: F,
    inverse_l: F,
    r: V3,
}

fn task<const FILTER: u32>(gather: &Gather, receivers: &Receivers, first: usize, sums: &mut [[f32; 4]]) {
    for (group, sums) in sums.chunks_mut(LANES).enumerate() {
        let start = first + group * LANES;
        let receiver = load_receivers(receivers, start, sums.len());
        if receiver.object.iter().all(|&object| object == u32::MAX) {
            continue;
        }
        let mut totals = [Vec4::ZERO; LANES];
        for batch in gather.pinholes.samples.chunks(BATCH_SIZE as usize) {
            let sum = gather.gather_batch::<FILTER>(batch, &receiver);
            totals.iter_mut().zip(sum).for_each(|(total, sum)| *total += sum);
        }
        sums.iter_mut().zip(totals).for_each(|(sum, total)| *sum = total.to_array());
    }
}

/// Lanes past the end, and those without a receiver, get a normal of zero, so that nothing reaches them.
fn load_receivers(receivers: &Receivers, start: usize, count: usize) -> Receiver {
    let mut position = [[0.0; LANES]; 3];
    let mut normal = [[0.0; LANES]; 3];
    let mut object = [u32::MAX; LANES];
    let views = receivers.viewers.as_ref().map(|viewers| &viewers.directions[start..start + count]);
    for lane in 0..count {
        let (p, n) = (receivers.positions[start + lane], receivers.normals[start + lane]);
        if p[3] < 0.0 {
            continue;
        }
        // Rounded: a rasteriser's interpolation may leave 0.9999999.
        object[lane] = (p[3] + 0.5) as u32;
        for axis in 0..3 {
            position[axis][lane] = p[axis];
            normal[axis][lane] = n[axis];
        }
    }
    Receiver {
        position: V3(position.map(f32x8::new)),
        normal: V3(normal.map(f32x8::new)),
        object,
        view: views.map(view_lanes),
    }
}

fn view_lanes(views: &[[f32; 4]]) -> [Vec3; LANES] {
    std::array::from_fn(|lane| views.get(lane).map_or(Vec3::ZERO, |v| Vec3::from_slice(v)))
}

/// Multiplies by what the receivers reflect from a unit direction, and so many sr around it, to their viewers, 1/sr.
#[cold]
fn reflect_to_viewers(
    materials: &Materials,
    receiver: &Receiver,
    views: &[Vec3; LANES],
    (d, solid_angle): (V3, F),
    lit: u32,
    factors: &mut [Vec4; LANES],
) {
    let vectors = |v: V3| {
        let [x, y, z] = v.0.map(F::to_array);
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
    fn gather_batch<const FILTER: u32>(&self, batch: &[PinholeSample], receiver: &Receiver) -> [Vec4; LANES] {
        let mut sum = [Vec4::ZERO; LANES];
        for sample in batch {
            self.sample_irradiance::<FILTER>(sample, receiver, &mut sum);
        }
        sum
    }

    /// Adds what one sample contributes: rgb = irradiance, w = fetches.
    #[inline]
    fn sample_irradiance<const FILTER: u32>(
        &self,
        sample: &PinholeSample,
        receiver: &Receiver,
        sum: &mut [Vec4; LANES],
    ) {
        let n = splat3(sample.normal_object);
        let d = splat3(sample.position_area) - receiver.position;
        let l2 = d.dot(d);
        let dn = d.dot(n);
        let facing = if sample.two_sided() { abs(dn) } else { (-dn).max(F::ZERO) };
        let inverse_l = F::ONE / l2.sqrt();
        let cosines = facing * d.dot(receiver.normal).max(F::ZERO) * inverse_l * inverse_l;
        // Also false where the sample lies on the receiver point and the quotient is not a number.
        let lit = cosines.simd_gt(F::ZERO).to_bitmask();
        if lit == 0 {
            return;
        }
        let weight = splat(sample.area()) * cosines * self.attenuation(l2, sample, &receiver.object);
        let r = (d - n * (dn + dn)) * inverse_l;
        let pair = Pair { d, n, dn, inverse_l, r };
        let (weight, lit, radiance) = match &self.pinholes.visibility {
            None => (weight, lit, self.filtered_radiance::<FILTER>(sample, &pair, &Unhindered, lit)),
            Some(maps) => {
                let sight = Surroundings::new(maps, sample, dn);
                let visible = f32x8::new(sight.visible_part(V3([F::ZERO; 3]) - d, lit));
                let lit = lit & visible.simd_gt(F::ZERO).to_bitmask();
                if lit == 0 {
                    return;
                }
                (weight * visible, lit, self.filtered_radiance::<FILTER>(sample, &pair, &sight, lit))
            }
        };
        let mut reflectance = self.reflectance(sample, facing * inverse_l);
        if let (Some(materials), Some(views)) = (self.materials, &receiver.view) {
            let solid_angle = splat(sample.area()) * facing * inverse_l * inverse_l * inverse_l;
            reflect_to_viewers(materials, receiver, views, (d * inverse_l, solid_angle), lit, &mut reflectance);
        }
        let weight = weight.to_array();
        for lane in 0..LANES {
            if lit & (1 << lane) != 0 {
                let fetches = radiance[lane].w * Vec4::W;
                sum[lane] += weight[lane] * reflectance[lane] * radiance[lane] + fetches;
            }
        }
    }

    /// Reflectance, w = 0, at a cosine of the angle of incidence.
    #[inline]
    fn reflectance(&self, sample: &PinholeSample, cosine: F) -> [Vec4; LANES] {
        let Some(curve) = sample.curve() else {
            return [Vec4::from(sample.reflectance); LANES];
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
    #[inline]
    fn attenuation(&self, l2: F, sample: &PinholeSample, objects: &[u32; LANES]) -> F {
        let u = &self.uniforms;
        if u.attenuation == 0 {
            return F::ONE;
        }
        let (own, least) = (sample.object(), u.own_scale * sample.area());
        let least = f32x8::new(objects.map(|object| if object == own { least } else { 0.0 }));
        F::ONE / (l2 + splat(u.epsilon_scale * sample.area() + u.epsilon)).max(least)
    }

    /// Mean radiance over the sample's footprint around r; w = fetches.
    #[inline]
    fn filtered_radiance<const FILTER: u32>(
        &self,
        sample: &PinholeSample,
        &Pair { d, n, dn, inverse_l, r }: &Pair,
        sight: &impl Sight,
        lit: u32,
    ) -> [Vec4; LANES] {
        if FILTER == FILTER_NONE {
            return single_look_up(&self.environment, r, sight, lit);
        }
        let v1 = reflected_side(splat3(sample.side_1), splat3(sample.change_1), d, n, dn, inverse_l, r);
        let v2 = reflected_side(splat3(sample.side_2), splat3(sample.change_2), d, n, dn, inverse_l, r);
        let lobe = sample.lobe();
        let (v1, v2) = if lobe > 0.0 { blurred(v1, v2, r, n, abs(dn) * inverse_l, splat(lobe)) } else { (v1, v2) };
        let footprint = Sides { r, v1, v2 };
        mean_over_footprint::<FILTER>(&self.environment, &footprint, sight, self.uniforms.taps as f32, lit)
    }
}
