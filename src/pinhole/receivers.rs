//! Receiver points: the G-buffer that a gather reads.

use std::sync::Arc;

use glam::Vec3;

use crate::brdf::Materials;

/// The `w` of a position where there is nothing to receive.
pub const NO_RECEIVER: f32 = -1.0;

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
}
