//! Layouts and pipelines of photons, compiled once for a device.

use wgpu::{BindGroupLayout, BindGroupLayoutEntry, ComputePipeline, ShaderStages};

use super::images::ImagePipelines;
use crate::pinhole::gpu::pipeline::{compute_pipeline, layout, seen_by, storage, texture, uniform, writable};
use crate::pinhole::gpu::ray_entries;
use crate::pinhole::gpu::shaders::{
    PHOTON_CLUSTERS, PHOTON_EMISSION, PHOTON_PLACES, PHOTON_POLYGONS, PHOTON_SPLATS, Shader,
};

/// The passes on one device.
#[derive(Debug)]
pub(crate) struct PhotonPipelines {
    pub(super) emit: ComputePipeline,
    pub(super) emit_in_images: ComputePipeline,
    pub(super) images: ImagePipelines,
    pub(super) count_layers: ComputePipeline,
    pub(super) find_receivers: ComputePipeline,
    pub(super) find_parts: ComputePipeline,
    pub(super) settle_parts: ComputePipeline,
    pub(super) place_photons: ComputePipeline,
    pub(super) add_splats: ComputePipeline,
    pub(super) add_polygons: ComputePipeline,
    pub(super) decide: ComputePipeline,
    pub(super) merge: ComputePipeline,
    pub(super) merge_squares: ComputePipeline,
    pub(super) of_clusters: BindGroupLayout,
    pub(super) of_view: BindGroupLayout,
    pub(super) of_light: BindGroupLayout,
    pub(super) of_map: BindGroupLayout,
    pub(super) of_surfaces: BindGroupLayout,
    pub(super) nothing: BindGroupLayout,
    pub(super) geometry: BindGroupLayout,
}

impl PhotonPipelines {
    /// Compiles the shaders.
    pub fn new(device: &wgpu::Device) -> Self {
        let of = |label, entries: &[BindGroupLayoutEntry]| {
            let entries: Vec<_> = entries.iter().map(|entry| seen_by(ShaderStages::COMPUTE, *entry)).collect();
            layout(device, label, &entries)
        };
        let written = |last: u32| (1..=last).map(writable);
        let of_view =
            of("a light's view", &[uniform(0)].into_iter().chain(written(3)).chain([storage(4)]).collect::<Vec<_>>());
        let of_clusters = of(
            "clusters",
            &[uniform(0), writable(1), storage(2), writable(3), writable(4), writable(5), storage(6), writable(7)],
        );
        let of_light = of("a light and surfaces", &[storage(0), storage(1), storage(2), texture(3)]);
        let of_map = of("a caustic map", &[uniform(0)].into_iter().chain(written(7)).collect::<Vec<_>>());
        let of_surfaces = of("surfaces", &[storage(0)]);
        let nothing = of("nothing", &[]);
        let geometry = of("rays", &ray_entries(device, ShaderStages::COMPUTE));
        let images = ImagePipelines::new(device);
        let pipeline = |shader: Shader, groups: [&BindGroupLayout; 3], entries: &[(&str, f64)]| {
            let groups = [groups[0], groups[1], groups[2], &geometry].map(Some);
            let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(shader.name),
                bind_group_layouts: &groups,
                immediate_size: 0,
            });
            let module = shader.module(device);
            let compile = |(entry, in_images): &(&str, f64)| {
                let constants = [("IN_IMAGES", *in_images)];
                let constants = if shader == PHOTON_EMISSION { &constants[..] } else { &[] };
                compute_pipeline(device, &layout, &module, entry, constants)
            };
            entries.iter().map(compile).collect::<Vec<_>>()
        };
        let of_map_and_surfaces = [&of_map, &of_surfaces, &nothing];
        let of_emission = [&of_view, &of_light, &images.of_images];
        let emit = pipeline(PHOTON_EMISSION, of_emission, &[("emit", 0.0), ("emit", 1.0)]);
        let places =
            ["count_layers", "find_receivers", "find_parts", "settle_parts", "place_photons"].map(|e| (e, 0.0));
        let places = pipeline(PHOTON_PLACES, of_map_and_surfaces, &places);
        let splats = pipeline(PHOTON_SPLATS, of_map_and_surfaces, &[("add_splats", 0.0)]);
        let polygons = pipeline(PHOTON_POLYGONS, of_map_and_surfaces, &[("add_polygons", 0.0)]);
        let clusters = [&of_clusters, &nothing, &nothing];
        let clusters = pipeline(PHOTON_CLUSTERS, clusters, &["decide", "merge", "merge_squares"].map(|e| (e, 0.0)));
        Self {
            decide: clusters[0].clone(),
            merge: clusters[1].clone(),
            merge_squares: clusters[2].clone(),
            of_clusters,
            emit: emit[0].clone(),
            emit_in_images: emit[1].clone(),
            images,
            count_layers: places[0].clone(),
            find_receivers: places[1].clone(),
            find_parts: places[2].clone(),
            settle_parts: places[3].clone(),
            place_photons: places[4].clone(),
            add_splats: splats[0].clone(),
            add_polygons: polygons[0].clone(),
            of_view,
            of_light,
            of_map,
            of_surfaces,
            nothing,
            geometry,
        }
    }
}
