//! What the gather reads, byte for byte as in `shaders/gather.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

use super::visibility::VisibilityMaps;
use super::{Epsilon, Params};
use crate::environment::CubeMap;

/// Samples per batch. A batch is what one draw adds to the image; ranges of batches can be submitted one at a time.
pub const BATCH_SIZE: u32 = 256;

/// Points of a curve of reflectance.
pub const CURVE_POINTS: usize = 128;

/// Reflectance (and an unused lane) at equal steps of the cosine of the angle of incidence, from 0 to 1.
pub type ReflectanceCurve = [[f32; 4]; CURVE_POINTS];

/// The samples, and what they refer to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pinholes {
    /// The samples.
    pub samples: Vec<PinholeSample>,
    /// Reflectances that depend on the angle.
    pub curves: Vec<ReflectanceCurve>,
    /// What the samples see; `None`: nothing hides anything.
    pub visibility: Option<VisibilityMaps>,
}

impl From<Vec<PinholeSample>> for Pinholes {
    /// Samples whose reflectances are constant.
    fn from(samples: Vec<PinholeSample>) -> Self {
        Self { samples, ..Self::default() }
    }
}

/// One pinhole, 112 bytes: seven vectors of four.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PinholeSample {
    /// c: world position, metres; a: the area that the sample stands for, m².
    pub position_area: [f32; 4],
    /// n: unit normal; ±(object + 1), negative where both sides reflect.
    pub normal_object: [f32; 4],
    /// Reflectance; the number of the curve that holds instead, from 1, or 0.
    pub reflectance: [f32; 4],
    /// T₁: full first side of the footprint on the surface, metres; full width of the lobe that blurs the footprint,
    /// radians.
    pub side_1: [f32; 4],
    /// T₂: full second side; the number of the sample's first map of visibility, from 1, or 0.
    pub side_2: [f32; 4],
    /// M₁: change of the normal along T₁; how far the map's texels are shifted along u, from −½ to ½ of a texel.
    pub change_1: [f32; 4],
    /// M₂: change of the normal along T₂; the shift along v.
    pub change_2: [f32; 4],
}

/// What a pinhole is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PinholeParts {
    /// World position, metres.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// The area that it stands for, m².
    pub area: f32,
    /// Full sides of the footprint on the surface, metres.
    pub sides: [Vec3; 2],
    /// Change of the normal along each side.
    pub changes: [Vec3; 2],
    /// Reflectance at all angles,
    pub reflectance: Vec3,
    /// unless it is one of the [`Pinholes::curves`].
    pub curve: Option<u32>,
    /// Blur of the footprint in the plane of incidence: the side of a square with the same second moments, radians.
    pub lobe: f32,
    /// Index of the object in the scene.
    pub object: u32,
    /// Whether both sides reflect.
    pub two_sided: bool,
}

impl From<PinholeParts> for PinholeSample {
    fn from(parts: PinholeParts) -> Self {
        let object = (parts.object + 1) as f32;
        let object = if parts.two_sided { -object } else { object };
        let vector = |v: Vec3| v.extend(0.0).to_array();
        Self {
            position_area: parts.position.extend(parts.area).to_array(),
            normal_object: parts.normal.extend(object).to_array(),
            reflectance: parts.reflectance.extend(parts.curve.map_or(0.0, |c| (c + 1) as f32)).to_array(),
            side_1: parts.sides[0].extend(parts.lobe).to_array(),
            side_2: vector(parts.sides[1]),
            change_1: vector(parts.changes[0]),
            change_2: vector(parts.changes[1]),
        }
    }
}

impl PinholeSample {
    /// World position, metres.
    pub fn position(&self) -> Vec3 {
        Vec3::from_slice(&self.position_area)
    }

    /// Unit normal.
    pub fn normal(&self) -> Vec3 {
        Vec3::from_slice(&self.normal_object)
    }

    /// The area that the sample stands for, m².
    pub fn area(&self) -> f32 {
        self.position_area[3]
    }

    /// Index of the object in the scene.
    pub fn object(&self) -> u32 {
        self.normal_object[3].abs() as u32 - 1
    }

