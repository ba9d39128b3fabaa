//! What the gather reads, byte for byte as in `shaders/gather.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::{Epsilon, Params};
use crate::environment::CubeMap;

/// Samples per batch. A batch is what one draw adds to the image; ranges of batches can be submitted one at a time.
pub const BATCH_SIZE: u32 = 256;

/// The bit of [`PinholeSample::flags`] for samples that reflect on both sides; the lower bits are the object's index.
pub(super) const TWO_SIDED: u32 = 1 << 31;

/// One pinhole, 96 bytes. The reflectance is spread over the padding of the vectors.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PinholeSample {
    /// c: world position, metres.
    pub position: [f32; 3],
    /// a: the area that the sample stands for, m².
    pub area: f32,
    /// n: unit normal.
    pub normal: [f32; 3],
    /// Object index; the top bit says that both sides reflect.
    pub flags: u32,
    /// T₁: full first side of the footprint on the surface, metres.
    pub side_1: [f32; 3],
    /// Reflectance, red.
    pub reflectance_r: f32,
    /// T₂: full second side.
    pub side_2: [f32; 3],
    /// Reflectance, green.
    pub reflectance_g: f32,
    /// M₁: change of the normal along T₁.
    pub change_1: [f32; 3],
    /// Reflectance, blue.
    pub reflectance_b: f32,
    /// M₂: change of the normal along T₂.
    pub change_2: [f32; 3],
    /// Unused.
    pub padding: f32,
}

impl PinholeSample {
    /// Packs a sample.
    #[expect(clippy::too_many_arguments, reason = "one argument a field, called in one place")]
    pub fn new(
        position: Vec3,
        normal: Vec3,
        area: f32,
        sides: [Vec3; 2],
        changes: [Vec3; 2],
        reflectance: Vec3,
        object: u32,
        two_sided: bool,
    ) -> Self {
        Self {
            position: position.to_array(),
            area,
            normal: normal.to_array(),
            flags: object | if two_sided { TWO_SIDED } else { 0 },
            side_1: sides[0].to_array(),
            reflectance_r: reflectance.x,
            side_2: sides[1].to_array(),
            reflectance_g: reflectance.y,
            change_1: changes[0].to_array(),
            reflectance_b: reflectance.z,
            change_2: changes[1].to_array(),
            padding: 0.0,
        }
    }
}

/// Parameters of a gather, 32 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GatherUniforms {
    /// Number of samples in the buffer.
    pub sample_count: u32,
    /// Most taps of the anisotropic filter.
    pub taps: u32,
    /// 1: multiply by 1/l².
    pub attenuation: u32,
    /// 0: auto; 1: add `epsilon_scale · a + epsilon` to l².
    pub epsilon_mode: u32,
    /// Factor of the sample's area, see `epsilon_mode`.
    pub epsilon_scale: f32,
    /// m², see `epsilon_mode`.
    pub epsilon: f32,
    /// Texel width at a face's centre, level 0, radians: 2 / size.
    pub texel_rad: f32,
    /// What the cube's texels were divided by to fit their format.
    pub radiance_scale: f32,
}

impl GatherUniforms {
    /// The uniforms of a gather of `sample_count` samples from a cube of `cube_size`² texels a face.
    pub fn new(params: &Params, sample_count: u32, cube_size: u32, radiance_scale: f32) -> Self {
        let (epsilon_mode, epsilon_scale, epsilon) = match params.epsilon {
            Epsilon::Auto => (0, 0.0, 0.0),
            Epsilon::Paper => (1, 4.0 * std::f32::consts::FRAC_1_PI, 0.0),
            Epsilon::Value(value) => (1, 0.0, value),
        };
        Self {
            sample_count,
            taps: params.taps,
            attenuation: params.attenuation.into(),
            epsilon_mode,
            epsilon_scale,
            epsilon,
            texel_rad: 2.0 / cube_size as f32,
            radiance_scale,
        }
    }

    /// The uniforms for the CPU twin, whose texels are never scaled.
    pub fn for_cube(params: &Params, sample_count: usize, cube: &CubeMap) -> Self {
        Self::new(params, sample_count as u32, cube.size(), 1.0)
    }
}
