//! Image after image of a scene whose mirrors and light stand still: what did not move is taken from the image before.
//!
//! A tile's sums depend on its own receivers only, so that the result is the same to the bit.

use std::sync::Arc;

use super::blocks::Grid;
use super::{Accuracy, Light, Walked, gather_tiles};
use crate::pinhole::{Params, PinholeTree, Receivers};

/// A hierarchical gather that remembers the image before. It borrows cells and light, so that they cannot change between images;
/// where they do, make another one.
#[derive(Debug)]
pub struct StillGather<'a> {
    pinholes: &'a PinholeTree,
    light: Light<'a>,
    params: Params,
    accuracy: Accuracy,
    last: Option<Last>,
}

/// The image before.
#[derive(Debug)]
struct Last {
    receivers: Receivers,
    sums: Vec<[f32; 4]>,
}

/// The sums of an image, and what they took.
#[derive(Clone, Copy, Debug)]
pub struct StillSums<'a> {
    /// As of [`super::gather_hierarchical`].
    pub sums: &'a [[f32; 4]],
    /// Receivers in tiles of 64² that are as they were.
    pub reused: usize,
}

impl<'a> StillGather<'a> {
    /// Remembers nothing yet.
    pub fn new(pinholes: &'a PinholeTree, light: Light<'a>, params: &Params, accuracy: Accuracy) -> Self {
        Self { pinholes, light, params: *params, accuracy, last: None }
    }

    /// Gathers at receivers; where those of a tile are what they were in the image before, so are their sums.
    pub fn gather(&mut self, receivers: Receivers, progress: &(dyn Fn(u64) + Sync)) -> StillSums<'_> {
        let last = self.last.take().filter(|last| last.is_like(&receivers));
        let materials = receivers.viewers.as_ref().map(|viewers| &*viewers.materials);
        let scene = Walked::new(self.pinholes, self.light, &self.params, materials);
        let mut sums = match &last {
            Some(last) => last.sums.clone(),
            None => vec![[0.0; 4]; receivers.positions.len()],
        };
        let is_known = |grid: &Grid| last.as_ref().is_some_and(|last| last.knows(grid));
        let reused = gather_tiles(&scene, &receivers, self.accuracy, &is_known, progress, &mut sums);
        let last = self.last.insert(Last { receivers, sums });
        StillSums { sums: &last.sums, reused }
    }
}

impl Last {
    /// Whether tiles of both are the same places, and reflect alike.
    fn is_like(&self, receivers: &Receivers) -> bool {
        let Receivers { width, height, arrangement, positions, viewers, .. } = receivers;
        let last = &self.receivers;
        (last.width, last.height, last.arrangement, last.positions.len())
            == (*width, *height, *arrangement, positions.len())
            && match (&last.viewers, viewers) {
                (None, None) => true,
                (Some(a), Some(b)) => Arc::ptr_eq(&a.materials, &b.materials),
                _ => false,
            }
    }

    /// Whether a tile's receivers are what they were.
    fn knows(&self, grid: &Grid) -> bool {
        let (a, b) = (&self.receivers, grid.receivers());
        let directions = a.viewers.as_ref().zip(b.viewers.as_ref());
        grid.places().flatten().all(|k| {
            a.positions[k] == b.positions[k]
                && a.normals[k] == b.normals[k]
                && directions.is_none_or(|(a, b)| a.directions[k] == b.directions[k])
        })
    }
}
