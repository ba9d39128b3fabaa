//! Scene files: TOML in, [`Scene`] out, with messages that name file, line, key and remedy.
//!
//! The `[render]` table belongs to whoever renders: its type is a parameter here.

use std::path::Path;
use std::sync::Arc;

use glam::Vec3;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::obj::{ObjPart, load_obj_by_material};
use super::shapes::Shape;
use super::{
    BUILT_IN, Camera, EnvironmentSource, Light, MapLayout, Mesh, MeshError, ObjReport, Object, Projection, Receiver,
    Reflector, Scene, SceneError, Sides, Transform, load_obj, mtl,
};
use crate::brdf::{BrdfTable, Gloss};
use crate::reflectance::{Finish, Metal};

/// A scene and the `[render]` table that came with it.
#[derive(Clone, Debug)]
pub struct Loaded<R> {
    /// The scene.
    pub scene: Scene,
    /// Its `[render]` table.
    pub render: R,
}

/// Loads a scene file, or the built-in scene of that name. `R` is the type of the `[render]` table.
pub fn load<R: DeserializeOwned + Default>(path_or_name: &str) -> Result<Loaded<R>, SceneError> {
    if let Some(built_in) = BUILT_IN.iter().find(|b| b.name == path_or_name) {
        return parse(built_in.name, built_in.toml, Path::new("."));
    }
    let path = Path::new(path_or_name);
    let text = std::fs::read_to_string(path).map_err(|source| {
        let names = BUILT_IN.iter().map(|b| b.name);
        let hint = nearest(path_or_name, names).map(|n| format!("; did you mean '{n}'?")).unwrap_or_default();
        SceneError::Read { path: path.into(), hint, source }
    })?;
    parse(path_or_name, &text, path.parent().unwrap_or(Path::new(".")))
}

/// Parses a scene file's text; `base` is what its paths are relative to, `file` is used in messages.
pub fn parse<R: DeserializeOwned + Default>(file: &str, text: &str, base: &Path) -> Result<Loaded<R>, SceneError> {
    let tables: SceneTable<R> = toml::from_str(text).map_err(|error| {
        let line = error.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
        SceneError::Syntax { file: file.into(), line, message: readable(error.message()) }
    })?;
    let builder = Builder { file, text, base };
    let mut notes = Vec::new();
    let mut objects = Vec::with_capacity(tables.object.len());
    for (index, table) in tables.object.into_iter().enumerate() {
        objects.extend(builder.objects(index, &table, &mut notes)?);
    }
    let name = Path::new(file).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let environment = builder.environment(tables.environment)?;
    let camera = builder.camera(&tables.camera)?;
    Ok(Loaded { scene: Scene { name, environment, camera, objects, notes }, render: tables.render })
}

/// The candidate most similar to `word`, if any is similar at all.
pub(crate) fn nearest<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .map(|c| (strsim::jaro_winkler(word, c), c))
        .filter(|(similarity, _)| *similarity > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, c)| c)
}

/// Keys of the documented format that later versions bring.
const NOT_BUILT_YET: [&str; 4] = ["refractor", "leaves", "evaluation", "tolerance"];

