//! Emitters on the device: their meshes, and where they are seen.

use std::sync::Arc;

use glam::{Mat4, Vec3};
use wgpu::BufferUsages;

use crate::gpu::buffer_with;
use crate::scene::{Mesh, Transform};

/// An emitter in the scene.
#[derive(Clone, Debug)]
pub struct PlacedEmitter {
    pub mesh: Arc<Mesh>,
    pub placement: Transform,
    /// W/(m²·sr).
    pub radiance: Vec3,
}

/// A mesh on the device.
#[derive(Debug)]
pub struct UploadedMesh {
    pub mesh: Arc<Mesh>,
    pub corners: wgpu::Buffer,
    pub indices: wgpu::Buffer,
    centre: Vec3,
    radius: f32,
}

/// An emitter as it is seen: its mesh, and a sphere around it relative to the cube's centre.
pub struct Placed {
    /// Its number among those on the device.
    pub mesh: usize,
    pub world_from_mesh: Mat4,
    pub centre: Vec3,
    pub radius: f32,
}

impl UploadedMesh {
    pub fn new(device: &wgpu::Device, mesh: &Arc<Mesh>) -> Self {
        let positions = mesh.positions();
        let (low, high) =
            positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
        Self {
            corners: buffer_with(device, "corners", bytemuck::cast_slice(positions), BufferUsages::VERTEX),
            indices: buffer_with(device, "triangles", bytemuck::cast_slice(mesh.triangles()), BufferUsages::INDEX),
            mesh: mesh.clone(),
            centre: 0.5 * (low + high),
            radius: 0.5 * low.distance(high),
        }
    }
}

impl Placed {
    pub fn new(emitter: &PlacedEmitter, meshes: &[UploadedMesh], seen_from: Vec3) -> Self {
        let Transform { scale, translate, .. } = emitter.placement;
        let turn = scale * emitter.placement.rotation();
        let mesh = meshes.iter().position(|known| Arc::ptr_eq(&known.mesh, &emitter.mesh)).unwrap_or_default();
        let UploadedMesh { centre, radius, .. } = meshes[mesh];
        Self {
            mesh,
            world_from_mesh: Mat4::from_translation(translate) * Mat4::from_mat3(turn),
            centre: turn * centre + translate - seen_from,
            radius: scale.abs() * radius,
        }
    }
}
