//! What the passes of a preview read from buffers; see `shaders/shared/preview.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::PreviewInputs;
use super::near_light::PackedNearLight;
use crate::brdf::Material;
use crate::engine::paths::surface_albedo;
use crate::engine::preview::scattering::SeenMedium;
use crate::environment::CubeMap;
use crate::options::{DisplaySettings, Exposure};
use crate::pinhole::CURVE_POINTS;
use crate::pinhole::gpu::EnvironmentCube;
use crate::scene::{Camera, Object, Projection, Sides, Visibility};
use crate::stages::{PreparedLight, SurfaceMaterials};

/// What pixels see, in bytes: a point of a surface, an escape, and what the camera sees first.
pub(crate) const PIXEL_BYTES: [u64; 3] = [48, 32, 16];

/// What all passes know.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct PreviewUniforms {
    pub camera_position: [f32; 3],
    pub half_height: f32,
    pub camera_forward: [f32; 3],
    pub is_perspective: u32,
    pub camera_right: [f32; 3],
    pub lamp_count: u32,
    pub camera_up: [f32; 3],
    pub direction_count: u32,
    pub light_centre: [f32; 3],
    pub has_emitters: u32,
    pub size: [u32; 2],
    pub rotation: [f32; 2],
    pub intensity: f32,
    pub background_intensity: f32,
    pub environment_scale: f32,
    pub background_scale: f32,
    pub irradiance_scale: f32,
    pub texel_rad: f32,
    pub caustic_gain: f32,
    pub is_plain: u32,
    pub exposure: f32,
    pub background_exposure: f32,
    pub exposure_flags: u32,
    pub tone_map: u32,
    pub extinction: [f32; 3],
    pub part_count: u32,
    pub is_shadowed: u32,
    pub medium_flags: u32,
    pub sight: f32,
    pub scattering_spacing: u32,
}

const IS_METERED: u32 = 1;
const IS_SHARED: u32 = 2;

/// The cubes that a preview looks up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cubes<'a> {
    pub environment: &'a EnvironmentCube,
    pub background: &'a EnvironmentCube,
    pub irradiance: &'a EnvironmentCube,
}

impl PreviewUniforms {
    pub(super) fn new(
        inputs: &PreviewInputs,
        cubes: Cubes,
        direction_count: usize,
        near_light: &PackedNearLight,
    ) -> Self {
        let PreviewInputs { scene, prepared, options, light, .. } = inputs;
        let light_centre = prepared.light_geometry.as_ref().map(|geometry| geometry.centre());
        let medium = MediumUniforms::new(inputs);
        let Camera { position, forward, right, up, projection } = scene.camera;
        let (half_height, is_perspective) = match projection {
            Projection::Perspective { fov_y_rad } => ((0.5 * fov_y_rad).tan(), 1),
            Projection::Orthographic { height } => (0.5 * height, 0),
        };
        let DisplaySettings { exposure, background_exposure_ev, tone_map } = options.display;
        let (exposure, is_metered) = match exposure {
            Exposure::Auto => (0.0, IS_METERED),
            Exposure::Stops(stops) => (stops, 0),
        };
        let is_shared = if background_exposure_ev.is_none() { IS_SHARED } else { 0 };
        let (sin, cos) = light.rotation_rad.sin_cos();
        Self {
            camera_position: position.to_array(),
            half_height,
            camera_forward: forward.to_array(),
            is_perspective,
            camera_right: right.to_array(),
            lamp_count: near_light.lamp_count,
            camera_up: up.to_array(),
            direction_count: direction_count as u32,
            light_centre: light_centre.unwrap_or(Vec3::ZERO).to_array(),
            has_emitters: u32::from(light_centre.is_some()),
            size: options.size,
            rotation: [cos, sin],
            intensity: light.intensity,
            background_intensity: light.background.1,
            environment_scale: cubes.environment.radiance_scale(),
            background_scale: cubes.background.radiance_scale(),
            irradiance_scale: cubes.irradiance.radiance_scale(),
            texel_rad: 2.0 / cubes.environment.size() as f32,
            caustic_gain: options.caustic_gain,
            is_plain: u32::from(options.plain_diffuse),
            exposure,
            background_exposure: background_exposure_ev.unwrap_or(0.0),
            exposure_flags: is_metered | is_shared,
            tone_map: tone_map as u32,
            extinction: medium.extinction.to_array(),
            part_count: near_light.part_count,
            is_shadowed: u32::from(options.visibility == Visibility::Full),
            medium_flags: medium.flags,
            sight: medium.sight,
            scattering_spacing: medium.scattering_spacing,
        }
    }
}

