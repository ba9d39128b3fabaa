//! Pipelines of a device, compiled when they are first needed and shared by all that use it.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::{
    Engine, GatherOptions, HierarchicalEngine, HierarchicalOptions, LightKind, LitPipelines, MapTracer,
    PreviewPipelines, RayBatchPipelines,
};
use crate::image_space::gpu::PhotonPipelines;
use crate::pinhole::Filter;

/// What pipelines are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PipelineKey {
    pub filter: Filter,
    pub light: LightKind,
    /// Whether samples have visibility maps.
    pub visibility: bool,
    /// Whether any is on an interface between two media.
    pub refraction: bool,
    /// Whether there is a medium.
    pub medium: bool,
}

/// The pipelines of one device. There are few keys, so that none is ever dropped.
#[derive(Debug, Default)]
pub(crate) struct PipelineCache {
    flat: Compiled<Engine>,
    hierarchical: Compiled<HierarchicalEngine>,
    map_tracer: OnceLock<Arc<MapTracer>>,
    preview: OnceLock<Arc<PreviewPipelines>>,
    lit: OnceLock<Arc<LitPipelines>>,
    ray_batches: OnceLock<Arc<RayBatchPipelines>>,
    photons: OnceLock<Arc<PhotonPipelines>>,
}

#[derive(Debug)]
struct Compiled<T>(Mutex<Vec<(PipelineKey, Arc<T>)>>);

impl<T> Default for Compiled<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl PipelineCache {
    /// The pipelines of flat sums. It is always the same device.
    pub fn flat(&self, device: &wgpu::Device, key: PipelineKey) -> Arc<Engine> {
        let PipelineKey { filter, light, visibility, refraction, medium } = key;
        let options = GatherOptions { filter, light, visibility, refraction, medium, ..Default::default() };
        self.flat.get(key, || Engine::new(device, &options))
    }

    /// The pipelines of hierarchical sums.
    pub fn hierarchical(&self, device: &wgpu::Device, key: PipelineKey) -> Arc<HierarchicalEngine> {
        let PipelineKey { filter, light, visibility, refraction, medium } = key;
        let options = HierarchicalOptions { filter, light, visibility, refraction, medium };
        self.hierarchical.get(key, || HierarchicalEngine::new(device, &options))
    }

    /// The pipeline that traces visibility maps.
    pub fn map_tracer(&self, device: &wgpu::Device) -> Arc<MapTracer> {
        self.map_tracer.get_or_init(|| Arc::new(MapTracer::new(device))).clone()
    }

    /// The passes of previews.
    pub fn preview(&self, device: &wgpu::Device) -> Arc<PreviewPipelines> {
        self.preview.get_or_init(|| Arc::new(PreviewPipelines::new(device))).clone()
    }

    /// The passes that draw emitters into the environment.
    pub fn lit(&self, device: &wgpu::Device) -> Arc<LitPipelines> {
        self.lit.get_or_init(|| Arc::new(LitPipelines::new(device))).clone()
    }

    /// The passes that trace rays of whole pictures.
    pub fn ray_batches(&self, device: &wgpu::Device) -> Arc<RayBatchPipelines> {
        self.ray_batches.get_or_init(|| Arc::new(RayBatchPipelines::new(device))).clone()
    }

    /// The passes over photons.
    pub fn photons(&self, device: &wgpu::Device) -> Arc<PhotonPipelines> {
        self.photons.get_or_init(|| Arc::new(PhotonPipelines::new(device))).clone()
    }
}

impl<T> Compiled<T> {
    fn get(&self, key: PipelineKey, compile: impl FnOnce() -> T) -> Arc<T> {
        // Entries are complete when they are added: a panic elsewhere leaves nothing half-made.
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, known)) = all.iter().find(|(known, _)| *known == key) {
            return known.clone();
        }
        let compiled = Arc::new(compile());
        all.push((key, compiled.clone()));
        compiled
    }
}
