//! Photons where they are needed, on the device: lists of clusters of 2×2 photons, each of which becomes one photon, four, or four clusters of
//! a grid that is twice as fine (Wyman and Nichols 2009, Section 3.2). Lists are divided into batches that fit in the buffers; each is
//! followed to its end before the next one. CPU twin: [`crate::image_space::adaptive`]. Shader: `shaders/photon_clusters.wgsl`.

use wgpu::{BindingResource, BufferBinding, BufferUsages};

use super::layout::{Block, ClusterUniforms};
use super::map::MapOnGpu;
use super::passes::{Passes, Source};
use crate::gpu::{GpuError, buffer_with};
use crate::image_space::adaptive::{FIRST_MERGED_GRID, is_followed};
use crate::image_space::coverage::Coverage;
use crate::image_space::emission::Kind;
use crate::image_space::lights::LightView;
use crate::image_space::options::Traversal;
use crate::pinhole::gpu::storage_buffer;

/// A traversal of a light's view.
pub(super) struct Traverser<'a> {
    pub passes: &'a Passes<'a>,
    /// Rays of the finest grid.
    pub from: Source<'a>,
    pub kind: Kind,
    /// Where photons land: the map tells how far they lie from each other.
    pub map: &'a MapOnGpu<'a>,
    pub traversal: Traversal,
    /// Photons along an edge of the finest grid; a power of two.
    pub finest: u32,
}

/// What the view shows of casters.
pub(super) struct CoverageOnGpu {
    coverage: Coverage,
    levels: u32,
    bits: wgpu::Buffer,
}

/// Clusters of a grid.
struct List {
    /// Photons along an edge.
    grid: u32,
    clusters: wgpu::Buffer,
    /// Those from here on are left to do.
    next: u32,
    count: u32,
}

/// A part of a list that fits in the buffers.
struct Batch<'a> {
    grid: u32,
    clusters: BufferBinding<'a>,
    count: u32,
}

/// What became of a batch.
struct Decided {
    divided: wgpu::Buffer,
    merged: wgpu::Buffer,
    /// How many there are of each.
    counts: [u32; 2],
}

impl CoverageOnGpu {
    pub fn new(device: &wgpu::Device, coverage: Coverage) -> Self {
        let (levels, bits) = coverage.bits();
        let bits = storage_buffer(device, "what a light sees of casters", bytemuck::cast_slice(&bits));
        Self { coverage, levels, bits }
    }
}

impl List {
    /// The next part of it, of at most so many clusters.
    fn next_batch(&mut self, most: u32) -> Option<Batch<'_>> {
        let count = (self.count - self.next).min(most);
        let offset = u64::from(self.next) * size_of::<u32>() as u64;
        self.next += count;
        let clusters = BufferBinding { buffer: &self.clusters, offset, size: None };
        (count > 0).then_some(Batch { grid: self.grid, clusters, count })
    }
}

