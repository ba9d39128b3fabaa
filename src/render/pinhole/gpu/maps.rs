//! Visibility maps on the GPU: uploaded, or traced there. Shader: `shaders/trace_maps.wgsl`; CPU twin: [`crate::pinhole::visibility`].

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use wgpu::ShaderStages;

use super::geometry::{Geometry, ray_entries};
use super::hierarchical::DYNAMIC_OFFSET;

use super::pipeline::{bind, compute_pipeline, layout, seen_by, storage, window, writable, written};
use super::shaders::TRACE_MAPS;
use super::{filled_storage, storage_buffer};
use crate::gpu::{GpuError, buffer_with};
use crate::pinhole::{PinholeSample, VisibilityMaps};
use crate::scene::Scene;
use pinspot_sums::pinhole::visibility::{Edges, Hemisphere, Hemispheres};

/// Texels in a row of the texture of doubts.
pub(super) const DOUBTS_ROW: u32 = 4096;
/// Invocations of a workgroup, which traces a map.
pub(super) const MAP_WORKGROUP_SIZE: u32 = 256;
/// Maps of a dispatch.
const MAPS_PER_DISPATCH: u32 = 256;

/// What samples see: the maps that look-ups read.
#[derive(Clone, Debug)]
pub struct VisibilityMapBuffers {
    pub(super) planes: wgpu::Buffer,
    pub(super) sky_masks: wgpu::Buffer,
    /// Texels along the edge of a map.
    pub(super) resolution: u32,
    /// What settles doubts, if rays do.
    pub(super) rays: Option<RayInputs>,
}

/// What is needed to trace rays where maps are in doubt.
#[derive(Clone, Debug)]
pub(super) struct RayInputs {
    pub doubts: wgpu::TextureView,
    pub geometry: Geometry,
}

impl VisibilityMapBuffers {
    /// Uploads maps that were traced on the CPU.
    pub fn upload(device: &wgpu::Device, maps: &VisibilityMaps) -> Result<Self, GpuError> {
        check_size(device, maps.planes.len() as u64)?;
        Ok(Self {
            planes: storage_buffer(device, "visible planes", bytemuck::cast_slice(&maps.planes)),
            sky_masks: storage_buffer(device, "sky masks", bytemuck::cast_slice(&maps.sky_mask)),
            resolution: maps.resolution,
            rays: None,
        })
    }

    /// No maps.
    pub(super) fn none(device: &wgpu::Device) -> Self {
        let empty = |label| storage_buffer(device, label, &[]);
        Self { planes: empty("no planes"), sky_masks: empty("no sky masks"), resolution: 0, rays: None }
    }
}

fn check_size(device: &wgpu::Device, texels: u64) -> Result<(), GpuError> {
    let limits = device.limits();
    let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    let bytes = texels * size_of::<[f32; 4]>() as u64;
    if bytes > limit { Err(GpuError::MapsTooLarge { bytes, limit }) } else { Ok(()) }
}

/// The pipeline that traces maps on one device.
#[derive(Debug)]
pub struct MapTracer {
    pipeline: wgpu::ComputePipeline,
    maps: wgpu::BindGroupLayout,
    nothing: wgpu::BindGroupLayout,
    rays: wgpu::BindGroupLayout,
}

impl MapTracer {
    /// Compiles the shader.
    pub fn new(device: &wgpu::Device) -> Self {
        let entries = [window(0), storage(1), writable(2), writable(3), written_doubts(4), writable(5)];
        let maps = layout(device, "visibility maps", &entries.map(|entry| seen_by(ShaderStages::COMPUTE, entry)));
        let nothing = layout(device, "nothing", &[]);
        let rays = layout(device, "rays", &ray_entries(device, ShaderStages::COMPUTE));
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("visibility maps"),
            bind_group_layouts: &[&maps, &nothing, &nothing, &rays].map(Some),
            immediate_size: 0,
        });
        let module = TRACE_MAPS.module(device);
        let pipeline = compute_pipeline(device, &pipeline_layout, &module, "trace_map", &[]);
        Self { pipeline, maps, nothing, rays }
    }
}

fn written_doubts(binding: u32) -> wgpu::BindGroupLayoutEntry {
    written(binding, wgpu::TextureFormat::Rg32Uint)
}

