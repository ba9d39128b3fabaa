//! The hierarchical gather on the GPU, recorded into the caller's encoder on the caller's device.
//!
//! [`HierarchicalEngine`] is made once per device and filter, [`CellTreeBuffers`] once per tree, [`LightBoundsTexture`] once per
//! light, [`HierarchicalFrame`] once per image. Compute passes look at blocks of receivers and judge pairs of a block and a cell, from
//! the largest blocks to the smallest: what can be interpolated is added at sixteen points of its block, the rest is listed for the
//! next level. A fragment pass interpolates, and lets every pixel walk down from the cells of its block's list.
//!
//! Lists are bounded and reused by run after run of tiles; where one is full, cells are handed on unrefined. Nothing is read back
//! within a frame. Shaders: `blocks`, `cut`, `finish`, `scout`, `light_bounds`; CPU twin: [`crate::pinhole::cpu::gather_hierarchical`].

mod layout;
mod light_bounds;
mod pipelines;
mod tree;

pub use layout::{CellRoot, Stage, TreeUniforms};
pub use light_bounds::{LightBoundsMaker, LightBoundsTexture};
pub use tree::CellTreeBuffers;

use std::ops::Range;

use wgpu::util::DeviceExt;

use self::layout::{BLOCK_BYTES, BLOCKS, LEVELS, POINTS, TILE};
use self::pipelines::Pipelines;
use super::pipeline::bind;
use super::{EnvironmentCube, FrameViewers, bind_receivers, target};
use crate::gpu::GpuError;
use crate::pinhole::{Filter, GatherUniforms, Params};

/// The hierarchical gather's pipelines on one device. It needs nothing beyond what every WebGPU device has.
#[derive(Debug)]
pub struct HierarchicalEngine {
    pipelines: Pipelines,
    filter: Filter,
    visibility: bool,
}

/// What is fixed when an engine is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HierarchicalOptions {
    /// [`Filter::Anisotropic`] or [`Filter::Hardware`]; it is compiled into the shaders.
    pub filter: Filter,
    /// Whether the roots' maps of visibility count.
    pub visibility: bool,
}

/// What one image is gathered from.
#[derive(Clone, Copy, Debug)]
pub struct HierarchicalInputs<'a> {
    /// World positions; `w` is the object's index in the scene, or negative where there is no receiver. Any float format.
    pub positions: &'a wgpu::TextureView,
    /// Unit normals on the side that receives. Any float format.
    pub normals: &'a wgpu::TextureView,
    /// `None`: irradiance is gathered. Else the radiance that receivers reflect to their viewers.
    pub viewers: Option<FrameViewers<'a>>,
    /// Width and height of all.
    pub size: [u32; 2],
    /// Whether neighbours in the textures are neighbours in a picture: then sixteen may stand for many.
    pub is_picture: bool,
    /// The cells; with maps of visibility if, and only if, the engine was made for them.
    pub tree: &'a CellTreeBuffers,
    /// The environment,
    pub environment: &'a EnvironmentCube,
    /// and its bounds.
    pub bounds: &'a LightBoundsTexture,
    /// Parameters; the filter must be the engine's.
    pub params: Params,
    /// How right the sum is to be.
    pub tolerance: Tolerance,
    /// Leaves are quartered for receivers that are nearer to them than they are wide.
    pub split_near: bool,
    /// Passes that share what a pixel does by itself; at least 1. More where an adapter limits loops (see
    /// [`HierarchicalFrame::caustic`]) or the time of a draw.
    pub parts: u32,
}

/// The error that is allowed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tolerance {
    /// W/m²; see [`crate::pinhole::cpu::Accuracy`].
    Absolute(f32),
    /// A part of the image's mean irradiance, which a pass before all others estimates.
    Relative(f32),
}

/// Entries of a list of cells; more if there are more objects than that.
const CAPACITY: u32 = 4096;
/// Bytes of the lists of a run of tiles.
const RUN_BYTES: u64 = 96 << 20;
/// Dynamic offsets of uniforms are multiples of this on every device.
const STAGE_STRIDE: u64 = 256;
/// Bytes of what scouts report.
const REPORT_BYTES: u64 = 64 * 16;

