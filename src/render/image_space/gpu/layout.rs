//! What the shaders of photons read and write, as it lies in buffers: `shaders/shared/photons.wgsl`, `photon_map.wgsl` and
//! `photon_emission.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

use crate::brdf::Material;
use crate::image_space::caustic_map::ForGloss;
use crate::image_space::constants::{
    CHAIN_R, CHAIN_T, CHAIN_TT, CHAIN_TTTT, CLUSTER_ROW, IS_FRESNEL_SURFACE, IS_SOLID, IS_SURFACE, KEEPS_DIRECTIONS,
    KEEPS_NOTHING, KEEPS_REFLECTED, KEEPS_UNDEFLECTED, MODE_EXACT_POLYGONS, MODE_FOOTPRINTS, MODE_GATHER,
    MODE_MULTI_RESOLUTION, MODE_POINTS, MODE_POLYGONS, MODE_SPLATS, MODE_THICK_LENS, MODE_THIN_LENS, RECEIVES_PHOTONS,
    REFLECTS_BEHIND, REFLECTS_IN_FRONT,
};
use crate::image_space::options::Mode;
use crate::image_space::projection::Projection;
use crate::image_space::receiver_layers::Texel;
use crate::image_space::strips::Strip;
use crate::pinhole::gpu::LampUniforms;
use crate::scene::{Chain, Interfaces, Object, Sides};
use crate::tracing::unpacked_normal;

/// Bytes of a photon, of its way, and of its place in a map.
pub(super) const PHOTON_BYTES: [u64; 3] =
    [size_of::<GpuPhoton>() as u64, size_of::<GpuWay>() as u64, size_of::<GpuPlace>() as u64];

/// A projection.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct PlaneUniforms {
    pub origin: [f32; 3],
    pub texel: f32,
    pub right: [f32; 3],
    pub low_x: f32,
    pub down: [f32; 3],
    pub low_y: f32,
    pub forward: [f32; 3],
    pub is_parallel: u32,
}

impl From<&Projection> for PlaneUniforms {
    fn from(projection: &Projection) -> Self {
        let vector = |v: DVec3| v.as_vec3().to_array();
        let [right, down, forward] = projection.axes.map(vector);
        let [low_x, low_y] = projection.low.as_vec2().to_array();
        Self {
            origin: vector(projection.origin),
            texel: projection.texel as f32,
            right,
            low_x,
            down,
            low_y,
            forward,
            is_parallel: u32::from(projection.is_parallel),
        }
    }
}

/// A light's view, and the part of it that is emitted.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct ViewUniforms {
    pub plane: PlaneUniforms,
    pub power: [f32; 3],
    pub extent: f32,
    pub lamp: LampUniforms,
    pub channels: [f32; 3],
    pub pivot: f32,
    pub chain: u32,
    pub channel: u32,
    pub is_cube: u32,
    pub columns: u32,
    pub strip: Strip,
    pub steps_per_watt: f32,
    pub has_ways: u32,
    pub seed: u32,
    pub all_rows: u32,
    pub cluster_count: u32,
    pub is_papers: u32,
    pub offset: [f32; 2],
    pub is_disc: u32,
    pub(super) padding: [u32; 3],
}

/// A list of clusters of a grid.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct ClusterUniforms {
    pub plane: PlaneUniforms,
    pub count: u32,
    pub grid: u32,
    pub may_merge: u32,
    pub levels: u32,
    pub is_finest: u32,
    pub stride: u32,
    pub(super) padding: [u32; 2],
}

/// Photons that are in the buffers together, in rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Block {
    pub columns: u32,
    pub strip: Strip,
    /// As shaders have it: 0, or 1 of clusters, or 2 of those that were merged.
    pub clusters: u32,
}

impl Block {
    /// Rows of a view.
    pub fn of_rows(columns: u32, strip: Strip) -> Self {
        Self { columns, strip, clusters: 0 }
    }

    /// Clusters of 2×2 photons, or photons that each stand for one.
    pub fn of_clusters(count: u32, are_merged: bool) -> Self {
        let rows = (4 * count).div_ceil(CLUSTER_ROW);
        let strip = Strip { first_row: 0, rows, first_own_row: 0, own_rows: rows };
        Self { columns: CLUSTER_ROW, strip, clusters: 1 + u32::from(are_merged) }
    }
}

/// A map, and the photons that are added to it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct MapUniforms {
    pub plane: PlaneUniforms,
    pub size: [u32; 2],
    pub is_camera: u32,
    pub kept: u32,
    pub columns: u32,
    pub rows: u32,
    pub first_own_row: u32,
    pub own_rows: u32,
    pub steps_per_watt: f32,
    pub is_one_of_many: u32,
    pub mode: u32,
    pub diameter: f32,
    pub spacing: f32,
    pub is_first: u32,
    pub layers: u32,
    pub clusters: u32,
    pub light: [f32; 3],
    pub is_light_far: u32,
    pub is_alone: u32,
    pub frame_spacing: f32,
    pub(super) padding: [u32; 2],
}

