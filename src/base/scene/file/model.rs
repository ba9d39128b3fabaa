//! A scene around a mesh that is rendered by itself: it stands on a table, unless it has a floor, under a clear sky, in front of a camera.

use std::path::Path;

use glam::DVec3;

use crate::maps::BUILT_IN_MAPS;
use crate::scene::wavefront::{ObjPart, ObjParts, load_obj_by_material};
use crate::scene::{Assets, Mesh, MeshError, SceneError};
use crate::words::escaped;

use super::objects::CREASE_ANGLE_DEG;

/// Extensions of models in formats that are not read.
const OTHER_FORMATS: [&str; 12] =
    ["glb", "gltf", "stl", "ply", "fbx", "dae", "3ds", "blend", "usd", "usda", "usdc", "usdz"];
/// The table is so many times as wide as the model is long.
const TABLE_WIDTH: f64 = 24.0;
/// The model stands this part of its length above the table: faces that coincide are neither's.
const GAP: f64 = 1e-3;
/// What the sky is scaled by, so that white paper in the sun is not overexposed.
const SKY_INTENSITY: f64 = 0.25;
/// A part of the model is a floor if it is so many times the model's length along both edges,
const FLOOR_LENGTH: f64 = 0.9;
/// and no higher than this.
const FLOOR_HEIGHT: f64 = 0.02;
/// Vertical field of view, degrees.
const FIELD_OF_VIEW_DEG: f64 = 35.0;

/// What a file is by its extension.
pub(super) enum Kind {
    Scene,
    Model,
    /// A model that is not read.
    Other(String),
}

impl Kind {
    pub fn of(path: &Path) -> Self {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match extension.as_str() {
            "obj" => Self::Model,
            other if OTHER_FORMATS.contains(&other) => Self::Other(extension),
            _ => Self::Scene,
        }
    }
}

/// The scene file of a model: what one would write for it by hand. A model without a mirror or glass of its own is made of silver.
pub(super) fn scene_of(file: &Path, assets: &dyn Assets) -> Result<String, SceneError> {
    let ObjParts { parts, origin, .. } = load_obj_by_material(assets, file, CREASE_ANGLE_DEG.to_radians())?;
    let bounds: Vec<[DVec3; 2]> = parts.iter().map(|part| bounds(&part.mesh, origin)).collect();
    let low = bounds.iter().fold(DVec3::INFINITY, |low, part| low.min(part[0]));
    let high = bounds.iter().fold(DVec3::NEG_INFINITY, |high, part| high.max(part[1]));
    let length = (high - low).max_element();
    if !(length.is_finite() && length > 0.0) {
        let origin = escaped(&file.display().to_string());
        return Err(MeshError::Empty { origin, dropped: 0 }.into());
    }
    let [x, y, z] = (-0.5 * (low + high)).with_y(GAP * length - low.y).to_array();
    let casts = parts.iter().any(|part| part.surface.reflector.is_some() || part.surface.refractor.is_some());
    let material = if casts { "" } else { "reflector = { metal = \"silver\", sides = \"both\" }\n" };
    let sky = match BUILT_IN_MAPS.first() {
        Some(map) => format!("map = \"{}\"\nintensity = {SKY_INTENSITY:?}", map.name),
        None => "constant = [1.0, 1.0, 1.0]".to_owned(),
    };
    let is_floor = |(part, [low, high]): (&ObjPart, &[DVec3; 2])| {
        let edges = high - low;
        let is_wide = edges.x.min(edges.z) > FLOOR_LENGTH * length && edges.y < FLOOR_HEIGHT * length;
        is_wide && part.surface.receiver.is_some()
    };
    let has_floor = parts.iter().zip(&bounds).any(is_floor);
    let mesh = toml::Value::String(file.to_string_lossy().into_owned());
    let (width, height) = (TABLE_WIDTH * length, high.y - low.y);
    // Far enough to see the model and as much of the table beside it.
    let target = DVec3::new(0.0, 0.3 * height, 0.0);
    let distance = 1.1 * length / (0.5 * FIELD_OF_VIEW_DEG).to_radians().tan();
    let position = (target + distance * DVec3::new(0.35, 0.62, 0.8).normalize()).to_array();
    let target = target.to_array();
    let table = format!(
        "[[object]]\nname = \"table\"\nshape = {{ plane = {{ size = [{width:?}, {width:?}] }} }}\nreceiver = {{ albedo = [0.5, 0.5, 0.5] }}\n"
    );
    let table = if has_floor { "" } else { &table };
    Ok(format!(
        "[environment]\n{sky}\n[camera]\nposition = {position:?}\ntarget = {target:?}\n\
         perspective = {{ fov_y_deg = {FIELD_OF_VIEW_DEG:?} }}\n\
         [[object]]\nname = \"model\"\nmesh = {mesh}\ntranslate = [{x:?}, {y:?}, {z:?}]\n{material}\
         {table}"
    ))
}

/// The corners of a mesh's bounds, whose positions count from there.
fn bounds(mesh: &Mesh, origin: DVec3) -> [DVec3; 2] {
    let positions = || mesh.positions().iter().map(|p| p.as_dvec3() + origin);
    [positions().fold(DVec3::INFINITY, DVec3::min), positions().fold(DVec3::NEG_INFINITY, DVec3::max)]
}
