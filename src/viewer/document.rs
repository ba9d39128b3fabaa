//! The scene that is open: as it was loaded, as it has been edited, and how it is written back to a scene file, whose comments and order
//! stay. Knows neither rendering nor the window.

use std::ops::Range;
use std::path::{Path, PathBuf};

use toml_edit::{DocumentMut, InlineTable, Item, Table, value};

use super::history::History;
use super::scene_text::{number, write_camera, write_lamps, write_medium, write_objects, write_options};
use crate::Error;
use crate::image::write_atomically;
use crate::scene::{BUILT_IN, Light, Loaded, MapLayout, Scene, Transform, parse};
use pinspot_render::options::{Exposure, Options, Settings};

/// What an edit changes, and undoing restores.
#[derive(Clone, Debug)]
pub struct State {
    pub scene: Scene,
    pub options: Options,
    /// Whether the animation poses the scene.
    pub is_animated: bool,
    /// Options whose picture is shown beside that of the current ones.
    pub kept: Option<Options>,
    /// An environment map in place of the scene's light: its file or, if it is built in, its name.
    pub map: Option<String>,
}

/// An open scene.
#[derive(Clone, Debug)]
pub struct Document {
    /// A path, or the name of a built-in scene.
    pub name: String,
    /// The scene file's text, with what has been added to it.
    text: String,
    /// What the scene file held when it was read; empty for built-in scenes.
    on_disk: String,
    /// Files named in the text are relative to it.
    folder: PathBuf,
    /// The objects of each `[[object]]` table of the text.
    objects_of_tables: Vec<Range<usize>>,
    /// As loaded.
    pub original: State,
    pub state: State,
    pub history: History<State>,
}

/// The part of a scene file that holds the options.
#[derive(serde::Deserialize)]
struct RenderTable {
    #[serde(default)]
    render: Settings,
}

impl Document {
    /// Reads a scene file, or the built-in scene of that name.
    pub fn open(name: &str) -> Result<Self, String> {
        if let Some(built_in) = BUILT_IN.iter().find(|scene| scene.name == name) {
            return Self::of_text(name, built_in.toml.to_owned(), Path::new("."));
        }
        let text = std::fs::read_to_string(name).map_err(|e| format!("cannot read scene file '{name}': {e}"))?;
        let folder = Path::new(name).parent().filter(|folder| !folder.as_os_str().is_empty());
        let opened = Self::of_text(name, text.clone(), folder.unwrap_or(Path::new(".")))?;
        Ok(Self { on_disk: text, ..opened })
    }

