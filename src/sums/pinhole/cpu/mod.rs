//! The gather on the CPU: the twin of `shaders/gather.wgsl`, step by step and name by name.
//!
//! Sixteen neighbouring receivers go through the loop together, one in each SIMD lane, as fragments do on a GPU;
//! rayon spreads the groups over the cores.

mod crossing;
mod cube;
mod filters;
mod footprint;
mod hierarchical;
mod inspection;
mod lamp;
mod medium;
mod near_light;
mod pair;
mod receiver;
mod sky;
mod sky_texels;
mod surroundings;
mod visibility;

pub use cube::{CubeLookup, Lanes16};
pub use filters::{HardwareFilterError, probe};
pub use hierarchical::{
    Accuracy, CachedGather, CachedSums, Light, TakenCell, cells_taken, estimate_irradiance, gather_hierarchical,
};
pub use inspection::{Contribution, contributions_to};
pub use near_light::{gather_lamp, gather_surroundings};

use std::sync::Arc;

use glam::{Vec3, Vec4};

use self::filters::{CpuFilter, Kernel, mean_over_footprint, mean_over_parts, through_lobe};
use self::lamp::LampLight;
use self::medium::pass_medium;
use self::pair::ReceiverCellPair;
use self::receiver::{NO_OBJECT, Receiver, ReceiverGroup, load_receivers};
use self::sky::{OccludedSky, Occlusion, Unoccluded};
use self::surroundings::SurroundingLight;
use self::visibility::VisibilityMap;
use super::{
    BATCH_SIZE, CURVE_POINTS, GatherUniforms, Params, PinholeParts, PinholeSample, Pinholes, Receivers, Surroundings,
};
use crate::brdf::Materials;
use crate::environment::CubeMap;
use crate::lanes::{F, LANES, Simd, SimdBase, bits, dispatch, lanes, level, set_bits, splat3};
use crate::parallel;
use crate::progress::Progress;
use crate::scene::{Lamp, Medium};

/// Groups of lanes between two reports of progress.
const GROUPS_PER_TASK: usize = 32;

/// Gathers the irradiance at every receiver, W/m², or the radiance that it reflects towards its viewer, W/(m²·sr): R, G, B,
/// and the number of fetches. Progress counts receivers; those that are left once it is cancelled stay dark.
///
/// # Errors
///
/// [`Filter::Hardware`](crate::pinhole::Filter::Hardware) exists on GPUs only.
pub fn gather(
    receivers: &Receivers,
    pinholes: &Pinholes,
    environment: &CubeMap,
    params: &Params,
    progress: &dyn Progress,
) -> Result<Vec<[f32; 4]>, HardwareFilterError> {
    let uniforms = GatherUniforms::for_cube(params, pinholes, environment);
    let source = Source::Environment(CubeLookup::rotated(environment, &uniforms));
    let filter = CpuFilter::try_from(params.filter)?;
    Ok(gather_from(receivers, (pinholes, source, uniforms, params), filter, progress))
}

fn gather_from(
    receivers: &Receivers,
    (pinholes, source, uniforms, params): (&Pinholes, Source, GatherUniforms, &Params),
    filter: CpuFilter,
    progress: &dyn Progress,
) -> Vec<[f32; 4]> {
    let materials = receivers.view_directions.as_ref().map(|view| &*view.materials);
    let Params { medium, lamps_in_medium, .. } = *params;
    let gather = Gather { pinholes, materials, uniforms, source, medium, lamps_in_medium };
    let mut sums = vec![[0.0; 4]; receivers.positions.len()];
    parallel::for_each_chunk(&mut sums, LANES * GROUPS_PER_TASK, &|index, sums| {
        if !progress.is_cancelled() {
            let first = index * LANES * GROUPS_PER_TASK;
            dispatch!(level(), simd => task(simd, (&gather, filter), receivers, first, sums));
        }
        progress.advance(sums.len() as u64);
    });
    sums
}

/// Contribution of each sample to the receivers, per area: the root of the sum of the squares of what it adds, over its area.
/// Densities of samples are made from it.
pub fn contributions(receivers: &Receivers, pinholes: &Pinholes, lights: &Lights, params: &Params) -> Vec<f32> {
    let gathers = lights.gathers(pinholes, params);
    let count = receivers.positions.len();
    let groups: Vec<ReceiverGroup> =
        (0..count).step_by(LANES).map(|start| load_receivers(receivers, start, LANES.min(count - start))).collect();
    let contribution =
        |sample: &PinholeSample| dispatch!(level(), simd => contribution(simd, &gathers, sample, &groups));
    parallel::map(&pinholes.samples, &contribution)
}