/// Visibility maps that are being traced.
#[derive(Clone, Debug)]
pub struct MapTracing {
    maps: VisibilityMapBuffers,
    samples: Vec<PinholeSample>,
    count: u32,
    geometry: Geometry,
    hemispheres: wgpu::Buffer,
    pipeline: wgpu::ComputePipeline,
    of_maps: wgpu::BindGroup,
    nothing: wgpu::BindGroup,
    of_rays: wgpu::BindGroup,
    unfinished: wgpu::Buffer,
}

/// One side of a sample, 48 bytes; see the shader.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(super) struct PackedHemisphere {
    pub position: [f32; 3],
    pub extent: f32,
    pub normal: [f32; 3],
    pub object_sides: u32,
    pub texel_jitter: [f32; 2],
    padding: [u32; 2],
}

impl PackedHemisphere {
    fn new(hemisphere: &Hemisphere) -> Self {
        let Hemisphere { piece, axes: [u, v, w], texel_jitter } = hemisphere;
        // The frame of a sample is right-handed on the side that its normal points to.
        let is_back = u.cross(*v).dot(*w) < 0.0;
        Self {
            position: piece.position.to_array(),
            extent: piece.extent,
            normal: (if is_back { -*w } else { *w }).to_array(),
            object_sides: piece.object << 2 | u32::from(piece.front) << 1 | u32::from(is_back),
            texel_jitter: texel_jitter.to_array(),
            padding: [0; 2],
        }
    }
}

/// Which maps a dispatch traces, and how; 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(super) struct MapUniforms {
    pub first_map: u32,
    pub resolution: u32,
    pub bisections: u32,
    padding: u32,
}

/// How the maps that are traced are looked up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapUse {
    /// Alone.
    Maps,
    /// Where they are in doubt, rays are traced.
    MapsAndRays,
}

impl MapTracing {
    /// Numbers the maps of samples, and makes what it takes to trace them.
    pub fn new(
        device: &wgpu::Device,
        tracer: &MapTracer,
        geometry: &Geometry,
        (scene, mut samples): (&Scene, Vec<PinholeSample>),
        map_use: MapUse,
    ) -> Result<Self, GpuError> {
        let Hemispheres { resolution, of_maps } = Hemispheres::number(scene, &mut samples);
        let count = of_maps.len() as u32;
        let texels = u64::from(count) * u64::from(resolution * resolution);
        check_size(device, texels)?;
        let edges = if map_use == MapUse::Maps { Edges::Fine } else { Edges::Traced };
        let empty = |label, size: u64, usage| {
            let size = size.max(16);
            device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
        };
        let storage = wgpu::BufferUsages::STORAGE;
        let planes = empty("visible planes", 16 * texels, storage | wgpu::BufferUsages::COPY_SRC);
        let rows = u64::from(count) * u64::from(resolution);
        let sky_masks = empty("sky masks", 4 * rows, storage | wgpu::BufferUsages::COPY_SRC);
        let counter = storage | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let unfinished = empty("unfinished rays", 16, counter);
        let doubts = doubts_texture(device, texels).create_view(&Default::default());
        let uniforms = buffer_with(
            device,
            "map uniforms",
            &dispatch_uniforms(count, resolution, edges.bisections()),
            wgpu::BufferUsages::UNIFORM,
        );
        let window = wgpu::BufferBinding {
            buffer: &uniforms,
            offset: 0,
            size: std::num::NonZero::new(size_of::<MapUniforms>() as u64),
        };
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let hemispheres = buffer_with(device, "hemispheres", &packed(&of_maps), usage);
        let resources = [
            wgpu::BindingResource::Buffer(window),
            hemispheres.as_entire_binding(),
            planes.as_entire_binding(),
            sky_masks.as_entire_binding(),
            wgpu::BindingResource::TextureView(&doubts),
            unfinished.as_entire_binding(),
        ];
        Ok(Self {
            samples,
            count,
            geometry: geometry.clone(),
            hemispheres: hemispheres.clone(),
            pipeline: tracer.pipeline.clone(),
            of_maps: bind(device, &tracer.maps, &resources),
            nothing: bind(device, &tracer.nothing, &[]),
            of_rays: geometry.bind(device, &tracer.rays),
            unfinished,
            maps: VisibilityMapBuffers {
                planes,
                sky_masks,
                resolution,
                rays: (map_use == MapUse::MapsAndRays).then(|| RayInputs { doubts, geometry: geometry.clone() }),
            },
        })
    }

