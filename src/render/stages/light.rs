//! The prepared light, in the environment's own frame and at its own intensity: look-ups rotate their directions and sums
//! are scaled, so that rotating or scaling the environment prepares nothing again, unless emitters shine before it. Of the scene it knows its light geometry alone.

use std::sync::Arc;

use glam::{Mat3, Vec3};

use super::StageCounts;
use super::memo::{Id, Memo};
use super::near_emitters::NearEmitters;
use crate::environment::{
    CubeMap, CubeSize, Environment, EnvironmentError, LightBounds, LightGeometry, LightSampler, LitBy, irradiance_map,
    irradiance_map_of_frame,
};
#[cfg(feature = "gpu")]
use crate::pinhole::gpu::EnvironmentCube;
use crate::progress::{Progress, Stage};
use crate::scene::{EnvironmentSource, Lamp, Light, Medium, Object, Scene};

/// Face size of the cube map that the CPU derives irradiance and directions from in frames, see `irradiance_map_of_frame`.
const COARSE_SIZE: u32 = 128;

/// A light in its own frame, with its rotation and intensity in the world.
#[derive(Clone, Debug)]
pub(crate) struct PreparedLight {
    pub environment: Arc<Environment>,
    /// The environment without emitters, and the factor on its radiance beside the intensity.
    #[cfg(feature = "gpu")]
    pub background: (Arc<Environment>, f32),
    /// The cube map on the GPU, where it is drawn there: finer than `environment`, which is what the CPU derives the rest from.
    #[cfg(feature = "gpu")]
    pub on_gpu: Option<Arc<EnvironmentCube>>,
    /// Counter-clockwise about +Y, radians.
    pub rotation_rad: f32,
    /// Factor on every radiance.
    pub intensity: f32,
    /// The lamps, for an intensity of 1, as sums and direct light are computed before they are scaled.
    pub lamps: Arc<[Lamp]>,
    /// Emitters that are near, and the factor on their radiance for the same reason.
    pub near_emitters: Option<(Arc<NearEmitters>, f32)>,
    /// What is between lamps and surfaces: a medium that fills all space.
    pub medium: Option<Medium>,
}

/// Environments fainter than this are black beside lamps: what lamps are divided by must not be zero.
const MIN_INTENSITY: f32 = 1e-12;

impl PreparedLight {
    /// The same with emitters that are near.
    pub fn with_near(self, emitters: Option<&Arc<NearEmitters>>) -> Self {
        let near_emitters = emitters.map(|emitters| (emitters.clone(), self.of_emitters()));
        Self { near_emitters, ..self }
    }

    /// Whether any light is near: lamps or emitters.
    pub fn has_near_light(&self) -> bool {
        !self.lamps.is_empty() || self.near_emitters.is_some()
    }

    /// The factor on the radiance of emitters where the sum of all light is multiplied by the intensity.
    pub fn of_emitters(&self) -> f32 {
        1.0 / self.intensity
    }

    /// Names the near emitters and their brightness.
    pub fn near_key(&self) -> Option<(Id<NearEmitters>, f32)> {
        self.near_emitters.as_ref().map(|(emitters, factor)| (Id::of(emitters), *factor))
    }

    /// The rotation from the environment's frame to the world's.
    pub fn world_from_light(&self) -> Mat3 {
        Mat3::from_rotation_y(self.rotation_rad)
    }

    /// Transforms a direction from the world's frame to the environment's.
    pub fn light_from_world(&self, direction_in_world: Vec3) -> Vec3 {
        Mat3::from_rotation_y(-self.rotation_rad) * direction_in_world
    }
}

/// The stages that make a [`PreparedLight`] and what is derived from it.
#[derive(Debug)]
pub(crate) struct LightStages {
    /// The light is different in the next frame: what is derived from it is made quickly, and less finely.
    is_for_frames: bool,
    environment: Memo<(Light, CubeSize, u32), Environment>,
    /// As fine as light geometry is drawn by the CPU if a GPU draws it, too.
    coarse: Memo<Id<Environment>, Environment>,
    /// With light geometry drawn into it.
    lit: Memo<LitKey, Environment>,
    bounds: Memo<Id<Environment>, LightBounds>,
    irradiance: Memo<Id<Environment>, CubeMap>,
    sampler: Memo<Id<Environment>, LightSampler>,
}

/// The environment, the geometry before it, and the rotation and intensity of what lies behind.
type LitKey = (Id<Environment>, Id<LightGeometry>, [f32; 2]);

/// Light geometry, and the face size of the cube map that it is drawn into, at least, if the size is not given.
#[derive(Clone, Debug)]
pub(crate) struct DrawnGeometry {
    pub geometry: Arc<LightGeometry>,
    pub cube_size: u32,
    /// A GPU draws it, too: the CPU draws it as finely as irradiance and directions of shadow rays need.
    pub is_on_gpu: bool,
}

