//! The hierarchical gather on the GPU, recorded into the caller's encoder on the caller's device.
//!
//! [`HierarchicalEngine`] is made once per device and filter, [`CellTreeBuffers`] once per tree, [`LightBoundsTexture`] once per
//! light, [`HierarchicalFrame`] once per image. Compute passes make blocks of receivers and refine pairs of a block and a cell, from
//! the largest blocks to the smallest: what can be interpolated is added at sixteen points of its block, the rest is listed for the
//! next level. A fragment pass interpolates, and lets every pixel traverse the tree from the cells of its block's list down.
//!
//! Lists are bounded and reused by batch after batch of tiles; where one is full, cells are handed on unrefined. Nothing is read
//! back within a frame. Shaders: `receiver_blocks`, `refine`, `resolve`, `irradiance_estimate`, `light_bounds`. The CPU's
//! [`crate::pinhole::cpu::gather_hierarchical`] applies the same criteria in another order; see `shaders/README.md`.

mod frame;
pub(super) mod layout;
pub(super) mod light_bounds;
pub(super) mod pipelines;
mod tile_batch;
mod tree;

pub use frame::HierarchicalFrame;
pub use light_bounds::{LightBoundsBuilder, LightBoundsTexture};
pub use tree::CellTreeBuffers;

use self::layout::{BLOCKS_PER_TILE, ESTIMATE_WORKGROUPS, TreeUniforms};
use self::pipelines::Pipelines;
use self::tile_batch::TileBatch;
use super::maps::{RayInputs, VisibilityMapBuffers};
use super::pipeline::{bind, bind_numbered};
use super::{
    EnvironmentCube, FrameLight, FrameViewers, LightKind, TARGET_FORMAT, UploadedLamp, UploadedSurroundings,
    bind_receivers, target,
};
use crate::gpu::{GpuError, buffer_with};
use crate::pinhole::constants::TILE_SIZE;
use crate::pinhole::{Filter, Params, Pinholes};

/// The hierarchical gather's pipelines on one device. It needs nothing beyond what every WebGPU device has.
#[derive(Debug)]
pub struct HierarchicalEngine {
    pipelines: Pipelines,
    options: HierarchicalOptions,
}

/// What is fixed when an engine is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HierarchicalOptions {
    /// [`Filter::Anisotropic`] or [`Filter::Hardware`]; it is compiled into the shaders.
    pub filter: Filter,
    /// What the light is; only an environment takes other filters than the anisotropic one.
    pub light: LightKind,
    /// Whether the samples' visibility maps count.
    pub visibility: bool,
    /// Whether cells may be on interfaces between two media; without, the shaders are faster.
    pub refraction: bool,
    /// Whether there may be a medium, and receivers that are parts of rays through it; likewise.
    pub medium: bool,
}

/// What one image is gathered from.
#[derive(Clone, Copy, Debug)]
pub struct HierarchicalInputs<'a> {
    /// World positions; `w` is the object's index in the scene, or negative where there is no receiver. Any float format.
    pub positions: &'a wgpu::TextureView,
    /// Unit normals on the side that receives; of parts of rays, whose object is [`MEDIUM_OBJECT`](crate::pinhole::MEDIUM_OBJECT), the
    /// way from one end to the other, towards the viewer, metres. Any float format.
    pub normals: &'a wgpu::TextureView,
    /// `None`: irradiance is gathered. Else the radiance that receivers reflect to their viewers.
    pub viewers: Option<FrameViewers<'a>>,
    /// Width and height of all.
    pub size: [u32; 2],
    /// Whether neighbours in the textures are neighbours in a picture: then sixteen may stand for many.
    pub is_grid: bool,
    /// The cells; with visibility maps if, and only if, the engine was made for them.
    pub tree: &'a CellTreeBuffers,
    /// The light, of the engine's kind.
    pub light: TreeLight<'a>,
    /// Parameters; the filter must be the engine's.
    pub params: Params,
    /// How right the sum is to be.
    pub tolerance: Tolerance,
    /// The fourth component of a normal is an error that may be made at its receiver beyond the tolerance, W/m².
    pub has_tolerances: bool,
    /// Leaves are quartered for receivers that are nearer to them than they are wide.
    pub split_near: bool,
    /// Passes that the pixels' own work is split into, from 1 to 4096: all but the last do a bounded part of it. More where an adapter
    /// limits loops (see [`HierarchicalFrame::caustic`]) or the time of a draw.
    pub split_passes: u32,
}

