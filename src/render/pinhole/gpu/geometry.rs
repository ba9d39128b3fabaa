//! The scene's triangles on the GPU, for rays; read by `shaders/shared/rays.wgsl`. Objects that move take their meshes along.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use super::acceleration::{MeshStructure, SceneStructure, fits, has_ray_queries};
use super::pipeline::{bind_numbered, entry, seen_by, uniform};
use crate::gpu::{GpuError, buffer_with};
use crate::scene::{Mesh, Object, Scene};
use crate::tracing::{BottomLevel, Instance, SeenBy, TopLevel};

/// Texels in a row of the texture.
pub(super) const GEOMETRY_ROW: u32 = 2048;

/// The triangles of a scene, and hierarchies over them and over the objects.
#[derive(Clone, Debug, PartialEq)]
pub struct Geometry {
    pub(super) texels: wgpu::TextureView,
    pub(super) uniforms: wgpu::Buffer,
    /// For ray queries; `None` on devices without.
    structure: Option<wgpu::Tlas>,
    draws: Arc<[Draw]>,
}

/// An object whose triangles can be drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Draw {
    /// Its number.
    pub object: u32,
    /// The first of its texels.
    pub first_texel: u32,
    pub triangles: u32,
}

/// What rays have to know, 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(super) struct RayUniforms {
    /// Of nodes over objects.
    pub node_count: u32,
    /// Rays start this far off a surface, metres.
    pub offset: f32,
    padding: [u32; 2],
}

impl Geometry {
    /// Uploads a scene's triangles. On devices with ray queries, submits what builds the structures for these.
    pub fn upload(device: &wgpu::Device, queue: &wgpu::Queue, scene: &Scene) -> Result<Self, GpuError> {
        MovingGeometry::default().update(device, queue, &scene.objects, false)
    }

    /// No triangles. Where there are ray queries, commands that use it come after [`Self::build`].
    pub(super) fn none(device: &wgpu::Device) -> Self {
        let structure = has_ray_queries(device).then(|| SceneStructure::new(device, 0).tlas());
        Self::new(device, &device.create_texture(&geometry_texture(1)), structure)
    }

    /// Builds the empty structure for ray queries.
    pub(super) fn build(&self, encoder: &mut wgpu::CommandEncoder) {
        if let Some(structure) = &self.structure {
            encoder.build_acceleration_structures([], [structure]);
        }
    }

    fn new(device: &wgpu::Device, texture: &wgpu::Texture, structure: Option<wgpu::Tlas>) -> Self {
        let uniforms = buffer_with(
            device,
            "ray uniforms",
            bytemuck::bytes_of(&RayUniforms::default()),
            wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        );
        Self { texels: texture.create_view(&Default::default()), uniforms, structure, draws: Arc::default() }
    }

    /// The objects that light meets.
    pub(crate) fn draws(&self) -> &[Draw] {
        &self.draws
    }

    /// The resources of [`ray_entries`].
    pub(super) fn bindings(&self) -> Vec<(u32, wgpu::BindingResource<'_>)> {
        let texels = wgpu::BindingResource::TextureView(&self.texels);
        let structure = self.structure.as_ref().map(|structure| (2, structure.as_binding()));
        [(0, texels), (1, self.uniforms.as_entire_binding())].into_iter().chain(structure).collect()
    }

    /// The bind group of a layout of [`ray_entries`].
    pub(crate) fn bind(&self, device: &wgpu::Device, layout: &wgpu::BindGroupLayout) -> wgpu::BindGroup {
        bind_numbered(device, layout, self.bindings())
    }
}

/// A scene's triangles from frame to frame: meshes stay where they are on the GPU while objects move.
#[derive(Debug, Default)]
pub(crate) struct MovingGeometry {
    meshes: Vec<PlacedMesh>,
    uploaded: Option<(wgpu::Texture, Geometry)>,
    /// For ray queries; `None` on devices without.
    structure: Option<SceneStructure>,
}

/// A mesh in the texture.
#[derive(Debug)]
struct PlacedMesh {
    mesh: Arc<Mesh>,
    hierarchy: BottomLevel,
    first_row: u32,
    is_for_one_frame: bool,
    is_uploaded: bool,
    /// For ray queries; `None` on devices without, and of no triangles.
    structure: Option<MeshStructure>,
}

