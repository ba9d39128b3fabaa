//! Photons that are all followed, and then put together from fine to coarse where the map does not tell them apart, on the device. CPU twin:
//! [`crate::image_space::hierarchical`]. Shader: `shaders/photon_clusters.wgsl`.

use wgpu::BufferUsages;

use super::layout::{Block, ClusterUniforms};
use super::map::MapOnGpu;
use super::passes::{Passes, Source};
use crate::image_space::emission::Kind;
use crate::image_space::hierarchical::{photons_of_square, texel_at};
use crate::pinhole::gpu::storage_buffer;

/// All photons of a light's view.
pub(super) struct Hierarchy<'a> {
    pub passes: &'a Passes<'a>,
    pub from: Source<'a>,
    pub kind: Kind,
    /// Where photons land: the map tells how far they lie from each other.
    pub map: &'a MapOnGpu<'a>,
    /// Photons along an edge of the grid; a power of two.
    pub photons: u32,
}

impl Hierarchy<'_> {
    /// Follows all photons, and calls with what is in the buffers, which is to be added to maps. Returns how many were followed.
    pub fn run(&self, add: &mut dyn FnMut(&mut wgpu::CommandEncoder, Block)) -> u64 {
        let clusters_of_square = photons_of_square(self.photons) / 4;
        let most = u64::from(self.passes.clusters_of_batch()) / clusters_of_square * clusters_of_square;
        let all = u64::from(self.photons).pow(2) / 4;
        for first in (0..all).step_by(most as usize) {
            self.run_batch(first, most.min(all - first), add);
        }
        4 * all
    }

    fn run_batch(&self, first: u64, count: u64, add: &mut dyn FnMut(&mut wgpu::CommandEncoder, Block)) {
        let on = self.passes.on();
        let texels = (first..first + count).map(texel_at);
        let clusters: Vec<u32> = texels.map(|[x, y]| x | y << 16).collect();
        let clusters = storage_buffer(on, "clusters", bytemuck::cast_slice(&clusters));
        let mut encoder = on.create_command_encoder(&Default::default());
        let view = self.from.view.resized(self.photons);
        let from = Source { view: &view, ..self.from };
        let count = count as u32;
        self.passes.emit_clusters(&mut encoder, from, self.kind, (clusters.as_entire_binding(), count), true);
        let is_whole = on.create_buffer(&wgpu::BufferDescriptor {
            label: Some("squares that are one photon"),
            size: u64::from(count) * size_of::<u32>() as u64,
            usage: BufferUsages::STORAGE,
            mapped_at_creation: false,
        });
        // The pass has no use for them.
        let [divided, counts] = [(); 2].map(|()| storage_buffer(on, "no clusters", &[0; 8]));
        let mut stride = 1;
        while 4 * u64::from(stride) <= photons_of_square(self.photons) {
            let plane = (&self.map.projection).into();
            let uniforms = ClusterUniforms { plane, count: count / stride, stride, ..ClusterUniforms::default() };
            let buffers = [&clusters, &divided, &is_whole, &counts, &clusters];
            let bindings = buffers.map(wgpu::Buffer::as_entire_binding);
            let pipeline = &self.passes.pipelines().merge_squares;
            self.passes.run_over_clusters(&mut encoder, pipeline, &uniforms, bindings);
            stride *= 4;
        }
        add(&mut encoder, Block::of_clusters(count, false));
        self.passes.submit(encoder);
    }
}
