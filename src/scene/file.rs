//! Scene files: TOML in, [`Scene`] out, with messages that name file, line, key and remedy.
//!
//! The `[render]` table belongs to whoever renders: its type is a parameter here.

mod objects;

use std::path::Path;

use glam::Vec3;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use self::objects::ObjectTable;

use super::{
    Assets, BUILT_IN, Camera, EnvironmentMap, EnvironmentSource, Light, MapLayout, Projection, Scene, SceneError,
};

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

/// Parses a scene file's text. The files that it names are read from `assets`: a folder's path, or files in memory. `file` is
/// used in messages.
pub fn parse<R: DeserializeOwned + Default>(
    file: &str,
    text: &str,
    assets: &(impl Assets + ?Sized),
) -> Result<Loaded<R>, SceneError> {
    let tables: SceneTable<R> = toml::from_str(text).map_err(|error| {
        let line = error.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
        SceneError::Syntax { file: file.into(), line, message: readable(error.message()) }
    })?;
    let builder = Builder { file, text, assets: &assets };
    let mut notes = Vec::new();
    let mut objects = Vec::with_capacity(tables.object.len());
    for (index, table) in tables.object.into_iter().enumerate() {
        objects.extend(builder.objects(index, &table, &mut notes)?);
    }
    let name = Path::new(file).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let environment = builder.environment(tables.environment, &mut notes)?;
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
const NOT_BUILT_YET: [&str; 1] = ["refractor"];

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

fn one() -> f32 {
    1.0
}
fn up() -> [f32; 3] {
    [0.0, 1.0, 0.0]
}
struct Builder<'a> {
    file: &'a str,
    text: &'a str,
    assets: &'a dyn Assets,
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

    fn environment(&self, table: EnvironmentTable, notes: &mut Vec<String>) -> Result<EnvironmentSource, SceneError> {
        if !table.rotation_deg.is_finite() {
            return Err(self.error("environment.rotation_deg", "must be a finite number of degrees"));
        }
        if !(table.intensity.is_finite() && table.intensity >= 0.0) {
            return Err(self.error("environment.intensity", "must be a number that is not negative"));
        }
        Ok(EnvironmentSource {
            rotation_rad: table.rotation_deg.to_radians(),
            intensity: table.intensity,
            light: self.light(table, notes)?,
        })
    }

    fn light(&self, table: EnvironmentTable, notes: &mut Vec<String>) -> Result<Light, SceneError> {
        let is_file = table.faces.is_some() || table.map.as_ref().is_some_and(|m| Path::new(m).extension().is_some());
        if table.layout.is_some() && !is_file {
            return Err(self.error("environment.layout", "is for environment images from files"));
        }
        let layout = table.layout.unwrap_or(MapLayout::Auto);
        match (table.map, table.faces, table.spot, table.constant) {
            (Some(_), None, None, None) if layout == MapLayout::Faces => {
                Err(self.error("environment.layout", "\"faces\" needs faces = [six files] instead of map"))
            }
            (Some(map), None, None, None) => {
                let (light, repaired) = Light::map(self.assets, &map, layout)?;
                notes.extend(repaired);
                Ok(light)
            }
            (None, Some(faces), None, None) if matches!(layout, MapLayout::Auto | MapLayout::Faces) => {
                let faces = faces.each_ref().map(String::as_str);
                let (map, repaired) = EnvironmentMap::load(self.assets, &faces, MapLayout::Faces)?;
                notes.extend(repaired);
                Ok(Light::Map(map))
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