/// The light of one hierarchical gather; several lights are several gathers.
#[derive(Clone, Copy, Debug)]
pub enum TreeLight<'a> {
    /// An environment, and bounds of its radiance.
    Environment {
        /// Its radiance.
        cube: &'a EnvironmentCube,
        /// Bounds of that.
        bounds: &'a LightBoundsTexture,
    },
    /// A lamp.
    Lamp(&'a UploadedLamp),
    /// Lit surfaces.
    Surroundings(&'a UploadedSurroundings),
}

impl<'a> TreeLight<'a> {
    /// What it is.
    pub fn kind(&self) -> LightKind {
        self.without_bounds().kind()
    }

    fn without_bounds(&self) -> FrameLight<'a> {
        match *self {
            Self::Environment { cube, .. } => FrameLight::Environment(cube),
            Self::Lamp(lamp) => FrameLight::Lamp(lamp),
            Self::Surroundings(surfaces) => FrameLight::Surroundings(surfaces),
        }
    }

    fn bounds(&self) -> Option<&'a LightBoundsTexture> {
        match *self {
            Self::Environment { bounds, .. } => Some(bounds),
            Self::Lamp(_) => None,
            Self::Surroundings(surfaces) => Some(&surfaces.bounds),
        }
    }
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
const LIST_CAPACITY: u32 = 4096;
/// Bytes of the lists of a batch of tiles.
const BATCH_LIST_BYTES: u64 = 96 << 20;
/// The most passes that an image's work is split into.
const MAX_SPLIT_PASSES: u32 = 4096;
/// The format of the texture that says where walks stopped.
const WALK_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Uint;
/// Dynamic offsets of uniforms are multiples of this on every device.
pub(crate) const DYNAMIC_OFFSET: u64 = 256;
/// Bytes of the partial sums of an irradiance estimate.
const PARTIAL_SUM_BYTES: u64 = ESTIMATE_WORKGROUPS as u64 * 16;

/// How an image is divided into tiles, and their work into passes.
#[derive(Clone, Copy, Debug)]
struct Tiling {
    /// Tiles along a row and a column.
    across: u32,
    down: u32,
    /// Entries of a block's list.
    list_capacity: u32,
    /// Tiles in a batch.
    per_batch: u32,
    split_passes: u32,
}

impl Tiling {
    fn new(inputs: &HierarchicalInputs) -> Self {
        let [across, down] = inputs.size.map(|pixels| pixels.div_ceil(TILE_SIZE));
        let list_capacity = LIST_CAPACITY.max(2 * inputs.tree.root_count);
        let split_passes = inputs.split_passes.clamp(1, MAX_SPLIT_PASSES);
        let one = Self { across, down, list_capacity, per_batch: 1, split_passes };
        let per_batch = ((BATCH_LIST_BYTES / one.bytes_per_tile()) as u32).clamp(1, one.count().max(1));
        Self { per_batch, ..one }
    }

    fn count(&self) -> u32 {
        self.across * self.down
    }

    /// Of the nodes without a parent, and of all lists of a batch.
    fn list_bytes(&self, tree: &CellTreeBuffers) -> u64 {
        u64::from(tree.root_count) * 4 + self.bytes_per_tile() * u64::from(self.per_batch)
    }

    /// Of its blocks' lists.
    fn bytes_per_tile(&self) -> u64 {
        u64::from(BLOCKS_PER_TILE) * u64::from(self.list_capacity + 1) * 4
    }
}

