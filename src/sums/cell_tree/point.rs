//! What a tree needs to know of a point of its cells, in little memory: building one mostly moves points around.

use glam::Vec3;

use crate::sampling::SurfacePoint;

/// A point of a cell, 32 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(super) struct CellPoint {
    /// Position, metres; unit normal.
    pub axes: [f32; 6],
    /// The area that it stands for, m².
    pub area: f32,
    /// Points of one patch lie on a surface without creases.
    pub patch: u32,
}

impl CellPoint {
    #[inline]
    pub fn position(&self) -> Vec3 {
        Vec3::from_slice(&self.axes)
    }

    #[inline]
    pub fn normal(&self) -> Vec3 {
        Vec3::from_slice(&self.axes[3..])
    }
}

impl From<&SurfacePoint> for CellPoint {
    fn from(point: &SurfacePoint) -> Self {
        let ([a, b, c], [x, y, z]) = (point.position.to_array(), point.normal.to_array());
        Self { axes: [a, b, c, x, y, z], area: point.area, patch: point.patch }
    }
}