impl LightStages {
    pub fn new() -> Self {
        Self {
            is_for_frames: false,
            environment: Memo::new(Stage::Light),
            coarse: Memo::new(Stage::Light),
            lit: Memo::new(Stage::LitEnvironment),
            bounds: Memo::new(Stage::LightBounds),
            irradiance: Memo::new(Stage::Irradiance),
            sampler: Memo::new(Stage::LightSampler),
        }
    }

    /// For previews of a light that moves.
    pub fn for_frames() -> Self {
        Self { is_for_frames: true, ..Self::new() }
    }

    pub fn prepare(
        &mut self,
        scene: &Scene,
        light_geometry: Option<&DrawnGeometry>,
        cube_size: CubeSize,
        progress: &dyn Progress,
    ) -> Result<PreparedLight, EnvironmentError> {
        let Scene { environment: source, lamps, medium, .. } = scene;
        let medium = medium.filter(|_| scene.has_medium_everywhere());
        let black = EnvironmentSource { light: Light::Constant(Vec3::ZERO), intensity: 1.0, ..*source };
        let has_near_light = !lamps.is_empty() || scene.objects.iter().any(Object::is_near_light);
        let source = if source.intensity < MIN_INTENSITY && has_near_light { &black } else { source };
        let least = light_geometry.map_or(0, |drawn| drawn.cube_size);
        let environment = self.environment.try_get((source.light.clone(), cube_size, least), progress, || {
            Environment::at_least(&source.light, cube_size, least)
        })?;
        let EnvironmentSource { rotation_rad, intensity, .. } = *source;
        environment.radiance.check_placement(intensity, rotation_rad)?;
        let Some(DrawnGeometry { geometry, is_on_gpu, .. }) = light_geometry else {
            return Ok(PreparedLight {
                #[cfg(feature = "gpu")]
                background: (environment.clone(), 1.0),
                #[cfg(feature = "gpu")]
                on_gpu: None,
                environment,
                rotation_rad,
                intensity,
                lamps: lamps
                    .iter()
                    .map(|lamp| Lamp { intensity: lamp.intensity / intensity, ..lamp.clone() })
                    .collect(),
                near_emitters: None,
                medium,
            });
        };
        let behind = if *is_on_gpu {
            self.coarse.get(Id::of(&environment), progress, || environment.coarser(COARSE_SIZE))
        } else {
            environment.clone()
        };
        let key = (Id::of(&behind), Id::of(geometry), [rotation_rad, intensity]);
        let lit = self
            .lit
            .get(key, progress, || behind.behind(LitBy { geometry: geometry.clone(), rotation_rad, intensity }));
        // Emitters are not scaled by the environment's intensity, which is therefore in the texels.
        lit.radiance.check_placement(1.0, rotation_rad)?;
        Ok(PreparedLight {
            environment: lit,
            #[cfg(feature = "gpu")]
            background: (environment, intensity),
            #[cfg(feature = "gpu")]
            on_gpu: None,
            rotation_rad,
            intensity: 1.0,
            lamps: lamps.as_slice().into(),
            near_emitters: None,
            medium,
        })
    }

    /// Bounds of the radiance, for hierarchical sums.
    pub fn bounds(&mut self, light: &PreparedLight, progress: &dyn Progress) -> Arc<LightBounds> {
        let cube = &light.environment.cube;
        self.bounds.get(Id::of(&light.environment), progress, || LightBounds::new(cube))
    }

    /// The irradiance map (irradiance by normal), for direct light.
    pub fn irradiance(&mut self, light: &PreparedLight, progress: &dyn Progress) -> Arc<CubeMap> {
        let cube = &light.environment.cube;
        let make = if self.is_for_frames { irradiance_map_of_frame } else { irradiance_map };
        self.irradiance.get(Id::of(&light.environment), progress, || make(cube))
    }

    /// Importance sampling of the environment, for shadowed or glossy direct light.
    pub fn sampler(&mut self, light: &PreparedLight, progress: &dyn Progress) -> Arc<LightSampler> {
        let cube = &light.environment.cube;
        let make = if self.is_for_frames { LightSampler::of_frame } else { LightSampler::new };
        self.sampler.get(Id::of(&light.environment), progress, || make(cube))
    }

    pub fn count(&self, counts: &mut StageCounts) {
        counts.add_memo(&self.environment);
        counts.add_memo(&self.lit);
        counts.add_memo(&self.bounds);
        counts.add_memo(&self.irradiance);
        counts.add_memo(&self.sampler);
    }
}
