//! The stages of the pinhole technique (Wand and Straßer 2003): samples → visibility maps → a sum, flat or
//! hierarchical, on the CPU or on a GPU. The sums themselves are in [`crate::pinhole`].

mod clearance;
mod density;
mod on_cpu;
#[cfg(feature = "gpu")]
mod on_gpu;
mod samples;
mod surroundings;

use std::sync::Arc;

use glam::Vec3;

use self::clearance::MirrorClearance;
pub use self::density::place_samples;
use self::on_cpu::{FlatOnCpu, HierarchicalOnCpu};
#[cfg(feature = "gpu")]
use self::on_gpu::{GpuStages, HierarchicalOnGpu};
use self::samples::{OccluderKey, SampleStages, occluder};
use self::surroundings::{emitters_seen, lit_surfaces, surroundings};
use super::{Inputs, Inspected, Pending, Statistics, Sum, TechniqueStages};
use crate::differential::DifferentialSample;
use crate::environment::{Environment, LightBounds};
use crate::error::check_wanted;
use crate::image::Aov;
use crate::options::Evaluation;
use crate::pinhole::cpu::{Accuracy, Light, Lights, TakenCell, cells_taken, contributions_to, estimate_irradiance};
use crate::pinhole::{Filter, Params, PinholeSample, PinholeTree, Pinholes, Receivers, Surroundings};
use crate::progress::Stage;
use crate::scene::{Camera, Lamp, Medium, Visibility};
use crate::stages::{
    Id, LightStages, Memo, NearEmitters, StageCounts, SurfaceMaterials, receivers_through_interfaces, visible_receivers,
};
use crate::tracing::{Hit, Tracer};
use crate::{Error, NoProgress};

/// The longer side of the picture at whose receivers the mean irradiance is estimated, pixels.
const ESTIMATE_SIZE: u32 = 64;

/// The softening of previews' few samples. Measured as the error of the irradiance beside the ground truth (`benches/frames.rs`), `ring-natural`
/// with 103 samples: .499 with 4, which is the paper's ε, .400 with 1, .358 with this; .346 without, but with spots near the wall.
const PREVIEW_SOFTENING: f32 = 0.25;

/// The inputs of a flat sum.
#[derive(Clone, Debug)]
struct FlatInputs {
    pinholes: Arc<Pinholes>,
    environment: Arc<Environment>,
    params: Params,
    near: NearLight,
    is_preview: bool,
}

impl FlatInputs {
    /// Lit surfaces do not count for these receivers: in previews, that mirrors cast their light into a medium takes longer than all else, and
    /// is hardly seen.
    fn omits_surfaces(&self, receivers: &Receivers) -> bool {
        self.is_preview && receivers.lengths.is_some()
    }
}

/// Light that is not infinitely far away.
#[derive(Clone, Debug, Default)]
struct NearLight {
    /// Lamps, and near emitters that shine like them.
    lamps: Arc<[Lamp]>,
    seen: SeenNearby,
}

/// What mirrors see that is not infinitely far away.
#[derive(Clone, Debug, Default)]
struct SeenNearby {
    /// Near emitters that shine like lamps.
    lamps: Vec<Lamp>,
    /// Of the other ones.
    emitters: Vec<Arc<Surroundings>>,
    /// The surfaces that emitters and lamps light.
    surfaces: Option<Arc<Surroundings>>,
}

impl PartialEq for NearLight {
    fn eq(&self, other: &Self) -> bool {
        let seen = |light: &Self| light.seen.all().map(Id::of).collect::<Vec<_>>();
        self.lamps == other.lamps && seen(self) == seen(other)
    }
}

impl SeenNearby {
    /// The lit surfaces come last.
    fn all(&self) -> impl Iterator<Item = &Arc<Surroundings>> {
        self.emitters.iter().chain(&self.surfaces)
    }
}

/// The inputs of a hierarchical sum.
#[derive(Clone, Debug)]
struct HierarchicalInputs {
    tree: Arc<PinholeTree>,
    environment: Arc<Environment>,
    bounds: Arc<LightBounds>,
    params: Params,
    accuracy: Accuracy,
    near: NearLight,
    clearance: MirrorClearance,
}

