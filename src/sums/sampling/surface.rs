//! The reflecting surface: the triangles of all reflectors, their normals turned to the reflecting side.

use bytemuck::Zeroable;
use glam::Vec3;

use super::patches::smooth_patches;
use crate::parallel;
use crate::scene::{Mesh, Scene, Sides};

/// One triangle of the surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfaceTriangle {
    pub corners: [Vec3; 3],
    pub normals: [Vec3; 3],
    pub object: u32,
    /// Triangles of one patch meet without a crease.
    pub patch: u32,
}

/// All that reflects in a scene.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    triangles: Vec<SurfaceTriangle>,
    /// Of each triangle, m².
    areas: Vec<f32>,
    patch_areas: Vec<f32>,
    area: f64,
}

/// A point on the surface.
#[derive(Clone, Copy, Debug, PartialEq, Zeroable)]
pub struct SurfacePoint {
    /// World space, metres.
    pub position: Vec3,
    /// Unit normal, towards the reflecting side.
    pub normal: Vec3,
    /// The area that the point stands for, m².
    pub area: f32,
    /// Index of the object in the scene.
    pub object: u32,
    /// Points of one patch lie on a surface without creases.
    pub patch: u32,
    /// The patch, or a stand-in for all patches of the object too small for a sample of their own.
    pub group: u32,
}

impl SurfacePoint {
    /// Whether two points may stand for each other: no crease and no sheet's thickness lies between them.
    pub fn same_side(&self, other: &Self) -> bool {
        self.group == other.group && self.normal.dot(other.normal) > 0.0
    }
}

impl Surface {
    /// Collects what casts caustics in a scene: reflectors and refractors.
    pub fn of_scene(scene: &Scene) -> Self {
        let mut surface = Self::default();
        for (index, object) in scene.objects.iter().enumerate() {
            if let Some(specular) = object.specular() {
                surface.append(&object.mesh_in_world(), index as u32, specular.sides() == Sides::Back);
            }
        }
        surface
    }

    /// Adds an object's mesh; `flipped` makes its back the reflecting side.
    pub fn append(&mut self, mesh: &Mesh, object: u32, flipped: bool) {
        let first_patch = self.patch_areas.len() as u32;
        let (patches, count) = smooth_patches(mesh);
        self.patch_areas.resize(first_patch as usize + count, 0.0);
        let sign = if flipped { -1.0 } else { 1.0 };
        let triangle = |t: usize| {
            let normals = mesh.corner_normals(t).map(|n| sign * n);
            SurfaceTriangle { corners: mesh.corners(t), normals, object, patch: first_patch + patches[t] }
        };
        let first = self.triangles.len();
        self.triangles.extend(parallel::collect(patches.len(), &triangle));
        self.areas.extend(parallel::map(&self.triangles[first..], &SurfaceTriangle::area));
        for (patch, &area) in patches.iter().zip(&self.areas[first..]) {
            self.patch_areas[(first_patch + patch) as usize] += area;
            self.area += f64::from(area);
        }
    }

    /// Total area, m².
    pub fn area(&self) -> f64 {
        self.area
    }

    pub(super) fn triangles(&self) -> &[SurfaceTriangle] {
        &self.triangles
    }

    /// The triangles' areas, m².
    pub(super) fn areas(&self) -> &[f32] {
        &self.areas
    }

    pub(super) fn patch_area(&self, patch: u32) -> f32 {
        self.patch_areas[patch as usize]
    }

    pub(super) fn patch_count(&self) -> u32 {
        self.patch_areas.len() as u32
    }
}

impl SurfaceTriangle {
    pub fn area(&self) -> f32 {
        let [a, b, c] = self.corners;
        0.5 * (b - a).cross(c - a).length()
    }

    /// The point at barycentric coordinates, standing for `area`.
    pub fn point(&self, barycentric: Vec3, area: f32) -> SurfacePoint {
        let mix = |v: [Vec3; 3]| barycentric.x * v[0] + barycentric.y * v[1] + barycentric.z * v[2];
        self.piece(mix(self.corners), mix(self.normals), area)
    }

    /// The point at a place on it, whose normal may have any length, standing for `area`.
    pub fn piece(&self, position: Vec3, normal: Vec3, area: f32) -> SurfacePoint {
        SurfacePoint {
            position,
            normal: normal.try_normalize().unwrap_or(self.normals[0]),
            area,
            object: self.object,
            patch: self.patch,
            group: self.patch,
        }
    }
}
