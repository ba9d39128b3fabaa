//! The shaders without a device: naga validates each, and every struct that crosses is laid out as the Rust one.

use std::collections::BTreeMap;
use std::mem::offset_of;

use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{AddressSpace, Handle, Module, Type, TypeInner};

use super::*;
use crate::brdf::Material;
use crate::cell_tree::CellNode;
use crate::engine::preview_layout::{PIXEL_BYTES, PreviewGrid, PreviewObject, PreviewUniforms};
use crate::image_space::gpu::{
    ClusterUniforms, DrawUniforms, GpuPhoton, GpuPlace, GpuSurface, GpuTexel, GpuWay, ImagePlaneUniforms,
    MapUniforms as PhotonMapUniforms, PlaneUniforms, Strip, ViewUniforms,
};
use crate::pinhole::gpu::geometry::RayUniforms;
use crate::pinhole::gpu::hierarchical::layout::{BLOCK_BYTES, SampleNode, TilePass, Tolerance, TreeUniforms};
use crate::pinhole::gpu::hierarchical::light_bounds::BoundsUniforms;
use crate::pinhole::gpu::lamp::LampUniforms;
use crate::pinhole::gpu::lit_environment::{EmitterUniforms, LitFace};
use crate::pinhole::gpu::maps::{MapUniforms, PackedHemisphere};
use crate::pinhole::gpu::medium::MediumUniforms;
use crate::pinhole::gpu::near_light::LightUniforms;
use crate::pinhole::gpu::probe::GpuProbe;
use crate::pinhole::gpu::ray_batch::{ArrivingLight, BatchHit, BatchRay, BatchUniforms, PackedDirection};
use crate::pinhole::gpu::surroundings::Viewpoints;
use crate::pinhole::{GatherUniforms, PinholeSample};

pub(super) const ALL: [Shader; 23] = [
    COARSER_LEVEL,
    EMITTERS,
    FILTER_PROBE,
    GATHER,
    IRRADIANCE_ESTIMATE,
    LIGHT_BOUNDS,
    LIT_ENVIRONMENT,
    PHOTON_CLUSTERS,
    PHOTON_EMISSION,
    PHOTON_PLACES,
    PHOTON_POLYGONS,
    PHOTON_SPLATS,
    PREVIEW_DISPLAY,
    PREVIEW_LIGHT,
    PREVIEW_SHADING,
    PREVIEW_VIEWS,
    RECEIVER_BLOCKS,
    REFINE,
    RESOLVE,
    SURFACE_IMAGES,
    TRACE_MAPS,
    TRACE_RAYS,
    TRACE_SHADOWS,
];

/// What every WebGPU device has: halves packed in words, and arrays of cubes.
const EVERYWHERE: Capabilities = Capabilities::SHADER_FLOAT16_IN_FLOAT32.union(Capabilities::CUBE_ARRAY_TEXTURES);

const PLAIN: Variant = Variant { rays: RayMethod::Traversal, light: LightKind::Environment, medium: false };

fn parse(shader: Shader) -> Result<Module, String> {
    parse_with(shader, PLAIN, Capabilities::empty())
}

pub(super) fn parse_with(shader: Shader, variant: Variant, more: Capabilities) -> Result<Module, String> {
    let (name, source) = (shader.name, shader.resolve(variant));
    let module = naga::front::wgsl::parse_str(&source).map_err(|e| format!("{name}: {}", e.emit_to_string(&source)))?;

    Validator::new(ValidationFlags::all(), EVERYWHERE | more)
        .validate(&module)
        .map_err(|e| format!("{name}: {}", e.emit_to_string(&source)))?;
    Ok(module)
}

