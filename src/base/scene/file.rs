//! Scene files: parses TOML into a [`Scene`], with messages that name file, line, key and remedy.
//!
//! The type of the `[render]` table is a parameter, because this module does not know rendering options.

mod animation;
mod camera;
mod document;
mod environment;
mod lamps;
mod medium;
mod model;
mod objects;

use std::ops::Range;
use std::path::Path;

use glam::Vec3;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use self::animation::AnimationTable;
use self::camera::CameraTable;
use self::document::{Fault, KeyLines, Problem};
use self::environment::EnvironmentTable;
use self::lamps::LampTable;
use self::medium::MediumTable;
use self::model::Kind;
use self::objects::ObjectTable;

use super::emitters::decide_near;
use super::{Assets, BUILT_IN, Medium, MeshError, Scene, SceneError};
use crate::words::escaped;

/// So many objects with coplanar faces are named.
const NAMED_COPLANAR: usize = 3;

/// A scene, and the `[render]` table of its file.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Loaded<R> {
    /// The scene.
    pub scene: Scene,
    /// Its `[render]` table.
    pub render: R,
    file: String,
    lines: KeyLines,
    objects_of_tables: Vec<Range<usize>>,
}

impl<R> Loaded<R> {
    /// The objects that each `[[object]]` table makes, as indices in the scene: one, or one for each material of a mesh.
    pub fn objects_of_tables(&self) -> &[Range<usize>] {
        &self.objects_of_tables
    }

    /// An error for a value of the `[render]` table that was found invalid later; it names file and line.
    pub fn render_error(&self, key: &str, message: impl Into<String>) -> SceneError {
        let key = format!("render.{key}");
        SceneError::Value { file: self.file.clone(), line: self.lines.line_of(&key), key, message: message.into() }
    }
}

/// Loads a scene file, the built-in scene of that name, or a model (.obj) on a table under a clear sky. `R` is the type of the
/// `[render]` table.
pub fn load<R: DeserializeOwned + Default>(path_or_name: &str) -> Result<Loaded<R>, SceneError> {
    if let Some(built_in) = BUILT_IN.iter().find(|b| b.name == path_or_name) {
        return parse(built_in.name, built_in.toml, Path::new("."));
    }
    let path = Path::new(path_or_name);
    let folder = path.parent().unwrap_or(Path::new("."));
    match Kind::of(path) {
        Kind::Scene => {}
        Kind::Model => {
            let text = model::scene_of(Path::new(path.file_name().unwrap_or_default()), &folder)?;
            return parse(path_or_name, &text, folder);
        }
        Kind::Other(extension) => {
            let (origin, extension) = (escaped(path_or_name), format!(".{extension}"));
            return Err(MeshError::Format { origin, extension }.into());
        }
    }
    let text = std::fs::read_to_string(path).map_err(|source| {
        let names = BUILT_IN.iter().map(|b| b.name);
        let hint = nearest(path_or_name, names).map(|n| format!("; did you mean '{n}'?")).unwrap_or_default();
        SceneError::Read { path: path.into(), hint, source }
    })?;
    parse(path_or_name, &text, folder)
}

