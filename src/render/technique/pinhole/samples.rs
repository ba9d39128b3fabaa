//! The stages of the samples: points → cells, or a tree of them → visibility maps. In previews, mirrors that move without changing
//! their shape keep their samples.

use std::sync::Arc;

use glam::{Mat3, Vec3};

use super::density::{self, DensityInputs};
use crate::cell_tree::{CellTree, TreeOptions};
use crate::differential::{DifferentialSample, differentials};
use crate::environment::Environment;
use crate::parallel;
use crate::pinhole::{Edges, Footprint, Params, PinholeTree, Pinholes, pinholes_with};
use crate::progress::Stage;
use crate::sampling::{Density, PointSet, SamplingError, Strategy};
use crate::scene::{Camera, Chains, Lamp, Medium, Mesh, Object, Scene, Sides, Specular, Transform, Visibility};
use crate::stages::{Id, LazySurface, Memo, NearEmitters, StageCounts};
use crate::technique::Inputs;
use crate::tracing::Tracer;

/// The placed samples, and their positions.
#[derive(Clone, Debug)]
pub(super) struct Points {
    pub set: Arc<PointSet>,
    pub positions: Arc<Vec<Vec3>>,
}

/// The inputs of the samples' positions.
#[derive(PartialEq)]
struct PointsKey {
    surface: Id<LazySurface>,
    samples: u32,
    strategy: Strategy,
    seed: u64,
    density: Option<DensityKey>,
}

/// The inputs of a density that is not uniform.
#[derive(PartialEq)]
struct DensityKey {
    density: Density,
    tracer: Id<Tracer>,
    environment: Id<Environment>,
    lamps: Arc<[Lamp]>,
    near_emitters: Option<(Id<NearEmitters>, f32)>,
    medium: Option<Medium>,
    specular: Vec<Option<Specular>>,
    receives: Vec<bool>,
    camera: Camera,
    size: [u32; 2],
    visibility: Visibility,
    params: Params,
}

/// The inputs of a tree or a set of pinholes, except for visibility.
#[derive(PartialEq)]
struct CellsKey {
    points: Id<PointSet>,
    surface: Id<LazySurface>,
    specular: Vec<Option<Specular>>,
    chains: Chains,
    footprint: Footprint,
    leaves: u32,
    seed: u64,
}

/// The inputs of samples that mirrors keep while they move.
#[derive(PartialEq)]
struct KeptSamplesKey {
    /// By object: of those that mirror, the mesh, its scale, and on which sides.
    mirrors: Vec<Option<(Id<Mesh>, f32, Sides)>>,
    samples: u32,
    strategy: Strategy,
    seed: u64,
}

/// Samples, and where the mirrors were for which they were made, by object.
#[derive(Debug)]
struct KeptSamples {
    samples: Arc<Vec<DifferentialSample>>,
    placements: Vec<Transform>,
}

/// The inputs of a preview's samples: the surface around them, the mirrors' materials, and what occludes.
type FrameKey = (Id<Vec<DifferentialSample>>, Vec<Option<Specular>>, Chains, Footprint, OccluderKey);

/// The ray tracer that visibility depends on; `None` without visibility.
pub(super) type OccluderKey = Option<Id<Tracer>>;

#[derive(Debug)]
pub(super) struct SampleStages {
    points: Memo<PointsKey, (Arc<PointSet>, Arc<Vec<Vec3>>)>,
    differentials: Memo<Id<PointSet>, Vec<DifferentialSample>>,
    tree: Memo<CellsKey, PinholeTree>,
    /// The tree with visibility maps.
    visible_tree: Memo<(Id<PinholeTree>, OccluderKey), PinholeTree>,
    pinholes: Memo<(CellsKey, OccluderKey), Pinholes>,
    kept: Memo<KeptSamplesKey, KeptSamples>,
    /// Where the mirrors are in this frame.
    moved: Memo<(Id<KeptSamples>, Vec<Transform>), Vec<DifferentialSample>>,
    pinholes_of_frame: Memo<FrameKey, Pinholes>,
}

