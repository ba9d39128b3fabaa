//! Bounds of the light, as a texture: uploaded, or made on the GPU for light that changes.

use super::super::EnvironmentCube;
use super::super::medium::{MaxAlongArcs, UNBOUNDED_ARCS};
use super::super::pipeline::{bind, compute_pipeline, cube, entry, layout, sampler, seen_by, window, writable};
use super::super::shaders::LIGHT_BOUNDS;
use super::layout::BOUNDS_WORKGROUP_EDGE;

use super::{DYNAMIC_OFFSET, uniform_buffer};
use crate::environment::{Bound, FACES, FINEST_BOUNDS, FIRST_BOUNDED_MIP, LightBounds, mip_of_pyramid};
use crate::gpu::GpuError;
use crate::pinhole::SurroundingView;

/// Bounds of an environment's radiance and of that of its mips, as textures: each texel holds the maximum and the
/// contrast around it.
#[derive(Clone, Debug)]
pub struct LightBoundsTexture {
    /// Six layers with all mips.
    pub(super) light: BoundsTexture,
    /// The bounds of the environment's mips from [`FIRST_BOUNDED_MIP`] on: six layers each. The finest level has as many texels as the first
    /// of them.
    pub(super) mips: BoundsTexture,
    /// The largest means along arcs, as far as they are known.
    pub(super) along_arcs: MaxAlongArcs,
}

/// A texture of bounds.
#[derive(Clone, Debug)]
pub(super) struct BoundsTexture {
    texture: wgpu::Texture,
    view: wgpu::TextureView,
}

impl LightBoundsTexture {
    /// Empty textures for a cube of so many texels along an edge.
    fn new(device: &wgpu::Device, size: u32, usage: wgpu::TextureUsages) -> Self {
        // A cube that has no further mips gets a texture all the same, as a pipeline binds one.
        let mips = (size.ilog2() + 1).saturating_sub(FIRST_BOUNDED_MIP).max(1);
        Self {
            light: BoundsTexture::new(device, size, FACES as u32, usage),
            mips: BoundsTexture::new(device, (size >> FIRST_BOUNDED_MIP).max(1), FACES as u32 * mips, usage),
            along_arcs: UNBOUNDED_ARCS,
        }
    }

    /// What is bound where the light is no environment.
    pub(in crate::pinhole::gpu) fn none(device: &wgpu::Device) -> Self {
        Self::new(device, 1, wgpu::TextureUsages::TEXTURE_BINDING)
    }

    /// Uploads bounds of the views of surroundings: six layers each. Their mips have none of their own.
    pub(in crate::pinhole::gpu) fn of_views(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        views: &[SurroundingView],
    ) -> Self {
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let size = views.first().map_or(1, |view| view.bounds.size());
        let light = BoundsTexture::new(device, size, (FACES * views.len()) as u32, usage);
        for (k, view) in views.iter().enumerate() {
            for (level, (edge, texels)) in (0..).zip(view.bounds.pyramids().next().into_iter().flatten()) {
                light.write(queue, (level, (FACES * k) as u32), edge, texels);
            }
        }
        Self { light, mips: BoundsTexture::new(device, 1, FACES as u32, usage), along_arcs: UNBOUNDED_ARCS }
    }

    /// Uploads bounds that the CPU made.
    pub fn upload(device: &wgpu::Device, queue: &wgpu::Queue, bounds: &LightBounds) -> Self {
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let mut textures = Self::new(device, bounds.size(), usage);
        textures.along_arcs.iter_mut().zip(bounds.along_arcs()).for_each(|(bound, known)| *bound = *known);
        for (pyramid, levels) in bounds.pyramids().enumerate() {
            let (texture, first_level, first_layer) = textures.place(pyramid as u32);
            for (level, (edge, texels)) in (first_level..).zip(levels) {
                texture.write(queue, (level, first_layer), edge, texels);
            }
        }
        textures
    }

    /// Where a pyramid is: its texture, the level of its finest texels, and its first layer.
    fn place(&self, pyramid: u32) -> (&BoundsTexture, u32, u32) {
        match pyramid {
            0 => (&self.light, 0, 0),
            _ => (&self.mips, pyramid - 1, (pyramid - 1) * FACES as u32),
        }
    }

    /// The bounds of the radiance itself, two floats a texel: the maximum, and the contrast, W/(m²·sr). Six layers.
    pub fn texture(&self) -> &wgpu::Texture {
        &self.light.texture
    }
}