/// One image being gathered.
#[derive(Debug)]
pub struct HierarchicalFrame {
    /// One, or two by turns where there are parts.
    targets: Vec<wgpu::Texture>,
    views: Vec<wgpu::TextureView>,
    scene: wgpu::BindGroup,
    receivers: wgpu::BindGroup,
    work: wgpu::BindGroup,
    /// For each target: the group that reads the other one.
    results: Vec<wgpu::BindGroup>,
    scouts: Option<wgpu::BindGroup>,
    passes: Passes,
    /// Tiles of the image, and of a run.
    tiles: u32,
    tiles_per_run: u32,
    parts: u32,
    /// The nodes above all others, to be copied to where the lists are.
    tops: wgpu::Buffer,
    lists: wgpu::Buffer,
    is_begun: bool,
}

#[derive(Clone, Debug)]
struct Passes {
    blocks: wgpu::ComputePipeline,
    cut: wgpu::ComputePipeline,
    scout: wgpu::ComputePipeline,
    settle: wgpu::ComputePipeline,
    finish: wgpu::RenderPipeline,
}

impl HierarchicalEngine {
    /// Compiles the shaders.
    pub fn new(device: &wgpu::Device, options: &HierarchicalOptions) -> Self {
        let HierarchicalOptions { filter, visibility } = *options;
        Self { pipelines: Pipelines::new(device, filter, visibility), filter, visibility }
    }

    /// Makes what one image needs.
    pub fn frame(&self, device: &wgpu::Device, inputs: &HierarchicalInputs) -> Result<HierarchicalFrame, GpuError> {
        self.check(device, inputs)?;
        let [width, height] = inputs.size;
        let tiles_across = width.div_ceil(TILE);
        let tiles = tiles_across * height.div_ceil(TILE);
        let tops = inputs.tree.top_count;
        let capacity = CAPACITY.max(2 * tops);
        let bytes_per_tile = u64::from(BLOCKS) * u64::from(capacity + 1) * 4;
        let tiles_per_run = ((RUN_BYTES / bytes_per_tile) as u32).clamp(1, tiles);
        let uniforms = TreeUniforms {
            size: inputs.size,
            tiles_across,
            capacity,
            tops,
            first_above: inputs.tree.first_above,
            roots: inputs.tree.root_count,
            may_interpolate: (inputs.is_picture && inputs.viewers.is_none()).into(),
            split_near: inputs.split_near.into(),
            has_viewers: inputs.viewers.is_some().into(),
            area: inputs.tree.area,
            map_texel: inputs.tree.map_resolution.map_or(0.0, |n| std::f32::consts::TAU.sqrt() / n as f32),
        };
        let run = Run::new(device, inputs, tiles, tiles_per_run, bytes_per_tile);
        let layouts = &self.pipelines.layouts;
        let work = [
            run.stage(),
            run.lists.as_entire_binding(),
            run.blocks.as_entire_binding(),
            wgpu::BindingResource::TextureView(&run.smooth),
            run.allowed(),
        ];
        let parts = inputs.parts.max(1);
        let targets: Vec<wgpu::Texture> = (0..parts.min(2)).map(|_| target(device, inputs.size)).collect();
        let views: Vec<wgpu::TextureView> = targets.iter().map(|t| t.create_view(&Default::default())).collect();
        let result = |other: &wgpu::TextureView| {
            let resources = [
                run.stage(),
                run.lists.as_entire_binding(),
                wgpu::BindingResource::TextureView(&run.smooth),
                run.allowed(),
                wgpu::BindingResource::TextureView(other),
            ];
            bind(device, &layouts.result, &resources)
        };
        // Without parts nothing is read from there.
        let results = match views.as_slice() {
            [first, second] => vec![result(second), result(first)],
            _ => vec![result(&run.smooth)],
        };
        let scouts = matches!(inputs.tolerance, Tolerance::Relative(_)).then(|| {
            let resources = [run.reports.as_entire_binding(), run.tolerance.as_entire_binding()];
            bind(device, &layouts.scouts, &resources)
        });
        let Pipelines { blocks, cut, scout, settle, finish, reflect, .. } = &self.pipelines;
        let finish = if inputs.viewers.is_some() { reflect } else { finish };
        Ok(HierarchicalFrame {
            targets,
            views,
            scene: self.bind_scene(device, inputs, &uniforms),
            receivers: bind_receivers(device, &layouts.receivers, [inputs.positions, inputs.normals], inputs.viewers),
            work: bind(device, &layouts.work, &work),
            results,
            scouts,
            passes: Passes {
                blocks: blocks.clone(),
                cut: cut.clone(),
                scout: scout.clone(),
                settle: settle.clone(),
                finish: finish.clone(),
            },
            tiles,
            tiles_per_run,
            parts,
            tops: inputs.tree.tops.clone(),
            lists: run.lists,
            is_begun: false,
        })
    }