/// A plane of an image of surfaces.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct ImagePlaneUniforms {
    pub plane: PlaneUniforms,
    pub size: u32,
    pub receivers: u32,
    pub diagonal: f32,
    pub solids: u32,
    pub object: u32,
    pub(super) padding: [u32; 3],
}

/// A plane, and what is drawn into it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct DrawUniforms {
    pub plane: PlaneUniforms,
    pub size: f32,
    pub near: f32,
    pub far: f32,
    pub instance: u32,
    pub shown: u32,
    pub(super) padding: [u32; 3],
}

/// What an object does to photons.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct GpuSurface {
    pub eta: [f32; 3],
    pub flags: u32,
    pub albedo: [f32; 3],
    pub kind: u32,
    pub specular: [f32; 3],
    pub width: f32,
    pub curve: u32,
    padding: [u32; 3],
}

/// A photon on a receiver.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct GpuPhoton {
    pub position: [f32; 3],
    pub object: u32,
    pub flux: [f32; 3],
    pub caster: u32,
    pub normal: u32,
    pub direction: u32,
    pub inverse_before: f32,
    pub beyond: f32,
}

/// Where a photon was reflected or refracted.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct GpuWay {
    pub first: [f32; 3],
    pub within: f32,
    pub first_normal: [f32; 3],
    padding: u32,
    pub last: [f32; 3],
    padding_2: u32,
    pub last_normal: [f32; 3],
    padding_3: u32,
}

/// A receiver that a texel of a map shows.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct GpuTexel {
    pub position: [f32; 3],
    pub object: u32,
    pub edge: f32,
    pub part: f32,
    pub normal: u32,
    padding: u32,
}

impl From<GpuTexel> for Texel {
    fn from(GpuTexel { position, object, edge, part, normal, .. }: GpuTexel) -> Self {
        Self { position: position.into(), object, normal: unpacked_normal(normal), edge, part }
    }
}

/// Where a photon lands in a map.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct GpuPlace {
    pub at: [f32; 2],
    pub texel: u32,
    padding: u32,
}

impl GpuSurface {
    /// Of an object; `curve`: the number of its curve of reflectance. `material`: its BRDF, where that has to be known.
    pub fn new(object: &Object, curve: u32, material: Option<&Material>) -> Self {
        let mut surface = Self { curve, ..Self::default() };
        if let Some(Material { albedo, kind, specular, width, .. }) = material {
            surface = Self { albedo: *albedo, kind: *kind, specular: *specular, width: *width, ..surface };
        }
        if let Some(reflector) = object.reflector {
            surface.flags |= match reflector.sides {
                Sides::Front => REFLECTS_IN_FRONT,
                Sides::Back => REFLECTS_BEHIND,
                Sides::Both => REFLECTS_IN_FRONT | REFLECTS_BEHIND,
            };
        } else if let Some(refractor) = object.refractor {
            surface.eta = refractor.eta.as_vec3().to_array();
            surface.flags |= match refractor.interfaces {
                Interfaces::One => IS_SURFACE,
                Interfaces::Two => IS_SOLID,
            };
            surface.flags |= if refractor.fresnel { IS_FRESNEL_SURFACE } else { 0 };
        }
        surface.flags |= if object.receiver.is_some() { RECEIVES_PHOTONS } else { 0 };
        surface
    }
}

/// The shader's `CHAIN_…` constants.
pub(super) fn chain_constant(chain: Chain) -> u32 {
    match chain {
        Chain::R => CHAIN_R,
        Chain::T => CHAIN_T,
        Chain::TT => CHAIN_TT,
        Chain::TTTT => CHAIN_TTTT,
    }
}

/// The shader's `MODE_…` constants.
pub(super) fn mode_constant(mode: Mode) -> u32 {
    match mode {
        Mode::Points => MODE_POINTS,
        Mode::Gather => MODE_GATHER,
        Mode::Polygons => MODE_POLYGONS,
        Mode::Auto | Mode::ExactPolygons => MODE_EXACT_POLYGONS,
        Mode::Splats => MODE_SPLATS,
        Mode::MultiResolution => MODE_MULTI_RESOLUTION,
        Mode::ThinLens => MODE_THIN_LENS,
        Mode::ThickLens => MODE_THICK_LENS,
        Mode::Footprints => MODE_FOOTPRINTS,
    }
}

/// The shader's `KEEPS_…` constants.
pub(super) fn kept_constant(kept: ForGloss) -> u32 {
    match kept {
        ForGloss::Nothing => KEEPS_NOTHING,
        ForGloss::Directions => KEEPS_DIRECTIONS,
        ForGloss::Undeflected => KEEPS_UNDEFLECTED,
        ForGloss::Reflected(_) => KEEPS_REFLECTED,
    }
}

/// The channels of a kind of light, as factors.
pub(super) fn channels(channel: Option<usize>) -> [f32; 3] {
    channel.map_or(Vec3::ONE, |channel| Vec3::AXES[channel]).to_array()
}
