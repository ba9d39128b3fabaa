//! The shaders without a device: naga validates each, and their structs are laid out as the Rust ones.

use naga::valid::{Capabilities, ValidationFlags, Validator};
use pinspot::low_level::cell_tree::CellNode;
use pinspot::low_level::gpu::{SHADERS, resolve};
use pinspot::low_level::pinhole::gpu::{CellRoot, Stage, TreeUniforms};
use pinspot::low_level::pinhole::{BATCH_SIZE, CURVE_POINTS, GatherUniforms, PinholeSample};

fn parse(name: &str) -> Result<naga::Module, String> {
    let source = resolve(name);
    let module = naga::front::wgsl::parse_str(&source).map_err(|e| format!("{name}: {}", e.emit_to_string(&source)))?;
    // Halves packed in words: every WebGPU device reads them.
    Validator::new(ValidationFlags::all(), Capabilities::SHADER_FLOAT16_IN_FLOAT32)
        .validate(&module)
        .map_err(|e| format!("{name}: {}", e.emit_to_string(&source)))?;
    Ok(module)
}

#[test]
fn every_shader_is_valid() {
    let failures: Vec<String> = SHADERS.iter().filter_map(|(name, _)| parse(name).err()).collect();
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn every_shader_file_is_known() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    let mut files: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|f| f.unwrap().path())
        .filter(|f| f.extension().is_some_and(|e| e == "wgsl"))
        .map(|f| f.file_stem().unwrap().to_string_lossy().into_owned())
        .collect();
    files.sort();
    let mut known: Vec<&str> = SHADERS.iter().map(|(name, _)| *name).collect();
    known.sort_unstable();
    assert_eq!(files, known);
}

/// Name, offset and the size of the whole, of a struct in a shader.
fn wgsl_struct(shader: &str, name: &str) -> (Vec<(String, u32)>, u32) {
    let module = parse(shader).unwrap();
    let (_, ty) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).unwrap();
    let naga::TypeInner::Struct { members, span } = &ty.inner else { panic!("{name} is no struct") };
    (members.iter().map(|m| (m.name.clone().unwrap(), m.offset)).collect(), *span)
}

macro_rules! layout {
    ($type:ty { $($field:ident),* $(,)? }) => {
        (vec![$((stringify!($field).to_owned(), std::mem::offset_of!($type, $field) as u32)),*], size_of::<$type>() as u32)
    };
}

#[test]
fn structs_are_laid_out_alike() {
    let sample =
        layout!(PinholeSample { position_area, normal_object, reflectance, side_1, side_2, change_1, change_2 });
    assert_eq!(wgsl_struct("gather", "PinholeSample"), sample);
    let uniforms = layout!(GatherUniforms {
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
    });
    for shader in ["gather", "cut", "finish"] {
        assert_eq!(wgsl_struct(shader, "GatherUniforms"), uniforms);
    }
    let tree = layout!(TreeUniforms {
        size,
        tiles_across,
        capacity,
        tops,
        first_above,
        roots,
        may_interpolate,
        split_near,
        has_viewers,
        area,
        map_texel,
    });
    let root = layout!(CellRoot { position_lobe, normal_object, reflectance, most_phase, map_node });
    let stage = layout!(Stage { first_tile, level, part, parts });
    for shader in ["cut", "finish"] {
        assert_eq!(wgsl_struct(shader, "TreeUniforms"), tree);
        assert_eq!(wgsl_struct(shader, "CellRoot"), root);
        assert_eq!(wgsl_struct(shader, "Stage"), stage);
        assert_eq!(wgsl_struct(shader, "CellNode").1, size_of::<CellNode>() as u32);
    }
}

#[test]
fn the_batch_size_is_the_same() {
    assert!(resolve("gather").contains(&format!("const BATCH_SIZE: u32 = {BATCH_SIZE}u;")));
    assert!(resolve("gather").contains(&format!("const CURVE_POINTS: u32 = {CURVE_POINTS}u;")));
}
