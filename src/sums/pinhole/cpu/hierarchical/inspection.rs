//! The sum at one receiver taken apart: the cells that are taken for it.

use glam::{Vec3, Vec4};

use super::super::receiver::load_receivers;
use super::blocks::ReceiverTile;
use super::tile::TileGather;
use super::{Accuracy, Light, TraversalContext};
use crate::lanes::{LANES, dispatch, level};
use crate::pinhole::{Params, PinholeParts, PinholeTree, Receivers};
use crate::progress::NoProgress;

/// A cell that is taken as one sample of the mirrors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TakenCell {
    /// What it adds to the receiver's irradiance, W/m².
    pub irradiance: Vec3,
    /// Its middle, metres.
    pub centroid: Vec3,
    /// Full sides of a parallelogram with its moments, metres.
    pub sides: [Vec3; 2],
}

/// The cells that add something to a receiver, given by its position, unit normal and object. Neighbouring receivers of a picture may
/// share coarser cells, between whose light is interpolated.
pub fn cells_taken(
    receiver: (Vec3, Vec3, u32),
    pinholes: &PinholeTree,
    light: Light,
    params: &Params,
    accuracy: Accuracy,
) -> Vec<TakenCell> {
    let context = TraversalContext::new(pinholes, light, params, None);
    let receivers = Receivers::from_points(&[receiver], 1);
    let group = load_receivers(&receivers, 0, 1);
    let Some(tile) = ReceiverTile::all(&receivers).next() else { return Vec::new() };
    let mut gather = TileGather::new(&context, tile, accuracy, &NoProgress);
    gather.criterion.allow(accuracy.error, pinholes.tree.area());
    gather.taken_by_first = Some(Vec::new());
    dispatch!(level(), simd => gather.packet(simd, &group, pinholes.roots(), &mut [Vec4::ZERO; LANES]));
    gather.taken_by_first.unwrap_or_default()
}

impl TakenCell {
    /// A cell that adds so much to a receiver, if it adds something.
    pub(super) fn new(cell: &PinholeParts, irradiance: Vec3) -> Option<Self> {
        (irradiance != Vec3::ZERO).then_some(Self { irradiance, centroid: cell.position, sides: cell.sides })
    }
}