    fn check(&self, device: &wgpu::Device, inputs: &HierarchicalInputs) -> Result<(), GpuError> {
        if inputs.params.filter != self.filter {
            return Err(GpuError::OtherFilter { engine: self.filter.name(), params: inputs.params.filter.name() });
        }
        if inputs.tree.map_resolution.is_some() != self.visibility {
            return Err(GpuError::OtherVisibility { engine: self.visibility });
        }
        super::check_image(&device.limits(), inputs.size)
    }

    fn bind_scene(
        &self,
        device: &wgpu::Device,
        inputs: &HierarchicalInputs,
        uniforms: &TreeUniforms,
    ) -> wgpu::BindGroup {
        let (cube, tree) = (inputs.environment, inputs.tree);
        let gather = GatherUniforms {
            map_resolution: tree.map_resolution.unwrap_or(0),
            ..GatherUniforms::new(&inputs.params, &Default::default(), cube.size(), cube.radiance_scale())
        };
        let gather = uniform_buffer(device, "gather uniforms", bytemuck::bytes_of(&gather));
        let uniforms = uniform_buffer(device, "tree uniforms", bytemuck::bytes_of(uniforms));
        let resources = [
            gather.as_entire_binding(),
            uniforms.as_entire_binding(),
            wgpu::BindingResource::TextureView(cube.view()),
            wgpu::BindingResource::Sampler(&self.pipelines.trilinear),
            wgpu::BindingResource::Sampler(&self.pipelines.anisotropic),
            wgpu::BindingResource::TextureView(&inputs.bounds.view),
            tree.nodes.as_entire_binding(),
            tree.roots.as_entire_binding(),
            tree.curves.as_entire_binding(),
            tree.planes.as_entire_binding(),
            tree.open.as_entire_binding(),
        ];
        bind(device, &self.pipelines.layouts.scene, &resources)
    }
}

/// What a run of tiles works on; the next one uses it again.
struct Run {
    stages: wgpu::Buffer,
    lists: wgpu::Buffer,
    blocks: wgpu::Buffer,
    smooth: wgpu::TextureView,
    reports: wgpu::Buffer,
    tolerance: wgpu::Buffer,
}

impl Run {
    fn new(device: &wgpu::Device, inputs: &HierarchicalInputs, tiles: u32, per_run: u32, bytes_per_tile: u64) -> Self {
        let blocks = u64::from(per_run * BLOCKS);
        let empty = |label, size| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let smooth = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("sums at blocks' points"),
            size: wgpu::Extent3d { width: BLOCKS * POINTS, height: per_run, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING,
            view_formats: &[],
        });
        let (Tolerance::Absolute(error) | Tolerance::Relative(error)) = inputs.tolerance;
        let tolerance = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("tolerance"),
            // Allowed at a point, and as a part of what is typical: one of them is not read.
            contents: bytemuck::cast_slice(&[error; 8]),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::UNIFORM,
        });
        Self {
            stages: uniform_buffer(device, "stages", &stages(tiles, per_run, inputs.parts.max(1))),
            lists: empty("lists of cells", u64::from(inputs.tree.top_count) * 4 + bytes_per_tile * u64::from(per_run)),
            blocks: empty("blocks of receivers", blocks * BLOCK_BYTES),
            smooth: smooth.create_view(&Default::default()),
            reports: empty("scouts' reports", REPORT_BYTES),
            tolerance,
        }
    }

    fn stage(&self) -> wgpu::BindingResource<'_> {
        let size = std::num::NonZero::new(size_of::<Stage>() as u64);
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &self.stages, offset: 0, size })
    }

    fn allowed(&self) -> wgpu::BindingResource<'_> {
        let size = std::num::NonZero::new(16);
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &self.tolerance, offset: 0, size })
    }
}

