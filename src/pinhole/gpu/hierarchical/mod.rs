//! The hierarchical gather on the GPU, recorded into the caller's encoder on the caller's device.
//!
//! [`HierarchicalEngine`] is made once per device and filter, [`CellTreeBuffers`] once per tree, [`LightBoundsTexture`] once per
//! light, [`HierarchicalFrame`] once per image. Compute passes look at blocks of receivers and judge pairs of a block and a cell, from
//! the largest blocks to the smallest: what can be interpolated is added at sixteen points of its block, the rest is listed for the
//! next level. A fragment pass interpolates, and lets every pixel walk down from the cells of its block's list.
//!
//! Lists are bounded and reused by run after run of tiles; where one is full, cells are handed on unrefined. Nothing is read back
//! within a frame. Shaders: `blocks`, `cut`, `finish`, `scout`, `light_bounds`; CPU twin: [`crate::pinhole::cpu::gather_hierarchical`].

mod frame;
mod layout;
mod light_bounds;
mod pipelines;
mod run;
mod tree;

pub use frame::HierarchicalFrame;
pub use layout::{CellRoot, Stage, TreeUniforms};
pub use light_bounds::{LightBoundsMaker, LightBoundsTexture};
pub use tree::CellTreeBuffers;

use wgpu::util::DeviceExt;

use self::frame::Passes;
use self::layout::{BLOCKS, TILE};
use self::pipelines::Pipelines;
use self::run::Run;
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

fn uniform_buffer(device: &wgpu::Device, label: &str, contents: &[u8]) -> wgpu::Buffer {
    let usage = wgpu::BufferUsages::UNIFORM;
    device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: Some(label), contents, usage })
}