#[inline(always)]
fn contribution<S: Simd>(simd: S, gathers: &[Gather], sample: &PinholeSample, groups: &[ReceiverGroup]) -> f32 {
    let mut squares = 0.0f32;
    for group in groups {
        let sum = irradiance_of(simd, (gathers, CpuFilter::Isotropic), sample, &group.in_lanes(simd));
        squares += sum.iter().map(|s| s.truncate().length_squared()).sum::<f32>();
    }
    squares.sqrt() / sample.area()
}

/// What a sample adds of all lights.
#[inline(always)]
fn irradiance_of<S: Simd>(
    simd: S,
    (gathers, filter): (&[Gather], CpuFilter),
    sample: &PinholeSample,
    receiver: &Receiver<S>,
) -> [Vec4; LANES] {
    let mut sum = [Vec4::ZERO; LANES];
    for gather in gathers {
        gather.add_samples(simd, filter, (std::slice::from_ref(sample), 1), receiver, &mut sum);
    }
    sum
}

/// All lights of a scene.
#[derive(Clone, Copy, Debug)]
pub struct Lights<'a> {
    /// Radiance of what is infinitely far away.
    pub environment: &'a CubeMap,
    /// Lamps.
    pub lamps: &'a [Lamp],
    /// What mirrors see nearby.
    pub surroundings: &'a [Arc<Surroundings>],
}

impl<'a> Lights<'a> {
    /// An environment alone.
    pub fn environment(environment: &'a CubeMap) -> Self {
        Self { environment, lamps: &[], surroundings: &[] }
    }

    fn gathers(&self, pinholes: &'a Pinholes, params: &Params) -> Vec<Gather<'a>> {
        let Params { medium, lamps_in_medium, .. } = *params;
        let gather = |source, uniforms| Gather { pinholes, materials: None, uniforms, source, medium, lamps_in_medium };
        let uniforms = GatherUniforms::for_cube(params, pinholes, self.environment);
        let environment = gather(Source::Environment(CubeLookup::rotated(self.environment, &uniforms)), uniforms);
        let lamp = |lamp| {
            gather(
                Source::Lamp(LampLight::new(lamp, pinholes.shapes)),
                GatherUniforms::for_near_light(params, pinholes, 0.0),
            )
        };
        let surroundings = |seen: &'a Arc<Surroundings>| {
            let uniforms = GatherUniforms::for_near_light(params, pinholes, seen.texel_rad());
            gather(Source::Surroundings(SurroundingLight(seen)), uniforms)
        };
        let near = self.lamps.iter().map(lamp).chain(self.surroundings.iter().map(surroundings));
        std::iter::once(environment).chain(near).collect()
    }
}

struct Gather<'a> {
    pinholes: &'a Pinholes,
    /// Of the receivers, if they reflect towards viewers.
    materials: Option<&'a Materials>,
    uniforms: GatherUniforms,
    source: Source<'a>,
    medium: Option<Medium>,
    lamps_in_medium: bool,
}