    /// Maps of samples that are elsewhere, in the same buffers; `None` if the number of maps, their resolution or the geometry differs. What is
    /// recorded next overwrites the maps that were traced before.
    pub fn again(
        &self,
        queue: &wgpu::Queue,
        geometry: &Geometry,
        (scene, mut samples): (&Scene, Vec<PinholeSample>),
    ) -> Option<Self> {
        let Hemispheres { resolution, of_maps } = Hemispheres::number(scene, &mut samples);
        let is_alike = (resolution, of_maps.len() as u32) == (self.maps.resolution, self.count);
        if !is_alike || self.geometry != *geometry || self.maps.rays.is_some() {
            return None;
        }
        queue.write_buffer(&self.hemispheres, 0, &packed(&of_maps));
        Some(Self { samples, ..self.clone() })
    }

    /// Number of dispatches, each of bounded work.
    pub fn dispatch_count(&self) -> u32 {
        self.count.div_ceil(MAPS_PER_DISPATCH)
    }

    /// Records a range of dispatches, up to [`Self::dispatch_count`]. Record each once, in order, in one encoder or in several.
    pub fn record(&self, encoder: &mut wgpu::CommandEncoder, dispatches: Range<u32>) {
        let label = Some("visibility maps");
        if dispatches.start == 0 {
            encoder.clear_buffer(&self.unfinished, 0, None);
        }
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label, ..Default::default() });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(1, &self.nothing, &[]);
        pass.set_bind_group(2, &self.nothing, &[]);
        pass.set_bind_group(3, &self.of_rays, &[]);
        for dispatch in dispatches.start..dispatches.end.min(self.dispatch_count()) {
            let maps = MAPS_PER_DISPATCH.min(self.count - dispatch * MAPS_PER_DISPATCH);
            pass.set_bind_group(0, &self.of_maps, &[dispatch * DYNAMIC_OFFSET as u32]);
            pass.dispatch_workgroups(maps, 1, 1);
        }
    }

    /// The first word of this buffer counts rays that the adapter did not let be finished, once all dispatches are done: the maps are
    /// right if it is 0.
    pub fn unfinished(&self) -> &wgpu::Buffer {
        &self.unfinished
    }

    /// Takes the samples, which carry the numbers of their maps.
    pub(crate) fn take_samples(&mut self) -> Vec<PinholeSample> {
        std::mem::take(&mut self.samples)
    }

    /// The maps, valid once all dispatches are done.
    pub fn maps(&self) -> &VisibilityMapBuffers {
        &self.maps
    }

    /// The samples, which carry the numbers of their maps, and the maps.
    pub fn finish(self) -> (Vec<PinholeSample>, VisibilityMapBuffers) {
        (self.samples, self.maps)
    }
}

/// The contents of the buffer of hemispheres.
fn packed(hemispheres: &[Hemisphere]) -> Vec<u8> {
    let packed: Vec<PackedHemisphere> = hemispheres.iter().map(PackedHemisphere::new).collect();
    filled_storage(bytemuck::cast_slice(&packed)).to_vec()
}

fn doubts_texture(device: &wgpu::Device, texels: u64) -> wgpu::Texture {
    let height = (texels.div_ceil(u64::from(DOUBTS_ROW)) as u32).max(1);
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some("doubts of visibility maps"),
        size: wgpu::Extent3d { width: DOUBTS_ROW, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rg32Uint,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING,
        view_formats: &[],
    })
}

/// The uniforms of all dispatches.
fn dispatch_uniforms(count: u32, resolution: u32, bisections: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    for first_map in (0..count.max(1)).step_by(MAPS_PER_DISPATCH as usize) {
        bytes.extend_from_slice(bytemuck::bytes_of(&MapUniforms { first_map, resolution, bisections, padding: 0 }));
        bytes.resize(bytes.len().next_multiple_of(DYNAMIC_OFFSET as usize), 0);
    }
    bytes
}