/// serde's message, with the nearest known key or word in place of a list of all of them.
fn readable(message: &str) -> String {
    let message = message.replace('\n', " ");
    for kind in ["field", "variant"] {
        let Some(rest) = message.strip_prefix(&format!("unknown {kind} `")) else { continue };
        let Some((word, rest)) = rest.split_once('`') else { continue };
        let what = if kind == "field" { "key" } else { "value" };
        if NOT_BUILT_YET.contains(&word) {
            return format!("{what} '{word}' is not built yet; remove it");
        }
        // Serde quotes every candidate with back-ticks.
        let candidates: Vec<&str> = rest.split('`').skip(1).step_by(2).collect();
        let remedy = match nearest(word, candidates.iter().copied()) {
            Some(candidate) => format!("did you mean '{candidate}'?"),
            None => format!("known are: {}", candidates.join(", ")),
        };
        return format!("unknown {what} '{word}'; {remedy}");
    }
    message
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, bound(deserialize = "R: DeserializeOwned + Default"))]
struct SceneTable<R> {
    environment: EnvironmentTable,
    camera: CameraTable,
    #[serde(default)]
    render: R,
    #[serde(default)]
    object: Vec<ObjectTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EnvironmentTable {
    map: Option<String>,
    faces: Option<[String; 6]>,
    layout: Option<MapLayout>,
    spot: Option<SpotTable>,
    constant: Option<[f32; 3]>,
    #[serde(default)]
    rotation_deg: f32,
    #[serde(default = "one")]
    intensity: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SpotTable {
    direction: [f32; 3],
    sigma_rad: f32,
    radiance: [f32; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraTable {
    position: [f32; 3],
    target: [f32; 3],
    #[serde(default = "up")]
    up: [f32; 3],
    orthographic: Option<OrthographicTable>,
    perspective: Option<PerspectiveTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OrthographicTable {
    height: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PerspectiveTable {
    fov_y_deg: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ObjectTable {
    name: Option<String>,
    mesh: Option<String>,
    shape: Option<Shape>,
    #[serde(default)]
    translate: [f32; 3],
    #[serde(default)]
    rotate_deg: [f32; 3],
    #[serde(default = "one")]
    scale: f32,
    crease_angle_deg: Option<f32>,
    reflector: Option<ReflectorTable>,
    receiver: Option<ReceiverTable>,
    #[serde(default = "yes")]
    camera_visible: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ReflectorTable {
    #[serde(default)]
    sides: Sides,
    #[serde(default = "white")]
    reflectance: [f32; 3],
    metal: Option<Metal>,
    coat: Option<f64>,
    #[serde(default)]
    roughness: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ReceiverTable {
    #[serde(default = "grey")]
    albedo: [f32; 3],
    phong: Option<PhongTable>,
    ggx: Option<GgxTable>,
    table: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PhongTable {
    specular: [f32; 3],
    exponent: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GgxTable {
    #[serde(default = "plastic")]
    specular: [f32; 3],
    roughness: f32,
}

fn grey() -> [f32; 3] {
    [0.5; 3]
}
/// A refractive index of 1.5.
fn plastic() -> [f32; 3] {
    [0.04; 3]
}

fn one() -> f32 {
    1.0
}
fn up() -> [f32; 3] {
    [0.0, 1.0, 0.0]
}
fn white() -> [f32; 3] {
    [1.0; 3]
}
fn yes() -> bool {
    true
}
/// The smoothest GGX receiver.
const LEAST_ROUGHNESS: f32 = 0.05;
/// Where a mesh without normals has edges, unless its object says otherwise.
const CREASE_ANGLE_DEG: f32 = 40.0;

fn crease_angle_rad(table: &ObjectTable) -> f32 {
    table.crease_angle_deg.unwrap_or(CREASE_ANGLE_DEG).to_radians()
}

fn note_dropped(path: &Path, report: ObjReport, notes: &mut Vec<String>) {
    if report.dropped_triangles > 0 {
        notes.push(format!("{}: dropped {} degenerate triangles", path.display(), report.dropped_triangles));
    }
}

struct Builder<'a> {
    file: &'a str,
    text: &'a str,
    base: &'a Path,
}

impl Builder<'_> {
    fn error(&self, key: impl Into<String>, message: impl Into<String>) -> SceneError {
        let key = key.into();
        SceneError::Value { file: self.file.into(), line: self.line_of(&key), key, message: message.into() }
    }

    /// The line of a key such as `camera.position` or `object 'ring'.scale`: where its parts stand one after the other.
    fn line_of(&self, key: &str) -> usize {
        let mut at = 0;
        for part in key.split('.') {
            let part = part.strip_prefix("object '").map_or(part, |name| name.trim_end_matches('\''));
            at += self.text[at..].find(part).unwrap_or(0);
        }
        self.text[..at].matches('\n').count() + 1
    }

    fn vector(&self, key: &str, value: [f32; 3]) -> Result<Vec3, SceneError> {
        let value = Vec3::from(value);
        if value.is_finite() { Ok(value) } else { Err(self.error(key, "must be three finite numbers")) }
    }

    /// A colour in [0, `most`].
    fn colour(&self, key: &str, value: [f32; 3], most: f32) -> Result<Vec3, SceneError> {
        let value = self.vector(key, value)?;
        if value.min_element() >= 0.0 && value.max_element() <= most {
            Ok(value)
        } else if most.is_finite() {
            Err(self.error(key, format!("is {value}, but must be three numbers from 0 to {most}")))
        } else {
            Err(self.error(key, format!("is {value}, but must be three numbers that are not negative")))
        }
    }

    fn environment(&self, table: EnvironmentTable) -> Result<EnvironmentSource, SceneError> {
        if !table.rotation_deg.is_finite() {
            return Err(self.error("environment.rotation_deg", "must be a finite number of degrees"));
        }
        if !(table.intensity.is_finite() && table.intensity >= 0.0) {
            return Err(self.error("environment.intensity", "must be a number that is not negative"));
        }
        Ok(EnvironmentSource {
            rotation_rad: table.rotation_deg.to_radians(),
            intensity: table.intensity,
            light: self.light(table)?,
        })
    }

    fn light(&self, table: EnvironmentTable) -> Result<Light, SceneError> {
        let is_file = table.faces.is_some() || table.map.as_ref().is_some_and(|m| Path::new(m).extension().is_some());
        if table.layout.is_some() && !is_file {
            return Err(self.error("environment.layout", "is for environment images from files"));
        }
        let layout = table.layout.unwrap_or(MapLayout::Auto);
        match (table.map, table.faces, table.spot, table.constant) {
            (Some(_), None, None, None) if layout == MapLayout::Faces => {
                Err(self.error("environment.layout", "\"faces\" needs faces = [six files] instead of map"))
            }
            (Some(map), None, None, None) => Ok(Light::map(self.base, &map, layout)),
            (None, Some(faces), None, None) if matches!(layout, MapLayout::Auto | MapLayout::Faces) => {
                Ok(Light::Map { files: faces.map(|f| self.base.join(f)).into(), layout: MapLayout::Faces })
            }
            (None, Some(_), None, None) => {
                Err(self.error("environment.layout", "must be \"faces\" where six faces are given"))
            }
            (None, None, Some(spot), None) => self.spot(&spot),
            (None, None, None, Some(constant)) => {
                Ok(Light::Constant(self.colour("environment.constant", constant, f32::INFINITY)?))
            }
            _ => Err(self.error("environment", "give exactly one of map, faces, spot and constant")),
        }
    }

    fn spot(&self, spot: &SpotTable) -> Result<Light, SceneError> {
        let direction = self.vector("environment.spot.direction", spot.direction)?;
        let direction =
            direction.try_normalize().ok_or_else(|| self.error("environment.spot.direction", "must not be zero"))?;
        if !(spot.sigma_rad >= 1e-4 && spot.sigma_rad <= 1.0) {
            return Err(self
                .error("environment.spot.sigma_rad", format!("is {}, but must be from 0.0001 to 1", spot.sigma_rad)));
        }
        let radiance = self.colour("environment.spot.radiance", spot.radiance, f32::INFINITY)?;
        Ok(Light::Spot { direction, sigma_rad: spot.sigma_rad, radiance })
    }

    fn camera(&self, table: &CameraTable) -> Result<Camera, SceneError> {
        let position = self.vector("camera.position", table.position)?;
        let target = self.vector("camera.target", table.target)?;
        let up = self.vector("camera.up", table.up)?;
        let projection = match (&table.orthographic, &table.perspective) {
            (Some(o), None) if o.height > 0.0 && o.height.is_finite() => Projection::Orthographic { height: o.height },
            (Some(o), None) => {
                return Err(
                    self.error("camera.orthographic.height", format!("is {}, but must be a positive length", o.height))
                );
            }
            (None, Some(p)) if p.fov_y_deg > 0.0 && p.fov_y_deg < 180.0 => {
                Projection::Perspective { fov_y_rad: p.fov_y_deg.to_radians() }
            }
            (None, Some(p)) => {
                return Err(self.error(
                    "camera.perspective.fov_y_deg",
                    format!("is {}, but must be between 0 and 180", p.fov_y_deg),
                ));
            }
            _ => {
                return Err(self.error(
                    "camera",
                    "give exactly one of orthographic = { height = … } and perspective = { fov_y_deg = … }",
                ));
            }
        };
        Camera::look_at(position, target, up, projection).ok_or_else(|| {
            self.error("camera", "position and target must differ, and up must not be along the view axis")
        })
    }

    /// An object, or one for each material of a mesh that brings its own.
    fn objects(&self, index: usize, table: &ObjectTable, notes: &mut Vec<String>) -> Result<Vec<Object>, SceneError> {
        let name = table.name.clone().unwrap_or_else(|| format!("object {}", index + 1));
        let key = |k: &str| format!("object '{name}'.{k}");
        if !(table.scale.is_finite() && table.scale != 0.0) {
            return Err(self.error(key("scale"), format!("is {}, but must be a number other than zero", table.scale)));
        }
        if table.crease_angle_deg.is_some_and(|angle| !(0.0..=180.0).contains(&angle)) {
            return Err(self.error(key("crease_angle_deg"), "must be from 0 to 180"));
        }
        let place = Transform {
            scale: table.scale,
            rotate_rad: self.vector(&key("rotate_deg"), table.rotate_deg)? * (std::f32::consts::PI / 180.0),
            translate: self.vector(&key("translate"), table.translate)?,
        };
        let reflector = match &table.reflector {
            None => None,
            Some(r) => Some(Reflector { sides: r.sides, finish: self.finish(r, &key)? }),
        };
        let receiver = match &table.receiver {
            None => None,
            Some(r) => Some(self.receiver(r, &key)?),
        };
        let camera_visible = table.camera_visible;
        if let (Some(file), None, None, None) = (&table.mesh, table.shape, &reflector, &receiver) {
            let parts = self.parts(file, table, notes)?.into_iter();
            let object = |(material, mesh, surface): (String, Mesh, mtl::Surface)| Object {
                name: if material.is_empty() { name.clone() } else { format!("{name}/{material}") },
                mesh: mesh.transformed(&place),
                reflector: surface.reflector,
                receiver: surface.receiver,
                camera_visible,
            };
            return Ok(parts.map(object).collect());
        }
        let mesh = self.mesh(&name, table, notes)?.transformed(&place);
        Ok(vec![Object { name, mesh, reflector, receiver, camera_visible }])
    }

    /// A mesh file's parts by material: its name, or nothing where there is none.
    fn parts(
        &self,
        file: &str,
        table: &ObjectTable,
        notes: &mut Vec<String>,
    ) -> Result<Vec<(String, Mesh, mtl::Surface)>, SceneError> {
        let path = self.base.join(file);
        let origin = path.display().to_string();
        let (parts, failure) = load_obj_by_material(&path, crease_angle_rad(table))?;
        if let Some(reason) = failure {
            notes
                .push(format!("{origin}: its materials cannot be read ({reason}), so it neither mirrors nor receives"));
        }
        let part = |part: ObjPart| {
            note_dropped(&path, part.report, notes);
            let name = part.material.as_ref().map_or(String::new(), |m| m.name.clone());
            let surface = part.material.as_ref().map_or(Ok(mtl::Surface::default()), mtl::surface);
            let surface = surface.map_err(|reason| MeshError::Material { origin: origin.clone(), reason })?;
            Ok((name, part.mesh, surface))
        };
        parts.into_iter().map(part).collect()
    }

    fn receiver(&self, table: &ReceiverTable, key: &dyn Fn(&str) -> String) -> Result<Receiver, SceneError> {
        let gloss = match (&table.phong, &table.ggx, &table.table) {
            (None, None, None) => Gloss::None,
            (Some(phong), None, None) => {
                if !(0.0..=1e5).contains(&phong.exponent) {
                    return Err(self.error(key("receiver.phong.exponent"), "must be from 0 to 100000"));
                }
                let specular = self.colour(&key("receiver.phong.specular"), phong.specular, 1.0)?;
                Gloss::Phong { specular, exponent: phong.exponent }
            }
            (None, Some(ggx), None) => {
                if !(LEAST_ROUGHNESS..=1.0).contains(&ggx.roughness) {
                    let message = format!("must be from {LEAST_ROUGHNESS} to 1; a smoother one is a reflector");
                    return Err(self.error(key("receiver.ggx.roughness"), message));
                }
                let specular = self.colour(&key("receiver.ggx.specular"), ggx.specular, 1.0)?;
                Gloss::Ggx { specular, roughness: ggx.roughness }
            }
            (None, None, Some(file)) => Gloss::Table(Arc::new(BrdfTable::load(&self.base.join(file))?)),
            _ => return Err(self.error(key("receiver"), "give at most one of phong, ggx and table")),
        };
        Ok(Receiver { albedo: self.colour(&key("receiver.albedo"), table.albedo, 1.0)?, gloss })
    }

    fn finish(&self, table: &ReflectorTable, key: &dyn Fn(&str) -> String) -> Result<Finish, SceneError> {
        if table.coat.is_some_and(|index| !(1.0..=4.0).contains(&index)) {
            return Err(self.error(key("reflector.coat"), "must be a refractive index from 1 to 4"));
        }
        let reflectance = self.colour(&key("reflector.reflectance"), table.reflectance, 1.0)?.as_dvec3();
        if !(0.0..=1.0).contains(&table.roughness) {
            return Err(self.error(key("reflector.roughness"), "must be from 0 to 1"));
        }
        Ok(Finish { reflectance, metal: table.metal, coat: table.coat, roughness: table.roughness })
    }

    fn mesh(&self, name: &str, table: &ObjectTable, notes: &mut Vec<String>) -> Result<Mesh, SceneError> {
        match (&table.mesh, table.shape) {
            (Some(file), None) => {
                let path = self.base.join(file);
                let (mesh, report) = load_obj(&path, crease_angle_rad(table))?;
                note_dropped(&path, report, notes);
                Ok(mesh)
            }
            (None, Some(_)) if table.crease_angle_deg.is_some() => {
                let key = format!("object '{name}'.crease_angle_deg");
                Err(self.error(key, "is for meshes; built-in shapes have exact normals"))
            }
            (None, Some(shape)) => shape.mesh().map_err(|m| self.error(format!("object '{name}'.shape"), m)),
            _ => {
                Err(self.error(format!("object '{name}'"), "give exactly one of mesh = \"FILE.obj\" and shape = { … }"))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Render {
        samples: Option<u32>,
    }

    const GOOD: &str = r#"
[environment]
constant = [1.0, 1.0, 1.0]
[camera]
position = [0.0, 5.0, 0.0]
target = [0.0, 0.0, 0.0]
up = [0.0, 0.0, -1.0]
orthographic = { height = 3.0 }
[render]
samples = 7
[[object]]
name = "ring"
shape = { ring = { radius = 1.0, height = 0.5 } }
reflector = { sides = "front" }
[[object]]
name = "table"
shape = { plane = { size = [3.0, 3.0] } }
receiver = { albedo = [0.5, 0.5, 0.5] }
"#;

    fn failure(text: &str) -> String {
        parse::<Render>("scene.toml", text, Path::new(".")).unwrap_err().to_string()
    }

    #[test]
    fn a_good_file_is_read() {
        let loaded = parse::<Render>("scene.toml", GOOD, Path::new(".")).unwrap();
        assert_eq!(loaded.render.samples, Some(7));
        assert_eq!(loaded.scene.objects.len(), 2);
        assert!(loaded.scene.objects[0].reflector.is_some() && loaded.scene.objects[1].reflector.is_none());
    }

    #[test]
    fn an_unknown_key_is_named_with_its_line_and_the_nearest_known_one() {
        for (from, to, word, known) in [
            ("target =", "traget =", "traget", "target"),
            ("samples =", "sample =", "sample", "samples"),
            ("sides = \"front\"", "side = \"front\"", "side", "sides"),
            ("radius =", "radios =", "radios", "radius"),
            ("\"front\"", "\"fornt\"", "fornt", "front"),
            ("sides = \"front\"", "metal = \"sliver\"", "sliver", "silver"),
        ] {
            let message = failure(&GOOD.replace(from, to));
            let line = GOOD.lines().position(|l| l.contains(from)).unwrap() + 1;
            assert!(message.contains(&format!("'{word}'")) && message.contains(&format!("'{known}'")), "{message}");
            assert!(message.starts_with(&format!("scene.toml:{line}:")), "{message} (line {line})");
        }
    }

    #[test]
    fn keys_of_later_versions_are_refused() {
        assert!(failure(&GOOD.replace("name = \"ring\"", "refractor = {}")).contains("not built yet"));
    }

    #[test]
    fn a_mesh_without_a_surface_of_its_own_takes_its_materials() {
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
        write("two.mtl", "newmtl wood\nKd 0.5 0.3 0.1\nnewmtl steel\nKd 0.8 0.8 0.8\nPm 1\nPr 0.2\n");
        let faces =
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl wood\nf 1 2 3\nusemtl steel\nf 1 2 4\nusemtl wood\nf 2 3 4\n";
        write("two.obj", &format!("mtllib two.mtl\n{faces}"));
        let mesh = GOOD.replace(
            "shape = { plane = { size = [3.0, 3.0] } }\nreceiver = { albedo = [0.5, 0.5, 0.5] }",
            "mesh = \"two.obj\"",
        );
        let load = || parse::<Render>("scene.toml", &mesh, dir.path());
        let scene = load().unwrap().scene;
        let names: Vec<&str> = scene.objects.iter().map(|o| o.name.as_str()).collect();
        assert_eq!(names, ["ring", "table/wood", "table/steel"]);
        assert_eq!(scene.objects[1].mesh.triangles().len(), 2);
        assert!(scene.objects[1].receiver.is_some() && scene.objects[1].reflector.is_none());
        assert!(scene.objects[2].reflector.is_some());
        write("two.mtl", "newmtl wood\nKd 5 0.3 0.1\n");
        let message = load().unwrap_err().to_string();
        assert!(message.contains("'wood': Kd") && message.contains("two.obj"), "{message}");
        std::fs::remove_file(dir.path().join("two.mtl")).unwrap();
        let scene = load().unwrap().scene;
        assert!(scene.objects.len() == 2 && scene.notes[0].contains("materials cannot be read"), "{:?}", scene.notes);
    }

    #[test]
    fn values_out_of_range_are_named() {
        for (from, to, expected) in [
            ("height = 3.0", "height = -3.0", "scene.toml:8: camera.orthographic.height"),
            ("[0.5, 0.5, 0.5]", "[0.5, 1.5, 0.5]", "scene.toml:18: object 'table'.receiver.albedo"),
            ("albedo = [0.5, 0.5, 0.5]", "ggx = { roughness = 0.0 }", "receiver.ggx.roughness: must be from"),
            ("albedo = [0.5, 0.5, 0.5]", "table = \"none.binary\"", "none.binary"),
            ("sides = \"front\"", "roughness = 2", "reflector.roughness: must be from 0 to 1"),
            ("sides = \"front\"", "coat = 0.5", "reflector.coat: must be a refractive index from 1 to 4"),
            ("sides = \"front\"", "metal = \"gold\", reflectance = [2, 1, 1]", "reflector.reflectance"),
            ("up = [0.0, 0.0, -1.0]", "up = [0.0, 1.0, 0.0]", "up must not be along"),
            ("constant = [1.0, 1.0, 1.0]", "constant = [1.0, nan, 1.0]", "environment.constant"),
            ("constant = [1.0, 1.0, 1.0]", "", "exactly one of map"),
            ("shape = { ring = { radius = 1.0, height = 0.5 } }", "", "exactly one of mesh"),
        ] {
            let message = failure(&GOOD.replacen(from, to, 1));
            let of_file = message.starts_with("scene.toml:") || expected == "none.binary";
            assert!(message.contains(expected) && of_file, "{message}");
        }
    }
}
