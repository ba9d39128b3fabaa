//! Image after image of a scene whose mirrors and light stand still: tiles whose receivers did not change keep their sums.
//!
//! The sums of a tile depend on its own receivers only, so the result equals that of a fresh gather bit for bit.

use std::sync::Arc;

use super::blocks::ReceiverTile;
use super::{Accuracy, Light, TraversalContext, gather_tiles};
use crate::pinhole::{Params, PinholeTree, Receivers};
use crate::progress::Progress;

/// A hierarchical gather that caches its last image. It borrows cells and light, so they cannot change between images;
/// when they do, make another one.
#[derive(Debug)]
pub struct CachedGather<'a> {
    pinholes: &'a PinholeTree,
    light: Light<'a>,
    params: Params,
    accuracy: Accuracy,
    last: Option<LastImage>,
}

#[derive(Debug)]
struct LastImage {
    receivers: Receivers,
    sums: Vec<[f32; 4]>,
    /// The gather was not cancelled.
    is_complete: bool,
}

/// The sums of an image, and how much of it came from the cache.
#[derive(Clone, Copy, Debug)]
pub struct CachedSums<'a> {
    /// As returned by [`super::gather_hierarchical`].
    pub sums: &'a [[f32; 4]],
    /// Receivers in tiles that were reused.
    pub reused: usize,
}

impl<'a> CachedGather<'a> {
    /// An empty cache.
    pub fn new(pinholes: &'a PinholeTree, light: Light<'a>, params: &Params, accuracy: Accuracy) -> Self {
        Self { pinholes, light, params: *params, accuracy, last: None }
    }

    /// Gathers at receivers, reusing the sums of tiles that equal those of the last image.
    pub fn gather(&mut self, receivers: Receivers, progress: &dyn Progress) -> CachedSums<'_> {
        let last = self.last.take().filter(|last| last.is_complete && last.has_same_tiles(&receivers));
        let materials = receivers.view_directions.as_ref().map(|view| &*view.materials);
        let context = TraversalContext::new(self.pinholes, self.light, &self.params, materials);
        let mut sums = match &last {
            Some(last) => last.sums.clone(),
            None => vec![[0.0; 4]; receivers.positions.len()],
        };
        let is_cached = |tile: &ReceiverTile| last.as_ref().is_some_and(|last| last.holds(tile));
        let reused = gather_tiles(&context, &receivers, self.accuracy, &is_cached, progress, &mut sums);
        let last = self.last.insert(LastImage { receivers, sums, is_complete: !progress.is_cancelled() });
        CachedSums { sums: &last.sums, reused }
    }
}

impl LastImage {
    /// Whether tiles have the same indices in both images, and the same materials.
    fn has_same_tiles(&self, receivers: &Receivers) -> bool {
        let Receivers { width, height, layout, positions, view_directions, .. } = receivers;
        let last = &self.receivers;
        (last.width, last.height, last.layout, last.positions.len()) == (*width, *height, *layout, positions.len())
            && match (&last.view_directions, view_directions) {
                (None, None) => true,
                (Some(a), Some(b)) => Arc::ptr_eq(&a.materials, &b.materials),
                _ => false,
            }
    }

    /// Whether a tile's receivers are those of the last image.
    fn holds(&self, tile: &ReceiverTile) -> bool {
        let (a, b) = (&self.receivers, tile.receivers());
        let directions = a.view_directions.as_ref().zip(b.view_directions.as_ref());
        tile.places().flatten().all(|k| {
            a.positions[k] == b.positions[k]
                && a.normals[k] == b.normals[k]
                && directions.is_none_or(|(a, b)| a.directions[k] == b.directions[k])
        })
    }
}