/// Also writes the resolved shaders to `target/shaders`, as naga's and drivers' messages name lines of these.
#[test]
fn every_shader_is_valid() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/shaders");
    std::fs::create_dir_all(&folder).unwrap();
    for shader in ALL {
        std::fs::write(folder.join(shader.name).with_extension("wgsl"), shader.resolve(PLAIN)).unwrap();
    }
    let with_queries =
        |shader| parse_with(shader, Variant { rays: RayMethod::Queries, ..PLAIN }, Capabilities::RAY_QUERY);
    let under_lamps = |shader| parse_with(shader, Variant { light: LightKind::Lamp, ..PLAIN }, Capabilities::empty());
    let of_sums = [GATHER, IRRADIANCE_ESTIMATE, RECEIVER_BLOCKS, REFINE, RESOLVE];
    let in_medium = of_sums.into_iter().flat_map(|shader| {
        [LightKind::Environment, LightKind::Lamp]
            .map(|light| parse_with(shader, Variant { light, medium: true, ..PLAIN }, Capabilities::empty()))
    });
    let parsed = ALL.into_iter().flat_map(|shader| [parse(shader), with_queries(shader), under_lamps(shader)]);
    let parsed = parsed.chain(in_medium);
    let failures: Vec<String> = parsed.filter_map(Result::err).collect();
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn every_shader_file_is_known() {
    let files_in = |folder: &str| -> Vec<String> {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shaders").join(folder);
        let paths = std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().path());
        let mut names: Vec<String> = paths
            .filter(|path| path.extension().is_some_and(|extension| extension == "wgsl"))
            .map(|path| path.file_stem().unwrap().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    };
    assert_eq!(files_in(""), ALL.map(|shader| shader.name));
    let shared: Vec<&str> = SHARED.iter().map(|shader| shader.name.trim_start_matches("shared/")).collect();
    assert_eq!(files_in("shared"), shared);
}

/// Names and offsets of a struct's members, and the size of the whole.
#[derive(Debug, PartialEq)]
struct Layout {
    members: Vec<(String, u32)>,
    size: u32,
}

/// Adds the structs that a type is made of.
fn collect_structs(module: &Module, ty: Handle<Type>, found: &mut BTreeMap<String, Layout>) {
    match &module.types[ty].inner {
        TypeInner::Array { base, .. } => collect_structs(module, *base, found),
        TypeInner::Struct { members, span } => {
            for member in members {
                collect_structs(module, member.ty, found);
            }
            let name = module.types[ty].name.clone().unwrap();
            let members = members.iter().map(|member| (member.name.clone().unwrap(), member.offset)).collect();
            found.insert(name, Layout { members, size: *span });
        }
        _ => (),
    }
}

/// All structs in the uniform and storage buffers of a shader.
fn structs_in_buffers(shader: Shader) -> BTreeMap<String, Layout> {
    let module = parse(shader).unwrap();
    let mut found = BTreeMap::new();
    for (_, variable) in module.global_variables.iter() {
        if matches!(variable.space, AddressSpace::Uniform | AddressSpace::Storage { .. }) {
            collect_structs(&module, variable.ty, &mut found);
        }
    }
    found
}

macro_rules! layout {
    ($type:ty { $($field:ident),* $(,)? }) => {
        Layout {
            members: vec![$((stringify!($field).to_owned(), offset_of!($type, $field) as u32)),*],
            size: size_of::<$type>() as u32,
        }
    };
}