impl SampleStages {
    pub fn new() -> Self {
        Self {
            points: Memo::new(Stage::Points),
            differentials: Memo::new(Stage::Differentials),
            tree: Memo::new(Stage::Tree),
            visible_tree: Memo::new(Stage::Visibility),
            pinholes: Memo::new(Stage::Visibility),
            kept: Memo::new(Stage::Differentials),
            moved: Memo::new(Stage::Differentials),
            pinholes_of_frame: Memo::new(Stage::Visibility),
        }
    }

    /// Places the samples.
    pub fn points(&mut self, inputs: &Inputs) -> Result<Points, SamplingError> {
        let Inputs { prepared, light, options, progress, .. } = inputs;
        let key = PointsKey {
            surface: Id::of(&prepared.surface),
            samples: options.samples,
            strategy: options.strategy,
            seed: options.seed,
            density: (options.density != Density::Uniform).then(|| density_key(inputs)),
        };
        let made = self.points.try_get(key, *progress, || {
            let set = density::place(
                &DensityInputs { scene: inputs.scene, surface: &prepared.surface, tracer: &prepared.tracer, light },
                options,
            )?;
            let positions = set.points.iter().map(|p| p.position).collect();
            Ok::<_, SamplingError>((Arc::new(set), Arc::new(positions)))
        })?;
        let (set, positions) = &*made;
        Ok(Points { set: set.clone(), positions: positions.clone() })
    }

    /// The samples of a flat sum: the points themselves, or the leaves of their cells.
    pub fn pinholes(&mut self, inputs: &Inputs, points: &Points, leaves: u32) -> Arc<Pinholes> {
        let Inputs { scene, options, progress, .. } = inputs;
        let key = (cells_key(inputs, points, leaves), occluder(inputs));
        if leaves > 1 {
            let tree = self.bare_tree(inputs, points, leaves);
            return self.pinholes.get(key, *progress, || with_visibility(tree.leaves(), inputs));
        }
        let differentials = self.differentials(inputs, points);
        let curves = &inputs.prepared.materials.mirrors;
        self.pinholes.get(key, *progress, || {
            with_visibility(pinholes_with(scene, curves, &differentials, options.footprint, inputs.chains), inputs)
        })
    }

    /// The samples of a preview, which are not divided.
    pub fn pinholes_of_frame(&mut self, inputs: &Inputs, samples: &Arc<Vec<DifferentialSample>>) -> Arc<Pinholes> {
        let Inputs { scene, prepared, options, progress, .. } = inputs;
        let key = (Id::of(samples), specular(scene), inputs.chains, options.footprint, occluder(inputs));
        self.pinholes_of_frame.get(key, *progress, || {
            with_visibility(
                pinholes_with(scene, &prepared.materials.mirrors, samples, options.footprint, inputs.chains),
                inputs,
            )
        })
    }

    /// The surface around the samples of a preview: made where the mirrors first were, and moved with them.
    pub fn differentials_of_frame(&mut self, inputs: &Inputs) -> Result<Arc<Vec<DifferentialSample>>, SamplingError> {
        let Inputs { scene, options, progress, .. } = inputs;
        if options.density != Density::Uniform {
            let points = self.points(inputs)?;
            return Ok(self.differentials(inputs, &points));
        }
        let key = kept_samples_key(inputs);
        let placements = mirror_placements(scene);
        let kept = if let Some(kept) = self.kept.kept(&key) {
            kept
        } else {
            let points = self.points(inputs)?;
            let samples = self.differentials(inputs, &points);
            self.kept.get(key, *progress, || KeptSamples { samples, placements: placements.clone() })
        };
        if placements == kept.placements {
            return Ok(kept.samples.clone());
        }
        Ok(self.moved.get((Id::of(&kept), placements.clone()), *progress, || kept.moved_to(&placements)))
    }

    /// The surface around the points.
    pub fn differentials(&mut self, inputs: &Inputs, points: &Points) -> Arc<Vec<DifferentialSample>> {
        self.differentials.get(Id::of(&points.set), inputs.progress, || differentials(&points.set))
    }

    /// A tree of cells, with visibility maps of its sample nodes unless a GPU traces them.
    pub fn tree(&mut self, inputs: &Inputs, points: &Points, leaves: u32) -> Arc<PinholeTree> {
        let bare = self.bare_tree(inputs, points, leaves);
        let Some(tracer) = occluder(inputs).filter(|_| !inputs.backend.is_gpu()) else { return bare };
        self.visible_tree.get((Id::of(&bare), Some(tracer)), inputs.progress, || {
            let mut tree = (*bare).clone();
            tree.trace_visibility_and_doubts(inputs.scene, inputs.prepared.tracer.clone(), inputs.progress);
            tree
        })
    }

