//! Densities of samples: an even set of samples is placed first, the importance of each is evaluated, by default its
//! contribution to visible receivers, and the surface around each inherits it (Wand and Straßer 2003, Sections 3.2 and
//! 5, propose sampling by normals and by contribution).

use glam::Vec3;

use super::surroundings::emitters_seen;
use crate::differential::{DifferentialSample, differentials};
use crate::environment::CubeMap;
use crate::options::Options;
use crate::pinhole::cpu::{self, Lights};
use crate::pinhole::{Epsilon, Filter, Footprint, Params, pinholes};
use crate::sampling::{
    self, Density, PointSet, PointTree, SamplingError, Strategy, Surface, SurfacePoint, sample, sample_by,
};
use crate::scene::{Scene, Visibility};
use crate::stages::{LightStages, PreparedLight, SceneStages, visible_receivers};
use crate::tracing::Tracer;
use crate::{Error, NoProgress};

/// The filter with which contributions are evaluated.
pub(super) const FILTER: Filter = Filter::Isotropic;
/// Samples of the first set.
const FIRST_SAMPLES: u32 = 1500;
/// The longer side of the picture at whose receivers contributions are evaluated, pixels.
const RECEIVERS: u32 = 40;
/// The density is this power of the importance. Errors fall fastest with a density less than proportional, because
/// regions of low importance need samples, too.
const POWER: f32 = 0.5;
/// Bounds of the density, relative to its mean.
const MIN_DENSITY: f32 = 0.3;
const MAX_DENSITY: f32 = 5.0;

/// The inputs of a density.
pub(super) struct DensityInputs<'a> {
    pub scene: &'a Scene,
    pub surface: &'a Surface,
    pub tracer: &'a Tracer,
    pub light: &'a PreparedLight,
}

/// Places a scene's samples. The light is prepared only if their density depends on it.
///
/// ```
/// let (scene, options) = pinspot::load("ring")?;
/// let points = pinspot::place_samples(&scene, &options.with_samples(100))?;
/// assert!(!points.points.is_empty());
/// # Ok::<(), pinspot::Error>(())
/// ```
///
/// # Errors
/// Options out of range, a scene without reflectors, a strategy that cannot follow a density, or an invalid light.
pub fn place_samples(scene: &Scene, options: &Options) -> Result<PointSet, Error> {
    options.check()?;
    scene.check_placements()?;
    if options.density == Density::Uniform {
        return Ok(sample(&Surface::of_scene(scene), &options.sampling())?);
    }
    let prepared = SceneStages::new().prepare(scene, &NoProgress)?;
    let geometry = prepared.drawn_geometry();
    let light = LightStages::new().prepare(scene, geometry.as_ref(), options.cube_size, &NoProgress)?;
    let inputs = DensityInputs {
        scene,
        surface: &prepared.surface,
        tracer: &prepared.tracer,
        light: &light.with_near(prepared.near_emitters.as_ref()),
    };
    Ok(place(&inputs, options)?)
}

/// Like [`place_samples`], from prepared stages.
pub(super) fn place(inputs: &DensityInputs, options: &Options) -> Result<PointSet, SamplingError> {
    if options.density == Density::Uniform {
        return sample(inputs.surface, &options.sampling());
    }
    let importance = Importance::new(inputs, options)?;
    sample_by(inputs.surface, &options.sampling(), &|point| importance.at(point))
}

/// Relative importance over the surface.
struct Importance {
    points: Vec<SurfacePoint>,
    tree: PointTree,
    of_points: Vec<f32>,
}

impl Importance {
    /// Not for [`Density::Uniform`].
    fn new(inputs: &DensityInputs, options: &Options) -> Result<Self, SamplingError> {
        let first = sampling::Options { samples: FIRST_SAMPLES, strategy: Strategy::Neighbourhood, seed: options.seed };
        let mut set = sample(inputs.surface, &first)?;
        let samples = differentials(&set);
        // Samples without a cell are dropped from both lists.
        set.points =
            samples.iter().filter_map(|s| set.points.iter().find(|p| p.position == s.position).copied()).collect();
        let importance = if options.density == Density::Curvature {
            samples.iter().map(|s| s.curvatures[0].abs() + s.curvatures[1].abs()).collect()
        } else {
            let mut pinholes = pinholes(inputs.scene, &samples, Footprint::Cells);
            let shadowed = options.density == Density::Visibility
                || options.density == Density::Contribution && options.visibility == Visibility::Full;
            if shadowed {
                pinholes.trace_visibility(inputs.scene, inputs.tracer, &NoProgress);
            }
            let longest = options.size[0].max(options.size[1]);
            let size = options.size.map(|edge| (edge * RECEIVERS / longest).max(1));
            let receivers = visible_receivers(inputs.scene, inputs.tracer, size);
            let even = CubeMap::from_radiance(16, None, |_| Vec3::ONE);
            let (mut lamps, emitters) = emitters_seen(inputs.scene, inputs.light, &pinholes.samples, true);
            lamps.extend_from_slice(&inputs.light.lamps);
            let environment = &inputs.light.environment.cube;
            let lights = if options.density == Density::Contribution {
                Lights { environment, lamps: &lamps, surroundings: &emitters }
            } else {
                Lights::environment(&even)
            };
            // The paper's ε limits contributions near receivers, where a few pixels would attract all samples.
            let params = Params { epsilon: Epsilon::Paper, ..options.params(FILTER, inputs.light.rotation_rad) };
            let contributions = cpu::contributions(&receivers, &pinholes, &lights, &params);
            by_sample(inputs.scene, &samples, &contributions)
        };
        let tree = PointTree::new(&set.points);
        Ok(Self { of_points: densities(importance), tree, points: set.points })
    }

    fn at(&self, point: &SurfacePoint) -> f32 {
        let mut near = self.tree.nearest(point.position, 8).map(|(_, k)| k);
        let nearest = near.find(|&k| self.points[k].same_side(point));
        nearest.map_or(1.0, |k| self.of_points[k])
    }
}

/// The importance of each sample from those of its pinholes: none of what casts nothing, one for each colour of what disperses light.
fn by_sample(scene: &Scene, samples: &[DifferentialSample], of_pinholes: &[f32]) -> Vec<f32> {
    let mut counts: Vec<Option<usize>> = vec![None; scene.objects.len()];
    let mut rest = of_pinholes;
    let of_sample = |sample: &DifferentialSample| {
        let count = *counts[sample.object as usize]
            .get_or_insert_with(|| pinholes(scene, std::slice::from_ref(sample), Footprint::Cells).samples.len());
        let (own, others) = rest.split_at(count);
        rest = others;
        own.iter().sum()
    };
    samples.iter().map(of_sample).collect()
}

/// Densities from importance: powers relative to their mean, clamped.
fn densities(importance: Vec<f32>) -> Vec<f32> {
    let powers: Vec<f32> = importance.into_iter().map(|w| w.max(0.0).powf(POWER)).collect();
    let mean = powers.iter().sum::<f32>() / powers.len().max(1) as f32;
    let bounded = |p: f32| if mean > 0.0 { (p / mean).clamp(MIN_DENSITY, MAX_DENSITY) } else { 1.0 };
    powers.into_iter().map(bounded).collect()
}