/// The inputs of a sum; equal if none of them was made again.
#[derive(PartialEq)]
enum SumKey {
    Flat {
        pinholes: Id<Pinholes>,
        occluder: OccluderKey,
        environment: Id<Environment>,
        params: Params,
        near: NearLight,
    },
    Hierarchical {
        tree: Id<PinholeTree>,
        occluder: OccluderKey,
        environment: Id<Environment>,
        params: Params,
        accuracy: Accuracy,
        near: NearLight,
        clearance: MirrorClearance,
    },
}

/// The inputs of the estimate of the mean irradiance.
#[derive(PartialEq)]
struct EstimateKey {
    tree: Id<PinholeTree>,
    environment: Id<Environment>,
    tracer: Id<Tracer>,
    receives: Vec<bool>,
    through_interfaces: bool,
    camera: Camera,
    size: [u32; 2],
    visibility: Visibility,
    params: Params,
    near: NearLight,
}

/// What surroundings are made from: the samples, the scene, and the lights in it.
#[derive(PartialEq)]
struct SurroundingsKey {
    points: Id<Vec<Vec3>>,
    tracer: Id<Tracer>,
    materials: Id<SurfaceMaterials>,
    visibility: Visibility,
    lamps: Arc<[Lamp]>,
    near_emitters: Option<(Id<NearEmitters>, f32)>,
    medium: Option<Medium>,
}

/// The stages of the pinhole technique.
#[derive(Debug)]
pub(super) struct PinholeStages {
    samples: SampleStages,
    estimate: Memo<EstimateKey, f32>,
    surroundings: Memo<SurroundingsKey, SeenNearby>,
    /// What mirrors show.
    surfaces: Memo<(Id<Tracer>, Id<SurfaceMaterials>), Tracer>,
    /// Of the samples of previews.
    positions: Memo<Id<Vec<DifferentialSample>>, Vec<Vec3>>,
    #[cfg(feature = "gpu")]
    gpu: GpuStages,
    sum: LastSum,
}

/// The sum that was returned last, valid while its inputs are unchanged.
#[derive(Default)]
struct LastSum(Option<(SumKey, Arc<dyn Sum>)>);

impl std::fmt::Debug for LastSum {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("LastSum")
    }
}

impl PinholeStages {
    pub fn new() -> Self {
        Self {
            samples: SampleStages::new(),
            estimate: Memo::new(Stage::Estimate),
            surroundings: Memo::new(Stage::Surroundings),
            surfaces: Memo::new(Stage::Surroundings),
            positions: Memo::new(Stage::Points),
            #[cfg(feature = "gpu")]
            gpu: GpuStages::new(),
            sum: LastSum::default(),
        }
    }

    async fn make(&mut self, inputs: Inputs<'_>, light: &mut LightStages) -> Result<Arc<dyn Sum>, Error> {
        let Inputs { options, backend, progress, .. } = inputs;
        let (filter, warning) = backend.resolve_filter(options.filter).await?;
        let evaluation = options.resolved_evaluation(filter, backend.is_gpu(), inputs.light.has_near_light())?;
        let softening = if inputs.is_preview { PREVIEW_SOFTENING } else { 0.0 };
        let params = Params { softening, ..params(&inputs, filter) };
        let environment = inputs.light.environment.clone();
        let statistics = |samples, positions| {
            let (evaluation, filter) = (Some(evaluation), Some(filter));
            Statistics {
                samples,
                positions,
                evaluation,
                filter,
                photons: None,
                warnings: warning.into_iter().collect(),
            }
        };
        match evaluation {
            Evaluation::Flat { leaves: 1 } if inputs.is_preview => {
                let samples = self.samples.differentials_of_frame(&inputs)?;
                check_wanted(progress)?;
                let pinholes = self.samples.pinholes_of_frame(&inputs, &samples);
                check_wanted(progress)?;
                let positions = self.positions.get(Id::of(&samples), &NoProgress, || {
                    samples.iter().map(|sample| sample.position).collect::<Vec<Vec3>>()
                });
                let near = self.near_light(&inputs, &positions, &pinholes);
                let statistics = statistics(pinholes.samples.len(), positions);
                let sum = FlatInputs { pinholes, environment, params, near, is_preview: inputs.is_preview };
                self.flat(sum, statistics, &inputs).await
            }
            Evaluation::Flat { leaves } => {
                let points = self.samples.points(&inputs)?;
                let pinholes = self.samples.pinholes(&inputs, &points, leaves);
                check_wanted(progress)?;
                let near = self.near_light(&inputs, &points.positions, &pinholes);
                let statistics = statistics(pinholes.samples.len(), points.positions.clone());
                let sum = FlatInputs { pinholes, environment, params, near, is_preview: inputs.is_preview };
                self.flat(sum, statistics, &inputs).await
            }
            Evaluation::Hierarchical { leaves, tolerance } => {
                let points = self.samples.points(&inputs)?;
                let tree = self.samples.tree(&inputs, &points, leaves);
                check_wanted(progress)?;
                let bounds = light.bounds(inputs.light, progress);
                let near = self.near_light(&inputs, &points.positions, tree.sample_nodes());
                let statistics = statistics(tree.sample_nodes().samples.len(), points.positions.clone());
                let accuracy = Accuracy { error: tolerance, split_near: true };
                let clearance = clearance(&inputs, &tree, leaves, &near);
                let sum = HierarchicalInputs { tree, environment, bounds, params, accuracy, near, clearance };
                self.hierarchical(sum, statistics, &inputs).await
            }
        }
    }