/// The structs that Rust and the shaders share, by their names in the shaders. Padding at the end has no name there.
fn rust_structs() -> BTreeMap<&'static str, Layout> {
    BTreeMap::from([
        ("ArrivingLight", layout!(ArrivingLight { arriving, unfinished, all })),
        ("BatchHit", layout!(BatchHit { position, distance, normal, object, face_normal, flags })),
        ("BatchRay", layout!(BatchRay { origin, direction })),
        ("BatchUniforms", layout!(BatchUniforms { count, first_direction, direction_count })),
        ("BoundsUniforms", layout!(BoundsUniforms { size, first, first_above, detail, mip, radiance_scale })),
        ("CellNode", layout!(CellNode { centroid_area, normal_e11, sides_curvature, curvature_bounds_links })),
        ("Clusters", layout!(ClusterUniforms { plane, count, grid, may_merge, levels, is_finest, stride })),
        ("EmitterUniforms", layout!(EmitterUniforms { clip_from_mesh, number })),
        ("GatherUniforms", gather_uniforms()),
        ("ImageDraw", layout!(DrawUniforms { plane, size, near, far, instance, shown })),
        ("ImagePlane", layout!(ImagePlaneUniforms { plane, size, receivers, diagonal, solids, object })),
        ("Hemisphere", layout!(PackedHemisphere { position, extent, normal, object_sides, texel_jitter })),
        (
            "Lamp",
            layout!(LampUniforms {
                position,
                radius,
                radiance,
                max_radiance,
                direction,
                half_angle,
                up,
                softness,
                beam
            }),
        ),
        ("LitFace", layout!(LitFace { face, points, background_factor })),
        ("Medium", layout!(MediumUniforms { extinction, g, lamps_in_medium, max_along_arcs })),
        ("MapUniforms", layout!(MapUniforms { first_map, resolution, bisections })),
        ("Material", layout!(Material { albedo, kind, specular, width, table })),
        ("MapTexel", layout!(GpuTexel { position, object, edge, part, normal })),
        ("Photon", layout!(GpuPhoton { position, object, flux, caster, normal, direction, inverse_before, beyond })),
        ("PhotonMap", photon_map()),
        ("PhotonPlace", layout!(GpuPlace { at, texel })),
        ("PhotonSurface", layout!(GpuSurface { eta, flags, albedo, kind, specular, width, curve })),
        ("PhotonView", photon_view()),
        ("PhotonWay", layout!(GpuWay { first, within, first_normal, last, last_normal })),
        ("PinholeSample", pinhole_sample()),
        ("LightDirection", layout!(PackedDirection { direction, radiance })),
        ("PreviewGrid", layout!(PreviewGrid { spacing, coarser })),
        (
            "PreviewObject",
            layout!(PreviewObject { albedo, flags, mirror_albedo, alpha, radiance, width, specular, kind }),
        ),
        ("PreviewUniforms", preview_uniforms()),
        ("Plane", layout!(PlaneUniforms { origin, texel, right, low_x, down, low_y, forward, is_parallel })),
        ("Probe", layout!(GpuProbe { direction, side_1, side_2 })),
        ("RayUniforms", layout!(RayUniforms { node_count, offset })),
        ("SampleNode", sample_node()),
        ("TilePass", layout!(TilePass { first_tile, level, split, split_count })),
        ("Tolerance", layout!(Tolerance { error, relative_error })),
        ("TreeUniforms", tree_uniforms()),
        ("Viewpoints", layout!(Viewpoints { count, plane_scale, places, normals })),
    ])
}

fn gather_uniforms() -> Layout {
    let mut layout = layout!(GatherUniforms {
        sample_count,
        taps,
        attenuation,
        own_scale,
        epsilon_scale,
        epsilon,
        texel_rad,
        radiance_scale,
        map_resolution,
        rotation_cos,
        rotation_sin,
        reach,
        cell_area,
    });
    layout.members.push(("lamp".into(), offset_of!(LightUniforms, lamp) as u32));
    layout.members.push(("viewpoints".into(), offset_of!(LightUniforms, viewpoints) as u32));
    layout.members.push(("medium".into(), offset_of!(LightUniforms, medium) as u32));
    Layout { size: size_of::<LightUniforms>() as u32, ..layout }
}

fn preview_uniforms() -> Layout {
    layout!(PreviewUniforms {
        camera_position,
        half_height,
        camera_forward,
        is_perspective,
        camera_right,
        lamp_count,
        camera_up,
        direction_count,
        light_centre,
        has_emitters,
        size,
        rotation,
        intensity,
        background_intensity,
        environment_scale,
        background_scale,
        irradiance_scale,
        texel_rad,
        caustic_gain,
        is_plain,
        exposure,
        background_exposure,
        exposure_flags,
        tone_map,
        extinction,
        part_count,
        is_shadowed,
        medium_flags,
        sight,
        scattering_spacing,
    })
}

fn photon_map() -> Layout {
    layout!(PhotonMapUniforms {
        plane,
        size,
        is_camera,
        kept,
        columns,
        rows,
        first_own_row,
        own_rows,
        steps_per_watt,
        is_one_of_many,
        mode,
        diameter,
        spacing,
        is_first,
        layers,
        clusters,
        light,
        is_light_far,
        is_alone,
        frame_spacing,
    })
}