impl MovingGeometry {
    /// Makes the texture that of these objects. What was returned before shows them, too, unless they do not fit into its texture.
    /// The hierarchies of meshes that come later than the first ones are refitted or built quickly if these are there `for_one_frame`. For
    /// ray queries, structures are built in a submission of its own.
    pub fn update(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        objects: &[Object],
        for_one_frame: bool,
    ) -> Result<Geometry, GpuError> {
        let limit = device.limits().max_texture_dimension_2d;
        let too_large = || GpuError::TooManyTriangles { limit: most_triangles(limit) };
        // A hierarchy over objects has fewer than two nodes an object.
        let first_rows = rows_of(8 * objects.len());
        let rows =
            self.place(objects, first_rows, for_one_frame).filter(|rows| *rows <= limit).ok_or_else(too_large)?;
        let most = self.meshes.iter().map(|mesh| mesh.hierarchy.corners().len()).max().unwrap_or(0);
        if has_ray_queries(device) && !fits(device, objects.len(), most) {
            return Err(too_large());
        }
        let mut structure = self.structure.take();
        let has_room = structure.as_ref().is_none_or(|structure| structure.holds(objects.len()));
        let known = self.uploaded.take().filter(|(texture, _)| texture.height() >= rows && has_room);
        let (texture, geometry) = known.unwrap_or_else(|| {
            self.meshes.iter_mut().for_each(|mesh| mesh.is_uploaded = false);
            structure = has_ray_queries(device).then(|| SceneStructure::new(device, objects.len() as u32));
            let texture = device.create_texture(&geometry_texture(rows));
            let geometry = Geometry::new(device, &texture, structure.as_ref().map(SceneStructure::tlas));
            (texture, geometry)
        });
        for mesh in self.meshes.iter_mut().filter(|mesh| !mesh.is_uploaded) {
            write_rows(queue, &texture, mesh.first_row, &mesh.hierarchy.texels());
            mesh.is_uploaded = true;
            if structure.is_some() && mesh.structure.is_none() {
                mesh.structure = MeshStructure::new(device, mesh.hierarchy.corners(), mesh.is_for_one_frame);
            }
        }
        let instances: Vec<Instance> = objects.iter().filter_map(|object| self.instance(object)).collect();
        let list = TopLevel::new(&instances);
        write_rows(queue, &texture, 0, &list.texels);
        let draw = |(place, &object): (u32, &u32)| Draw {
            object,
            first_texel: 2 * list.node_count + 4 * place,
            triangles: instances[object as usize].mesh.corners().len() as u32,
        };
        let is_met = |draw: &Draw| instances[draw.object as usize].seen_by.light;
        let draws: Arc<[Draw]> = (0..).zip(&list.order).map(draw).filter(is_met).collect();
        let geometry =
            Geometry { draws: if geometry.draws == draws { geometry.draws.clone() } else { draws }, ..geometry };
        let uniforms = RayUniforms { node_count: list.node_count, offset: list.offset, padding: [0; 2] };
        queue.write_buffer(&geometry.uniforms, 0, bytemuck::bytes_of(&uniforms));
        if let Some(structure) = &mut structure {
            self.build_structures(
                (device, queue),
                structure,
                list.order.iter().map(|&index| instances[index as usize]),
            );
        }
        self.structure = structure;
        self.meshes.iter_mut().filter_map(|mesh| mesh.structure.as_mut()).for_each(MeshStructure::forget_corners);
        self.uploaded = Some((texture, geometry.clone()));
        Ok(geometry)
    }