impl BoundsTexture {
    fn new(device: &wgpu::Device, size: u32, layers: u32, usage: wgpu::TextureUsages) -> Self {
        let texture = device.create_texture(&descriptor(size, layers, usage));
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        });
        Self { texture, view }
    }

    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }

    /// Writes the six faces of a level.
    fn write(&self, queue: &wgpu::Queue, (mip_level, first_layer): (u32, u32), edge: u32, texels: &[Bound]) {
        let bytes: Vec<[f32; 2]> = texels.iter().map(|bound| [bound.max, bound.contrast]).collect();
        let origin = wgpu::Origin3d { x: 0, y: 0, z: first_layer };
        let to = wgpu::TexelCopyTextureInfo { mip_level, origin, ..self.texture.as_image_copy() };
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(8 * edge), rows_per_image: Some(edge) };
        let size = wgpu::Extent3d { width: edge, height: edge, depth_or_array_layers: FACES as u32 };
        queue.write_texture(to, bytemuck::cast_slice(&bytes), layout, size);
    }

    /// Six layers of a level.
    fn level(&self, level: u32, first_layer: u32) -> wgpu::TextureView {
        self.texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            base_mip_level: level,
            mip_level_count: Some(1),
            base_array_layer: first_layer,
            array_layer_count: Some(FACES as u32),
            ..Default::default()
        })
    }
}

/// Makes bounds on the GPU, again whenever the light has changed. It is made once per environment.
#[derive(Debug)]
pub struct LightBoundsBuilder {
    bounds: LightBoundsTexture,
    /// In the order in which they run: pipeline, its level's group, offset of its uniforms, workgroups along an edge.
    steps: Vec<Step>,
    light: wgpu::BindGroup,
}

#[derive(Debug)]
struct Step {
    pipeline: wgpu::ComputePipeline,
    target: wgpu::BindGroup,
    offset: u32,
    workgroups: u32,
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(in crate::pinhole::gpu) struct BoundsUniforms {
    pub size: u32,
    pub first: u32,
    pub first_above: u32,
    pub detail: u32,
    pub mip: u32,
    pub radiance_scale: f32,
    padding: [u32; 2],
}

/// Bytes of a texel's extremes.
const EXTREMES: u64 = 32;

impl LightBoundsBuilder {
    /// Compiles the shaders and makes the texture. The cube's size must be a power of two.
    pub fn new(device: &wgpu::Device, environment: &EnvironmentCube) -> Result<Self, GpuError> {
        Self::with_finest(device, environment, FINEST_BOUNDS)
    }

    fn with_finest(device: &wgpu::Device, environment: &EnvironmentCube, finest: u32) -> Result<Self, GpuError> {
        if !environment.size().is_power_of_two() {
            return Err(GpuError::CubeSize { size: environment.size() });
        }
        let size = environment.size().min(finest);
        let usage =
            wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::COPY_SRC;
        let bounds = LightBoundsTexture::new(device, size, usage);
        let compute = wgpu::ShaderStages::COMPUTE;
        let of_light = [window(0), cube(1), sampler(2), writable(3)].map(|entry| seen_by(compute, entry));
        let of_light = layout(device, "light", &of_light);
        let of_target = layout(device, "bounds of a level", &[seen_by(compute, written(0))]);
        let levels = levels(environment.size(), size);
        let light = bind_light(device, &of_light, environment, &levels);
        let pipelines = BoundsPipelines::new(device, [&of_light, &of_target]);
        let mut steps = Vec::new();
        for (index, level) in levels.iter().enumerate() {
            let (texture, first_level, first_layer) = bounds.place(level.pyramid);
            let target = texture.level(first_level + level.number, first_layer);
            let target = bind(device, &of_target, &[wgpu::BindingResource::TextureView(&target)]);
            for pipeline in pipelines.of_level(level.number) {
                let workgroups = level.size.div_ceil(BOUNDS_WORKGROUP_EDGE);
                let offset = index as u32 * DYNAMIC_OFFSET as u32;
                steps.push(Step { pipeline: pipeline.clone(), target: target.clone(), offset, workgroups });
            }
        }
        Ok(Self { bounds, steps, light })
    }