fn photon_view() -> Layout {
    let before =
        layout!(ViewUniforms { plane, power, extent, lamp, channels, pivot, chain, channel, is_cube, columns });
    let first = offset_of!(ViewUniforms, strip) as u32;
    let strip = layout!(Strip { first_row, rows, first_own_row, own_rows }).members;
    let strip = strip.into_iter().map(|(name, offset)| (name, first + offset)).collect();
    let after =
        layout!(ViewUniforms { steps_per_watt, has_ways, seed, all_rows, cluster_count, is_papers, offset, is_disc })
            .members;
    Layout { members: [before.members, strip, after].concat(), ..before }
}

fn pinhole_sample() -> Layout {
    layout!(PinholeSample {
        position,
        area,
        normal,
        object_flags,
        reflectance,
        curve,
        side_1,
        lobe,
        side_2,
        map,
        change_1,
        texel_jitter_u,
        change_2,
        texel_jitter_v,
    })
}

fn sample_node() -> Layout {
    layout!(SampleNode {
        position,
        lobe,
        normal,
        object_flags,
        reflectance,
        curve,
        texel_jitter,
        max_reflectance,
        map,
        node,
        face,
    })
}

fn tree_uniforms() -> Layout {
    layout!(TreeUniforms {
        size,
        tiles_across,
        list_capacity,
        root_count,
        first_cluster,
        sample_count,
        may_interpolate,
        split_near,
        has_view_directions,
        area,
        traces_rays,
        has_tolerances,
    })
}

#[test]
fn every_struct_in_a_buffer_is_laid_out_as_in_rust() {
    let in_rust = rust_structs();
    let mut seen = Vec::new();
    for shader in ALL {
        for (name, layout) in structs_in_buffers(shader) {
            if let Some(size) = size_of_pixels(&name) {
                assert_eq!(u64::from(layout.size), size, "{name}");
                continue;
            }
            if name == "Block" {
                // Rust knows only how large it is.
                assert_eq!(u64::from(layout.size), BLOCK_BYTES);
                continue;
            }
            let Some(expected) = in_rust.get(name.as_str()) else { panic!("{}: {name} is not pinned", shader.name) };
            assert_eq!(layout.members, expected.members, "{}: {name}", shader.name);
            // Shaders round sizes up to the alignment of uniforms' members, and buffers are at least as large.
            assert!(layout.size <= expected.size, "{}: {name} has {} bytes", shader.name, layout.size);
            seen.push(name);
        }
    }
    for name in in_rust.keys() {
        assert!(seen.iter().any(|seen| seen == name), "no shader has a struct {name}");
    }
}

/// What pixels of previews see, of which Rust knows only how large it is.
fn size_of_pixels(name: &str) -> Option<u64> {
    let names = ["SurfacePoint", "Escape", "FirstSurface"];
    Some(PIXEL_BYTES[names.iter().position(|known| *known == name)?])
}

/// Elements of arrays have to be as large as well.
#[test]
fn array_elements_are_as_large_as_in_rust() {
    let in_rust = rust_structs();
    for shader in ALL {
        let module = parse(shader).unwrap();
        for (_, variable) in module.global_variables.iter() {
            let TypeInner::Array { base, stride, .. } = module.types[variable.ty].inner else { continue };
            let Some(expected) = module.types[base].name.as_deref().and_then(|name| in_rust.get(name)) else {
                continue;
            };
            assert_eq!(stride, expected.size, "{}: {:?}", shader.name, variable.name);
        }
    }
}

#[test]
fn shared_numbers_reach_the_shaders() {
    let source = constants();
    assert!(source.contains("const BATCH_SIZE: u32 = 256u;") && source.contains("const TAP_SHARPNESS: f32 = 0.9f;"));
    // Bit for bit.
    assert!(source.contains(&format!("const EWA_RADIUS: f32 = {EWA_RADIUS:?}f;")));
    let module = naga::front::wgsl::parse_str(&source).unwrap();
    assert_eq!(module.constants.len(), source.lines().count());
}