    /// Builds what ray queries read of objects in the order of their texels.
    fn build_structures<'a>(
        &'a self,
        (device, queue): (&wgpu::Device, &wgpu::Queue),
        structure: &mut SceneStructure,
        instances: impl Iterator<Item = Instance<'a>>,
    ) {
        let of_instance = |instance: Instance<'a>| {
            let is_own = |mesh: &&PlacedMesh| std::ptr::eq(&raw const mesh.hierarchy, instance.mesh);
            Some((instance, self.meshes.iter().find(is_own)?.structure.as_ref()?))
        };
        let meshes = self.meshes.iter().filter_map(|mesh| mesh.structure.as_ref());
        structure.build((device, queue), meshes, instances.filter_map(of_instance));
    }

    /// Finds rows for the objects' meshes. Returns how many are needed; `None` if a mesh has too many triangles.
    fn place(&mut self, objects: &[Object], first_row: u32, for_one_frame: bool) -> Option<u32> {
        let mut before = std::mem::take(&mut self.meshes);
        let is_first = before.is_empty();
        let mut next_row = first_row;
        for object in objects {
            if self.meshes.iter().any(|known| Arc::ptr_eq(&known.mesh, &object.mesh)) {
                continue;
            }
            let is_fine = |known: &PlacedMesh| {
                Arc::ptr_eq(&known.mesh, &object.mesh) && (for_one_frame || !known.is_for_one_frame)
            };
            let known = before.iter().position(is_fine).map(|index| before.swap_remove(index));
            let mut mesh = match known {
                Some(known) => known,
                None => PlacedMesh {
                    mesh: object.mesh.clone(),
                    hierarchy: if for_one_frame {
                        BottomLevel::for_frame(&object.mesh, former(&before, objects, &object.mesh), is_first)?
                    } else {
                        BottomLevel::new(&object.mesh)?
                    },
                    first_row: 0,
                    is_for_one_frame: for_one_frame,
                    is_uploaded: false,
                    structure: None,
                },
            };
            mesh.is_uploaded &= mesh.first_row == next_row;
            mesh.first_row = next_row;
            next_row += rows_of(mesh.hierarchy.texel_count());
            self.meshes.push(mesh);
        }
        Some(next_row.max(1))
    }

    fn instance(&self, object: &Object) -> Option<Instance<'_>> {
        let crate::scene::Transform { scale, rotate_rad, translate } = object.placement;
        if !(scale.is_normal() && rotate_rad.is_finite() && translate.is_finite()) {
            return None;
        }
        let mesh = self.meshes.iter().find(|known| Arc::ptr_eq(&known.mesh, &object.mesh))?;
        Some(Instance {
            mesh: &mesh.hierarchy,
            first_texel: mesh.first_row * GEOMETRY_ROW,
            placement: object.placement,
            seen_by: SeenBy::of(object),
        })
    }
}

/// What a mesh may have been in the frame before, if it deforms: one with as many triangles that no object has any longer.
fn former<'a>(before: &'a [PlacedMesh], objects: &[Object], mesh: &Mesh) -> Option<&'a BottomLevel> {
    let is_gone = |known: &PlacedMesh| !objects.iter().any(|object| Arc::ptr_eq(&object.mesh, &known.mesh));
    let is_alike = |known: &&PlacedMesh| known.mesh.triangles().len() == mesh.triangles().len() && is_gone(known);
    before.iter().find(is_alike).map(|known| &known.hierarchy)
}

fn rows_of(texels: usize) -> u32 {
    texels.div_ceil(GEOMETRY_ROW as usize) as u32
}

/// Writes texels from the start of a row on.
fn write_rows(queue: &wgpu::Queue, texture: &wgpu::Texture, first_row: u32, texels: &[[u32; 4]]) {
    let row = GEOMETRY_ROW as usize;
    let write = |y: u32, texels: &[[u32; 4]], width: u32, height: u32| {
        let place = wgpu::TexelCopyTextureInfo { origin: wgpu::Origin3d { x: 0, y, z: 0 }, ..texture.as_image_copy() };
        let bytes_per_row = Some(width * size_of::<[u32; 4]>() as u32);
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row, rows_per_image: None };
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        queue.write_texture(place, bytemuck::cast_slice(texels), layout, size);
    };
    let (whole, rest) = texels.split_at(texels.len() / row * row);
    let rows = (whole.len() / row) as u32;
    if !whole.is_empty() {
        write(first_row, whole, GEOMETRY_ROW, rows);
    }
    if !rest.is_empty() {
        write(first_row + rows, rest, rest.len() as u32, 1);
    }
}

fn geometry_texture(rows: u32) -> wgpu::TextureDescriptor<'static> {
    wgpu::TextureDescriptor {
        label: Some("triangles"),
        size: wgpu::Extent3d { width: GEOMETRY_ROW, height: rows, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba32Uint,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    }
}

/// The largest number of triangles: each takes four texels, and its leaf with what is above no more than four.
fn most_triangles(max_texture: u32) -> u64 {
    (u64::from(GEOMETRY_ROW) * u64::from(max_texture) / 8).min(1 << 24)
}

/// A texture of integers.
pub(super) fn integers(binding: u32) -> wgpu::BindGroupLayoutEntry {
    let sample_type = wgpu::TextureSampleType::Uint;
    let view_dimension = wgpu::TextureViewDimension::D2;
    entry(binding, wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false })
}

/// The bindings that rays read: two or, on devices with ray queries, three.
pub(crate) fn ray_entries(device: &wgpu::Device, stages: wgpu::ShaderStages) -> Vec<wgpu::BindGroupLayoutEntry> {
    let structure = entry(2, wgpu::BindingType::AccelerationStructure { vertex_return: false });
    let structure = has_ray_queries(device).then_some(structure);
    [integers(0), uniform(1)].into_iter().chain(structure).map(|entry| seen_by(stages, entry)).collect()
}
