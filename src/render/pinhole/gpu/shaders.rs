//! The shaders. A line `#import name` is replaced by `shaders/shared/name.wgsl`, once per shader; `#import constants` by the numbers
//! that Rust and the shaders share, of which Rust has the only copy; `#import ray_traversal`, on devices that have ray queries, by
//! `ray_queries.wgsl`; `#import near_light` and `#import near_light_cells`, where the light is the environment, by `no_near_light.wgsl` and
//! `no_near_light_cells.wgsl`; `#import medium`, where there is none, by `no_medium.wgsl`.

use std::fmt::Write;

use super::LightKind;
use super::acceleration::has_ray_queries;
use super::geometry::GEOMETRY_ROW;
use super::hierarchical::layout::{
    BLOCK_LEVELS, BLOCKS_PER_TILE, BOUNDS_WORKGROUP_EDGE, ESTIMATE_WORKGROUPS, MAX_TREE_DEPTH, WORKGROUP_SIZE,
};
use super::maps::{DOUBTS_ROW, MAP_WORKGROUP_SIZE};
use super::medium::ARC_STEP_VECTORS;
use super::probe::PROBES_PER_ROW;
use crate::brdf::{MATERIAL_GGX, MATERIAL_PHONG, MATERIAL_TABLE, TABLE_STEPS};
use crate::cell_tree::MAX_CHILDREN;
use crate::environment::{ARC_STEPS, FIRST_BOUNDED_MIP};
use crate::image::{HIGHLIGHT, MIDDLE_GREY};
use crate::image_space::constants::{
    CHAIN_R, CHAIN_T, CHAIN_TT, CHAIN_TTTT, CLUSTER_ROW, EDGE_RAYS, FIRST_SPLAT_DIAMETER, FOOTPRINT_OVERLAP,
    IMAGE_SEARCH_STEPS, IS_FRESNEL_SURFACE, IS_SOLID, IS_SURFACE, KEEPS_DIRECTIONS, KEEPS_NOTHING, KEEPS_REFLECTED,
    KEEPS_UNDEFLECTED, LEAST_TEAR, LEDGER_ENTRIES, LENS_SPACINGS, MAX_CLUSTER_EXTENT, MAX_EDGE_SURFACES,
    MAX_IMAGE_MISS, MAX_IMAGE_STEPS, MAX_RECEIVER_LAYERS, MAX_SPLAT_DIAMETER, MAX_SPREAD_RAD, MIN_CLUSTER_COSINE,
    MIN_DIRECT_COSINE, MIN_DRAWN_AREA, MIN_FOOTPRINT_DEVIATION, MIN_IMAGE_STEPS, MIN_SPLAT_DIAMETER,
    MODE_EXACT_POLYGONS, MODE_FOOTPRINTS, MODE_GATHER, MODE_MULTI_RESOLUTION, MODE_POINTS, MODE_POLYGONS, MODE_SPLATS,
    MODE_THICK_LENS, MODE_THIN_LENS, PHOTON_OFF_PLANE, PHOTON_OFF_RAY, RECEIVES_PHOTONS, REFLECTS_BEHIND,
    REFLECTS_IN_FRONT, SAME_SURFACE_COSINE, SHOWS_ALL, SHOWS_BACK, SHOWS_FIRST_AND_LAST, SHOWS_FRONT,
    SMOOTH_LENS_COSINE, SPLAT_DEVIATION, SPLAT_DIAMETER_STEP, SPLAT_REACH, SPLAT_SIZES, TEAR_STRETCH,
};
use crate::pinhole::MEDIUM_OBJECT;
use crate::pinhole::constants::{
    AZIMUTH_PER_SINE, CONE_PER_AXES, HALF_ANGLE_PER_CHORD, MAX_AZIMUTH_SINE, MAX_CONTRAST, MAX_MIRRORS, MAX_OFF_PLANE,
    MAX_PIXELS_APART, MAX_REFRACTED_BLUR, MIN_EVEN_COSINE, MIN_HEIGHT, MIN_NORMAL_COSINE, MIN_REFRACTED_COSINE,
    MIN_SAME_COSINE, MIN_SEEN_COSINE, MIN_WEIGHT, OTHER_SIDE, PART_OF_FACETS, WHOLE_SPHERE_RAD,
};
use crate::pinhole::constants::{
    BEAM_CONE, BEAM_NONE, BEAM_SLIDE, BEND_BLUR, BLUR_RADIUS, BLURRED_REACH, CENTRAL_VISIBILITY_SHARE,
    COHERENT_ERROR_SHARE, CONTRAST_ERROR_SCALE, ESTIMATE_MAX_SAMPLE_NODES, ESTIMATE_RMS_SHARE, EVEN_LIGHT_SHARPNESS,
    EWA_MAX_COLUMNS, EWA_RADIUS, EWA_TEXEL, FILTER_ANISOTROPIC, FILTER_EWA, FILTER_HARDWARE, FILTER_ISOTROPIC,
    FILTER_NONE, FOOTPRINT_BEND, FOOTPRINT_RADIUS, INTERPOLATION_ERROR_SCALE, INTERPOLATION_POINTS, LAMP_TEXELS,
    LIGHT_ENVIRONMENT, LIGHT_LAMP, LIGHT_SURROUNDINGS, LOBE_BLUR, LOBE_CORE, LOBE_CORE_WIDTH, LOBE_SHIFT, LOBE_TAIL,
    LOBE_TAIL_SHARE, LOBE_TAIL_WIDTH, LOBE_TILT, LOBE_TILT_GROWTH, MAX_EVEN_ASPECT, MAX_INTERPOLATED_WIDTH,
    MAX_LAMP_QUARTERINGS, MAX_LEFT_ALONG_RAY, MAX_LENGTH_RATIO, MAX_PIECE_SIZE, MAX_QUARTERINGS, MAX_RELATIVE_SIZE,
    MAX_TURN_ALONG_RAY, MAX_VIEWPOINTS, MIN_BEND_BLUR, MIN_CERTAIN_SINE, MIN_DISC_LENGTH, MIN_DISTANCE_RATIO,
    MIN_EVEN_PART, MIN_MINOR_SHARE, MIN_RAY_WEIGHT, MIN_SLENDERNESS, MIN_TRACED_SHARE, MIN_TRACED_SHARE_OF_INTERFACES,
    MIN_TRACED_SKY_SHARE, MIN_UNEVEN_SIZE, NEAR_FIELD_SIZES, NEGLIGIBLE_SHARE, PAIR_ERROR_SHARE, PART_TEXELS,
    POINT_SPACING, SMOOTH_NORMAL_TOLERANCE, SMOOTH_POSITION_TOLERANCE, TAP_SHARPNESS, TAPS_PER_ERROR_BUDGET, TILE_SIZE,
    WEIGHT_ERROR_SCALE,
};
use crate::tracing::{END_SLACK, SLACK, SeenBy};
use pinspot_sums::pinhole::layout::{
    BATCH_SIZE, CURVE_POINTS, IS_FRESNEL, IS_INTERFACE, LIGHTS_BACK, LIGHTS_FRONT, NO_CURVE, OBJECT_SCALE,
};
use pinspot_sums::pinhole::tree::CHANNEL_SHIFT;
use pinspot_sums::pinhole::visibility::{BEHIND, MIDDLE, MIN_OCCLUDER_COSINE};