/// Parses a scene file's text. The files that it names are read from `assets`: a folder's path, or files in memory.
/// `file` is the name in messages.
///
/// ```
/// use std::collections::HashMap;
/// use std::path::PathBuf;
///
/// let scene = r#"
///     environment = { constant = [1, 1, 1] }
///     camera = { position = [0, 5, 5], target = [0, 0, 0], perspective = { fov_y_deg = 40 } }
///     object = [{ mesh = "triangle.obj", reflector = {} }]
/// "#;
/// let files = HashMap::from([(PathBuf::from("triangle.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3")]);
/// let loaded = pinspot::scene::parse::<pinspot::Settings>("scene.toml", scene, &files)?;
/// assert_eq!(loaded.scene.objects[0].mesh.triangles().len(), 1);
/// # Ok::<(), pinspot::scene::SceneError>(())
/// ```
pub fn parse<R: DeserializeOwned + Default>(
    file: &str,
    text: &str,
    assets: &(impl Assets + ?Sized),
) -> Result<Loaded<R>, SceneError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let name = escaped(&Path::new(file).file_stem().unwrap_or_default().to_string_lossy());
    let file = escaped(file);
    let (tables, lines) = document::parse::<SceneTable<R>>(text).map_err(|fault| in_file(&file, fault))?;
    let builder = Builder { file: &file, lines: &lines, assets: &assets };
    let mut notes = Vec::new();
    let mut objects = Vec::with_capacity(tables.object.len());
    let mut animated = Vec::with_capacity(tables.object.len());
    let mut is_open = Vec::with_capacity(tables.object.len());
    for (index, table) in tables.object.into_iter().enumerate() {
        let first = objects.len();
        let (of_table, is_far) = builder.objects(index, &table, &mut notes)?;
        objects.extend(of_table);
        is_open.resize(objects.len(), table.leaves_nearness_open());
        animated.push(table.animated(first..objects.len(), is_far));
    }
    decide_near(&mut objects, &is_open);
    let environment = builder.environment(tables.environment, &mut notes)?;
    let camera = builder.camera(&tables.camera)?;
    let lamps = builder.lamps(&tables.light, &objects, &mut notes)?;
    let medium = tables.medium.map(|table| builder.medium(&table)).transpose()?;
    let animations = builder.animations(&tables.animation, (&animated, &lamps), &tables.camera)?;
    let mut scene = Scene { name, environment, lamps, medium, camera, objects, animations, notes };
    let mut coplanar = scene.separate_coplanar_faces();
    if let Some(more) = coplanar.len().checked_sub(NAMED_COPLANAR + 1) {
        coplanar.truncate(NAMED_COPLANAR);
        coplanar.push(format!("{} more objects have coplanar faces with others", more + 1));
    }
    scene.notes.extend(coplanar);
    if scene.has_medium_around_solids() {
        return Err(builder.error("medium", Medium::NOT_AROUND_SOLIDS));
    }
    let objects_of_tables = animated.into_iter().map(|table| table.objects).collect();
    Ok(Loaded { scene, render: tables.render, file, lines, objects_of_tables })
}

/// The candidate most similar to `word`, if one is similar enough.
pub fn nearest<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .map(|c| (strsim::jaro_winkler(word, c), c))
        .filter(|(similarity, _)| *similarity > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, c)| c)
}

fn in_file(file: &str, Fault { line, key, problem }: Fault) -> SceneError {
    let message = match problem {
        Problem::Other(message) => escaped(&message),
        Problem::Unknown { what, word, known } => match nearest(&word, known.iter().copied()) {
            Some(candidate) => format!("unknown {what} '{word}'; did you mean '{candidate}'?"),
            None => format!("unknown {what} '{word}'; known are: {}", known.join(", ")),
        },
    };
    let file = file.to_owned();
    if key.is_empty() {
        SceneError::Syntax { file, line, message }
    } else {
        SceneError::Value { file, line, key, message }
    }
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
    #[serde(default)]
    light: Vec<LampTable>,
    medium: Option<MediumTable>,
    #[serde(default)]
    animation: Vec<AnimationTable>,
}

fn one() -> f32 {
    1.0
}

/// A key: its form in messages, and its path in the document.
#[derive(Clone)]
struct Key {
    shown: String,
    path: String,
}

impl From<&str> for Key {
    fn from(key: &str) -> Self {
        Self { shown: key.into(), path: key.into() }
    }
}

struct Builder<'a> {
    file: &'a str,
    lines: &'a KeyLines,
    assets: &'a dyn Assets,
}

