//! Passes that trace rays of whole pictures, many at a time, through the scene's triangles on the GPU. Shaders:
//! `shaders/trace_rays.wgsl`, `shaders/trace_shadows.wgsl`. Knows buffers, but neither pictures nor when work is submitted.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use wgpu::{BindGroupLayout, BindingResource, BufferUsages, ShaderStages};

use super::geometry::{Geometry, ray_entries};
use super::hierarchical::DYNAMIC_OFFSET;
use super::pipeline::{bind, compile, layout, seen_by, storage, window, writable};
use super::shaders::{TRACE_RAYS, TRACE_SHADOWS};
use super::storage_buffer;
use crate::gpu::buffer_with;

/// Invocations of a workgroup.
const WORKGROUP_SIZE: u32 = 64;
/// Directions of shadow rays that one dispatch adds: few enough for adapters that end long loops early.
const DIRECTIONS_PER_DISPATCH: usize = 32;
/// In the flags of results, see the shaders.
const IS_FRONT: u32 = 1;
const IS_BLOCKED: u32 = 1;
const IS_UNFINISHED: u32 = 2;
const NO_OBJECT: u32 = u32::MAX;

/// Which rays or points a dispatch is for.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct BatchUniforms {
    pub count: u32,
    pub first_direction: u32,
    pub direction_count: u32,
    padding: u32,
}

/// A ray, or a point with its normal.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct BatchRay {
    pub origin: [f32; 3],
    padding: u32,
    pub direction: [f32; 3],
    padding_2: u32,
}

/// What a ray meets first.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct BatchHit {
    pub position: [f32; 3],
    pub distance: f32,
    pub normal: [f32; 3],
    pub object: u32,
    pub face_normal: [f32; 3],
    pub flags: u32,
}

/// Irradiance at a point by a set of directions.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct ArrivingLight {
    pub arriving: [f32; 3],
    pub unfinished: u32,
    pub all: [f32; 3],
    padding: u32,
}

/// A direction of shadow rays.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct PackedDirection {
    pub direction: [f32; 3],
    padding: u32,
    pub radiance: [f32; 3],
    padding_2: u32,
}

impl BatchRay {
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin: origin.to_array(), direction: direction.to_array(), ..Self::default() }
    }
}

impl BatchHit {
    /// Whether the traversal came to its end.
    pub fn is_finished(&self) -> bool {
        self.flags & IS_UNFINISHED == 0
    }

    /// Whether anything was met.
    pub fn is_hit(&self) -> bool {
        self.object != NO_OBJECT
    }

    /// Whether the ray came from the side that the mesh's normals point to.
    pub fn is_front(&self) -> bool {
        self.flags & IS_FRONT != 0
    }
}

impl ArrivingLight {
    /// The part of the light that arrives, per channel; `None` if not all rays came to their end. Where there is no light, there is no
    /// shadow.
    pub fn fraction(&self) -> Option<Vec3> {
        let [arriving, all] = [self.arriving, self.all].map(Vec3::from_array);
        (self.unfinished == 0).then(|| Vec3::select(all.cmpgt(Vec3::ZERO), arriving / all, Vec3::ONE))
    }
}

/// Whether a ray is blocked, from the flags of its result; `None` if the traversal did not come to its end.
pub(crate) fn is_blocked(flags: u32) -> Option<bool> {
    (flags & IS_UNFINISHED == 0).then_some(flags & IS_BLOCKED != 0)
}

impl PackedDirection {
    pub fn new(direction: Vec3, radiance: Vec3) -> Self {
        Self { direction: direction.to_array(), radiance: radiance.to_array(), ..Self::default() }
    }
}

/// Which rays are traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RayKind {
    /// Those of the camera, which sees emitters, and looks through what is invisible to it.
    Camera,
    /// Those that leave surfaces.
    Secondary,
}

/// The passes on one device.
#[derive(Debug)]
pub(crate) struct RayBatchPipelines {
    camera: wgpu::ComputePipeline,
    secondary: wgpu::ComputePipeline,
    add_light: wgpu::ComputePipeline,
    find_blocked: wgpu::ComputePipeline,
    of_rays: BindGroupLayout,
    of_shadows: BindGroupLayout,
    nothing: BindGroupLayout,
    geometry: BindGroupLayout,
}

/// What a batch writes, and the passes over it.
pub(crate) struct RayBatch {
    pipeline: wgpu::ComputePipeline,
    groups: [wgpu::BindGroup; 3],
    count: u32,
    dispatches: u32,
    /// One result for each ray or point.
    pub results: wgpu::Buffer,
}

impl RayBatchPipelines {
    /// Compiles the shaders.
    pub fn new(device: &wgpu::Device) -> Self {
        let of = |label, entries: &[wgpu::BindGroupLayoutEntry]| {
            let entries: Vec<_> = entries.iter().map(|entry| seen_by(ShaderStages::COMPUTE, *entry)).collect();
            layout(device, label, &entries)
        };
        let of_rays = of("rays of a batch", &[window(0), storage(1), writable(2)]);
        let of_shadows = of("shadow rays of a batch", &[window(0), storage(1), storage(2), writable(3), writable(4)]);
        let nothing = of("nothing", &[]);
        let geometry = of("rays", &ray_entries(device, ShaderStages::COMPUTE));
        let with = |own| [own, &nothing, &nothing, &geometry];
        let [camera, secondary] =
            compile(device, TRACE_RAYS, with(&of_rays), ["trace_camera_rays", "trace_secondary_rays"]);
        let [add_light, find_blocked] =
            compile(device, TRACE_SHADOWS, with(&of_shadows), ["add_light", "find_blocked"]);
        Self { camera, secondary, add_light, find_blocked, of_rays, of_shadows, nothing, geometry }
    }

