//! Samples and cells as the CPU sum evaluates them, unpacked from memory in one step.

use std::ops::Range;

use glam::Vec3;

use super::{PinholeParts, PinholeSample};

/// A cell of the tree: the sample that stands for it, and what bounds it.
#[derive(Clone, Debug)]
pub(super) struct Cell {
    pub sample: PinholeParts,
    /// Upper bound of the reflectance over channels and angles.
    pub max_reflectance: f32,
    /// Its look-ups, and those of the cells below it, are blurred over this width at least, radians.
    pub blur: f32,
    /// No point of the cell is farther from the centroid, metres.
    pub radius: f32,
    /// No unit normal of the cell is farther from the mean one.
    pub normal_radius: f32,
    /// Whether the cell is not one smooth piece of the surface.
    pub is_creased: bool,
    /// Indices of the child nodes; none of a leaf.
    pub children: Range<u32>,
    /// The sample node that it belongs to, whose visibility it shares; of a cluster, that of its most central sample.
    pub sample_node: u32,
}

impl Cell {
    #[inline(always)]
    pub fn is_leaf(&self) -> bool {
        self.children.is_empty()
    }
}

impl From<&PinholeSample> for PinholeParts {
    #[inline(always)]
    fn from(sample: &PinholeSample) -> Self {
        Self {
            position: sample.position(),
            normal: sample.normal(),
            area: sample.area(),
            sides: [sample.side_1(), sample.side_2()],
            changes: [sample.change_1(), sample.change_2()],
            reflectance: sample.reflectance(),
            curve: sample.curve().map(|curve| curve as u32),
            lobe: sample.lobe(),
            object: sample.object(),
            lights: sample.lights(),
            interface: sample.interface(),
        }
    }
}

impl PinholeParts {
    /// The four quarters of its parallelogram, to second order.
    pub(super) fn quarters(&self) -> [Self; 4] {
        let (n, [t1, t2], [m1, m2]) = (self.normal, self.sides, self.changes);
        [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)].map(|(x, y)| {
            let (q, m) = (x * t1 + y * t2, x * m1 + y * m2);
            let normal = (n + m).normalize();
            let half = |v: Vec3| 0.5 * (v - v.dot(normal) * normal);
            // Where normals diverge the surface falls away from the tangent plane.
            let position = self.position + q - 0.5 * q.dot(m) * n;
            let area = 0.25 * self.area;
            Self { position, normal, area, sides: [t1, t2].map(half), changes: [m1, m2].map(half), ..*self }
        })
    }
}
