//! The environment behind emitters, which is drawn on the GPU when they move.

use std::sync::Arc;

use crate::backend::SharedGpu;
use crate::environment::Environment;
use crate::gpu::GpuError;
use crate::pinhole::gpu::{CubeView, EnvironmentCube, LitEnvironment, PlacedEmitter};
use crate::progress::{Progress, Stage};
use crate::scene::{Object, Scene};
use crate::stages::{Id, Memo, PreparedLight, PreparedScene};

/// What is kept from frame to frame.
#[derive(Debug)]
pub(in crate::engine::preview) struct LitStages {
    background: Memo<Id<Environment>, EnvironmentCube>,
    lit: Option<LitEnvironment>,
    /// What is drawn, or will be.
    shown: Option<Id<Environment>>,
    is_drawn: bool,
}

impl LitStages {
    pub fn new() -> Self {
        Self { background: Memo::new(Stage::Upload), lit: None, shown: None, is_drawn: false }
    }

    /// The cube map of a light; `None` without emitters. It is as the light wants it once [`Self::record`] is done.
    pub fn prepare(
        &mut self,
        shared: &SharedGpu,
        (scene, prepared): (&Scene, &PreparedScene),
        light: &PreparedLight,
        progress: &dyn Progress,
    ) -> Result<Option<Arc<EnvironmentCube>>, GpuError> {
        let Some(geometry) = &prepared.light_geometry else { return Ok(None) };
        let gpu = &shared.gpu;
        let (background, intensity) = &light.background;
        let upload = || EnvironmentCube::upload(&gpu.device, &gpu.queue, &background.cube);
        let background = self.background.try_get(Id::of(background), progress, upload)?;
        let known = self.lit.take().filter(|lit| Arc::ptr_eq(lit.background(), &background));
        let is_new = known.is_none();
        let lit =
            self.lit
                .insert(known.unwrap_or_else(|| {
                    LitEnvironment::new(&gpu.device, shared.pipelines.lit(&gpu.device), background)
                }));
        let wanted = Id::of(&light.environment);
        if is_new || self.shown.as_ref() != Some(&wanted) {
            let view = CubeView { centre: geometry.centre(), rotation_rad: light.rotation_rad, intensity: *intensity };
            lit.update((&gpu.device, &gpu.queue), &emitters(scene), view);
            (self.shown, self.is_drawn) = (Some(wanted), false);
        }
        Ok(Some(lit.cube().clone()))
    }

    /// Records the drawing, if anything has changed.
    pub fn record(&mut self, encoder: &mut wgpu::CommandEncoder) {
        if let Some(lit) = self.lit.as_ref().filter(|_| !self.is_drawn) {
            lit.record(encoder);
            self.is_drawn = true;
        }
    }

    /// Submits the drawing by itself, for frames whose other passes are not on the GPU.
    pub fn submit(&mut self, shared: &SharedGpu) {
        let mut encoder = shared.gpu.device.create_command_encoder(&Default::default());
        self.record(&mut encoder);
        shared.gpu.queue.submit([encoder.finish()]);
    }
}

fn emitters(scene: &Scene) -> Vec<PlacedEmitter> {
    let emitter = |object: &Object| {
        Some(PlacedEmitter {
            mesh: object.mesh.clone(),
            placement: object.placement,
            radiance: object.emitter?.radiance,
        })
    };
    scene.objects.iter().filter(|object| object.is_distant_light()).filter_map(emitter).collect()
}