    fn bare_tree(&mut self, inputs: &Inputs, points: &Points, leaves: u32) -> Arc<PinholeTree> {
        let Inputs { scene, prepared, options, progress, .. } = inputs;
        self.tree.get(cells_key(inputs, points, leaves), *progress, || {
            let options = TreeOptions { leaves, seed: options.seed };
            let cells = CellTree::new(&prepared.surface, &points.set, &options);
            PinholeTree::with_curves(scene, &prepared.materials.mirrors, cells, inputs.chains)
        })
    }

    pub fn count(&self, counts: &mut StageCounts) {
        counts.add_memo(&self.points);
        counts.add_memo(&self.differentials);
        counts.add_memo(&self.tree);
        counts.add_memo(&self.visible_tree);
        counts.add_memo(&self.pinholes);
    }
}

impl KeptSamples {
    /// The samples where the mirrors are at other places, with the same scale.
    fn moved_to(&self, placements: &[Transform]) -> Vec<DifferentialSample> {
        let motion = |(from, to): (&Transform, &Transform)| {
            let rotation = to.rotation() * from.rotation().transpose();
            (rotation, to.translate - rotation * from.translate)
        };
        let motions: Vec<(Mat3, Vec3)> = self.placements.iter().zip(placements).map(motion).collect();
        let moved = |sample: &DifferentialSample| {
            let (rotation, translation) = motions[sample.object as usize];
            sample.moved(rotation, translation)
        };
        parallel::map(&self.samples, &moved)
    }
}

/// Where the mirrors are, by object: samples don't depend on where others are.
fn mirror_placements(scene: &Scene) -> Vec<Transform> {
    let of_mirror = |object: &Object| object.specular().map(|_| object.placement).unwrap_or_default();
    scene.objects.iter().map(of_mirror).collect()
}

fn kept_samples_key(inputs: &Inputs) -> KeptSamplesKey {
    let Inputs { scene, options, .. } = inputs;
    let mirror = |object: &Object| Some((Id::of(&object.mesh), object.placement.scale, object.specular()?.sides()));
    KeptSamplesKey {
        mirrors: scene.objects.iter().map(mirror).collect(),
        samples: options.samples,
        strategy: options.strategy,
        seed: options.seed,
    }
}

/// Traces visibility maps if they count, unless a GPU does.
fn with_visibility(mut pinholes: Pinholes, inputs: &Inputs) -> Pinholes {
    if inputs.options.visibility == Visibility::Full && !inputs.backend.is_gpu() {
        let edges = if inputs.is_preview { Edges::Coarse } else { Edges::Fine };
        pinholes.trace_maps(inputs.scene, &inputs.prepared.tracer, edges, inputs.progress);
    }
    pinholes
}

pub(super) fn occluder(inputs: &Inputs) -> OccluderKey {
    (inputs.options.visibility == Visibility::Full).then(|| Id::of(&inputs.prepared.tracer))
}

fn specular(scene: &Scene) -> Vec<Option<Specular>> {
    scene.objects.iter().map(Object::specular).collect()
}

fn cells_key(inputs: &Inputs, points: &Points, leaves: u32) -> CellsKey {
    CellsKey {
        points: Id::of(&points.set),
        surface: Id::of(&inputs.prepared.surface),
        specular: specular(inputs.scene),
        chains: inputs.chains,
        footprint: inputs.options.footprint,
        leaves,
        seed: inputs.options.seed,
    }
}

fn density_key(inputs: &Inputs) -> DensityKey {
    let Inputs { scene, prepared, light, options, .. } = inputs;
    DensityKey {
        density: options.density,
        tracer: Id::of(&prepared.tracer),
        environment: Id::of(&light.environment),
        lamps: light.lamps.clone(),
        near_emitters: light.near_key(),
        medium: scene.medium,
        specular: specular(scene),
        receives: scene.objects.iter().map(|o| o.receiver.is_some()).collect(),
        camera: scene.camera,
        size: options.size,
        visibility: options.visibility,
        params: options.params(density::FILTER, light.rotation_rad),
    }
}