impl Traverser<'_> {
    /// Follows photons as far as the map needs them, and calls with what is in the buffers, which is to be added to maps. Returns how many
    /// were followed.
    ///
    /// # Errors
    /// The device is lost.
    pub async fn run(
        &self,
        coverage: &CoverageOnGpu,
        add: &mut dyn FnMut(&mut wgpu::CommandEncoder, Block),
    ) -> Result<u64, GpuError> {
        let most = self.passes.clusters_of_batch();
        let mut lists = vec![self.first_list(coverage)];
        let mut followed = 0;
        while let Some(list) = lists.last_mut() {
            let Some(batch) = list.next_batch(most) else {
                lists.pop();
                continue;
            };
            let is_followed = is_followed(self.traversal, batch.grid, self.finest);
            followed += if is_followed { 4 * u64::from(batch.count) } else { 0 };
            if self.traversal == Traversal::MaximalLevel && is_followed {
                self.emit(&batch, false, add);
                continue;
            }
            let grid = batch.grid;
            let Decided { divided, merged, counts } = self.decide(&batch, is_followed, coverage).await?;
            let whole = |clusters| BufferBinding { buffer: clusters, offset: 0, size: None };
            self.emit(&Batch { grid, clusters: whole(&merged), count: counts[1] }, true, add);
            if grid >= self.finest {
                self.emit(&Batch { grid, clusters: whole(&divided), count: counts[0] }, false, add);
            } else {
                lists.push(List { grid: 2 * grid, clusters: divided, next: 0, count: counts[0] });
            }
        }
        Ok(followed)
    }

    /// The clusters of the first grid in which anything can be decided.
    fn first_list(&self, coverage: &CoverageOnGpu) -> List {
        let grid = FIRST_MERGED_GRID.min(self.finest);
        let packed: Vec<u32> = coverage.coverage.texels_of(grid / 2).iter().map(|[x, y]| x | y << 16).collect();
        let bytes = if packed.is_empty() { &[0; 4] } else { bytemuck::cast_slice(&packed) };
        let clusters = storage_buffer(self.passes.on(), "clusters", bytes);
        List { grid, clusters, next: 0, count: packed.len() as u32 }
    }

    fn view(&self, grid: u32) -> LightView {
        self.from.view.resized(grid)
    }

    /// Follows photons of clusters, and hands them over; merged ones are one photon each.
    fn emit(&self, batch: &Batch<'_>, are_merged: bool, add: &mut dyn FnMut(&mut wgpu::CommandEncoder, Block)) {
        if batch.count == 0 {
            return;
        }
        let mut encoder = self.passes.on().create_command_encoder(&Default::default());
        let view = self.view(batch.grid);
        let from = Source { view: &view, ..self.from };
        let clusters = BindingResource::Buffer(batch.clusters.clone());
        self.passes.emit_clusters(&mut encoder, from, self.kind, (clusters, batch.count), true);
        if are_merged {
            let nothing = self.lists(1);
            let uniforms = ClusterUniforms { count: batch.count, ..ClusterUniforms::default() };
            let coverage = batch.clusters.buffer.as_entire_binding();
            let [divided, merged, counts] = nothing.each_ref().map(wgpu::Buffer::as_entire_binding);
            let bindings = [BindingResource::Buffer(batch.clusters.clone()), divided, merged, counts, coverage];
            self.passes.run_over_clusters(&mut encoder, &self.passes.pipelines().merge, &uniforms, bindings);
        }
        add(&mut encoder, Block::of_clusters(batch.count, are_merged));
        self.passes.submit(encoder);
    }

    /// Decides what becomes of clusters.
    async fn decide(
        &self,
        batch: &Batch<'_>,
        is_followed: bool,
        coverage: &CoverageOnGpu,
    ) -> Result<Decided, GpuError> {
        let mut encoder = self.passes.on().create_command_encoder(&Default::default());
        let clusters = || BindingResource::Buffer(batch.clusters.clone());
        if is_followed {
            let view = self.view(batch.grid);
            let from = Source { view: &view, ..self.from };
            self.passes.emit_clusters(&mut encoder, from, self.kind, (clusters(), batch.count), false);
        }
        let [divided, merged, counts] = self.lists(batch.count);
        let uniforms = ClusterUniforms {
            plane: (&self.map.projection).into(),
            count: batch.count,
            grid: batch.grid / 2,
            may_merge: u32::from(is_followed),
            levels: coverage.levels,
            is_finest: u32::from(batch.grid >= self.finest),
            ..ClusterUniforms::default()
        };
        let [a, b, c, d] = [&divided, &merged, &counts, &coverage.bits].map(wgpu::Buffer::as_entire_binding);
        self.passes.run_over_clusters(
            &mut encoder,
            &self.passes.pipelines().decide,
            &uniforms,
            [clusters(), a, b, c, d],
        );
        self.passes.submit(encoder);
        let counts = self.passes.read_counts(&counts).await?;
        Ok(Decided { divided, merged, counts })
    }

    /// Room for what so many clusters are divided into, for those that are one photon, and for the numbers of both.
    fn lists(&self, count: u32) -> [wgpu::Buffer; 3] {
        let on = self.passes.on();
        let list = |label, count: u32| {
            on.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: u64::from(count) * size_of::<u32>() as u64,
                usage: BufferUsages::STORAGE,
                mapped_at_creation: false,
            })
        };
        let counts = buffer_with(on, "numbers of clusters", &[0; 8], BufferUsages::STORAGE | BufferUsages::COPY_SRC);
        [list("divided clusters", 4 * count), list("merged clusters", count), counts]
    }
}