/// Bins of the histogram of luminance by which previews are metered: the upper bits of a positive float, less the lowest of them.
pub(crate) const HISTOGRAM_BINS: u32 = 1 << (31 - HISTOGRAM_SHIFT);
const HISTOGRAM_SHIFT: u32 = 12;

/// A shader that pipelines are made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shader {
    /// Its file, without the extension.
    pub name: &'static str,
    source: &'static str,
}

macro_rules! shader {
    ($name:literal) => {
        Shader { name: $name, source: include_str!(concat!("../../../../shaders/", $name, ".wgsl")) }
    };
}

pub(crate) const COARSER_LEVEL: Shader = shader!("coarser_level");
pub(crate) const EMITTERS: Shader = shader!("emitters");
pub(crate) const FILTER_PROBE: Shader = shader!("filter_probe");
pub(crate) const GATHER: Shader = shader!("gather");
pub(crate) const IRRADIANCE_ESTIMATE: Shader = shader!("irradiance_estimate");
pub(crate) const LIGHT_BOUNDS: Shader = shader!("light_bounds");
pub(crate) const LIT_ENVIRONMENT: Shader = shader!("lit_environment");
pub(crate) const PHOTON_CLUSTERS: Shader = shader!("photon_clusters");
pub(crate) const PHOTON_EMISSION: Shader = shader!("photon_emission");
pub(crate) const PHOTON_PLACES: Shader = shader!("photon_places");
pub(crate) const PHOTON_POLYGONS: Shader = shader!("photon_polygons");
pub(crate) const PHOTON_SPLATS: Shader = shader!("photon_splats");
pub(crate) const PREVIEW_DISPLAY: Shader = shader!("preview_display");
pub(crate) const PREVIEW_LIGHT: Shader = shader!("preview_light");
pub(crate) const PREVIEW_SHADING: Shader = shader!("preview_shading");
pub(crate) const PREVIEW_VIEWS: Shader = shader!("preview_views");
pub(crate) const RECEIVER_BLOCKS: Shader = shader!("receiver_blocks");
pub(crate) const REFINE: Shader = shader!("refine");
pub(crate) const RESOLVE: Shader = shader!("resolve");
pub(crate) const SURFACE_IMAGES: Shader = shader!("surface_images");
pub(crate) const TRACE_MAPS: Shader = shader!("trace_maps");
pub(crate) const TRACE_RAYS: Shader = shader!("trace_rays");
pub(crate) const TRACE_SHADOWS: Shader = shader!("trace_shadows");

