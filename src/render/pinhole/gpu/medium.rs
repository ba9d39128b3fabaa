//! A medium on the GPU.

use bytemuck::{Pod, Zeroable};

use crate::environment::ARC_STEPS;
use crate::pinhole::Params;

/// Vectors of four that hold the bounds along arcs.
pub(super) const ARC_STEP_VECTORS: u32 = ARC_STEPS.div_ceil(4);

/// Bounds of an environment's mean along arcs, W/(m²·sr), by their lengths.
pub(super) type MaxAlongArcs = [f32; 4 * ARC_STEP_VECTORS as usize];

/// Where nothing is known of them.
pub(super) const UNBOUNDED_ARCS: MaxAlongArcs = [f32::MAX; 4 * ARC_STEP_VECTORS as usize];

/// A medium as shaders read it, 96 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct MediumUniforms {
    /// 1/m.
    pub extinction: [f32; 3],
    /// As in [`Medium`](crate::scene::Medium).
    pub g: f32,
    /// 1: it also lies between lamps and mirrors.
    pub lamps_in_medium: u32,
    padding: [u32; 3],
    /// Of the environment, if that is the light.
    pub max_along_arcs: MaxAlongArcs,
}

impl From<&Params> for MediumUniforms {
    fn from(params: &Params) -> Self {
        let none = Self { max_along_arcs: UNBOUNDED_ARCS, ..Self::zeroed() };
        let Some(medium) = params.medium else { return none };
        let lamps_in_medium = params.lamps_in_medium.into();
        Self { extinction: medium.extinction().to_array(), g: medium.g, lamps_in_medium, ..none }
    }
}
