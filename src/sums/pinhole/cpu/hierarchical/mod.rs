//! The hierarchical gather on the CPU: pairs of a receiver block and a cell, refined until the error of each is a small part
//! of the tolerance (after the dual-tree methods of *n*-body physics).
//!
//! A pair is dropped, accepted (evaluated at sixteen points of the block and interpolated between them) or refined on the side
//! with the larger error. In blocks of 4×4 every receiver refines for itself, all sixteen in lockstep.
//!
//! `blocks` knows receivers only; `criterion` bounds the error of a pair; `tile` and `packet` traverse; `evaluation` evaluates,
//! `quarters` divides leaves that are near, and `occlusion` traces what visibility maps leave in doubt;
//! `inspection` tells which cells were taken.

mod blocks;
mod cached;
mod coverage;
mod criterion;
mod evaluation;
mod inspection;
mod occlusion;
mod packet;
mod quarters;
mod tile;

pub use cached::{CachedGather, CachedSums};
pub use inspection::{TakenCell, cells_taken};

use glam::Vec4;

use self::blocks::{ReceiverTile, Weights};
use self::criterion::SourceBounds;
use self::tile::TileGather;
use super::lamp::LampLight;
use super::receiver::{ReceiverGroup, load_at};
use super::surroundings::SurroundingLight;
use super::{CubeLookup, Gather, GatherUniforms, Source};
use crate::brdf::Materials;
use crate::environment::{CubeMap, LightBounds};
use crate::lanes::{LANES, dispatch, level};
use crate::parallel;
use crate::pinhole::constants::{ESTIMATE_MAX_RECEIVERS, ESTIMATE_MAX_SAMPLE_NODES, ESTIMATE_RMS_SHARE};
use crate::pinhole::{Params, PinholeTree, Receivers, Surroundings};
use crate::progress::Progress;
use crate::scene::Lamp;

/// The light of a hierarchical gather.
#[derive(Clone, Copy, Debug)]
pub enum Light<'a> {
    /// The environment.
    Environment {
        /// Its radiance.
        cube: &'a CubeMap,
        /// Bounds of that.
        bounds: &'a LightBounds,
    },
    /// A lamp.
    Lamp(&'a Lamp),
    /// Lit surfaces.
    Surroundings(&'a Surroundings),
}

/// Accuracy of a hierarchical gather.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accuracy {
    /// The tolerated error, W/m² (with view directions: π times that of the radiance that a white receiver would reflect).
    pub error: f32,
    /// Leaves are quartered for receivers that are nearer to them than they are wide. Off: a leaf is one sample for all
    /// receivers, as in a flat gather.
    pub split_near: bool,
}

/// A rough estimate of the mean irradiance, W/m², from a subset of the receivers and of the sample nodes. Where a few receivers
/// get nearly all of the light, a tenth of the root mean square, if that is more.
pub fn estimate_irradiance(receivers: &Receivers, pinholes: &PinholeTree, light: Light, params: &Params) -> f32 {
    TraversalContext::new(pinholes, light, params, None).estimate_irradiance(receivers)
}

/// Gathers the irradiance at every receiver, W/m², from a hierarchy of samples, or the radiance that it reflects towards its
/// viewer, W/(m²·sr): R, G, B, and the number of fetches.
///
/// Progress counts receivers; those that are left once it is cancelled stay dark. The filter is always
/// [`Filter::Anisotropic`](crate::pinhole::Filter::Anisotropic).
pub fn gather_hierarchical(
    receivers: &Receivers,
    pinholes: &PinholeTree,
    light: Light,
    params: &Params,
    accuracy: Accuracy,
    progress: &dyn Progress,
) -> Vec<[f32; 4]> {
    let materials = receivers.view_directions.as_ref().map(|view| &*view.materials);
    let context = TraversalContext::new(pinholes, light, params, materials);
    let mut sums = vec![[0.0; 4]; receivers.positions.len()];
    gather_tiles(&context, receivers, accuracy, &|_| false, progress, &mut sums);
    sums
}