    /// The files that the scene is made of.
    pub fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = if self.on_disk.is_empty() { Vec::new() } else { vec![(&self.name).into()] };
        let Ok(document) = self.document() else { return files };
        let mut add = |item: Option<&Item>| {
            let file = item.and_then(Item::as_str).map(|file| self.folder.join(file));
            files.extend(file.filter(|file| file.extension().is_some()));
        };
        add(document.get("environment").and_then(|table| table.get("map")));
        for object in document.get("object").and_then(Item::as_array_of_tables).into_iter().flatten() {
            add(object.get("mesh"));
            add(object.get("receiver").and_then(|table| table.get("table")));
        }
        let own: Option<PathBuf> = self.state.map.as_ref().map(Into::into);
        files.extend(own.filter(|file| file.extension().is_some()));
        files
    }

    /// The same scene from its files as they are now, without edits.
    pub fn reloaded(&self) -> Result<Self, String> {
        // Editors that truncate a file before they write it leave it empty for a moment.
        let read = std::fs::read_to_string(&self.name).ok().filter(|text| !text.is_empty());
        let on_disk = read.unwrap_or_else(|| self.on_disk.clone());
        let text = if on_disk == self.on_disk { self.text.clone() } else { on_disk.clone() };
        let mut opened = Self { on_disk, ..Self::of_text(&self.name, text, &self.folder)? };
        if let Some(map) = &self.state.map {
            let (light, reference) = Self::read_map(Path::new(map))?;
            opened.state.scene.environment.light = light;
            opened.state.map = Some(reference);
        }
        Ok(opened)
    }

    /// The edits of this document, on the same one read again. What was edited before cannot be undone any more.
    pub fn edits_on(&self, mut opened: Self) -> Self {
        let State { scene, is_animated, kept, .. } = &self.state;
        opened.state.options = self.options_on(&opened);
        let (new, old) = (&mut opened.state.scene, &self.original.scene);
        new.camera = scene.camera;
        if scene.environment.rotation_rad != old.environment.rotation_rad {
            new.environment.rotation_rad = scene.environment.rotation_rad;
        }
        if scene.environment.intensity != old.environment.intensity {
            new.environment.intensity = scene.environment.intensity;
        }
        for (edited, original) in scene.lamps.iter().zip(&old.lamps) {
            let same = new.lamps.iter_mut().find(|lamp| lamp.name == edited.name);
            let Some(lamp) = same else { continue };
            if edited.position != original.position {
                lamp.position = edited.position;
            }
            if edited.intensity != original.intensity {
                lamp.intensity = edited.intensity;
            }
        }
        if scene.medium != old.medium {
            new.medium = scene.medium;
        }
        for (edited, original) in scene.objects.iter().zip(&old.objects) {
            let same = new.objects.iter_mut().find(|object| object.name == edited.name);
            let Some(object) = same else { continue };
            if edited.placement != original.placement {
                object.placement = edited.placement;
            }
            if edited.emitter != original.emitter && object.emitter.is_some() {
                object.emitter = edited.emitter;
            }
            if edited.refractor != original.refractor && object.refractor.is_some() {
                object.refractor.clone_from(&edited.refractor);
            }
        }
        opened.state.kept.clone_from(kept);
        opened.state.is_animated = *is_animated && !opened.state.scene.animations.is_empty();
        opened
    }

    /// The options of the same scene read again, with those keys changed that were edited.
    fn options_on(&self, opened: &Self) -> Options {
        let (edited, original) = (&self.state.options, &self.original.options);
        if edited == original {
            return opened.state.options.clone();
        }
        let merged = opened.document().ok().and_then(|mut document| {
            write_options(&mut document, original, edited);
            toml::from_str::<RenderTable>(&document.to_string()).ok()?.render.options().ok()
        });
        let merged = merged.unwrap_or_else(|| edited.clone());
        merged.with_overlay(edited.overlay).with_plain_diffuse(edited.plain_diffuse)
    }

    fn of_text(name: &str, text: String, folder: &Path) -> Result<Self, String> {
        let loaded = parse::<Settings>(name, &text, folder).map_err(|e| e.to_string())?;
        let options = loaded.render.clone().options();
        let options = options.map_err(|e| loaded.render_error(e.key(), e.to_string()).to_string())?;
        let objects_of_tables = loaded.objects_of_tables().to_vec();
        let Loaded { scene, .. } = loaded;
        let is_animated = !scene.animations.is_empty();
        let state = State { scene, options, is_animated, kept: None, map: None };
        let (original, history) = (state.clone(), History::default());
        let on_disk = String::new();
        Ok(Self {
            name: name.to_owned(),
            text,
            on_disk,
            folder: folder.to_owned(),
            objects_of_tables,
            original,
            state,
            history,
        })
    }

    /// The scene without its edits and with a mesh added, which takes its materials from its own library or else mirrors on both sides.
    pub fn with_mesh(&self, mesh: &Path) -> Result<Self, String> {
        let add = |has_materials: bool| -> Result<Self, String> {
            let mut document = self.document()?;
            let mut table = Table::new();
            let stem = mesh.file_stem().unwrap_or_default().to_string_lossy();
            table["name"] = value(stem.as_ref());
            table["mesh"] = value(absolute(mesh).display().to_string());
            if !has_materials {
                let mut reflector = InlineTable::new();
                reflector.insert("sides", "both".into());
                table["reflector"] = value(reflector);
            }
            let objects = document.entry("object").or_insert(Item::ArrayOfTables(Default::default()));
            objects.as_array_of_tables_mut().ok_or("the scene's objects are not [[object]] tables")?.push(table);
            let opened = Self::of_text(&self.name, document.to_string(), &self.folder)?;
            Ok(Self { on_disk: self.on_disk.clone(), ..opened })
        };
        let with_own = add(true)?;
        let own = self.original.scene.objects.len();
        let has_surface = |document: &Self| {
            let added = document.state.scene.objects.get(own..).unwrap_or_default();
            added.iter().any(|object| object.reflector.is_some() || object.receiver.is_some())
        };
        Ok(if has_surface(&with_own) { with_own } else { add(false)? })
    }

    /// The edits of this document, on another one that has one more mesh.
    pub fn edits_with_mesh(&self, mut opened: Self) -> Self {
        let own = self.state.scene.objects.len().min(opened.state.scene.objects.len());
        let added = opened.state.scene.objects.split_off(own);
        opened.state = self.state.clone();
        opened.state.scene.objects.extend(added);
        opened
    }

    /// Reads an environment map, or finds the built-in one of that name. The second part of the result is what scene files call it.
    pub fn read_map(path: &Path) -> Result<(Light, String), String> {
        let is_file = path.extension().is_some();
        let reference = if is_file { absolute(path) } else { path.to_owned() }.display().to_string();
        let (light, _) = Light::map(Path::new(""), &reference, MapLayout::Auto).map_err(|e| e.to_string())?;
        Ok((light, reference))
    }

    /// Lights the scene with an environment map, of which scene files use this name; it is exposed for anew.
    pub fn set_map(&mut self, light: Light, reference: String) {
        self.history.note(&self.state);
        self.state.scene.environment.light = light;
        self.state.map = Some(reference);
        self.state.options.display.exposure = Exposure::Auto;
        self.state.options.display.background_exposure_ev = None;
    }

    /// Lights the scene as its file says.
    pub fn reset_map(&mut self) {
        self.history.note(&self.state);
        self.state.scene.environment.light = self.original.scene.environment.light.clone();
        self.state.map = None;
        self.state.options.display.exposure = self.original.options.display.exposure;
        self.state.options.display.background_exposure_ev = self.original.options.display.background_exposure_ev;
    }

    /// Takes back the last edit; the camera stays.
    pub fn undo(&mut self) {
        if let Some(state) = self.history.undo(&self.state) {
            self.restore(state);
        }
    }

    /// Makes the last edit again that was taken back.
    pub fn redo(&mut self) {
        if let Some(state) = self.history.redo(&self.state) {
            self.restore(state);
        }
    }

    fn restore(&mut self, state: State) {
        let camera = self.state.scene.camera;
        self.state = state;
        self.state.scene.camera = camera;
    }

    /// The objects that are moved together with one: those of its table.
    pub fn moved_with(&self, object: usize) -> Range<usize> {
        let of_table = self.objects_of_tables.iter().find(|objects| objects.contains(&object));
        of_table.cloned().unwrap_or(object..object + 1)
    }

    /// Places an object, and those that are moved together with it.
    pub fn place(&mut self, object: usize, placement: Transform) {
        let together = self.moved_with(object);
        for moved in self.state.scene.objects.get_mut(together).unwrap_or_default() {
            moved.placement = placement;
        }
    }

    /// Whether anything differs from the file.
    pub fn is_edited(&self) -> bool {
        self.to_toml().is_ok_and(|text| text != self.text) || self.state.map.is_some()
    }

    fn document(&self) -> Result<DocumentMut, String> {
        self.text.parse().map_err(|e: toml_edit::TomlError| e.message().to_owned())
    }

    /// The scene file with all edits.
    pub fn to_toml(&self) -> Result<String, String> {
        let mut document = self.document()?;
        write_camera(&mut document, &self.original.scene.camera, &self.state.scene.camera);
        self.write_environment(&mut document);
        write_lamps(&mut document, &self.original.scene.lamps, &self.state.scene.lamps);
        write_medium(&mut document, self.original.scene.medium, self.state.scene.medium);
        write_options(&mut document, &self.original.options, &self.state.options);
        write_objects(&mut document, &self.objects_of_tables, &self.original.scene.objects, &self.state.scene.objects);
        Ok(document.to_string())
    }

    /// Writes the scene file. Files that it names are given by their whole paths if the new one lies in another folder.
    pub fn save(&mut self, path: &Path) -> Result<(), Error> {
        use std::io::Write;
        let write = |text: Result<String, String>| {
            write_atomically(path, |out| out.write_all(text?.as_bytes()).map_err(|e| e.to_string()))
        };
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let is_moved = std::fs::canonicalize(folder).ok() != std::fs::canonicalize(&self.folder).ok();
        let text = self.to_toml().and_then(|text| if is_moved { self.with_whole_paths(&text) } else { Ok(text) });
        write(text.clone())?;
        self.text = text.unwrap_or_default();
        self.on_disk.clone_from(&self.text);
        folder.clone_into(&mut self.folder);
        self.name = path.display().to_string();
        self.original = self.state.clone();
        if self.state.map.take().is_some() {
            // The text names the map now; earlier states don't know that.
            (self.original.map, self.history) = (None, History::default());
        }
        Ok(())
    }

    fn with_whole_paths(&self, text: &str) -> Result<String, String> {
        let mut document: DocumentMut = text.parse().map_err(|e: toml_edit::TomlError| e.message().to_owned())?;
        let whole = |item: Option<&mut Item>| {
            let file = item.as_ref().and_then(|item| item.as_str()).map(|file| self.folder.join(file));
            // Built-in maps have names without an ending.
            if let (Some(item), Some(file)) = (item, file.filter(|file| file.extension().is_some())) {
                *item = value(absolute(&file).display().to_string());
            }
        };
        let environment = document.get_mut("environment").and_then(Item::as_table_like_mut);
        whole(environment.and_then(|table| table.get_mut("map")));
        if let Some(objects) = document.get_mut("object").and_then(Item::as_array_of_tables_mut) {
            for object in objects.iter_mut() {
                whole(object.get_mut("mesh"));
                let receiver = object.get_mut("receiver").and_then(Item::as_table_like_mut);
                whole(receiver.and_then(|table| table.get_mut("table")));
            }
        }
        if let Some(lights) = document.get_mut("light").and_then(Item::as_array_of_tables_mut) {
            for light in lights.iter_mut() {
                let spot = light.get_mut("spot").and_then(Item::as_table_like_mut);
                whole(spot.and_then(|table| table.get_mut("slide")));
            }
        }
        Ok(document.to_string())
    }

    fn write_environment(&self, document: &mut DocumentMut) {
        let (old, new) = (&self.original.scene.environment, &self.state.scene.environment);
        let is_edited =
            self.state.map.is_some() || new.rotation_rad != old.rotation_rad || new.intensity != old.intensity;
        if !is_edited {
            return;
        }
        let environment = document.entry("environment").or_insert(Item::Table(Table::new()));
        let Some(table) = environment.as_table_like_mut() else { return };
        if let Some(map) = &self.state.map {
            for key in ["faces", "layout", "spot", "constant"] {
                table.remove(key);
            }
            table.insert("map", value(map));
        }
        if new.rotation_rad != old.rotation_rad {
            table.insert("rotation_deg", value(number(new.rotation_rad.to_degrees())));
        }
        if new.intensity != old.intensity {
            table.insert("intensity", value(number(new.intensity)));
        }
    }
}