    /// Records the making of the bounds of what is in the cube when that is executed.
    pub fn record(&self, encoder: &mut wgpu::CommandEncoder) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("bounds of the light"),
            ..Default::default()
        });
        for step in &self.steps {
            pass.set_pipeline(&step.pipeline);
            pass.set_bind_group(0, &self.light, &[step.offset]);
            pass.set_bind_group(1, &step.target, &[]);
            pass.dispatch_workgroups(step.workgroups, step.workgroups, FACES as u32);
        }
    }

    /// The bounds, as recorded last.
    pub fn bounds(&self) -> &LightBoundsTexture {
        &self.bounds
    }
}

/// A level of a pyramid of bounds.
struct Level {
    pyramid: u32,
    /// From the pyramid's finest one.
    number: u32,
    /// Texels along an edge.
    size: u32,
    /// The mip of the cube that the pyramid bounds, and its texels along an edge for each of the pyramid's finest level.
    mip: u32,
    detail: u32,
}

/// The levels of all pyramids of a cube, if the finest one has `finest` texels along an edge.
fn levels(cube: u32, finest: u32) -> Vec<Level> {
    let of_pyramid = |pyramid: u32| {
        let size = finest >> mip_of_pyramid(pyramid);
        let (mip, detail) = match pyramid {
            0 => (0, cube / finest),
            _ => ((cube / size).ilog2(), 1),
        };
        (0..=size.ilog2()).map(move |number| Level { pyramid, number, size: size >> number, mip, detail })
    };
    (0..=(finest.ilog2() + 1).saturating_sub(FIRST_BOUNDED_MIP)).flat_map(of_pyramid).collect()
}

/// The uniforms of all levels, and how many vectors their extremes take.
fn uniforms_of_levels(environment: &EnvironmentCube, levels: &[Level]) -> (Vec<u8>, u32) {
    let (mut bytes, mut first, mut first_above) = (Vec::new(), 0, 0);
    for &Level { number, size, mip, detail, .. } in levels {
        let radiance_scale = environment.radiance_scale();
        let uniforms = BoundsUniforms { size, first, first_above, detail, mip, radiance_scale, padding: [0; 2] };
        bytes.extend_from_slice(bytemuck::bytes_of(&uniforms));
        bytes.resize(bytes.len().next_multiple_of(DYNAMIC_OFFSET as usize), 0);
        // The finest level's extremes are the cube's texels.
        if number > 0 {
            first_above = first;
            first += 2 * FACES as u32 * size * size;
        }
    }
    (bytes, first)
}

/// Binds the cube, the uniforms of all levels, and room for their extremes.
fn bind_light(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    environment: &EnvironmentCube,
    levels: &[Level],
) -> wgpu::BindGroup {
    let (uniforms, vectors) = uniforms_of_levels(environment, levels);
    let uniforms = uniform_buffer(device, "levels of bounds", &uniforms);
    let extremes = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("extremes of the light"),
        size: (u64::from(vectors) / 2).max(1) * EXTREMES,
        usage: wgpu::BufferUsages::STORAGE,
        mapped_at_creation: false,
    });
    let nearest = device.create_sampler(&wgpu::SamplerDescriptor::default());
    let window = wgpu::BufferBinding {
        buffer: &uniforms,
        offset: 0,
        size: std::num::NonZero::new(size_of::<BoundsUniforms>() as u64),
    };
    let resources = [
        wgpu::BindingResource::Buffer(window),
        wgpu::BindingResource::TextureView(environment.view()),
        wgpu::BindingResource::Sampler(&nearest),
        extremes.as_entire_binding(),
    ];
    bind(device, layout, &resources)
}

/// The pipelines of extremes, and of bounds of them.
struct BoundsPipelines {
    bound_cube: wgpu::ComputePipeline,
    downsample_cube: wgpu::ComputePipeline,
    downsample: wgpu::ComputePipeline,
    bound: wgpu::ComputePipeline,
}

impl BoundsPipelines {
    fn new(device: &wgpu::Device, groups: [&wgpu::BindGroupLayout; 2]) -> Self {
        let module = LIGHT_BOUNDS.module(device);
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("bounds of the light"),
            bind_group_layouts: &groups.map(Some),
            immediate_size: 0,
        });
        let compute = |entry: &str| compute_pipeline(device, &layout, &module, entry, &[]);
        Self {
            bound_cube: compute("bound_cube"),
            downsample_cube: compute("downsample_cube"),
            downsample: compute("downsample"),
            bound: compute("bound"),
        }
    }

    fn of_level(&self, level: u32) -> Vec<&wgpu::ComputePipeline> {
        match level {
            0 => vec![&self.bound_cube],
            1 => vec![&self.downsample_cube, &self.bound],
            _ => vec![&self.downsample, &self.bound],
        }
    }
}