impl Builder<'_> {
    fn error(&self, key: impl Into<Key>, message: impl Into<String>) -> SceneError {
        let Key { shown, path } = key.into();
        let line = self.lines.line_of(&path);
        SceneError::Value { file: self.file.into(), line, key: shown, message: message.into() }
    }

    fn vector(&self, key: impl Into<Key>, value: [f32; 3]) -> Result<Vec3, SceneError> {
        let value = Vec3::from(value);
        if value.is_finite() { Ok(value) } else { Err(self.error(key, "must be three finite numbers")) }
    }

    /// A colour in [0, `most`].
    fn colour(&self, key: impl Into<Key>, value: [f32; 3], most: f32) -> Result<Vec3, SceneError> {
        let value = Vec3::from(value);
        if value.is_finite() && value.min_element() >= 0.0 && value.max_element() <= most {
            return Ok(value);
        }
        let [r, g, b] = value.to_array();
        Err(self.error(key, format!("is [{r:?}, {g:?}, {b:?}], but must be three numbers from 0 to {most:?}")))
    }
}

#[cfg(test)]
mod mesh_tests;

#[cfg(test)]
mod tests {
    use std::collections::HashMap;
    use std::path::PathBuf;

    use super::*;
    use crate::scene::Light;

    #[derive(Debug, Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub(super) struct Render {
        samples: Option<u32>,
    }

    pub(super) const GOOD: &str = r#"
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
    fn refractors_have_one_index_or_three() {
        let refractor = |keys: &str| {
            let text = GOOD.replace("reflector = { sides = \"front\" }", &format!("refractor = {{ {keys} }}"));
            parse::<Render>("scene.toml", &text, Path::new("."))
                .map(|loaded| loaded.scene.objects[0].refractor.unwrap())
        };
        let water = refractor("eta = 1.333").unwrap();
        assert!(water.fresnel && !water.is_dispersive() && water.eta.x == 1.333);
        let prism = refractor("eta = [1.5, 1.51, 1.53], fresnel = false").unwrap();
        assert!(!prism.fresnel && prism.is_dispersive());
        // BK7: its index is 1.5168 at 587.6 nm, and blue is refracted more.
        let glass = refractor("cauchy = [1.5046, 0.0042]").unwrap();
        assert!((glass.eta.y - 1.5185).abs() < 1e-3 && glass.eta.z > glass.eta.y && glass.eta.y > glass.eta.x);
        for (keys, expected) in [
            ("eta = 0", "refractor.eta: gives a refractive index of 0"),
            ("eta = -1.3", "refractor.eta: gives a refractive index of -1.3"),
            ("eta = nan", "refractor.eta: gives a refractive index of NaN"),
            ("eta = [1.3, 1.3]", "expected a number, or three"),
            ("cauchy = [1.5, -3]", "refractor.cauchy: gives a refractive index of"),
            ("eta = 1.3, cauchy = [1.5, 0.004]", "give either eta"),
            ("", "give either eta"),
            ("eta = 1.5, interfaces = 3", "refractor.interfaces: must be 1"),
            ("eta = 1.5, interfaces = 2", "refractor.interfaces: is 2, but the mesh is not closed: the edge from"),
            ("eta = 1.5, etas = 2", "unknown key 'etas'; did you mean 'eta'?"),
            ("eta = 1.5 }\nreceiver = {", "refractor: is neither reflector nor receiver"),
        ] {
            let message = refractor(keys).unwrap_err().to_string();
            assert!(message.starts_with("scene.toml:") && message.contains(expected), "{keys}: {message}");
        }
    }

    #[test]
    fn media_absorb_and_scatter() {
        let medium = |keys: &str| {
            let text = format!("{GOOD}[medium]\n{keys}");
            parse::<Render>("scene.toml", &text, Path::new(".")).map(|loaded| loaded.scene)
        };
        let haze = medium("sigma_s = 0.1\nsigma_a = [0.3, 0.2, 0.1]\ng = 0.5").unwrap();
        let expected = Medium { sigma_s: Vec3::splat(0.1), sigma_a: Vec3::new(0.3, 0.2, 0.1), g: 0.5 };
        assert_eq!(haze.medium, Some(expected));
        assert_ne!(haze.fingerprint(""), medium("sigma_s = 0.1").unwrap().fingerprint(""));
        for (keys, expected) in [
            ("sigma_s = -0.1", "medium.sigma_s: is [-0.1, -0.1, -0.1], but must be three numbers from 0"),
            ("sigma_a = [0.1, nan, 0]", "medium.sigma_a: is [0.1, NaN"),
            ("sigma_a = [0.1]", "medium.sigma_a: "),
            ("sigma_s = 0.1\ng = 1", "medium.g: is 1, but must be from -0.99"),
            ("sigma_s = 0", "medium: is a medium that does nothing"),
            ("sigma = 0.1", "unknown key 'sigma'; did you mean 'sigma_a'?"),
            (
                "sigma_s = 0.1\n[[object]]\nshape = { sphere = {} }\nrefractor = { eta = 1.5, interfaces = 2 }",
                "medium: cannot fill a scene with closed refractors yet",
            ),
        ] {
            let message = medium(keys).unwrap_err().to_string();
            assert!(message.starts_with("scene.toml:") && message.contains(expected), "{keys}: {message}");
        }
    }

    #[test]
    fn scenes_load_from_memory() {
        let mut map = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n".to_vec();
        map.extend([128, 128, 128, 129, 128, 128, 128, 129]);
        let files: HashMap<PathBuf, Vec<u8>> = HashMap::from([
            ("sky.hdr".into(), map),
            ("a/b.mtl".into(), b"newmtl m\nKd 0.5".to_vec()),
            ("a/b.obj".into(), b"mtllib b.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3".to_vec()),
        ]);
        let text = GOOD.replace("constant = [1.0, 1.0, 1.0]", "map = \"sky.hdr\"").replace(
            "shape = { plane = { size = [3.0, 3.0] } }\nreceiver = { albedo = [0.5, 0.5, 0.5] }",
            "mesh = \"a/b.obj\"",
        );
        let scene = parse::<Render>("scene.toml", &text, &files).unwrap().scene;
        assert!(scene.objects[1].receiver.is_some());
        let Light::Map(map) = &scene.environment.light else { panic!("{:?}", scene.environment) };
        assert_eq!(map.images()[0].pixels, [[1.0; 3]; 2]);
        let other = text.replace("radius = 1.0", "radius = 2.0");
        let other = parse::<Render>("scene.toml", &other, &files).unwrap().scene;
        assert_ne!(scene.fingerprint(""), other.fingerprint(""));
        let message = parse::<Render>("scene.toml", &text.replace("sky.hdr", "sea.hdr"), &files).unwrap_err();
        assert!(message.to_string().contains("'sea.hdr': no such file"), "{message}");
    }

    #[test]
    fn errors_of_the_render_table_name_its_line() {
        let loaded = parse::<Render>("scene.toml", &format!("\u{feff}{GOOD}"), Path::new(".")).unwrap();
        let message = loaded.render_error("samples", "must be positive").to_string();
        assert_eq!(message, "scene.toml:10: render.samples: must be positive");
        assert!(loaded.render_error("size", "is odd").to_string().starts_with("scene.toml:9: render.size"));
    }

    #[test]
    fn directions_may_be_of_any_length() {
        for length in ["1e30", "1e-30"] {
            let text = GOOD.replace("up = [0.0, 0.0, -1.0]", &format!("up = [0.0, 0.0, -{length}]")).replace(
                "constant = [1.0, 1.0, 1.0]",
                &format!("spot = {{ direction = [0, {length}, 0], sigma_rad = 0.1, radiance = [1, 1, 1] }}"),
            );
            let scene = parse::<Render>("scene.toml", &text, Path::new(".")).unwrap().scene;
            let Light::Spot { direction, .. } = scene.environment.light else { panic!("no spot") };
            assert!(direction == Vec3::Y && scene.camera.up.abs_diff_eq(Vec3::NEG_Z, 1e-6));
        }
    }

    #[test]
    fn control_characters_do_not_reach_messages() {
        let text = GOOD.replace("name = \"table\"", r#"name = "ta\u001bble""#).replace("[0.5, 0.5, 0.5]", "[5, 0, 0]");
        let message = failure(&text);
        assert!(message.contains(r"ta\u{1b}ble") && !message.contains('\u{1b}'), "{message:?}");
        let message = failure(&GOOD.replace("samples =", r#""sam\u0007ples" ="#));
        assert!(!message.contains('\u{7}'), "{message:?}");
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
            ("constant = [1.0, 1.0, 1.0]", "constant = [3e38, 0, 0]", "scene.toml:3: environment.constant: is [3e38"),
            (
                "constant = [1.0, 1.0, 1.0]",
                "constant = [1e30, 0, 0]\nintensity = 1e30",
                "scene.toml:4: environment.intensity: times the radiance",
            ),
            (
                "constant = [1.0, 1.0, 1.0]",
                "constant = [1, 1, 1]\nintensity = -1",
                "scene.toml:4: environment.intensity",
            ),
            (
                "constant = [1.0, 1.0, 1.0]",
                "constant = [1, 1, 1, 1]",
                "scene.toml:3: environment.constant: has 4 elements",
            ),
            ("[0.5, 0.5, 0.5]", "[0.5, 0.5, 0.5, 9]", "scene.toml:18: object 'table'.receiver.albedo: has 4 elements"),
            ("size = [3.0, 3.0]", "size = [3.0]", "scene.toml:17: object 'table'.shape.plane.size: has 1 elements"),
            ("size = [3.0, 3.0]", "size = [3e30, 3]", "scene.toml:17: object 'table'.shape"),
            (
                "position = [0.0, 5.0, 0.0]",
                "position = [0.0, 5e30, 0.0]",
                "scene.toml:5: camera.position: must be at most",
            ),
            (
                "name = \"table\"",
                "name = \"table\"\nscale = 1e30",
                "object 'table' cannot be placed: it reaches beyond",
            ),
            (
                "name = \"table\"",
                "name = \"table\"\nscale = 1e-30",
                "object 'table' cannot be placed: it becomes too small",
            ),
            ("name = \"table\"", "name = \"table\"\ntranslate = [3e38, 0, 0]", "object 'table' cannot be placed"),
            ("shape = { ring = { radius = 1.0, height = 0.5 } }", "", "exactly one of mesh"),
        ] {
            let message = failure(&GOOD.replacen(from, to, 1));
            let of_file =
                message.starts_with("scene.toml:") || expected == "none.binary" || expected.contains("placed");
            assert!(message.contains(expected) && of_file, "{message}");
        }
    }

    #[test]
    fn a_few_of_the_objects_with_coplanar_faces_are_named() {
        let block = |k: u32| {
            format!(
                "{{ name = \"block {k}\", shape = {{ box = {{ size = [0.1, 0.1, 0.1] }} }}, translate = [{k}, 0.05, 0], reflector = {{}} }},"
            )
        };
        let blocks: String = (0..6).map(block).collect();
        let text = format!(
            "environment = {{ constant = [1, 1, 1] }}
            camera = {{ position = [0, 5, 5], target = [0, 0, 0], perspective = {{ fov_y_deg = 40 }} }}
            object = [{blocks} {{ shape = {{ plane = {{ size = [20, 20] }} }}, receiver = {{}} }}]"
        );
        let scene = parse::<Render>("blocks.toml", &text, Path::new(".")).unwrap().scene;
        assert_eq!(scene.notes.len(), 4, "{:?}", scene.notes);
        assert!(scene.notes[0].contains("'block 0'") && scene.notes[3].contains("3 more objects"), "{:?}", scene.notes);
    }
}