/// The stages of all runs: level by level, then part by part.
fn stages(tiles: u32, per_run: u32, parts: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    for first_tile in (0..tiles).step_by(per_run as usize) {
        let of_levels = (0..LEVELS).map(|level| Stage { first_tile, level, part: 0, parts });
        let of_parts = (0..parts).map(|part| Stage { first_tile, level: LEVELS, part, parts });
        for stage in of_levels.chain(of_parts) {
            bytes.extend_from_slice(bytemuck::bytes_of(&stage));
            bytes.resize(bytes.len().next_multiple_of(STAGE_STRIDE as usize), 0);
        }
    }
    bytes
}

impl HierarchicalFrame {
    /// Number of runs of tiles. Work, and memory, of a run are bounded.
    pub fn run_count(&self) -> u32 {
        self.tiles.div_ceil(self.tiles_per_run)
    }

    /// Records a range of runs. Record every run once, in order, in one encoder or in several.
    pub fn record(&mut self, encoder: &mut wgpu::CommandEncoder, runs: Range<u32>) {
        if !self.is_begun {
            encoder.copy_buffer_to_buffer(&self.tops, 0, &self.lists, 0, self.tops.size());
            if let Some(scouts) = &self.scouts {
                self.record_scouts(encoder, scouts);
            }
            self.is_begun = true;
        }
        for run in runs {
            let tiles = self.tiles_per_run.min(self.tiles - run * self.tiles_per_run);
            self.record_cuts(encoder, run, tiles);
            (0..self.parts).for_each(|part| self.record_finish(encoder, run, tiles, part));
        }
    }

    fn record_scouts(&self, encoder: &mut wgpu::CommandEncoder, scouts: &wgpu::BindGroup) {
        let mut pass =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("scouts"), ..Default::default() });
        for (group, bound) in (0..).zip([&self.scene, &self.receivers, scouts]) {
            pass.set_bind_group(group, bound, &[]);
        }
        pass.set_pipeline(&self.passes.scout);
        pass.dispatch_workgroups((REPORT_BYTES / 16) as u32, 1, 1);
        pass.set_pipeline(&self.passes.settle);
        pass.dispatch_workgroups(1, 1, 1);
    }

    fn record_cuts(&self, encoder: &mut wgpu::CommandEncoder, run: u32, tiles: u32) {
        let mut pass =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("cuts"), ..Default::default() });
        pass.set_bind_group(0, &self.scene, &[]);
        pass.set_bind_group(1, &self.receivers, &[]);
        let mut dispatch = |pipeline, level: u32| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(2, &self.work, &[self.stage(run, level)]);
            pass.dispatch_workgroups(tiles << (2 * level), 1, 1);
        };
        // Blocks are known by their parts, cuts by those of larger blocks.
        (0..LEVELS).rev().for_each(|level| dispatch(&self.passes.blocks, level));
        (0..LEVELS).for_each(|level| dispatch(&self.passes.cut, level));
    }

    fn record_finish(&self, encoder: &mut wgpu::CommandEncoder, run: u32, tiles: u32, part: u32) {
        let target = part as usize % self.views.len();
        let load = if run == 0 { wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT) } else { wgpu::LoadOp::Load };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("finish"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.views[target],
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.passes.finish);
        pass.set_bind_group(0, &self.scene, &[]);
        pass.set_bind_group(1, &self.receivers, &[]);
        pass.set_bind_group(2, &self.results[target], &[self.stage(run, LEVELS + part)]);
        pass.draw(0..6, 0..tiles);
    }

    /// Where a stage of a run is among all.
    fn stage(&self, run: u32, number: u32) -> u32 {
        (run * (LEVELS + self.parts) + number) * STAGE_STRIDE as u32
    }

    /// The caustic: rgb = irradiance, W/m²; a = number of fetches, or negative where the adapter ended a shader's loop before it
    /// was done (Mesa's software adapter does after 65,535 iterations): give more parts. Complete once all runs are recorded and
    /// submitted.
    pub fn caustic(&self) -> &wgpu::Texture {
        &self.targets[(self.parts as usize - 1) % self.targets.len()]
    }
}

fn uniform_buffer(device: &wgpu::Device, label: &str, contents: &[u8]) -> wgpu::Buffer {
    let usage = wgpu::BufferUsages::UNIFORM;
    device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: Some(label), contents, usage })
}