const SHARED: &[Shader] = &[
    shader!("shared/beam"),
    shader!("shared/block_coverage"),
    shader!("shared/block_pairs"),
    shader!("shared/brdf"),
    shader!("shared/cell_quarters"),
    shader!("shared/cell_radiance"),
    shader!("shared/cell_tree"),
    shader!("shared/contribution_bounds"),
    shader!("shared/cube"),
    shader!("shared/doubts"),
    shader!("shared/filters"),
    shader!("shared/footprint"),
    shader!("shared/frame"),
    shader!("shared/gather_inputs"),
    shader!("shared/gloss_bounds"),
    shader!("shared/hits"),
    shader!("shared/image_hits"),
    shader!("shared/interface"),
    shader!("shared/lamp"),
    shader!("shared/light_direction"),
    shader!("shared/lobe"),
    shader!("shared/medium"),
    shader!("shared/microfacets"),
    shader!("shared/near_light"),
    shader!("shared/near_light_cells"),
    shader!("shared/no_medium"),
    shader!("shared/no_near_light"),
    shader!("shared/no_near_light_cells"),
    shader!("shared/no_rays"),
    shader!("shared/photon_footprints"),
    shader!("shared/photon_map"),
    shader!("shared/photon_sheet"),
    shader!("shared/photon_surface"),
    shader!("shared/photons"),
    shader!("shared/plane"),
    shader!("shared/point_visibility"),
    shader!("shared/preview"),
    shader!("shared/preview_gloss"),
    shader!("shared/preview_lamps"),
    shader!("shared/preview_near_light"),
    shader!("shared/ray_batch"),
    shader!("shared/ray_origin"),
    shader!("shared/ray_queries"),
    shader!("shared/ray_traversal"),
    shader!("shared/rays"),
    shader!("shared/receiver_tiles"),
    shader!("shared/receivers"),
    shader!("shared/sobol"),
    shader!("shared/surroundings"),
    shader!("shared/tile_batch"),
    shader!("shared/traversal"),
    shader!("shared/unit_vectors"),
    shader!("shared/visibility"),
];