/// The absolute form of a path, which need not exist.
fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn edits_survive_in_the_saved_file() {
        let dir = tempfile::tempdir().unwrap();
        let mut document = Document::open("ring-natural").unwrap();
        assert!(!document.is_edited());
        document.state.options.samples = 777;
        document.state.options.tolerance = 0.03;
        document.state.options.display.background_exposure_ev = None;
        document.state.scene.environment.rotation_rad = 0.5;
        document.state.scene.objects[0].placement.translate = Vec3::new(0.1, 0.0, -0.25);
        document.state.scene.camera.position.y += 0.5;
        assert!(document.is_edited());
        let path = dir.path().join("mine.toml");
        document.save(&path).unwrap();
        assert!(!document.is_edited());
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.starts_with("# Figure 6d") && text.contains("translate = [0.1, 0.0, -0.25]"), "{text}");
        let again = Document::open(path.to_str().unwrap()).unwrap();
        assert_eq!(again.state.options, document.state.options);
        assert!((again.state.scene.environment.rotation_rad - 0.5).abs() < 1e-6);
        assert!(again.state.scene.camera.position.abs_diff_eq(document.state.scene.camera.position, 1e-6));
        assert!(again.state.scene.camera.forward.abs_diff_eq(document.state.scene.camera.forward, 1e-5));
        assert_eq!(again.state.scene.objects[0].placement, document.state.scene.objects[0].placement);
    }

    #[test]
    fn lamps_are_edited() {
        let dir = tempfile::tempdir().unwrap();
        let mut document = Document::open("colours").unwrap();
        document.state.scene.lamps[0].position.x = 0.75;
        document.state.scene.lamps[0].intensity *= 2.0;
        let path = dir.path().join("mine.toml");
        document.save(&path).unwrap();
        let again = Document::open(path.to_str().unwrap()).unwrap();
        let (expected, found) = (&document.state.scene.lamps[0], &again.state.scene.lamps[0]);
        assert!(found.position.abs_diff_eq(expected.position, 1e-6));
        assert!(found.intensity.abs_diff_eq(expected.intensity, 1e-5));
    }

    #[test]
    fn emitters_and_refractors_are_edited() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("mine.toml");
        for name in ["dynamic", "pool"] {
            let mut document = Document::open(name).unwrap();
            for object in &mut document.state.scene.objects {
                if let Some(emitter) = &mut object.emitter {
                    (emitter.radiance, emitter.is_near) = (0.5 * emitter.radiance, !emitter.is_near);
                }
                if let Some(refractor) = &mut object.refractor {
                    refractor.eta += 0.125;
                }
            }
            document.save(&path).unwrap();
            let again = Document::open(path.to_str().unwrap()).unwrap();
            for (found, expected) in again.state.scene.objects.iter().zip(&document.state.scene.objects) {
                assert_eq!(found.emitter, expected.emitter, "{name}");
                let eta = |object: &crate::scene::Object| object.refractor.as_ref().map(|r| r.eta.as_vec3());
                assert_eq!(eta(found), eta(expected), "{name}");
            }
            assert!(!again.is_edited(), "{name}");
        }
    }

    #[test]
    fn media_are_edited() {
        let dir = tempfile::tempdir().unwrap();
        let mut document = Document::open("underwater").unwrap();
        let medium = document.state.scene.medium.as_mut().unwrap();
        (medium.sigma_s, medium.g) = (0.5 * medium.sigma_s, 0.25);
        let path = dir.path().join("mine.toml");
        document.save(&path).unwrap();
        let again = Document::open(path.to_str().unwrap()).unwrap();
        assert_eq!(again.state.scene.medium, document.state.scene.medium);
        assert!(!again.is_edited());
    }

    #[test]
    fn meshes_are_added_and_paths_stay_valid_in_other_folders() {
        let dir = tempfile::tempdir().unwrap();
        let (here, there) = (dir.path().join("here"), dir.path().join("there"));
        for folder in [&here, &there] {
            std::fs::create_dir(folder).unwrap();
        }
        let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        std::fs::write(here.join("a.obj"), triangle).unwrap();
        std::fs::write(there.join("b.obj"), triangle).unwrap();
        let text = "environment = { constant = [1, 1, 1] }\n[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\n\
                    perspective = { fov_y_deg = 40 }\n[[object]]\nmesh = \"a.obj\"\nreceiver = {}\n";
        std::fs::write(here.join("scene.toml"), text).unwrap();
        let mut opened = Document::open(here.join("scene.toml").to_str().unwrap()).unwrap();
        opened.state.options.samples = 5;
        let mut added = opened.edits_with_mesh(opened.with_mesh(&there.join("b.obj")).unwrap());
        assert_eq!((added.state.scene.objects.len(), added.state.options.samples), (2, 5));
        assert!(added.state.scene.objects[1].reflector.is_some());
        added.save(&there.join("copy.toml")).unwrap();
        let copy = Document::open(there.join("copy.toml").to_str().unwrap()).unwrap();
        assert_eq!(copy.state.scene.objects.len(), 2);
        std::fs::write(there.join("c.obj"), "v 0 0\n").unwrap();
        assert!(added.with_mesh(&there.join("c.obj")).unwrap_err().contains("c.obj"));
    }

    /// A key that was edited keeps its value when the file is read again; others take the file's.
    #[test]
    fn edited_options_survive_a_changed_file() {
        let text = |tolerance: &str| {
            format!(
                "[environment]\nconstant = [1.0, 1.0, 1.0]\n[camera]\nposition = [0.0, 3.0, 0.0]\ntarget = [0.0, 0.0, 1.0]\n\
                 perspective = {{ fov_y_deg = 40.0 }}\n[render]\nsamples = 100\ntolerance = {tolerance}\n[[object]]\nshape = {{ ring = {{}} }}\nreflector = {{}}\n"
            )
        };
        let open = |tolerance: &str| Document::of_text("mine.toml", text(tolerance), Path::new(".")).unwrap();
        let mut document = open("0.05");
        document.state.options.samples = 200;
        document.state.options.plain_diffuse = true;
        let again = document.edits_on(open("0.1"));
        let Options { samples, tolerance, plain_diffuse, .. } = again.state.options;
        assert_eq!((samples, tolerance, plain_diffuse), (200, 0.1, true));
        assert_eq!(again.original.options.samples, 100);
    }

    #[test]
    fn edits_are_undone_and_made_again() {
        let mut document = Document::open("ring").unwrap();
        document.history.note(&document.state);
        document.state.options.samples = 10;
        document.state.scene.camera.position.x = 9.0;
        document.undo();
        assert_eq!(document.state.options.samples, 1000);
        assert_eq!(document.state.scene.camera.position.x, 9.0, "the camera stays");
        document.redo();
        assert_eq!(document.state.options.samples, 10);
    }
}
