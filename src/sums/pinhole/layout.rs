//! What the gather reads, byte for byte as in `shaders/gather.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

use super::visibility::VisibilityMaps;
use super::{CellShapes, Epsilon, Interface, Params};
use crate::environment::CubeMap;
use crate::scene::Sides;

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
    /// What their cells have in common.
    pub shapes: CellShapes,
}

impl From<Vec<PinholeSample>> for Pinholes {
    /// Samples whose reflectances are constant.
    fn from(samples: Vec<PinholeSample>) -> Self {
        Self { samples, ..Self::default() }
    }
}

/// The number of a curve of reflectance where there is none.
pub const NO_CURVE: u32 = u32::MAX;

/// Flags of a pinhole: it lights receivers in front of it, where its normal points to,
pub const LIGHTS_FRONT: u32 = 1;
/// it lights those behind it,
pub const LIGHTS_BACK: u32 = 2;
/// it is on an interface between two media,
pub const IS_INTERFACE: u32 = 4;
/// and that reflects by the Fresnel equations.
pub const IS_FRESNEL: u32 = 8;
/// What the object's index is multiplied by.
pub const OBJECT_SCALE: u32 = 16;

/// One pinhole, 112 bytes: seven vectors of four.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct PinholeSample {
    /// World position, metres.
    pub position: [f32; 3],
    /// The area that the sample stands for, m².
    pub area: f32,
    /// Unit normal.
    pub normal: [f32; 3],
    /// Sixteen times the object's index in the scene; plus 1 if it lights receivers in front of it, where its normal points to, 2 if it
    /// lights those behind it, 4 on an interface between two media, 8 if that reflects by the Fresnel equations.
    pub object_flags: u32,
    /// Reflectance where there is no curve.
    pub reflectance: [f32; 3],
    /// The number of its curve of reflectance; `u32::MAX`: there is none. Of an interface the bits of its relative refractive index.
    pub curve: u32,
    /// T₁: full first side of the footprint on the surface, metres.
    pub side_1: [f32; 3],
    /// Full width of the lobe that blurs the footprint, radians.
    pub lobe: f32,
    /// T₂: full second side.
    pub side_2: [f32; 3],
    /// The number of its first visibility map.
    pub map: u32,
    /// M₁: change of the normal along T₁.
    pub change_1: [f32; 3],
    /// How far the map's texels are shifted along u, from −½ to ½ of a texel.
    pub texel_jitter_u: f32,
    /// M₂: change of the normal along T₂.
    pub change_2: [f32; 3],
    /// The shift along v.
    pub texel_jitter_v: f32,
}

impl Default for PinholeSample {
    fn default() -> Self {
        Self { curve: NO_CURVE, ..Self::zeroed() }
    }
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
    /// The sides on which it lights receivers; its normal points to the front.
    pub lights: Sides,
    /// The interface between two media that it is on, if it is no mirror.
    pub interface: Option<Interface>,
}

impl PinholeParts {
    /// Whether the footprint is mostly a rough mirror's lobe.
    #[inline(always)]
    pub fn is_mostly_lobe(&self) -> bool {
        let [c1, c2] = self.changes;
        self.interface.is_none() && self.lobe * self.lobe > 4.0 * (c1.length_squared() + c2.length_squared())
    }

    /// Whether it is also wider than a texel of the visibility maps: it sees the sky as a whole, not tap by tap.
    #[inline(always)]
    pub fn is_wide_lobe(&self, map_texel_rad: f32) -> bool {
        self.lobe > map_texel_rad && self.is_mostly_lobe()
    }
}

impl From<PinholeParts> for PinholeSample {
    fn from(parts: PinholeParts) -> Self {
        let lights = match parts.lights {
            Sides::Front => LIGHTS_FRONT,
            Sides::Back => LIGHTS_BACK,
            Sides::Both => LIGHTS_FRONT | LIGHTS_BACK,
        };
        let interface = parts.interface.map_or(0, |i| IS_INTERFACE | if i.fresnel { IS_FRESNEL } else { 0 });
        let curve = match parts.interface {
            Some(interface) => interface.eta.to_bits(),
            None => parts.curve.unwrap_or(NO_CURVE),
        };
        Self {
            position: parts.position.to_array(),
            area: parts.area,
            normal: parts.normal.to_array(),
            object_flags: OBJECT_SCALE * parts.object + lights + interface,
            reflectance: parts.reflectance.to_array(),
            curve,
            side_1: parts.sides[0].to_array(),
            lobe: parts.lobe,
            side_2: parts.sides[1].to_array(),
            change_1: parts.changes[0].to_array(),
            change_2: parts.changes[1].to_array(),
            ..Self::zeroed()
        }
    }
}

impl PinholeSample {
    /// World position, metres.
    pub fn position(&self) -> Vec3 {
        self.position.into()
    }