    /// The four quarters of its parallelogram, to second order.
    pub(super) fn quarters(&self) -> [Self; 4] {
        let (n, [t1, t2]) = (self.normal(), [self.side_1(), self.side_2()]);
        let [m1, m2] = [self.change_1, self.change_2].map(|m| Vec3::from_slice(&m));
        [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)].map(|(x, y)| {
            let (q, m) = (x * t1 + y * t2, x * m1 + y * m2);
            let normal = (n + m).normalize();
            let tangent = |v: Vec3| v - v.dot(normal) * normal;
            let mut quarter = *self;
            // Where normals diverge the surface falls away from the tangent plane.
            let position = self.position() + q - 0.5 * q.dot(m) * n;
            quarter.position_area = position.extend(0.25 * self.area()).to_array();
            quarter.normal_object = normal.extend(self.normal_object[3]).to_array();
            let half = |v: Vec3, w: f32| (0.5 * tangent(v)).extend(w).to_array();
            quarter.side_1 = half(t1, self.side_1[3]);
            quarter.side_2 = half(t2, self.side_2[3]);
            quarter.change_1 = half(m1, self.change_1[3]);
            quarter.change_2 = half(m2, self.change_2[3]);
            quarter
        })
    }

    /// Blur of the footprint, radians.
    pub fn lobe(&self) -> f32 {
        self.side_1[3]
    }

    /// T₁, metres.
    pub fn side_1(&self) -> Vec3 {
        Vec3::from_slice(&self.side_1)
    }

    /// T₂, metres.
    pub fn side_2(&self) -> Vec3 {
        Vec3::from_slice(&self.side_2)
    }

    /// The first of its maps of visibility, from 0; of use only where there are maps.
    pub fn map(&self) -> u32 {
        (self.side_2[3] as u32).saturating_sub(1)
    }

    /// How far the maps' texels are shifted.
    pub fn phase(&self) -> Vec2 {
        Vec2::new(self.change_1[3], self.change_2[3])
    }

    /// Notes its first map of visibility.
    pub(super) fn set_map(&mut self, map: u32, phase: Vec2) {
        self.side_2[3] = (map + 1) as f32;
        (self.change_1[3], self.change_2[3]) = (phase.x, phase.y);
    }

    /// Which of the curves of reflectance holds.
    pub fn curve(&self) -> Option<usize> {
        (self.reflectance[3] as usize).checked_sub(1)
    }

    /// Whether both sides reflect.
    pub fn two_sided(&self) -> bool {
        self.normal_object[3] < 0.0
    }
}

/// Parameters of a gather, 44 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GatherUniforms {
    /// Number of samples in the buffer.
    pub sample_count: u32,
    /// Most taps of the anisotropic filter.
    pub taps: u32,
    /// 1: multiply by 1/l².
    pub attenuation: u32,
    /// On a sample's own object l² is at least this times the sample's area.
    pub own_scale: f32,
    /// This times the sample's area is added to l².
    pub epsilon_scale: f32,
    /// Added to l², m².
    pub epsilon: f32,
    /// Texel width at a face's centre, level 0, radians: 2 / size.
    pub texel_rad: f32,
    /// What the cube's texels were divided by to fit their format.
    pub radiance_scale: f32,
    /// Texels along the edge of a map of visibility.
    pub map_resolution: u32,
    /// Cosine of the environment's rotation about +Y.
    pub rotation_cos: f32,
    /// Sine of the environment's rotation about +Y.
    pub rotation_sin: f32,
}

impl GatherUniforms {
    /// The uniforms of a gather from a cube of `cube_size`² texels a face.
    pub fn new(params: &Params, pinholes: &Pinholes, cube_size: u32, radiance_scale: f32) -> Self {
        use std::f32::consts::FRAC_1_PI;
        let (own_scale, epsilon_scale, epsilon) = match params.epsilon {
            Epsilon::Auto => (FRAC_1_PI, 0.0, 0.0),
            Epsilon::Paper => (0.0, 4.0 * FRAC_1_PI, 0.0),
            Epsilon::Value(value) => (0.0, 0.0, value),
        };
        Self {
            sample_count: pinholes.samples.len() as u32,
            taps: params.taps,
            attenuation: params.attenuation.into(),
            own_scale,
            epsilon_scale,
            epsilon,
            texel_rad: 2.0 / cube_size as f32,
            radiance_scale,
            map_resolution: pinholes.visibility.as_ref().map_or(0, |maps| maps.resolution),
            rotation_cos: params.environment_rotation_rad.cos(),
            rotation_sin: params.environment_rotation_rad.sin(),
        }
    }

    /// The uniforms for the CPU twin, whose texels are never scaled.
    pub fn for_cube(params: &Params, pinholes: &Pinholes, cube: &CubeMap) -> Self {
        Self::new(params, pinholes, cube.size(), 1.0)
    }
}
