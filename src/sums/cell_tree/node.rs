//! One node of the tree, byte for byte as GPUs read it.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use half::f16;

use super::moments::Fit;
use crate::differential::tangent_frame;

/// A cell, 64 bytes: four vectors of four. Tensors are in the frame of the normal ([`glam::Vec3::any_orthonormal_pair`]).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct CellNode {
    /// Centroid, lifted onto the surface, metres; area, m².
    pub centroid_area: [f32; 4],
    /// Unit mean normal; e₁₁, metres.
    pub normal_e11: [f32; 4],
    /// e₂₁, e₂₂: the cell's sides are T₁ = (e₁₁, e₂₁) and T₂ = (0, e₂₂), a parallelogram with the cell's moments. k₁₁, k₁₂ and
    pub sides_curvature: [f32; 4],
    /// k₂₂: ∇n, 1/m. Two halves, the radius in metres below and above it the greatest distance of a normal from the mean one;
    /// eight times the first child's index and the number of children; twice the sample (of a cluster: its most central one),
    /// and 1 if there are creases within.
    pub curvature_bounds_links: [u32; 4],
}

/// A node's numbers in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeGeometry {
    /// Centroid, lifted onto the surface, metres.
    pub centroid: Vec3,
    /// Mean normal, unit.
    pub normal: Vec3,
    /// Area, m².
    pub area: f32,
    /// Full sides of a parallelogram with the cell's moments, metres.
    pub sides: [Vec3; 2],
    /// Change of the normal along each side.
    pub changes: [Vec3; 2],
    /// Whether the cell is not one smooth piece of the surface.
    pub creased: bool,
    /// No point of the cell is farther from the centroid, metres.
    pub radius: f32,
    /// No unit normal of the cell is farther from the mean one.
    pub normal_radius: f32,
}

impl CellNode {
    pub(super) fn new(fit: &Fit, radius: f32, normal_radius: f32, sample: u32, creased: bool) -> Self {
        let [a, b] = fit.sides.map(|side| side.to_array());
        let k = fit.curvature;
        let [x, y, z] = fit.centroid.to_array();
        let [n_x, n_y, n_z] = fit.normal.to_array();
        // Rounded up: halves have eleven bits.
        let half = |value: f32| u32::from(f16::from_f32(value * 1.001).to_bits());
        Self {
            centroid_area: [x, y, z, fit.area],
            normal_e11: [n_x, n_y, n_z, a[0]],
            sides_curvature: [a[1], b[1], k.xx, k.xy],
            curvature_bounds_links: [
                k.yy.to_bits(),
                half(radius) | half(normal_radius) << 16,
                0,
                sample << 1 | u32::from(creased),
            ],
        }
    }

    pub(super) fn set_children(&mut self, first: u32, count: u32) {
        self.curvature_bounds_links[2] = first << 3 | count;
    }

    /// The children's indices; none of a leaf.
    #[inline]
    pub fn children(&self) -> Range<u32> {
        let link = self.curvature_bounds_links[2];
        (link >> 3)..(link >> 3) + (link & 7)
    }

    /// The number of the sample that it belongs to; of a cluster, the one nearest to its centroid.
    #[inline]
    pub fn sample(&self) -> u32 {
        self.curvature_bounds_links[3] >> 1
    }

    /// Whether its cell is not one smooth piece of the surface.
    #[inline]
    pub fn is_creased(&self) -> bool {
        self.curvature_bounds_links[3] & 1 == 1
    }

    /// Area, m².
    #[inline]
    pub fn area(&self) -> f32 {
        self.centroid_area[3]
    }

    /// Centroid, lifted onto the surface, metres.
    #[inline]
    pub fn centroid(&self) -> Vec3 {
        Vec3::from_slice(&self.centroid_area)
    }

    /// Its numbers in world space.
    #[inline]
    pub fn geometry(&self) -> NodeGeometry {
        let normal = Vec3::from_slice(&self.normal_e11);
        let [u, v] = tangent_frame(normal);
        let e11 = self.normal_e11[3];
        let [e21, e22, k11, k12] = self.sides_curvature;
        let [k22, bounds, ..] = self.curvature_bounds_links;
        let k22 = f32::from_bits(k22);
        let (n_u, n_v) = (k11 * u + k12 * v, k12 * u + k22 * v);
        let half = |bits: u32| f16::from_bits(bits as u16).to_f32();
        NodeGeometry {
            centroid: self.centroid(),
            normal,
            area: self.area(),
            sides: [e11 * u + e21 * v, e22 * v],
            changes: [e11 * n_u + e21 * n_v, e22 * n_v],
            creased: self.is_creased(),
            radius: half(bounds),
            normal_radius: half(bounds >> 16),
        }
    }
}
