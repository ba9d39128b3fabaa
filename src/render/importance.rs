//! What places of the reflectors are worth (WS-F7): a first, even set of samples is asked what each brings to the receivers
//! that the camera sees; the places around it inherit that.

use glam::Vec3;

use super::Options;
use super::gbuffer::visible_receivers;
use crate::Error;
use crate::differential::differentials;
use crate::environment::{CubeMap, Environment};
use crate::pinhole::{Epsilon, Filter, Footprint, Params, cpu, pinholes};
use crate::sampling::{
    self, Density, PointSet, PointTree, SamplingError, Strategy, Surface, SurfacePoint, sample, sample_by,
};
use crate::scene::{Scene, Visibility};
use crate::tracing::Tracer;

/// Samples that are asked.
const PROBES: u32 = 1500;
/// The longer side of the picture whose receivers count, pixels.
const RECEIVERS: u32 = 40;
/// How strongly the density follows what places are worth: squares of errors fall fastest where it is less than in
/// proportion, as what is worth little needs samples, too.
const POWER: f32 = 0.5;
/// Nothing is worth less than this part of the mean, or more than this multiple.
const LEAST: f32 = 0.3;
const MOST: f32 = 5.0;

/// Places a scene's samples as the options say; the light is loaded only if their density depends on it.
pub fn place_samples(scene: &Scene, options: &Options) -> Result<PointSet, Error> {
    let surface = Surface::of_scene(scene);
    if options.density == Density::Uniform {
        return Ok(sample(&surface, &options.sampling())?);
    }
    let environment = Environment::load(&scene.environment, options.cube_size)?;
    Ok(place(scene, &surface, &environment, &Tracer::new(scene), options)?)
}

/// The same for a scene whose light is loaded.
pub(super) fn place(
    scene: &Scene,
    surface: &Surface,
    environment: &Environment,
    tracer: &Tracer,
    options: &Options,
) -> Result<PointSet, SamplingError> {
    if options.density == Density::Uniform {
        return sample(surface, &options.sampling());
    }
    let worth = Worth::new(scene, surface, environment, tracer, options)?;
    sample_by(surface, &options.sampling(), &|point| worth.at(point))
}

/// What places are worth, relative to each other.
struct Worth {
    points: Vec<SurfacePoint>,
    tree: PointTree,
    of_points: Vec<f32>,
}

impl Worth {
    /// Asks around. Not for [`Density::Uniform`].
    fn new(
        scene: &Scene,
        surface: &Surface,
        environment: &Environment,
        tracer: &Tracer,
        options: &Options,
    ) -> Result<Self, SamplingError> {
        let probes = sampling::Options { samples: PROBES, strategy: Strategy::Neighbourhood, seed: options.seed };
        let mut set = sample(surface, &probes)?;
        let samples = differentials(&set);
        // Those without a cell are gone from both.
        set.points =
            samples.iter().filter_map(|s| set.points.iter().find(|p| p.position == s.position).copied()).collect();
        let worth = if options.density == Density::Curvature {
            samples.iter().map(|s| s.curvatures[0].abs() + s.curvatures[1].abs()).collect()
        } else {
            let mut pinholes = pinholes(scene, &samples, Footprint::Cells);
            let shadowed = options.density == Density::Visibility
                || options.density == Density::Contribution && options.visibility == Visibility::Full;
            if shadowed {
                pinholes.look_around(scene, tracer);
            }
            let [width, height] = options.size;
            let longest = width.max(height);
            let size = [width, height].map(|edge| (edge * RECEIVERS / longest).max(1));
            let receivers = visible_receivers(scene, tracer, size);
            let even = CubeMap::from_radiance(16, None, |_| Vec3::ONE);
            let light = if options.density == Density::Contribution { &environment.cube } else { &even };
            // Held back where places come close to receivers, whose single pixels should not draw all samples.
            let params = Params { filter: Filter::Isotropic, epsilon: Epsilon::Paper, ..options.params };
            cpu::contributions(&receivers, &pinholes, light, &params)
        };
        let tree = PointTree::new(&set.points);
        Ok(Self { of_points: evened(worth), tree, points: set.points })
    }

    /// What a point is worth.
    fn at(&self, point: &SurfacePoint) -> f32 {
        let mut near = self.tree.nearest(point.position, 8).map(|(_, k)| k);
        let nearest = near.find(|&k| self.points[k].same_side(point));
        nearest.map_or(1.0, |k| self.of_points[k])
    }
}

/// Powers of what is known, over their mean, within bounds.
fn evened(worth: Vec<f32>) -> Vec<f32> {
    let powers: Vec<f32> = worth.into_iter().map(|w| w.max(0.0).powf(POWER)).collect();
    let mean = powers.iter().sum::<f32>() / powers.len().max(1) as f32;
    powers.into_iter().map(|p| if mean > 0.0 { (p / mean).clamp(LEAST, MOST) } else { 1.0 }).collect()
}