impl HierarchicalEngine {
    /// Compiles the shaders; towards viewers when a frame first has some.
    pub fn new(device: &wgpu::Device, options: &HierarchicalOptions) -> Self {
        Self { pipelines: Pipelines::new(device, options), options: *options }
    }

    /// Makes what one image needs.
    pub fn frame(&self, device: &wgpu::Device, inputs: &HierarchicalInputs) -> Result<HierarchicalFrame, GpuError> {
        self.check(device, inputs)?;
        let tiling = Tiling::new(inputs);
        let batch = TileBatch::new(device, inputs, &tiling);
        let layouts = &self.pipelines.layouts;
        let count = tiling.split_passes.min(2);
        let targets: Vec<wgpu::Texture> = (0..count).map(|_| target(device, inputs.size, TARGET_FORMAT)).collect();
        let view = |texture: &wgpu::Texture| texture.create_view(&Default::default());
        let views: Vec<ResolveTarget> = targets
            .iter()
            .map(|sum| ResolveTarget { sum: view(sum), walk: view(&target(device, inputs.size, WALK_FORMAT)) })
            .collect();
        let estimate = matches!(inputs.tolerance, Tolerance::Relative(_)).then(|| {
            let resources = [batch.partial_sums.as_entire_binding(), batch.tolerance.as_entire_binding()];
            bind(device, &layouts.estimate, &resources)
        });
        let traced = inputs.tree.maps.as_ref().and_then(|maps| maps.rays.clone());
        let rays = traced.clone().unwrap_or_else(|| RayInputs::none(device));
        Ok(HierarchicalFrame {
            scene: self.bind_scene(device, inputs, &tiling),
            rays: self.bind_rays(device, &rays),
            empty_geometry: traced.is_none().then_some(rays.geometry),
            receivers: bind_receivers(device, &layouts.receivers, [inputs.positions, inputs.normals], inputs.viewers),
            work: self.bind_work(device, &batch),
            results: self.bind_results(device, &batch, &views),
            targets,
            views,
            estimate,
            passes: self.pipelines.passes(device, inputs.viewers.is_some()),
            tiling,
            roots: inputs.tree.roots.clone(),
            lists: batch.lists,
            tolerance: batch.tolerance,
            is_begun: false,
        })
    }

    fn bind_rays(&self, device: &wgpu::Device, rays: &RayInputs) -> wgpu::BindGroup {
        let doubts = (pipelines::DOUBTS, wgpu::BindingResource::TextureView(&rays.doubts));
        bind_numbered(device, &self.pipelines.layouts.rays, rays.geometry.bindings().into_iter().chain([doubts]))
    }

    fn bind_work(&self, device: &wgpu::Device, batch: &TileBatch) -> wgpu::BindGroup {
        let resources = [
            batch.tile_pass(),
            batch.lists.as_entire_binding(),
            batch.blocks.as_entire_binding(),
            wgpu::BindingResource::TextureView(&batch.interpolated_part),
            batch.tolerance.as_entire_binding(),
        ];
        bind(device, &self.pipelines.layouts.work, &resources)
    }

    /// For each target: what the resolve pass reads, with the other one.
    fn bind_results(
        &self,
        device: &wgpu::Device,
        batch: &TileBatch,
        targets: &[ResolveTarget],
    ) -> Vec<wgpu::BindGroup> {
        let result = |sum: &wgpu::TextureView, walk: &wgpu::TextureView| {
            let resources = [
                batch.tile_pass(),
                batch.lists.as_entire_binding(),
                wgpu::BindingResource::TextureView(&batch.interpolated_part),
                batch.tolerance.as_entire_binding(),
                wgpu::BindingResource::TextureView(sum),
                wgpu::BindingResource::TextureView(walk),
            ];
            bind(device, &self.pipelines.layouts.result, &resources)
        };
        if let [first, second] = targets {
            return vec![result(&second.sum, &second.walk), result(&first.sum, &first.walk)];
        }
        // A single pass reads nothing from there.
        let nothing = target(device, [1, 1], WALK_FORMAT).create_view(&Default::default());
        vec![result(&batch.interpolated_part, &nothing)]
    }

