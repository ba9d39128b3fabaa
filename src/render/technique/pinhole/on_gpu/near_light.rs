//! Lamps and what they light, on the device.

use std::sync::Arc;

use crate::gpu::{Gpu, GpuError};
use crate::pinhole::Surroundings;
use crate::pinhole::gpu::{FrameLight, LightKind, PipelineKey, TreeLight, UploadedLamp, UploadedSurroundings};
use crate::technique::pinhole::NearLight;

/// Every lamp and near emitter, and the surfaces in their light, which come last.
#[derive(Debug)]
pub(in crate::technique::pinhole) struct NearLightOnGpu {
    lamps: Vec<UploadedLamp>,
    surroundings: Vec<UploadedSurroundings>,
}

impl NearLightOnGpu {
    pub fn upload(Gpu { device, queue, .. }: &Gpu, near: &NearLight) -> Result<Self, GpuError> {
        let lamps =
            near.lamps.iter().map(|lamp| UploadedLamp::upload(device, queue, lamp)).collect::<Result<_, _>>()?;
        let upload = |surfaces: &Arc<Surroundings>| UploadedSurroundings::upload(device, queue, surfaces);
        Ok(Self { lamps, surroundings: near.seen.all().map(upload).collect::<Result<_, _>>()? })
    }

    /// What each light is.
    pub fn kinds(&self) -> impl Iterator<Item = LightKind> {
        self.frame_lights().map(|light| light.kind())
    }

    pub fn frame_lights(&self) -> impl Iterator<Item = FrameLight<'_>> {
        self.lamps.iter().map(FrameLight::Lamp).chain(self.surroundings.iter().map(FrameLight::Surroundings))
    }

    pub fn tree_lights(&self) -> impl Iterator<Item = TreeLight<'_>> {
        self.lamps.iter().map(TreeLight::Lamp).chain(self.surroundings.iter().map(TreeLight::Surroundings))
    }
}

/// The pipelines for a kind of light; all filters share those of near light.
pub(super) fn key_for(light: LightKind, key: PipelineKey) -> PipelineKey {
    PipelineKey { light, filter: light.filter(key.filter), ..key }
}