    /// The lamps, and what samples at these positions see of emitters and in the light of both.
    fn near_light(&mut self, inputs: &Inputs, positions: &Arc<Vec<Vec3>>, samples: &Pinholes) -> NearLight {
        let Inputs { prepared, light, options, progress, .. } = *inputs;
        let lamps = light.lamps.clone();
        if !light.has_near_light() {
            return NearLight::default();
        }
        let key = SurroundingsKey {
            points: Id::of(positions),
            tracer: Id::of(&prepared.tracer),
            materials: Id::of(&prepared.materials),
            visibility: options.visibility,
            lamps: lamps.clone(),
            near_emitters: light.near_key(),
            medium: inputs.scene.medium,
        };
        let of_surfaces = (Id::of(&prepared.tracer), Id::of(&prepared.materials));
        let surfaces = self.surfaces.get(of_surfaces, progress, || lit_surfaces(inputs.scene));
        let make = || {
            let samples = &samples.samples;
            let (lamps, emitters) = emitters_seen(inputs.scene, light, samples, inputs.is_preview);
            SeenNearby { lamps, emitters, surfaces: surroundings(inputs, &surfaces, samples).map(Arc::new) }
        };
        let seen = self.surroundings.get(key, progress, make);
        let lamps = lamps.iter().chain(&seen.lamps).cloned().collect();
        NearLight { lamps, seen: (*seen).clone() }
    }

    #[cfg_attr(not(feature = "gpu"), expect(clippy::unused_async, reason = "as with the feature `gpu`"))]
    async fn flat(
        &mut self,
        sum: FlatInputs,
        statistics: Statistics,
        inputs: &Inputs<'_>,
    ) -> Result<Arc<dyn Sum>, Error> {
        let key = SumKey::Flat {
            pinholes: Id::of(&sum.pinholes),
            occluder: occluder(inputs),
            environment: Id::of(&sum.environment),
            params: sum.params,
            near: sum.near.clone(),
        };
        if let Some(known) = self.sum.known(&key) {
            return Ok(known);
        }
        #[cfg(feature = "gpu")]
        if let Some(shared) = inputs.backend.shared_gpu() {
            let placed = self.gpu.flat(shared, sum, statistics, inputs).await?;
            check_wanted(inputs.progress)?;
            return Ok(self.sum.keep(key, placed));
        }
        Ok(self.sum.keep(key, Arc::new(FlatOnCpu { sum, statistics })))
    }