/// The light of a sum.
enum Source<'a> {
    Environment(CubeLookup<'a>),
    Lamp(LampLight<'a>),
    Surroundings(SurroundingLight<'a>),
}

impl Source<'_> {
    /// Whether it is infinitely far away.
    fn is_environment(&self) -> bool {
        matches!(self, Self::Environment(_))
    }
}

#[inline(always)]
fn task<S: Simd>(
    simd: S,
    (gather, filter): (&Gather, CpuFilter),
    receivers: &Receivers,
    first: usize,
    sums: &mut [[f32; 4]],
) {
    for (group, sums) in sums.chunks_mut(LANES).enumerate() {
        let start = first + group * LANES;
        let group = load_receivers(receivers, start, sums.len());
        if group.object.iter().all(|&object| object == NO_OBJECT) {
            continue;
        }
        let receiver = group.in_lanes(simd);
        let mut totals = [Vec4::ZERO; LANES];
        for batch in gather.pinholes.samples.chunks(BATCH_SIZE as usize) {
            let mut sum = [Vec4::ZERO; LANES];
            gather.add_samples(simd, filter, (batch, 1), &receiver, &mut sum);
            totals.iter_mut().zip(sum).for_each(|(total, sum)| *total += sum);
        }
        sums.iter_mut().zip(totals).for_each(|(sum, total)| *sum = total.to_array());
    }
}

/// Multiplies by the BRDF, 1/sr, between unit directions, as the centres of so many sr, and the viewers.
#[cold]
fn reflect_to_viewers(
    materials: &Materials,
    (objects, normals, views): (&[u32; LANES], &[[f32; LANES]; 3], &[Vec3; LANES]),
    (directions, solid_angle): (&[[f32; LANES]; 3], &[f32; LANES]),
    lit: u32,
    factors: &mut [Vec4; LANES],
) {
    let vector = |[x, y, z]: &[[f32; LANES]; 3], lane: usize| Vec3::new(x[lane], y[lane], z[lane]);
    for lane in set_bits(lit) {
        let (normal, direction) = (vector(normals, lane), vector(directions, lane));
        let value = materials.value(objects[lane], normal, direction, views[lane], solid_angle[lane]);
        factors[lane] *= value.extend(1.0);
    }
}

impl Gather<'_> {
    /// Adds what every n-th of some samples contributes.
    #[inline(never)]
    fn add_samples<S: Simd>(
        &self,
        simd: S,
        filter: CpuFilter,
        (samples, n): (&[PinholeSample], usize),
        receiver: &Receiver<S>,
        sum: &mut [Vec4; LANES],
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                for sample in samples.iter().step_by(n) {
                    self.sample_irradiance(simd, filter, sample, receiver, sum);
                }
            },
        );
    }

    /// The sum of every n-th sample at a group.
    #[inline(always)]
    fn sum_of_every<S: Simd>(
        &self,
        simd: S,
        samples: &[PinholeSample],
        n: usize,
        group: &ReceiverGroup,
    ) -> [Vec4; LANES] {
        let mut sum = [Vec4::ZERO; LANES];
        let receiver = group.in_lanes(simd);
        self.add_samples(simd, CpuFilter::Isotropic, (samples, n), &receiver, &mut sum);
        sum
    }

    /// Adds what one sample contributes: rgb = irradiance, w = fetches.
    #[inline(always)]
    fn sample_irradiance<S: Simd>(
        &self,
        simd: S,
        filter: CpuFilter,
        packed: &PinholeSample,
        receiver: &Receiver<S>,
        sum: &mut [Vec4; LANES],
    ) {
        let sample = &PinholeParts::from(packed);
        let pair = ReceiverCellPair::new(simd, sample, receiver);
        let lit = pair.lit();
        if lit == 0 {
            return;
        }
        let weight = self.weight(simd, sample, &pair, receiver);
        let Source::Environment(environment) = &self.source else {
            self.add_near_light(simd, packed, (&pair, receiver), (weight, lit), sum);
            return;
        };
        let arriving = ((environment, filter), sample, &pair);
        let (weight, lit, radiance) = match &self.pinholes.visibility {
            None => (weight, lit, self.arriving(simd, arriving, &Unoccluded, lit)),
            Some(maps) => {
                let towards = VisibilityMap::of_receivers(maps, packed, pair.dn);
                let l = receiver.position - splat3(simd, sample.position);
                let visible = lanes(simd, towards.visible_fraction(simd, l, None, lit).0);
                let lit = lit & bits(visible.simd_gt(0.0));
                if lit == 0 {
                    return;
                }
                let map = VisibilityMap::of_sky(maps, packed, pair.dn);
                (weight * visible, lit, self.arriving(simd, arriving, &OccludedSky::from(&map), lit))
            }
        };
        self.add(sample, &pair, receiver, (weight, &radiance, lit), sum);
    }

    /// Weight of a pair, without reflectance and visibility.
    #[inline(always)]
    fn weight<S: Simd>(
        &self,
        simd: S,
        sample: &PinholeParts,
        pair: &ReceiverCellPair<S>,
        receiver: &Receiver<S>,
    ) -> F<S> {
        pair.geometry_term * sample.area * self.attenuation(simd, pair.l2, sample, receiver.object)
    }

    /// Adds radiance, weighted and reflected, in lit lanes; w = fetches.
    #[inline(always)]
    fn add<S: Simd>(
        &self,
        sample: &PinholeParts,
        pair: &ReceiverCellPair<S>,
        receiver: &Receiver<S>,
        (weight, radiance, lit): (F<S>, &[Vec4; LANES], u32),
        sum: &mut [Vec4; LANES],
    ) {
        let ReceiverCellPair { d, cos_at_sample, inverse_l, .. } = *pair;
        let mut reflectance = self.reflectance(sample, cos_at_sample);
        if let (Some(materials), Some(views)) = (self.materials, receiver.view) {
            let solid_angle = cos_at_sample * inverse_l * inverse_l * sample.area;
            let at_receiver = (receiver.object, &receiver.normal.to_arrays(), views);
            let towards_sample = (&(d * inverse_l).to_arrays(), &solid_angle.to_array());
            reflect_to_viewers(materials, at_receiver, towards_sample, lit, &mut reflectance);
        }
        if let Some(medium) = &self.medium {
            pass_medium(medium, (sample, pair), receiver, lit, &mut reflectance);
        }
        let weight = weight.to_array();
        for lane in set_bits(lit) {
            let fetches = radiance[lane].w * Vec4::W;
            sum[lane] += weight[lane] * reflectance[lane] * radiance[lane] + fetches;
        }
    }

    /// Reflectance, w = 0, at a cosine of the angle of incidence.
    #[inline(always)]
    fn reflectance<S: Simd>(&self, sample: &PinholeParts, cosine: F<S>) -> [Vec4; LANES] {
        let Some(curve) = sample.curve else {
            return [sample.reflectance.extend(0.0); LANES];
        };
        let curve = &self.pinholes.curves[curve as usize];
        cosine.to_array().map(|cosine| {
            let place = cosine.min(1.0) * (CURVE_POINTS - 1) as f32;
            let first = (place as usize).min(CURVE_POINTS - 2);
            let (a, b) = (Vec4::from(curve[first]), Vec4::from(curve[first + 1]));
            a + (b - a) * (place - first as f32)
        })
    }

    /// 1/l², kept finite as [`Epsilon`](crate::pinhole::Epsilon) says.
    #[inline(always)]
    fn attenuation<S: Simd>(&self, simd: S, l2: F<S>, sample: &PinholeParts, objects: &[u32; LANES]) -> F<S> {
        let u = &self.uniforms;
        if u.attenuation == 0 {
            return F::splat(simd, 1.0);
        }
        let min_l2 = u.own_scale * sample.area;
        let min_l2 = lanes(simd, std::array::from_fn(|lane| if objects[lane] == sample.object { min_l2 } else { 0.0 }));
        1.0 / (l2 + (u.epsilon_scale * sample.area + u.epsilon)).max(min_l2)
    }

    /// Mean radiance of the environment over the sample's footprint around r; w = fetches.
    #[inline(always)]
    fn arriving<S: Simd, O: Occlusion>(
        &self,
        simd: S,
        ((environment, filter), sample, pair): ((&CubeLookup, CpuFilter), &PinholeParts, &ReceiverCellPair<S>),
        occlusion: &O,
        lit: u32,
    ) -> [Vec4; LANES] {
        let is_filtered = filter != CpuFilter::None;
        let environment = (environment, Kernel::new(filter, F::splat(simd, self.uniforms.taps as f32)));
        if !O::IS_UNOCCLUDED && is_filtered && sample.is_wide_lobe(self.map_texel_rad()) {
            return through_lobe(
                simd,
                (pair.r, sample.lobe),
                occlusion,
                lit,
                #[inline(always)]
                |lit| mean_radiance(simd, environment, (sample, pair), &Unoccluded, lit),
            );
        }
        mean_radiance(simd, environment, (sample, pair), occlusion, lit)
    }
}

/// The environment's mean over a footprint, or over both parts of a lobe; w = fetches.
#[inline(never)]
fn mean_radiance<S: Simd>(
    simd: S,
    environment: (&CubeLookup, Kernel<S>),
    (sample, pair): (&PinholeParts, &ReceiverCellPair<S>),
    occlusion: &impl Occlusion,
    lit: u32,
) -> [Vec4; LANES] {
    simd.vectorize(
        #[inline(always)]
        || {
            let (whole, halves);
            let parts = if sample.is_mostly_lobe() && !matches!(environment.1, Kernel::Nearest) {
                halves = pair.lobe_parts(simd, sample);
                &halves[..]
            } else {
                whole = pair.footprint(simd, sample);
                std::slice::from_ref(&whole)
            };
            mean_over_parts(
                parts,
                #[inline(always)]
                |part| mean_over_footprint(simd, environment, part, occlusion, lit),
            )
        },
    )
}
