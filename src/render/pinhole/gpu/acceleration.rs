//! The scene's triangles as acceleration structures, for ray queries; read by `shaders/shared/ray_queries.wgsl`. Numbers of objects and
//! triangles are those of the texture of `geometry`, from which shaders read what a ray has met.

use glam::Vec3;
use wgpu::{
    AccelerationStructureFlags as Flags, AccelerationStructureGeometryFlags, AccelerationStructureUpdateMode,
    BlasBuildEntry, BlasGeometries, BlasGeometrySizeDescriptors, BlasTriangleGeometry,
    BlasTriangleGeometrySizeDescriptor, CreateBlasDescriptor, CreateTlasDescriptor, TlasInstance, VertexFormat,
};

use crate::gpu::buffer_with;
use crate::tracing::{Instance, SeenBy};

/// Whether a device finds what rays meet by itself: it has the feature, and limits that leave room for it.
pub(crate) fn has_ray_queries(device: &wgpu::Device) -> bool {
    let limits = device.limits();
    let room = limits.max_acceleration_structures_per_shader_stage.min(limits.max_blas_geometry_count);
    device.features().contains(wgpu::Features::EXPERIMENTAL_RAY_QUERY) && room > 0 && fits(device, 1, 1)
}

/// Whether a scene of so many objects, none with more than so many triangles, fits a device's limits.
pub(super) fn fits(device: &wgpu::Device, objects: usize, triangles: usize) -> bool {
    let limits = device.limits();
    objects <= limits.max_tlas_instance_count as usize && triangles <= limits.max_blas_primitive_count as usize
}

/// The triangles of a mesh, in its units.
#[derive(Debug)]
pub(super) struct MeshStructure {
    blas: wgpu::Blas,
    size: BlasTriangleGeometrySizeDescriptor,
    /// Corners, until the structure is built.
    corners: Option<wgpu::Buffer>,
}

/// The objects of a scene, in the order of their texels.
#[derive(Debug)]
pub(super) struct SceneStructure {
    tlas: wgpu::Tlas,
    capacity: u32,
}

impl MeshStructure {
    /// For triangles in the order of their texels, quickly if they are there for one frame; `None` if there are none.
    pub fn new(device: &wgpu::Device, corners: &[[Vec3; 3]], is_for_one_frame: bool) -> Option<Self> {
        if corners.is_empty() {
            return None;
        }
        let size = BlasTriangleGeometrySizeDescriptor {
            vertex_format: VertexFormat::Float32x3,
            vertex_count: 3 * corners.len() as u32,
            index_format: None,
            index_count: None,
            flags: AccelerationStructureGeometryFlags::empty(),
        };
        let descriptor = CreateBlasDescriptor {
            label: Some("triangles"),
            flags: if is_for_one_frame { Flags::PREFER_FAST_BUILD } else { Flags::PREFER_FAST_TRACE },
            update_mode: AccelerationStructureUpdateMode::Build,
        };
        let sizes = BlasGeometrySizeDescriptors::Triangles { descriptors: vec![size.clone()] };
        let blas = device.create_blas(&descriptor, sizes);
        let bytes = bytemuck::cast_slice(corners);
        let corners = Some(buffer_with(device, "corners of triangles", bytes, wgpu::BufferUsages::BLAS_INPUT));
        Some(Self { blas, size, corners })
    }

    /// Once it is built.
    pub fn forget_corners(&mut self) {
        self.corners = None;
    }

    fn build_entry(&self) -> Option<BlasBuildEntry<'_>> {
        let geometry = BlasTriangleGeometry {
            size: &self.size,
            vertex_buffer: self.corners.as_ref()?,
            first_vertex: 0,
            vertex_stride: size_of::<Vec3>() as u64,
            index_buffer: None,
            first_index: None,
            transform_buffer: None,
            transform_buffer_offset: None,
        };
        Some(BlasBuildEntry { blas: &self.blas, geometry: BlasGeometries::TriangleGeometries(vec![geometry]) })
    }
}

impl SceneStructure {
    pub fn new(device: &wgpu::Device, capacity: u32) -> Self {
        let capacity = capacity.max(1);
        let tlas = device.create_tlas(&CreateTlasDescriptor {
            label: Some("objects"),
            max_instances: capacity,
            flags: Flags::PREFER_FAST_TRACE,
            update_mode: AccelerationStructureUpdateMode::Build,
        });
        Self { tlas, capacity }
    }

    pub fn holds(&self, objects: usize) -> bool {
        objects <= self.capacity as usize
    }

    pub fn tlas(&self) -> wgpu::Tlas {
        self.tlas.clone()
    }

    /// Builds it for objects in the order of their texels, after the structures of those meshes that are new.
    pub fn build<'a>(
        &mut self,
        (device, queue): (&wgpu::Device, &wgpu::Queue),
        meshes: impl Iterator<Item = &'a MeshStructure>,
        mut objects: impl Iterator<Item = (Instance<'a>, &'a MeshStructure)>,
    ) {
        for place in 0..self.capacity {
            self.tlas[place as usize] = objects.next().map(|(instance, mesh)| {
                TlasInstance::new(&mesh.blas, instance.world_from_units(), place, mask(instance.seen_by))
            });
        }
        let new: Vec<BlasBuildEntry> = meshes.filter_map(MeshStructure::build_entry).collect();
        let mut encoder = device.create_command_encoder(&Default::default());
        encoder.build_acceleration_structures(&new, [&self.tlas]);
        queue.submit([encoder.finish()]);
    }
}

/// An instance's mask: bits for the rays that see the object, then for those that do not. See `cull_mask` in `ray_queries.wgsl`.
fn mask(seen_by: SeenBy) -> u8 {
    let all = (1 << SeenBy::BITS) - 1;
    (seen_by.bits() | (!seen_by.bits() & all) << SeenBy::BITS) as u8
}