    /// The tolerance of `sum` is relative to the mean irradiance, which is estimated first.
    #[cfg_attr(not(feature = "gpu"), expect(clippy::unused_async, reason = "as with the feature `gpu`"))]
    async fn hierarchical(
        &mut self,
        mut sum: HierarchicalInputs,
        statistics: Statistics,
        inputs: &Inputs<'_>,
    ) -> Result<Arc<dyn Sum>, Error> {
        #[cfg(feature = "gpu")]
        if let Some(shared) = inputs.backend.shared_gpu() {
            let hierarchy = self.gpu.hierarchy(shared, &sum, inputs).await?;
            check_wanted(inputs.progress)?;
            let estimate = async || hierarchy.estimate(&estimate_receivers(inputs)).await;
            let key = estimate_key(inputs, &sum);
            sum.accuracy.error *= *self.estimate.wait_for(key, (0, inputs.progress), estimate).await?;
            let key = hierarchical_key(inputs, &sum);
            if let Some(known) = self.sum.known(&key) {
                return Ok(known);
            }
            let accuracy = sum.accuracy;
            let clearance = sum.clearance;
            return Ok(self.sum.keep(key, Arc::new(HierarchicalOnGpu { hierarchy, accuracy, clearance, statistics })));
        }
        sum.accuracy.error *= *self
            .estimate
            .get(estimate_key(inputs, &sum), inputs.progress, || sum.estimate(&estimate_receivers(inputs)));
        let key = hierarchical_key(inputs, &sum);
        if let Some(known) = self.sum.known(&key) {
            return Ok(known);
        }
        Ok(self.sum.keep(key, Arc::new(HierarchicalOnCpu { sum, statistics })))
    }
}

/// Adds the irradiance and fetches of one more light.
fn add(sums: &mut [[f32; 4]], more: &[[f32; 4]]) {
    sums.as_flattened_mut().iter_mut().zip(more.as_flattened()).for_each(|(sum, more)| *sum += more);
}

/// The parameters of a sum.
fn params(inputs: &Inputs, filter: Filter) -> Params {
    let scene = inputs.scene;
    let params = inputs.options.params(filter, inputs.light.rotation_rad);
    Params { medium: scene.medium, lamps_in_medium: scene.has_medium_everywhere(), ..params }
}

/// What keeps receivers off mirrors whose samples are divided into so many leaves.
fn clearance(inputs: &Inputs, tree: &PinholeTree, leaves: u32, near: &NearLight) -> MirrorClearance {
    let samples = &tree.sample_nodes().samples;
    let area: f32 = samples.iter().map(PinholeSample::area).sum();
    let cell_area = area / (samples.len().max(1) as f32 * leaves as f32);
    MirrorClearance::new(inputs.scene, &inputs.prepared.tracer, cell_area, !near.lamps.is_empty())
}

/// The receivers at which the mean irradiance is estimated, to which the tolerance is relative.
fn estimate_receivers(inputs: &Inputs) -> Receivers {
    let find = if sees_through_interfaces(inputs) { receivers_through_interfaces } else { visible_receivers };
    find(inputs.scene, &inputs.prepared.tracer, inputs.options.size_within(ESTIMATE_SIZE))
}

/// Whether receivers behind interfaces are seen as well: pictures of caustics show those that camera rays hit first.
fn sees_through_interfaces(inputs: &Inputs) -> bool {
    inputs.is_preview || !inputs.options.aovs.iter().any(|aov| *aov == Aov::Caustic || aov.chain().is_some())
}

fn estimate_key(inputs: &Inputs, sum: &HierarchicalInputs) -> EstimateKey {
    let Inputs { scene, prepared, light, options, .. } = inputs;
    EstimateKey {
        tree: Id::of(&sum.tree),
        environment: Id::of(&light.environment),
        tracer: Id::of(&prepared.tracer),
        receives: scene.objects.iter().map(|o| o.receiver.is_some()).collect(),
        through_interfaces: sees_through_interfaces(inputs),
        camera: scene.camera,
        size: options.size_within(ESTIMATE_SIZE),
        visibility: options.visibility,
        params: sum.params,
        near: sum.near.clone(),
    }
}

fn hierarchical_key(inputs: &Inputs, sum: &HierarchicalInputs) -> SumKey {
    SumKey::Hierarchical {
        tree: Id::of(&sum.tree),
        occluder: occluder(inputs),
        environment: Id::of(&sum.environment),
        params: sum.params,
        accuracy: sum.accuracy,
        near: sum.near.clone(),
        clearance: sum.clearance.clone(),
    }
}

impl HierarchicalInputs {
    /// The environment, every lamp, and what these light.
    fn lights(&self) -> impl Iterator<Item = Light<'_>> {
        let environment = Light::Environment { cube: &self.environment.cube, bounds: &self.bounds };
        let surroundings = self.near.seen.all().map(|seen| Light::Surroundings(seen));
        std::iter::once(environment).chain(self.near.lamps.iter().map(Light::Lamp)).chain(surroundings)
    }

    /// The mean irradiance, to which the tolerance is relative.
    fn estimate(&self, receivers: &Receivers) -> f32 {
        self.lights().map(|light| estimate_irradiance(receivers, &self.tree, light, &self.params)).sum()
    }
}

