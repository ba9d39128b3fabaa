//! The hierarchical gather on the CPU: pairs of a receiver block and a cell, refined until each is a small part of the
//! tolerance (after the dual-tree methods of *n*-body physics).
//!
//! A pair is dropped, added (evaluated at sixteen points of the block and interpolated between them) or refined on the side that
//! brings the larger error. In blocks of 4×4 every point finds its own way down the tree, all sixteen in step.
//!
//! [`blocks`] knows receivers only; `bounds` says how wrong a pair may be; `tile` walks.

mod blocks;
mod bounds;
mod packet;
mod still;
mod tile;

pub use still::{StillGather, StillSums};

use glam::Vec4;
use rayon::prelude::*;

use self::blocks::{Grid, Weights};
use self::tile::TileGather;
use super::lanes::{LANES, dispatch, level};
use super::{CubeLookup, Gather, GatherUniforms, Group, load_at};
use crate::brdf::Materials;
use crate::environment::{CubeMap, LightBounds};
use crate::pinhole::constants::{ESTIMATE_MAX_SAMPLE_NODES, ESTIMATE_RMS_SHARE};
use crate::pinhole::{Params, PinholeTree, Receivers};

/// What a hierarchical gather reads beside receivers.
#[derive(Clone, Copy, Debug)]
pub struct Light<'a> {
    /// The environment.
    pub cube: &'a CubeMap,
    /// Its bounds.
    pub bounds: &'a LightBounds,
}

/// How right a hierarchical gather is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accuracy {
    /// The error that is allowed, W/m² (towards viewers: π times that of the radiance that a white receiver would reflect).
    pub error: f32,
    /// Leaves are quartered for receivers that are nearer to them than they are wide. Off: a leaf is one sample for all, as it
    /// is in a gather that knows no hierarchy.
    pub split_near: bool,
}

/// The mean irradiance of receivers, roughly: from some of them and some of the roots, W/m². Where a few receivers get nearly
/// all of it, a tenth of the root mean square, if that is more.
pub fn typical_irradiance(receivers: &Receivers, pinholes: &PinholeTree, light: Light, params: &Params) -> f32 {
    Walked::new(pinholes, light, params, None).typical(receivers)
}

/// Gathers the irradiance at every receiver from a hierarchy of samples, or the radiance that it reflects to its viewer: R, G, B
/// in W/m² or W/(m²·sr), and the number of fetches.
///
/// `progress` is told, from any thread, how many more receivers are done. The filter is
/// [`Filter::Anisotropic`](crate::pinhole::Filter::Anisotropic).
pub fn gather_hierarchical(
    receivers: &Receivers,
    pinholes: &PinholeTree,
    light: Light,
    params: &Params,
    accuracy: Accuracy,
    progress: &(dyn Fn(u64) + Sync),
) -> Vec<[f32; 4]> {
    let materials = receivers.viewers.as_ref().map(|viewers| &*viewers.materials);
    let scene = Walked::new(pinholes, light, params, materials);
    let mut sums = vec![[0.0; 4]; receivers.positions.len()];
    gather_tiles(&scene, receivers, accuracy, &|_| false, progress, &mut sums);
    sums
}

/// Gathers tile by tile, but for those whose sums are known; of how many receivers they are.
fn gather_tiles(
    scene: &Walked,
    receivers: &Receivers,
    accuracy: Accuracy,
    is_known: &(dyn Fn(&Grid) -> bool + Sync),
    progress: &(dyn Fn(u64) + Sync),
    sums: &mut [[f32; 4]],
) -> usize {
    let grids: Vec<Grid> = Grid::all(receivers).collect();
    let gather = |grid: &Grid| {
        let sums = (!is_known(grid)).then(|| {
            let mut tile = TileGather::new(scene, *grid, accuracy);
            dispatch!(level(), simd => tile.run(simd));
            tile.into_sums()
        });
        progress(grid.count() as u64);
        sums
    };
    let tiles: Vec<Option<Vec<Vec4>>> = grids.par_iter().map(gather).collect();
    let mut known = 0;
    for (grid, tile) in grids.iter().zip(tiles) {
        let Some(tile) = tile else {
            known += grid.count();
            continue;
        };
        grid.places().zip(tile).filter_map(|(place, sum)| Some((place?, sum))).for_each(|(place, sum)| {
            sums[place] = sum.to_array();
        });
    }
    known
}

/// Receivers, and roots, that are asked how bright the picture is.
const SCOUTS: usize = 1024;

/// What all tiles share.
struct Walked<'a> {
    pinholes: &'a PinholeTree,
    gather: Gather<'a>,
    bounds: &'a LightBounds,
    weights: [Weights; blocks::LEVELS],
}

impl<'a> Walked<'a> {
    fn new(pinholes: &'a PinholeTree, light: Light<'a>, params: &Params, materials: Option<&'a Materials>) -> Self {
        assert!(params.taps > 0, "a footprint needs one tap at least");
        let uniforms = GatherUniforms::for_cube(params, &pinholes.roots, light.cube);
        let environment = CubeLookup::rotated(light.cube, &uniforms);
        let gather = Gather { pinholes: &pinholes.roots, materials, uniforms, environment };
        Self { pinholes, gather, bounds: light.bounds, weights: std::array::from_fn(Weights::new) }
    }

    /// See [`typical_irradiance`].
    fn typical(&self, receivers: &Receivers) -> f32 {
        let there: Vec<usize> = (0..receivers.positions.len()).filter(|&k| receivers.positions[k][3] >= 0.0).collect();
        let count = there.len().min(SCOUTS);
        // Even steps might follow a picture's columns: golden ones do not.
        let scout = |k: usize| there[((k as f64 * 0.618_033_988_749_894_9).fract() * there.len() as f64) as usize];
        let groups: Vec<Group> = (0..count)
            .map(scout)
            .collect::<Vec<usize>>()
            .chunks(LANES)
            .map(|places| load_at(receivers, |lane| places.get(lane).copied()))
            .collect();
        let roots = &self.pinholes.roots.samples;
        let every = roots.len().div_ceil(ESTIMATE_MAX_SAMPLE_NODES as usize).max(1);
        let moments = |group: &Group| {
            let sums = dispatch!(level(), simd => self.gather.sum_of_some(simd, roots, every, group));
            let irradiances = sums.iter().map(|s| s.truncate().as_dvec3() * every as f64);
            irradiances.fold([0.0, 0.0], |[sum, squares], e| [sum + e.element_sum(), squares + e.length_squared()])
        };
        let add = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
        let [sum, squares] = groups.par_iter().map(moments).reduce(|| [0.0; 2], add);
        let count = 3.0 * count.max(1) as f64;
        // What is lit by nothing need not be exact.
        (sum / count).max(f64::from(ESTIMATE_RMS_SHARE) * (squares / count).sqrt()).max(f64::from(f32::MIN_POSITIVE))
            as f32
    }
}