    /// Unit normal.
    pub fn normal(&self) -> Vec3 {
        self.normal.into()
    }

    /// The area that the sample stands for, m².
    pub fn area(&self) -> f32 {
        self.area
    }

    /// Index of the object in the scene.
    pub fn object(&self) -> u32 {
        self.object_flags / OBJECT_SCALE
    }

    /// Blur of the footprint, radians.
    pub fn lobe(&self) -> f32 {
        self.lobe
    }

    /// T₁, metres.
    pub fn side_1(&self) -> Vec3 {
        self.side_1.into()
    }

    /// T₂, metres.
    pub fn side_2(&self) -> Vec3 {
        self.side_2.into()
    }

    /// Change of the normal along T₁.
    pub fn change_1(&self) -> Vec3 {
        self.change_1.into()
    }

    /// Change of the normal along T₂.
    pub fn change_2(&self) -> Vec3 {
        self.change_2.into()
    }

    /// Reflectance where there is no curve.
    pub fn reflectance(&self) -> Vec3 {
        self.reflectance.into()
    }

    /// The first of its visibility maps; of use only where there are maps.
    pub fn map(&self) -> u32 {
        self.map
    }

    /// How far the maps' texels are shifted, from −½ to ½ of a texel.
    pub fn texel_jitter(&self) -> Vec2 {
        Vec2::new(self.texel_jitter_u, self.texel_jitter_v)
    }

    /// Notes its first visibility map.
    pub(super) fn set_map(&mut self, map: u32, texel_jitter: Vec2) {
        self.map = map;
        [self.texel_jitter_u, self.texel_jitter_v] = texel_jitter.to_array();
    }

    /// Which of the curves of reflectance holds.
    pub fn curve(&self) -> Option<usize> {
        (self.curve != NO_CURVE && self.interface().is_none()).then_some(self.curve as usize)
    }

    /// The sides on which it lights receivers.
    pub fn lights(&self) -> Sides {
        match self.object_flags & (LIGHTS_FRONT | LIGHTS_BACK) {
            LIGHTS_BACK => Sides::Back,
            LIGHTS_FRONT => Sides::Front,
            _ => Sides::Both,
        }
    }

    /// The interface between two media that it is on.
    pub fn interface(&self) -> Option<Interface> {
        let fresnel = self.object_flags & IS_FRESNEL != 0;
        (self.object_flags & IS_INTERFACE != 0).then(|| Interface { eta: f32::from_bits(self.curve), fresnel })
    }

    /// Whether it has a visibility map for each side: where it lights receivers on both, and where these are on the other side than the
    /// light.
    pub fn has_two_maps(&self) -> bool {
        self.object_flags & IS_INTERFACE != 0 || self.lights() == Sides::Both
    }
}

/// Parameters of a gather, 52 bytes.
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
    /// [`CellShapes::reach`].
    pub reach: f32,
    /// [`CellShapes::area`].
    pub cell_area: f32,
}

impl GatherUniforms {
    /// The uniforms of a gather from a cube of `cube_size`² texels a face.
    pub fn new(params: &Params, pinholes: &Pinholes, cube_size: u32, radiance_scale: f32) -> Self {
        use std::f32::consts::FRAC_1_PI;
        let (own_scale, epsilon_scale, epsilon) = match params.epsilon {
            Epsilon::Auto => (FRAC_1_PI, params.softening * FRAC_1_PI, 0.0),
            Epsilon::Paper => (0.0, 4.0 * FRAC_1_PI, 0.0),
            Epsilon::Value(value) => (0.0, 0.0, value),
        };
        Self {
            sample_count: pinholes.samples.len() as u32,
            taps: params.taps.max(1),
            attenuation: params.attenuation.into(),
            own_scale,
            epsilon_scale,
            epsilon,
            texel_rad: 2.0 / cube_size as f32,
            radiance_scale,
            map_resolution: pinholes.visibility.as_ref().map_or(0, |maps| maps.resolution),
            rotation_cos: params.environment_rotation_rad.cos(),
            rotation_sin: params.environment_rotation_rad.sin(),
            reach: pinholes.shapes.reach,
            cell_area: pinholes.shapes.area,
        }
    }

    /// The uniforms of a sum of light that is not infinitely far away, and is looked up in texels of this width, radians; 0 for none.
    pub fn for_near_light(params: &Params, pinholes: &Pinholes, texel_rad: f32) -> Self {
        // Only the environment turns.
        Self { texel_rad, rotation_cos: 1.0, rotation_sin: 0.0, ..Self::new(params, pinholes, 1, 1.0) }
    }

    /// The uniforms for the CPU twin, whose texels are never scaled.
    pub fn for_cube(params: &Params, pinholes: &Pinholes, cube: &CubeMap) -> Self {
        Self::new(params, pinholes, cube.size(), 1.0)
    }
}