/// What the passes know of the medium.
struct MediumUniforms {
    extinction: Vec3,
    flags: u32,
    sight: f32,
    scattering_spacing: u32,
}

const FILLS_SPACE: u32 = 1;
const CAMERA_IN_MEDIUM: u32 = 2;

impl MediumUniforms {
    fn new(inputs: &PreviewInputs) -> Self {
        let scattering_spacing = inputs.scattered.map_or(0, |grid| grid.spacing);
        let Some(SeenMedium { medium, starts_within, is_everywhere }) = inputs.medium else {
            return Self { extinction: Vec3::ZERO, flags: 0, sight: f32::MAX, scattering_spacing };
        };
        let flag = |is_set: bool, flag: u32| if is_set { flag } else { 0 };
        let flags = flag(is_everywhere, FILLS_SPACE) | flag(starts_within, CAMERA_IN_MEDIUM);
        Self { extinction: medium.extinction(), flags, sight: medium.sight(), scattering_spacing }
    }
}

/// The receivers of a gather among the pixels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct PreviewGrid {
    pub spacing: u32,
    pub coarser: u32,
    padding: [u32; 2],
}

impl PreviewGrid {
    pub(super) fn new(spacing: u32, coarser: u32) -> Self {
        Self { spacing, coarser, padding: [0; 2] }
    }
}

/// An object's surface.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct PreviewObject {
    pub albedo: [f32; 3],
    pub flags: u32,
    pub mirror_albedo: [f32; 3],
    pub alpha: f32,
    pub radiance: [f32; 3],
    pub width: f32,
    pub specular: [f32; 3],
    pub kind: u32,
}

impl PreviewObject {
    /// `brightness` is a factor on what it emits.
    pub(super) fn new(object: &Object, material: &Material, is_plain: bool, brightness: f32) -> Self {
        let sides = match object.reflector.map(|reflector| reflector.sides) {
            None => 0,
            Some(Sides::Front) => 1,
            Some(Sides::Back) => 2,
            Some(Sides::Both) => 3,
        };
        let refractor = object.refractor;
        let flags = sides
            | u32::from(object.receiver.is_some()) << 2
            | u32::from(object.emitter.is_some()) << 3
            | u32::from(refractor.is_some()) << 4
            | u32::from(refractor.is_some_and(|refractor| refractor.fresnel)) << 5;
        Self {
            albedo: surface_albedo(object, is_plain, false).to_array(),
            flags,
            mirror_albedo: surface_albedo(object, is_plain, true).to_array(),
            alpha: object.reflector.map_or(0.0, |reflector| reflector.finish.alpha() as f32),
            radiance: object.emitter.map_or(Vec3::ZERO, |emitter| brightness * emitter.radiance).to_array(),
            width: refractor.map_or(material.width, |refractor| (refractor.eta.element_sum() / 3.0) as f32),
            specular: material.specular,
            kind: material.kind,
        }
    }
}

/// The reflectance of each object by the cosine of the angle of incidence.
pub(super) fn reflectance_curves(materials: &SurfaceMaterials) -> Vec<[f32; 4]> {
    let curve = |curve: &Option<crate::reflectance::Curve>| match curve {
        Some(curve) => curve.values().iter().map(|value| value.as_vec3().extend(0.0).to_array()).collect(),
        None => vec![[0.0; 4]; CURVE_POINTS],
    };
    materials.mirrors.iter().flat_map(curve).collect()
}

/// The largest size of a face of the cube that shows the background: 2048² × 6 look-ups.
const MAX_BACKGROUND_SIZE: u32 = 2048;

/// The environment as the eye sees it, finely enough that it looks like its own map.
pub(super) fn background_cube(light: &PreparedLight) -> CubeMap {
    let (background, _) = &light.background;
    let size = background.cube.size().min(MAX_BACKGROUND_SIZE);
    CubeMap::without_mips(size, |direction| background.radiance.smooth_radiance(direction))
}