fn written(binding: u32) -> wgpu::BindGroupLayoutEntry {
    let ty = wgpu::BindingType::StorageTexture {
        access: wgpu::StorageTextureAccess::WriteOnly,
        format: wgpu::TextureFormat::Rg32Float,
        view_dimension: wgpu::TextureViewDimension::D2Array,
    };
    entry(binding, ty)
}

fn descriptor(size: u32, layers: u32, usage: wgpu::TextureUsages) -> wgpu::TextureDescriptor<'static> {
    wgpu::TextureDescriptor {
        label: Some("bounds of the light"),
        size: wgpu::Extent3d { width: size, height: size, depth_or_array_layers: layers },
        mip_level_count: size.ilog2() + 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rg32Float,
        usage,
        view_formats: &[],
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::blocking::wait;
    use crate::environment::CubeMap;
    use crate::gpu::Gpu;

    /// The texels of a level, of six layers: face by face, row by row.
    fn read_level(gpu: &Gpu, texture: &wgpu::Texture, level: u32, first_layer: u32) -> Vec<[f32; 2]> {
        let size = texture.width() >> level;
        let row = (size * 8).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let bytes = u64::from(row * size) * FACES as u64;
        let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
        let descriptor = wgpu::BufferDescriptor { label: None, size: bytes, usage, mapped_at_creation: false };
        let buffer = gpu.device.create_buffer(&descriptor);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let origin = wgpu::Origin3d { x: 0, y: 0, z: first_layer };
        let source = wgpu::TexelCopyTextureInfo { mip_level: level, origin, ..texture.as_image_copy() };
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: Some(size) };
        let extent = wgpu::Extent3d { width: size, height: size, depth_or_array_layers: FACES as u32 };
        encoder.copy_texture_to_buffer(source, wgpu::TexelCopyBufferInfo { buffer: &buffer, layout }, extent);
        gpu.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |mapped| mapped.unwrap());
        wait(Some(&gpu.device), gpu.submitted_work_done()).unwrap();
        let mapped = buffer.get_mapped_range(..).unwrap();
        let rows = mapped.chunks(row as usize);
        rows.flat_map(|row| row[..size as usize * 8].chunks(8).map(bytemuck::pod_read_unaligned)).collect()
    }

    /// Every texel of every level, with and without texels of the cube that share one of the bounds', and again when the light has
    /// changed.
    #[test]
    fn bounds_made_on_the_gpu_are_those_of_the_cpu() {
        let gpu = wait(None, Gpu::open(None))
            .unwrap_or_else(|e| panic!("GPU tests need an adapter; run them by tests/run: {e}"));
        let light = |turn: f32| {
            CubeMap::from_radiance(32, None, move |d| {
                Vec3::new((9.0 * d.x + turn).sin().abs(), 1.0 + d.y, (40.0 * (d.z - 1.0)).exp() * 9.0)
            })
        };
        for (finest, turn) in [(64, 0.0), (8, 0.0), (8, 1.0)] {
            let cube = light(turn);
            let uploaded = EnvironmentCube::upload(&gpu.device, &gpu.queue, &cube).unwrap();
            let builder = LightBoundsBuilder::with_finest(&gpu.device, &uploaded, finest).unwrap();
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            builder.record(&mut encoder);
            gpu.queue.submit([encoder.finish()]);
            for (pyramid, levels) in LightBounds::with_finest(&cube, finest).pyramids().enumerate() {
                let (texture, first_level, first_layer) = builder.bounds().place(pyramid as u32);
                for (level, (size, expected)) in (first_level..).zip(levels) {
                    let made = read_level(&gpu, &texture.texture, level, first_layer);
                    assert_eq!(made.len(), expected.len());
                    for (k, (made, expected)) in made.iter().zip(expected).enumerate() {
                        let off = (made[0] - expected.max).abs().max((made[1] - expected.contrast).abs());
                        assert!(off < 1e-4, "pyramid {pyramid}, level of {size}, texel {k}: {made:?} {expected:?}");
                    }
                }
            }
        }
    }
}
