//! Receiver points: the G-buffer that a gather reads.

use std::sync::Arc;

use glam::Vec3;

use crate::brdf::Materials;

/// The `w` of a position without a receiver.
pub const NO_RECEIVER: f32 = -1.0;

/// Stands for the index of an object where a receiver is a point of a medium: the largest that 32-bit floats tell apart.
pub const MEDIUM_OBJECT: u32 = (1 << 23) - 1;

/// Points along an edge of a receiver tile, the unit of work of a hierarchical gather.
pub(super) const TILE: usize = super::constants::TILE_SIZE as usize;

/// Index along the Z-order curve of a place in a tile: the bits of both coordinates interleaved. Blocks of every level are
/// contiguous ranges of the curve.
pub(super) fn along_z_curve(x: usize, y: usize) -> usize {
    (0..TILE.ilog2()).map(|bit| (x >> bit & 1) << (2 * bit) | (y >> bit & 1) << (2 * bit + 1)).sum()
}

/// Receiver points, `width × height`, row by row. Any set of points will do; [`ReceiverLayout`] says whether it is an image.
#[derive(Clone, Debug)]
pub struct Receivers {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// How neighbours relate.
    pub layout: ReceiverLayout,
    /// World position; `w` is the object's index in the scene, or [`NO_RECEIVER`].
    pub positions: Vec<[f32; 4]>,
    /// Unit normal on the side that receives, or for parts of rays the unit direction towards the viewer; `w` is the error that may be made here beyond the accuracy of a hierarchical sum, W/m²,
    /// as other light hides it.
    pub normals: Vec<[f32; 4]>,
    /// `None`: the gather computes irradiance. Otherwise it computes the radiance reflected towards the viewer.
    pub view_directions: Option<ViewDirections>,
    /// `Some`: the receivers are parts of rays through a medium, of these lengths, metres, around their positions. The gather computes
    /// the light that the medium scatters towards the viewer there: the mean over the part of ∫ L 4π p dω, W/m², where p is the phase
    /// function, which is the fluence rate where the medium scatters evenly. They are without `view_directions`.
    pub lengths: Option<Vec<f32>>,
}

/// How neighbouring receivers relate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ReceiverLayout {
    /// Columns and rows are those of an image: neighbours are samples of one surface where it is smooth.
    #[default]
    Grid,
    /// Rows mean nothing. Consecutive points should be close to each other, which keeps the gather fast.
    Unordered,
}

/// Where each receiver is seen from, and how it reflects.
#[derive(Clone, Debug)]
pub struct ViewDirections {
    /// Unit direction from each receiver towards its viewer; `w` is not used.
    pub directions: Vec<[f32; 4]>,
    /// Materials of the scene's objects.
    pub materials: Arc<Materials>,
}

impl Receivers {
    /// A grid without any receiver.
    pub fn empty(width: u32, height: u32) -> Self {
        let count = width as usize * height as usize;
        Self {
            width,
            height,
            layout: ReceiverLayout::Grid,
            positions: vec![[0.0, 0.0, 0.0, NO_RECEIVER]; count],
            normals: vec![[0.0; 4]; count],
            view_directions: None,
            lengths: None,
        }
    }

    /// Unordered points (position, unit normal, object), in rows of `width`.
    pub fn from_points(points: &[(Vec3, Vec3, u32)], width: u32) -> Self {
        let rows = (points.len() as u32).div_ceil(width.max(1)).max(1);
        let mut grid = Self { layout: ReceiverLayout::Unordered, ..Self::empty(width.max(1), rows) };
        for (index, (position, normal, object)) in points.iter().enumerate() {
            grid.set(index, *position, *normal, *object);
        }
        grid
    }

    /// A list of parts of rays, in rows of `width`, still without any.
    pub fn of_rays(width: u32, height: u32) -> Self {
        let empty = Self { layout: ReceiverLayout::Unordered, ..Self::empty(width, height) };
        Self { lengths: Some(vec![0.0; empty.positions.len()]), ..empty }
    }

    /// Sets the part of a ray at `index`: its middle, the unit direction towards the viewer, and its length, metres.
    pub fn set_part(&mut self, index: usize, middle: Vec3, towards_viewer: Vec3, length: f32) {
        self.set(index, middle, towards_viewer, MEDIUM_OBJECT);
        if let Some(lengths) = &mut self.lengths {
            lengths[index] = length;
        }
    }

    /// Sets the receiver at `index`.
    pub fn set(&mut self, index: usize, position: Vec3, normal: Vec3, object: u32) {
        self.positions[index] = position.extend(object as f32).to_array();
        self.normals[index] = normal.extend(0.0).to_array();
    }

    /// Allows an error, W/m², at the receiver at `index` beyond the accuracy of a hierarchical sum.
    pub fn tolerate(&mut self, index: usize, error: f32) {
        self.normals[index][3] = error;
    }

    /// The object of the receiver at `index`, if there is a receiver.
    #[inline]
    pub fn object(&self, index: usize) -> Option<u32> {
        let object = self.positions[index][3];
        // Rounded, as interpolation by a rasterizer may yield 0.9999999.
        (object >= 0.0).then_some((object + 0.5) as u32)
    }

    /// Some of the receivers, no more than `most`, as an unordered list; all of them if they are no more.
    #[must_use]
    pub fn some(&self, most: usize) -> Self {
        let mut chosen: Vec<usize> = (0..self.positions.len()).filter(|&k| self.object(k).is_some()).collect();
        if chosen.len() > most {
            // Even steps could coincide with the columns of an image; golden-ratio steps do not.
            let place = |k: usize| ((k as f64 * 0.618_033_988_749_894_9).fract() * chosen.len() as f64) as usize;
            chosen = (0..most).map(|k| chosen[place(k)]).collect();
        }
        let mut some = Self { layout: ReceiverLayout::Unordered, ..Self::empty(chosen.len() as u32, 1) };
        some.lengths = self.lengths.as_ref().map(|lengths| chosen.iter().map(|&index| lengths[index]).collect());
        for (place, index) in chosen.into_iter().enumerate() {
            (some.positions[place], some.normals[place]) = (self.positions[index], self.normals[index]);
        }
        some
    }

    /// Unordered receivers as a grid of tiles of 64², each filled along the Z-order curve, so that blocks are ranges of the
    /// original order; and the index in the grid of each of them.
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
        tiled.layout = ReceiverLayout::Unordered;
        let mut directions = self.view_directions.as_ref().map(|_| vec![[0.0; 4]; tiled.positions.len()]);
        tiled.lengths = self.lengths.as_ref().map(|_| vec![0.0; tiled.positions.len()]);
        for (k, &place) in places.iter().enumerate() {
            tiled.positions[place] = self.positions[k];
            tiled.normals[place] = self.normals[k];
            if let (Some(directions), Some(view)) = (&mut directions, &self.view_directions) {
                directions[place] = view.directions[k];
            }
            if let (Some(in_tiles), Some(lengths)) = (&mut tiled.lengths, &self.lengths) {
                in_tiles[place] = lengths[k];
            }
        }
        let materials = self.view_directions.as_ref().map(|view| view.materials.clone());
        tiled.view_directions =
            directions.zip(materials).map(|(directions, materials)| ViewDirections { directions, materials });
        (tiled, places)
    }
}
