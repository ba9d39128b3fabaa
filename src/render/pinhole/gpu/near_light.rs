//! The kinds of light of a gather, and what is bound in place of those that it does not have.

use bytemuck::{Pod, Zeroable};

use super::environment::black_cube;
use super::hierarchical::LightBoundsTexture;
use super::lamp::{LampUniforms, no_slide};
use super::medium::MediumUniforms;
use super::surroundings::{Viewpoints, cube_array};
use super::{EnvironmentCube, UploadedLamp, UploadedSurroundings};
use crate::gpu::GpuError;
use crate::pinhole::constants::{LIGHT_ENVIRONMENT, LIGHT_LAMP, LIGHT_SURROUNDINGS};
use crate::pinhole::{Filter, GatherUniforms, Params, Pinholes};

/// What a gather's light is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightKind {
    /// Light from infinitely far away.
    #[default]
    Environment,
    /// A lamp.
    Lamp,
    /// Lit surfaces.
    Surroundings,
}

impl LightKind {
    /// Its number in shaders.
    pub(super) fn constant(self) -> u32 {
        match self {
            Self::Environment => LIGHT_ENVIRONMENT,
            Self::Lamp => LIGHT_LAMP,
            Self::Surroundings => LIGHT_SURROUNDINGS,
        }
    }

    /// The filter of its look-ups: a lamp needs none, and lit surfaces are always filtered anisotropically.
    pub fn filter(self, wanted: Filter) -> Filter {
        if self == Self::Environment { wanted } else { Filter::Anisotropic }
    }

    /// An error if an engine was made for other light.
    pub(super) fn check(self, engine: Self) -> Result<(), GpuError> {
        if engine == self { Ok(()) } else { Err(GpuError::OtherLight { engine: engine.name(), inputs: self.name() }) }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Environment => "an environment",
            Self::Lamp => "a lamp",
            Self::Surroundings => "surroundings",
        }
    }
}

/// The light of one gather; several lights are several gathers.
#[derive(Clone, Copy, Debug)]
pub enum FrameLight<'a> {
    /// An environment.
    Environment(&'a EnvironmentCube),
    /// A lamp.
    Lamp(&'a UploadedLamp),
    /// Lit surfaces.
    Surroundings(&'a UploadedSurroundings),
}

impl FrameLight<'_> {
    /// What it is.
    pub fn kind(&self) -> LightKind {
        match self {
            Self::Environment(_) => LightKind::Environment,
            Self::Lamp(_) => LightKind::Lamp,
            Self::Surroundings(_) => LightKind::Surroundings,
        }
    }

    /// The parameters of a gather of it.
    pub(super) fn uniforms(&self, params: &Params, pinholes: &Pinholes, map_resolution: u32) -> LightUniforms {
        let none = LightUniforms { medium: params.into(), ..LightUniforms::zeroed() };
        let uniforms = match self {
            Self::Environment(cube) => LightUniforms {
                gather: GatherUniforms::new(params, pinholes, cube.size(), cube.radiance_scale()),
                ..none
            },
            Self::Lamp(lamp) => LightUniforms {
                gather: GatherUniforms::for_near_light(params, pinholes, 0.0),
                lamp: lamp.uniforms,
                ..none
            },
            Self::Surroundings(surfaces) => {
                let gather = GatherUniforms::for_near_light(params, pinholes, surfaces.texel_rad);
                let gather = GatherUniforms { radiance_scale: surfaces.radiance_scale, ..gather };
                LightUniforms { gather, viewpoints: surfaces.viewpoints, ..none }
            }
        };
        LightUniforms { gather: GatherUniforms { map_resolution, ..uniforms.gather }, ..uniforms }
    }
}

/// What shaders call `GatherUniforms`: the parameters, and what is known of near light and of a medium, 512 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct LightUniforms {
    pub gather: GatherUniforms,
    padding: [u32; 3],
    pub lamp: LampUniforms,
    pub viewpoints: Viewpoints,
    pub medium: MediumUniforms,
}

/// The textures of light, whatever it is.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct LightTextures {
    environment: wgpu::TextureView,
    /// A slide, and the radiance and the planes of views.
    near: [wgpu::TextureView; 3],
}

impl LightTextures {
    /// The environment.
    pub fn environment(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::TextureView(&self.environment)
    }

    /// What is bound after the visibility maps.
    pub fn near(&self) -> [wgpu::BindingResource<'_>; 3] {
        self.near.each_ref().map(wgpu::BindingResource::TextureView)
    }
}

/// What is bound in place of light that there is not.
#[derive(Debug)]
pub(crate) struct LightPlaceholders {
    textures: LightTextures,
    pub(super) bounds: LightBoundsTexture,
}

impl LightPlaceholders {
    pub fn new(device: &wgpu::Device) -> Self {
        let black = black_cube(device);
        let environment = EnvironmentCube::of_texture(&black, 1, 1.0).view().clone();
        let view = black.create_view(&cube_array());
        let near = [no_slide(device), view.clone(), view];
        Self { textures: LightTextures { environment, near }, bounds: LightBoundsTexture::none(device) }
    }

    /// The textures of a gather's light, with placeholders for all other light.
    pub(super) fn with(&self, light: FrameLight) -> LightTextures {
        let mut textures = self.textures.clone();
        match light {
            FrameLight::Environment(cube) => textures.environment = cube.view().clone(),
            FrameLight::Lamp(lamp) => textures.near[0] = lamp.slide.clone(),
            FrameLight::Surroundings(UploadedSurroundings { radiance, planes, .. }) => {
                textures.near[1..].clone_from_slice(&[radiance.clone(), planes.clone()]);
            }
        }
        textures
    }
}