/// How rays find triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RayMethod {
    /// By a traversal in the shader.
    Traversal,
    /// By ray queries of the device.
    Queries,
}

/// What a shader is resolved for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Variant {
    pub rays: RayMethod,
    pub light: LightKind,
    /// Whether there is a medium.
    pub medium: bool,
}

impl RayMethod {
    fn of_device(device: &wgpu::Device) -> Self {
        if has_ray_queries(device) { Self::Queries } else { Self::Traversal }
    }
}

impl Shader {
    /// Its source with the imports in place.
    pub fn resolve(self, variant: Variant) -> String {
        let mut resolved = Resolved { source: String::new(), imported: Vec::new(), variant };
        resolved.add(self.source);
        let has_queries = resolved.imported.contains(&RAY_QUERIES);
        if has_queries { format!("enable wgpu_ray_query;\n{}", resolved.source) } else { resolved.source }
    }

    /// Its module on a device.
    pub fn module(self, device: &wgpu::Device) -> wgpu::ShaderModule {
        self.module_in(device, LightKind::Environment, false)
    }

    /// The same for a kind of light, in scenes with or without a medium.
    pub fn module_in(self, device: &wgpu::Device, light: LightKind, medium: bool) -> wgpu::ShaderModule {
        self.module_of(device, self.resolve(Variant { rays: RayMethod::of_device(device), light, medium }))
    }

    /// The same, writing storage textures of 32-bit floats or of halves: WGSL has no parameters for formats.
    pub fn module_writing(self, device: &wgpu::Device, format: wgpu::TextureFormat) -> wgpu::ShaderModule {
        let rays = RayMethod::of_device(device);
        let source = self.resolve(Variant { rays, light: LightKind::Environment, medium: false });
        let is_half = format == wgpu::TextureFormat::Rgba16Float;
        self.module_of(device, if is_half { source.replace("rgba32float", "rgba16float") } else { source })
    }

    fn module_of(self, device: &wgpu::Device, source: String) -> wgpu::ShaderModule {
        device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(self.name),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        })
    }
}

const RAY_TRAVERSAL: &str = "ray_traversal";
const RAY_QUERIES: &str = "ray_queries";

struct Resolved {
    source: String,
    imported: Vec<&'static str>,
    variant: Variant,
}

impl Resolved {
    fn add(&mut self, source: &'static str) {
        for line in source.lines() {
            if let Some(name) = line.strip_prefix("#import ") {
                self.import(name);
            } else {
                self.source.push_str(line);
                self.source.push('\n');
            }
        }
    }

    fn import(&mut self, name: &'static str) {
        let is_far = self.variant.light == LightKind::Environment;
        let name = match name {
            RAY_TRAVERSAL if self.variant.rays == RayMethod::Queries => RAY_QUERIES,
            "near_light" if is_far => "no_near_light",
            "near_light_cells" if is_far => "no_near_light_cells",
            "medium" if !self.variant.medium => "no_medium",
            name => name,
        };
        if self.imported.contains(&name) {
            return;
        }
        self.imported.push(name);
        if name == "constants" {
            self.source.push_str(&constants());
        } else if let Some(shared) = SHARED.iter().find(|shared| shared.name.strip_prefix("shared/") == Some(name)) {
            self.add(shared.source);
        }
        // A name that does not exist leaves names undeclared: the shader's validation fails.
    }
}

/// A constant in WGSL.
trait Constant: Copy {
    const TYPE: &str;
    fn literal(self) -> String;
}

impl Constant for u32 {
    const TYPE: &str = "u32";

    fn literal(self) -> String {
        format!("{self}u")
    }
}

impl Constant for f32 {
    const TYPE: &str = "f32";

    fn literal(self) -> String {
        format!("{self:?}f")
    }
}