impl RayInputs {
    /// Nothing, where no rays are traced.
    pub fn none(device: &wgpu::Device) -> Self {
        let doubts = doubts_texture(device, 1).create_view(&Default::default());
        Self { doubts, geometry: Geometry::none(device) }
    }
}

#[cfg(all(test, feature = "blocking"))]
mod tests {
    use super::*;
    use crate::blocking::wait;
    use crate::gpu::Gpu;
    use crate::pinhole::{Footprint, Pinholes, pinholes};
    use crate::sampling::{Options, Strategy, Surface, sample};
    use crate::scene::load;
    use crate::tracing::Tracer;

    fn samples(scene: &Scene) -> Pinholes {
        let options = Options { samples: 60, strategy: Strategy::Neighbourhood, seed: 1 };
        let set = sample(&Surface::of_scene(scene), &options).unwrap();
        pinholes(scene, &crate::differential::differentials(&set), Footprint::Cells)
    }

    /// Planes, sky masks, and the number of rays that were not finished.
    fn traced(gpu: &Gpu, scene: &Scene, samples: Vec<PinholeSample>) -> (Vec<[f32; 4]>, Vec<u32>) {
        let geometry = Geometry::upload(&gpu.device, &gpu.queue, scene).unwrap();
        let map_tracer = MapTracer::new(&gpu.device);
        let tracing = MapTracing::new(&gpu.device, &map_tracer, &geometry, (scene, samples), MapUse::Maps).unwrap();
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        tracing.record(&mut encoder, 0..tracing.dispatch_count());
        gpu.queue.submit([encoder.finish()]);
        let read = |buffer: &wgpu::Buffer| wait(Some(&gpu.device), gpu.read_buffer(buffer, buffer.size())).unwrap();
        assert_eq!(read(tracing.unfinished())[..4], [0; 4]);
        let (_, maps) = tracing.finish();
        (bytemuck::pod_collect_to_vec(&read(&maps.planes)), bytemuck::pod_collect_to_vec(&read(&maps.sky_masks)))
    }

    /// A GPU traces the maps that the CPU traces, up to rays that pass an edge closely.
    #[test]
    fn both_back_ends_trace_the_same_maps() {
        let gpu = wait(None, Gpu::open(None)).unwrap();
        for name in ["ring-natural", "columns", "spoon"] {
            let scene = load::<toml::Table>(name).unwrap().scene;
            let tracer = Tracer::new(&scene);
            let mut pinholes = samples(&scene);
            let (planes, sky_masks) = traced(&gpu, &scene, pinholes.samples.clone());
            pinholes.trace_visibility(&scene, &tracer, &crate::NoProgress);
            let expected = pinholes.visibility.unwrap();
            assert_eq!((planes.len(), sky_masks.len()), (expected.planes.len(), expected.sky_mask.len()));
            let is_close =
                |(a, b): (&[f32; 4], &[f32; 4])| (0..3).all(|k| (a[k] - b[k]).abs() <= 1e-2 * (1.0 + b[k].abs()));
            let same = planes.iter().zip(&expected.planes).filter(|pair| is_close(*pair)).count();
            let sky_differs: u32 = sky_masks.iter().zip(&expected.sky_mask).map(|(a, b)| (a ^ b).count_ones()).sum();
            // Places of edges, in 64ths of the way between texels.
            let edges = |texel: &[f32; 4]| [10, 2].map(|shift| (texel[3].to_bits() >> shift & 63) as i32);
            let near = |(a, b): (&[f32; 4], &[f32; 4])| (0..2).all(|k| (edges(a)[k] - edges(b)[k]).abs() <= 8);
            let same_edges = planes.iter().zip(&expected.planes).filter(|pair| near(*pair)).count();
            println!("{name}: {same} planes, {same_edges} edges of {}, {sky_differs} of the sky differ", planes.len());
            assert!(expected.sky_mask.iter().any(|&mask| mask != 0) && planes.iter().any(|plane| plane[0] != 0.0));
            assert!(same as f64 > 0.998 * planes.len() as f64, "{name}");
            assert!(same_edges as f64 > 0.99 * planes.len() as f64, "{name}");
            assert!(f64::from(sky_differs) < 1e-3 * planes.len() as f64, "{name}");
        }
    }
}