    fn check(&self, device: &wgpu::Device, inputs: &HierarchicalInputs) -> Result<(), GpuError> {
        let HierarchicalOptions { filter, light, visibility, refraction, medium } = self.options;
        if light == LightKind::Environment && inputs.params.filter != filter {
            return Err(GpuError::OtherFilter { engine: filter.name(), params: inputs.params.filter.name() });
        }
        inputs.light.kind().check(light)?;
        if inputs.tree.maps.is_some() != visibility {
            return Err(GpuError::OtherVisibility { engine: visibility });
        }
        if inputs.tree.refracts && !refraction {
            return Err(GpuError::NoRefraction);
        }
        if inputs.params.medium.is_some() && !medium {
            return Err(GpuError::NoMedium);
        }
        super::check_image(&device.limits(), inputs.size)?;
        let limit = device.limits().max_storage_buffer_binding_size.min(device.limits().max_buffer_size);
        let bytes = Tiling::new(inputs).list_bytes(inputs.tree);
        if bytes > limit {
            return Err(GpuError::TreeTooLarge { cells: inputs.tree.root_count as usize, bytes, limit });
        }
        Ok(())
    }

    fn bind_scene(&self, device: &wgpu::Device, inputs: &HierarchicalInputs, tiling: &Tiling) -> wgpu::BindGroup {
        let (tree, light) = (inputs.tree, inputs.light.without_bounds());
        let bounds = inputs.light.bounds().unwrap_or(&self.pipelines.placeholders.bounds);
        let maps = tree.maps.clone().unwrap_or_else(|| VisibilityMapBuffers::none(device));
        let samples = Pinholes { shapes: tree.shapes, ..Default::default() };
        let mut gather = light.uniforms(&inputs.params, &samples, maps.resolution);
        gather.medium.max_along_arcs = bounds.along_arcs;
        let gather = uniform_buffer(device, "gather uniforms", bytemuck::bytes_of(&gather));
        let uniforms = TreeUniforms {
            size: inputs.size,
            tiles_across: tiling.across,
            list_capacity: tiling.list_capacity,
            root_count: tree.root_count,
            first_cluster: tree.first_cluster,
            sample_count: tree.sample_count,
            may_interpolate: (inputs.is_grid && inputs.viewers.is_none()).into(),
            split_near: inputs.split_near.into(),
            has_view_directions: inputs.viewers.is_some().into(),
            area: tree.area,
            traces_rays: maps.rays.is_some().into(),
            has_tolerances: inputs.has_tolerances.into(),
            padding: 0,
        };
        let uniforms = uniform_buffer(device, "tree uniforms", bytemuck::bytes_of(&uniforms));
        let light = self.pipelines.placeholders.with(light);
        let common = [
            gather.as_entire_binding(),
            light.environment(),
            wgpu::BindingResource::Sampler(&self.pipelines.trilinear),
            wgpu::BindingResource::Sampler(&self.pipelines.anisotropic),
            tree.curves.as_entire_binding(),
            maps.planes.as_entire_binding(),
            maps.sky_masks.as_entire_binding(),
        ];
        let of_cells = [
            uniforms.as_entire_binding(),
            wgpu::BindingResource::TextureView(bounds.light.view()),
            tree.nodes.as_entire_binding(),
            tree.sample_nodes.as_entire_binding(),
            wgpu::BindingResource::TextureView(bounds.mips.view()),
        ];
        bind(device, &self.pipelines.layouts.scene, &[&common[..], &light.near(), &of_cells].concat())
    }
}

/// What a resolve pass draws into.
#[derive(Debug)]
pub(super) struct ResolveTarget {
    pub sum: wgpu::TextureView,
    /// Where pixels' walks through the tree stopped.
    pub walk: wgpu::TextureView,
}

fn uniform_buffer(device: &wgpu::Device, label: &str, contents: &[u8]) -> wgpu::Buffer {
    buffer_with(device, label, contents, wgpu::BufferUsages::UNIFORM)
}