/// Gathers tile by tile, except for cached tiles; returns the number of receivers in those.
fn gather_tiles(
    context: &TraversalContext,
    receivers: &Receivers,
    accuracy: Accuracy,
    is_cached: &(dyn Fn(&ReceiverTile) -> bool + Sync),
    progress: &dyn Progress,
    sums: &mut [[f32; 4]],
) -> usize {
    let tiles: Vec<ReceiverTile> = ReceiverTile::all(receivers).collect();
    let gather = |tile: &ReceiverTile| {
        let sums = (!is_cached(tile) && !progress.is_cancelled()).then(|| {
            let mut gather = TileGather::new(context, *tile, accuracy, progress);
            dispatch!(level(), simd => gather.run(simd));
            gather.into_sums()
        });
        progress.advance(tile.count() as u64);
        sums
    };
    let sums_of_tiles: Vec<Option<Vec<Vec4>>> = parallel::map(&tiles, &gather);
    let mut cached = 0;
    for (tile, sums_of_tile) in tiles.iter().zip(sums_of_tiles) {
        let Some(sums_of_tile) = sums_of_tile else {
            cached += tile.count();
            continue;
        };
        for (index, sum) in tile.places().zip(sums_of_tile) {
            if let Some(index) = index {
                sums[index] = sum.to_array();
            }
        }
    }
    cached
}

/// What all tiles share.
struct TraversalContext<'a> {
    pinholes: &'a PinholeTree,
    gather: Gather<'a>,
    bounds: SourceBounds<'a>,
    weights: [Weights; blocks::LEVELS],
}

impl<'a> TraversalContext<'a> {
    fn new(pinholes: &'a PinholeTree, light: Light<'a>, params: &Params, materials: Option<&'a Materials>) -> Self {
        let nodes = &pinholes.sample_nodes;
        let (uniforms, source, bounds) = match light {
            Light::Environment { cube, bounds } => {
                let uniforms = GatherUniforms::for_cube(params, nodes, cube);
                let source = Source::Environment(CubeLookup::rotated(cube, &uniforms));
                (uniforms, source, SourceBounds::Environment(bounds))
            }
            Light::Lamp(lamp) => {
                let lamp = LampLight::new(lamp, nodes.shapes);
                (GatherUniforms::for_near_light(params, nodes, 0.0), Source::Lamp(lamp), SourceBounds::Lamp(lamp))
            }
            Light::Surroundings(surfaces) => {
                let uniforms = GatherUniforms::for_near_light(params, nodes, surfaces.texel_rad());
                let source = Source::Surroundings(SurroundingLight(surfaces));
                (uniforms, source, SourceBounds::Surroundings(surfaces))
            }
        };
        let Params { medium, lamps_in_medium, .. } = *params;
        let gather = Gather { pinholes: nodes, materials, uniforms, source, medium, lamps_in_medium };
        Self { pinholes, gather, bounds, weights: std::array::from_fn(Weights::new) }
    }

    /// See [`estimate_irradiance`].
    fn estimate_irradiance(&self, receivers: &Receivers) -> f32 {
        let some = receivers.some(ESTIMATE_MAX_RECEIVERS);
        let count = some.positions.len();
        let groups: Vec<ReceiverGroup> = (0..count)
            .step_by(LANES)
            .map(|first| load_at(&some, |lane| Some(first + lane).filter(|&index| index < count)))
            .collect();
        let samples = &self.pinholes.sample_nodes.samples;
        let step = samples.len().div_ceil(ESTIMATE_MAX_SAMPLE_NODES as usize).max(1);
        let moments = |group: &ReceiverGroup| {
            let sums = dispatch!(level(), simd => self.gather.sum_of_every(simd, samples, step, group));
            let irradiances = sums.iter().map(|s| s.truncate().as_dvec3() * step as f64);
            irradiances.fold([0.0, 0.0], |[sum, squares], e| [sum + e.element_sum(), squares + e.length_squared()])
        };
        let add = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
        let [sum, squares] = parallel::map(&groups, &moments).into_iter().fold([0.0; 2], add);
        let count = 3.0 * count.max(1) as f64;
        let rms = (squares / count).sqrt();
        // Positive even in the dark, as tolerances are relative to it.
        (sum / count).max(f64::from(ESTIMATE_RMS_SHARE) * rms).max(f64::from(f32::MIN_POSITIVE)) as f32
    }
}
