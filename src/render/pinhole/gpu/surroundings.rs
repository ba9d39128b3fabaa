//! What mirrors see of lit surfaces, on the GPU.

use bytemuck::{Pod, Zeroable};

use super::environment::upload_cubes;
use super::hierarchical::LightBoundsTexture;
use crate::environment::CubeMap;
use crate::gpu::GpuError;
use crate::pinhole::constants::MAX_VIEWPOINTS;
use crate::pinhole::{SurroundingView, Surroundings};

/// The views of surroundings: their radiance, the planes of what they see, and bounds of the radiance. They serve any number of images.
#[derive(Clone, Debug)]
pub struct UploadedSurroundings {
    pub(super) viewpoints: Viewpoints,
    pub(super) radiance: wgpu::TextureView,
    pub(super) planes: wgpu::TextureView,
    pub(super) bounds: LightBoundsTexture,
    /// Width of the views' texels at a face's centre, radians.
    pub(super) texel_rad: f32,
    /// What texels are to be multiplied by, W/(m²·sr).
    pub(super) radiance_scale: f32,
}

/// From where surroundings are seen.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Viewpoints {
    /// How many there are.
    pub count: u32,
    /// What planes are to be multiplied by.
    pub plane_scale: f32,
    padding: [u32; 2],
    /// World positions, metres, and one over the distance of the nearest surface.
    pub places: [[f32; 4]; MAX_VIEWPOINTS as usize],
    /// Normals of the surfaces that they lie on; zero where it does not matter.
    pub normals: [[f32; 4]; MAX_VIEWPOINTS as usize],
}

impl UploadedSurroundings {
    /// Uploads all views: from one to sixteen, of one size.
    pub fn upload(device: &wgpu::Device, queue: &wgpu::Queue, surroundings: &Surroundings) -> Result<Self, GpuError> {
        let views = &surroundings.views;
        let sizes = |view: &SurroundingView| [view.radiance.size(), view.planes.size(), view.bounds.size()];
        let are_alike = views.iter().all(|view| sizes(view) == sizes(&views[0]));
        if views.is_empty() || views.len() > MAX_VIEWPOINTS as usize || !are_alike {
            return Err(GpuError::OddViews { views: views.len(), limit: MAX_VIEWPOINTS as usize });
        }
        let radiance: Vec<&CubeMap> = views.iter().map(|view| &view.radiance).collect();
        let planes: Vec<&CubeMap> = views.iter().map(|view| &view.planes).collect();
        let (radiance, radiance_scale) = upload_cubes(device, queue, "views of surroundings", &radiance)?;
        let (planes, plane_scale) = upload_cubes(device, queue, "planes of surroundings", &planes)?;
        let mut viewpoints = Viewpoints { count: views.len() as u32, plane_scale, ..Viewpoints::zeroed() };
        for (k, view) in views.iter().enumerate() {
            viewpoints.places[k] = view.viewpoint.position.extend(view.max_nearness).to_array();
            viewpoints.normals[k] = view.viewpoint.normal.extend(0.0).to_array();
        }
        Ok(Self {
            viewpoints,
            radiance: radiance.create_view(&cube_array()),
            planes: planes.create_view(&cube_array()),
            bounds: LightBoundsTexture::of_views(device, queue, views),
            texel_rad: surroundings.texel_rad(),
            radiance_scale,
        })
    }
}

/// A view of a texture as an array of cubes.
pub(super) fn cube_array() -> wgpu::TextureViewDescriptor<'static> {
    wgpu::TextureViewDescriptor { dimension: Some(wgpu::TextureViewDimension::CubeArray), ..Default::default() }
}