    /// What rays meet first: a [`BatchHit`] for each.
    pub fn hits(&self, device: &wgpu::Device, geometry: &Geometry, rays: &[BatchRay], kind: RayKind) -> RayBatch {
        let pipeline = if kind == RayKind::Camera { &self.camera } else { &self.secondary };
        let results = results_buffer(device, rays.len() * size_of::<BatchHit>());
        let (uniforms, rays_buffer) = (uniforms(device, rays.len(), 0), upload_rays(device, rays));
        let own = [window_of(&uniforms), rays_buffer.as_entire_binding(), results.as_entire_binding()];
        self.batch(device, geometry, (pipeline, bind(device, &self.of_rays, &own)), (rays.len(), 1), results)
    }

    /// Which rays that leave surfaces meet anything: a word of flags for each, see [`is_blocked`].
    pub fn blocked(&self, device: &wgpu::Device, geometry: &Geometry, rays: &[BatchRay]) -> RayBatch {
        let results = results_buffer(device, rays.len() * size_of::<u32>());
        let own = self.bind_shadows(device, (rays, &[]), [&results_buffer(device, 0), &results]);
        self.batch(device, geometry, (&self.find_blocked, own), (rays.len(), 1), results)
    }

    /// How much of the light of some directions arrives at points, whose rays are their normals: an [`ArrivingLight`] for each.
    pub fn arriving(
        &self,
        device: &wgpu::Device,
        geometry: &Geometry,
        points: &[BatchRay],
        directions: &[PackedDirection],
    ) -> RayBatch {
        let results = results_buffer(device, points.len() * size_of::<ArrivingLight>());
        let own = self.bind_shadows(device, (points, directions), [&results, &results_buffer(device, 0)]);
        let dispatches = directions.len().div_ceil(DIRECTIONS_PER_DISPATCH) as u32;
        self.batch(device, geometry, (&self.add_light, own), (points.len(), dispatches), results)
    }

    fn bind_shadows(
        &self,
        device: &wgpu::Device,
        (rays, directions): (&[BatchRay], &[PackedDirection]),
        [sums, blocked]: [&wgpu::Buffer; 2],
    ) -> wgpu::BindGroup {
        let uniforms = uniforms(device, rays.len(), directions.len());
        let directions = storage_buffer(device, "directions of shadow rays", bytemuck::cast_slice(directions));
        let rays = upload_rays(device, rays);
        let whole = [&rays, &directions, sums, blocked].map(|buffer| buffer.as_entire_binding());
        let [rays, directions, sums, blocked] = whole;
        bind(device, &self.of_shadows, &[window_of(&uniforms), rays, directions, sums, blocked])
    }

    fn batch(
        &self,
        device: &wgpu::Device,
        geometry: &Geometry,
        (pipeline, own): (&wgpu::ComputePipeline, wgpu::BindGroup),
        (count, dispatches): (usize, u32),
        results: wgpu::Buffer,
    ) -> RayBatch {
        let nothing = bind(device, &self.nothing, &[]);
        let geometry = geometry.bind(device, &self.geometry);
        RayBatch {
            pipeline: pipeline.clone(),
            groups: [own, nothing, geometry],
            count: count as u32,
            dispatches,
            results,
        }
    }
}

impl RayBatch {
    /// Records all passes.
    pub fn record(&self, encoder: &mut wgpu::CommandEncoder) {
        let label = Some("rays");
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label, ..Default::default() });
        let [own, nothing, geometry] = &self.groups;
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(1, nothing, &[]);
        pass.set_bind_group(2, nothing, &[]);
        pass.set_bind_group(3, geometry, &[]);
        for dispatch in 0..self.dispatches {
            pass.set_bind_group(0, own, &[dispatch * DYNAMIC_OFFSET as u32]);
            pass.dispatch_workgroups(self.count.div_ceil(WORKGROUP_SIZE), 1, 1);
        }
    }
}

/// The uniforms of all dispatches, each for some of the directions.
fn uniforms(device: &wgpu::Device, count: usize, directions: usize) -> wgpu::Buffer {
    let mut bytes = Vec::new();
    for first in (0..directions.max(1)).step_by(DIRECTIONS_PER_DISPATCH) {
        bytes.extend_from_slice(bytemuck::bytes_of(&BatchUniforms {
            count: count as u32,
            first_direction: first as u32,
            direction_count: directions.saturating_sub(first).min(DIRECTIONS_PER_DISPATCH) as u32,
            padding: 0,
        }));
        bytes.resize(bytes.len().next_multiple_of(DYNAMIC_OFFSET as usize), 0);
    }
    buffer_with(device, "uniforms of a batch", &bytes, BufferUsages::UNIFORM)
}

fn window_of(uniforms: &wgpu::Buffer) -> BindingResource<'_> {
    let size = std::num::NonZero::new(size_of::<BatchUniforms>() as u64);
    BindingResource::Buffer(wgpu::BufferBinding { buffer: uniforms, offset: 0, size })
}

fn upload_rays(device: &wgpu::Device, rays: &[BatchRay]) -> wgpu::Buffer {
    storage_buffer(device, "rays of a batch", bytemuck::cast_slice(rays))
}

/// A buffer of zeros that passes write and that is copied from; a binding cannot be empty.
fn results_buffer(device: &wgpu::Device, bytes: usize) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("results of a batch"),
        size: (bytes as u64).max(48),
        usage: BufferUsages::STORAGE | BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    })
}