fn declare<T: Constant>(source: &mut String, name: &str, value: T) {
    writeln!(source, "const {name}: {} = {};", T::TYPE, value.literal()).expect("a string takes everything");
}

/// Declarations of all shared numbers.
fn constants() -> String {
    let mut source = String::new();
    macro_rules! declare {
        ($($name:ident),* $(,)?) => {
            $(declare(&mut source, stringify!($name), $name);)*
        };
    }
    declare!(TILE_SIZE, INTERPOLATION_POINTS, BLOCK_LEVELS, BLOCKS_PER_TILE);
    declare!(WORKGROUP_SIZE, BOUNDS_WORKGROUP_EDGE, ESTIMATE_WORKGROUPS, PROBES_PER_ROW);
    declare(&mut source, "CURVE_POINTS", CURVE_POINTS as u32);
    declare!(BATCH_SIZE, NO_CURVE, MAX_CHILDREN, MAX_TREE_DEPTH, MAX_QUARTERINGS, MAX_LAMP_QUARTERINGS);
    declare!(SMOOTH_POSITION_TOLERANCE, SMOOTH_NORMAL_TOLERANCE, POINT_SPACING, MIN_MINOR_SHARE, MIN_DISTANCE_RATIO);
    declare!(
        PAIR_ERROR_SHARE,
        NEGLIGIBLE_SHARE,
        NEAR_FIELD_SIZES,
        MAX_PIECE_SIZE,
        MAX_RELATIVE_SIZE,
        TAPS_PER_ERROR_BUDGET,
        CENTRAL_VISIBILITY_SHARE
    );
    declare!(FOOTPRINT_RADIUS, FOOTPRINT_BEND, BEND_BLUR, MIN_BEND_BLUR, LOBE_BLUR, FIRST_BOUNDED_MIP);
    declare!(CONTRAST_ERROR_SCALE, WEIGHT_ERROR_SCALE, INTERPOLATION_ERROR_SCALE);
    declare!(ESTIMATE_MAX_SAMPLE_NODES, ESTIMATE_RMS_SHARE);
    declare!(TAP_SHARPNESS, EVEN_LIGHT_SHARPNESS, EWA_RADIUS, EWA_TEXEL, EWA_MAX_COLUMNS);
    declare(&mut source, "SEEN_BY_BITS", SeenBy::BITS);
    declare!(LAMP_TEXELS, PART_TEXELS, MAX_LENGTH_RATIO, MIN_RAY_WEIGHT);
    declare!(GEOMETRY_ROW, DOUBTS_ROW, MAP_WORKGROUP_SIZE, MIN_OCCLUDER_COSINE, BEHIND, END_SLACK);
    declare(&mut source, "TRIANGLE_SLACK", SLACK);
    declare(&mut source, "MIDDLE_EDGE", u32::from(MIDDLE));
    declare!(MIN_CERTAIN_SINE, MIN_TRACED_SHARE, MIN_TRACED_SHARE_OF_INTERFACES, MIN_TRACED_SKY_SHARE);
    declare!(MAX_INTERPOLATED_WIDTH, LOBE_CORE, LOBE_TAIL, LOBE_TAIL_SHARE, LOBE_SHIFT);
    declare!(LOBE_CORE_WIDTH, LOBE_TAIL_WIDTH, LOBE_TILT, LOBE_TILT_GROWTH);
    declare!(HISTOGRAM_BINS, HISTOGRAM_SHIFT, MIDDLE_GREY, HIGHLIGHT, MAX_MIRRORS, MIN_HEIGHT);
    declare!(MIN_NORMAL_COSINE, MAX_OFF_PLANE, MIN_WEIGHT, MAX_CONTRAST, MAX_PIXELS_APART, MIN_SEEN_COSINE);
    declare!(MIN_EVEN_COSINE, MIN_SAME_COSINE);
    declare!(LIGHTS_FRONT, LIGHTS_BACK, IS_INTERFACE, IS_FRESNEL, OBJECT_SCALE, CHANNEL_SHIFT);
    declare!(MIN_REFRACTED_COSINE, MAX_REFRACTED_BLUR, WHOLE_SPHERE_RAD);
    declare!(HALF_ANGLE_PER_CHORD, MAX_AZIMUTH_SINE, AZIMUTH_PER_SINE, CONE_PER_AXES);
    declare!(FILTER_NONE, FILTER_ISOTROPIC, FILTER_ANISOTROPIC, FILTER_HARDWARE, FILTER_EWA);
    declare!(LIGHT_ENVIRONMENT, LIGHT_LAMP, LIGHT_SURROUNDINGS, MAX_VIEWPOINTS, BEAM_NONE, BEAM_CONE, BEAM_SLIDE);
    declare!(OTHER_SIDE);
    declare!(
        BLUR_RADIUS,
        BLURRED_REACH,
        MAX_EVEN_ASPECT,
        MIN_EVEN_PART,
        MIN_UNEVEN_SIZE,
        COHERENT_ERROR_SHARE,
        MIN_SLENDERNESS,
        MIN_DISC_LENGTH
    );
    declare!(MEDIUM_OBJECT, ARC_STEPS, ARC_STEP_VECTORS, MAX_LEFT_ALONG_RAY, MAX_TURN_ALONG_RAY);
    declare!(PHOTON_OFF_PLANE, PHOTON_OFF_RAY, SAME_SURFACE_COSINE, TEAR_STRETCH, LEAST_TEAR, MIN_DRAWN_AREA);
    declare!(MAX_RECEIVER_LAYERS, EDGE_RAYS, MAX_EDGE_SURFACES, MAX_CLUSTER_EXTENT, MIN_CLUSTER_COSINE, CLUSTER_ROW);
    declare!(SPLAT_DEVIATION, SPLAT_REACH, MIN_SPLAT_DIAMETER, MAX_SPLAT_DIAMETER, MIN_FOOTPRINT_DEVIATION);
    declare!(FOOTPRINT_OVERLAP, LENS_SPACINGS, SMOOTH_LENS_COSINE, MAX_SPREAD_RAD);
    declare!(MIN_IMAGE_STEPS, MAX_IMAGE_STEPS, IMAGE_SEARCH_STEPS, MAX_IMAGE_MISS);
    declare!(SPLAT_SIZES, FIRST_SPLAT_DIAMETER, SPLAT_DIAMETER_STEP, LEDGER_ENTRIES);
    declare!(CHAIN_R, CHAIN_T, CHAIN_TT, CHAIN_TTTT, RECEIVES_PHOTONS);
    declare!(SHOWS_ALL, SHOWS_FIRST_AND_LAST, SHOWS_FRONT, SHOWS_BACK);
    declare!(REFLECTS_IN_FRONT, REFLECTS_BEHIND, IS_SURFACE, IS_SOLID, IS_FRESNEL_SURFACE);
    declare!(MODE_POINTS, MODE_GATHER, MODE_POLYGONS, MODE_EXACT_POLYGONS, MODE_SPLATS, MODE_MULTI_RESOLUTION);
    declare!(MODE_THIN_LENS, MODE_THICK_LENS, MODE_FOOTPRINTS, MIN_DIRECT_COSINE);
    declare!(KEEPS_NOTHING, KEEPS_DIRECTIONS, KEEPS_UNDEFLECTED, KEEPS_REFLECTED);
    declare!(MATERIAL_PHONG, MATERIAL_GGX, MATERIAL_TABLE, PART_OF_FACETS);
    let [theta_half, theta_diff, phi_diff] = TABLE_STEPS.map(|steps| steps as u32);
    declare(&mut source, "TABLE_THETA_HALF_STEPS", theta_half);
    declare(&mut source, "TABLE_THETA_DIFF_STEPS", theta_diff);
    declare(&mut source, "TABLE_PHI_DIFF_STEPS", phi_diff);
    source
}

#[cfg(test)]
mod inlined;
#[cfg(test)]
mod tests;
