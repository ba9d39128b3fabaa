//! Receiver points: the G-buffer that a gather reads.

use std::sync::Arc;

use glam::Vec3;

use super::constants::TILE_SIZE;
use crate::brdf::Materials;

/// The `w` of a position where there is nothing to receive.
pub const NO_RECEIVER: f32 = -1.0;

/// Points along the edge of the largest blocks that a hierarchical gather looks at.
pub(super) const TILE: usize = TILE_SIZE as usize;

/// The bits of two places of a tile by turns: blocks of every level are runs of a list.
pub(super) fn along_z_curve(x: usize, y: usize) -> usize {
    (0..TILE.ilog2()).map(|bit| (x >> bit & 1) << (2 * bit) | (y >> bit & 1) << (2 * bit + 1)).sum()
}

/// A grid of receiver points, `width × height`, row by row. It need not be a picture: any points will do.
#[derive(Clone, Debug)]
pub struct Receivers {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// What neighbours have in common.
    pub arrangement: Arrangement,
    /// World position; `w` is the object's index in the scene, or [`NO_RECEIVER`].
    pub positions: Vec<[f32; 4]>,
    /// Unit normal on the side that receives; `w` is not used.
    pub normals: Vec<[f32; 4]>,
    /// `None`: what is gathered is irradiance. Else it is the radiance that the objects reflect to their viewers.
    pub viewers: Option<Viewers>,
}

/// What neighbouring receivers have in common.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Arrangement {
    /// Columns and rows are those of a picture.
    #[default]
    Picture,
    /// Only the order counts: what follows each other is likely to be near each other.
    List,
}

/// Who looks at receivers.
#[derive(Clone, Debug)]
pub struct Viewers {
    /// Unit direction from each receiver towards its viewer; `w` is not used.
    pub directions: Vec<[f32; 4]>,
    /// What the scene's objects do with light.
    pub materials: Arc<Materials>,
}

impl Receivers {
    /// A grid without any receiver.
    pub fn empty(width: u32, height: u32) -> Self {
        let count = width as usize * height as usize;
        Self {
            width,
            height,
            arrangement: Arrangement::Picture,
            positions: vec![[0.0, 0.0, 0.0, NO_RECEIVER]; count],
            normals: vec![[0.0; 4]; count],
            viewers: None,
        }
    }

    /// Puts a list of points into rows of `width`.
    pub fn from_points(points: &[(Vec3, Vec3, u32)], width: u32) -> Self {
        let rows = (points.len() as u32).div_ceil(width).max(1);
        let mut grid = Self { arrangement: Arrangement::List, ..Self::empty(width, rows) };
        for (index, (position, normal, object)) in points.iter().enumerate() {
            grid.set(index, *position, *normal, *object);
        }
        grid
    }

    /// Puts a receiver in place `index`.
    pub fn set(&mut self, index: usize, position: Vec3, normal: Vec3, object: u32) {
        self.positions[index] = position.extend(object as f32).to_array();
        self.normals[index] = normal.extend(0.0).to_array();
    }

    /// Receivers in order as a grid of tiles of 64², whose blocks are runs of the list; and where each of them went.
    pub fn in_tiles(&self) -> (Self, Vec<usize>) {
        let count = self.positions.len();
        let tiles = count.div_ceil(TILE * TILE).max(1);
        let across = (tiles as f64).sqrt().ceil() as usize;
        let mut within = vec![(0, 0); TILE * TILE];
        (0..TILE * TILE).for_each(|k| within[along_z_curve(k % TILE, k / TILE)] = (k % TILE, k / TILE));
        let width = across * TILE;
        let place = |k: usize| {
            let (tile, (x, y)) = (k / (TILE * TILE), within[k % (TILE * TILE)]);
            (tile / across * TILE + y) * width + tile % across * TILE + x
        };
        let places: Vec<usize> = (0..count).map(place).collect();
        let mut tiled = Self::empty(width as u32, (tiles.div_ceil(across) * TILE) as u32);
        tiled.arrangement = Arrangement::List;
        let mut directions = self.viewers.as_ref().map(|_| vec![[0.0; 4]; tiled.positions.len()]);
        for (k, &place) in places.iter().enumerate() {
            tiled.positions[place] = self.positions[k];
            tiled.normals[place] = self.normals[k];
            if let (Some(directions), Some(viewers)) = (&mut directions, &self.viewers) {
                directions[place] = viewers.directions[k];
            }
        }
        let materials = self.viewers.as_ref().map(|viewers| viewers.materials.clone());
        tiled.viewers = directions.zip(materials).map(|(directions, materials)| Viewers { directions, materials });
        (tiled, places)
    }
}