impl LastSum {
    fn known(&mut self, key: &SumKey) -> Option<Arc<dyn Sum>> {
        // An outdated sum is dropped before a new one is made.
        self.0 = self.0.take().filter(|(known, _)| known == key);
        self.0.as_ref().map(|(_, sum)| sum.clone())
    }

    fn keep(&mut self, key: SumKey, sum: Arc<dyn Sum>) -> Arc<dyn Sum> {
        self.0 = Some((key, sum.clone()));
        sum
    }
}

impl TechniqueStages for PinholeStages {
    fn prepare<'a>(&'a mut self, inputs: Inputs<'a>, light: &'a mut LightStages) -> Pending<'a, Arc<dyn Sum>> {
        Box::pin(self.make(inputs, light))
    }

    fn surface_samples(&mut self, inputs: &Inputs) -> Result<Arc<Vec<DifferentialSample>>, Error> {
        if inputs.is_preview {
            return Ok(self.samples.differentials_of_frame(inputs)?);
        }
        let points = self.samples.points(inputs)?;
        Ok(self.samples.differentials(inputs, &points))
    }

    fn inspect(&mut self, inputs: &Inputs, place: &Hit) -> Result<Inspected, Error> {
        let points = self.samples.points(inputs)?;
        let pinholes = self.samples.pinholes(inputs, &points, 1);
        let params = params(inputs, Filter::Anisotropic);
        let receiver = (place.position, place.normal, place.object);
        let NearLight { lamps, seen } = self.near_light(inputs, &points.positions, &pinholes);
        let surroundings: Vec<Arc<Surroundings>> = seen.all().cloned().collect();
        let environment = &inputs.light.environment.cube;
        let lights = Lights { environment, lamps: &lamps, surroundings: &surroundings };
        let contributions = contributions_to(receiver, &pinholes, &lights, &params);
        Ok(Inspected { contributions, view: pinholes.view_from(place) })
    }

    fn cells_taken(
        &mut self,
        inputs: &Inputs,
        light: &mut LightStages,
        place: &Hit,
    ) -> Result<Option<Vec<TakenCell>>, Error> {
        let Inputs { options, progress, .. } = *inputs;
        // What GPUs filter in hardware, the CPU does by taps.
        let filter =
            options.filter.filter().filter(|filter| *filter != Filter::Hardware).unwrap_or(Filter::Anisotropic);
        let has_near_light = inputs.light.has_near_light();
        let Evaluation::Hierarchical { leaves, tolerance } =
            options.resolved_evaluation(filter, false, has_near_light)?
        else {
            return Ok(None);
        };
        let points = self.samples.points(inputs)?;
        let tree = self.samples.tree(inputs, &points, leaves);
        let bounds = light.bounds(inputs.light, progress);
        let params = params(inputs, filter);
        let environment = inputs.light.environment.clone();
        let accuracy = Accuracy { error: tolerance, split_near: true };
        let near = self.near_light(inputs, &points.positions, tree.sample_nodes());
        let clearance = clearance(inputs, &tree, leaves, &near);
        let mut sum = HierarchicalInputs { tree, environment, bounds, params, accuracy, near, clearance };
        sum.accuracy.error *=
            *self.estimate.get(estimate_key(inputs, &sum), progress, || sum.estimate(&estimate_receivers(inputs)));
        let receiver = (sum.clearance.place(place.position, place.normal, place.object), place.normal, place.object);
        let taken = |light| cells_taken(receiver, &sum.tree, light, &sum.params, sum.accuracy);
        let mut cells: Vec<TakenCell> = Vec::new();
        for cell in sum.lights().flat_map(taken) {
            // A cell may be taken for several lights.
            match cells.iter_mut().find(|known| known.centroid == cell.centroid && known.sides == cell.sides) {
                Some(known) => known.irradiance += cell.irradiance,
                None => cells.push(cell),
            }
        }
        Ok(Some(cells))
    }

    fn count(&self, counts: &mut StageCounts) {
        self.samples.count(counts);
        counts.add_memo(&self.estimate);
        counts.add_memo(&self.surroundings);
        #[cfg(feature = "gpu")]
        self.gpu.count(counts);
    }
}
