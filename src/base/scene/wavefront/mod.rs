//! Wavefront OBJ through `tobj`, as one mesh, or one per material.
//!
//! ```text
//! bytes → text: statements → obj: checked → tobj: indexed → polygon: triangles → Mesh
//!                          → mtl: materials
//! ```

mod mtl;
mod obj;
mod polygon;
mod text;

use std::collections::HashMap;
use std::io::Read;
use std::path::Path;

use glam::{DVec3, Vec3};

pub(super) use mtl::Surface;

use super::Assets;
use super::Transform;
use super::assets::readable_name;
use super::mesh::{Mesh, MeshError};
use super::normals::smooth_normals;
use crate::vectors::direction;
use crate::words::escaped;

/// What was repaired while reading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ObjReport {
    /// Triangles without area that were dropped.
    pub dropped_triangles: usize,
    /// The file had no normals; smooth ones were computed.
    pub normals_made: bool,
}

impl Mesh {
    /// Reads all objects and groups of an OBJ file as one mesh, without materials. `name` is used in messages;
    /// `crease_angle_rad` only if the file has no normals.
    pub fn from_obj(name: &str, bytes: &[u8], crease_angle_rad: f32) -> Result<(Self, ObjReport), MeshError> {
        let (mesh, report, origin) = whole(name, bytes, crease_angle_rad)?;
        if origin == DVec3::ZERO {
            return Ok((mesh, report));
        }
        let placement = Transform { translate: origin.as_vec3(), ..Default::default() };
        let (mesh, dropped) = mesh.placed(&placement, name)?;
        Ok((mesh, ObjReport { dropped_triangles: report.dropped_triangles + dropped, ..report }))
    }
}

/// A file as one mesh, and what its positions count from, metres.
fn whole(name: &str, bytes: &[u8], crease_angle_rad: f32) -> Result<(Mesh, ObjReport, DVec3), MeshError> {
    let checked = obj::check(name, bytes)?;
    let (mesh, report) = merged(name, indexed(name, &checked, &[])?.iter(), crease_angle_rad)?;
    Ok((mesh, report, checked.origin))
}

/// Reads an OBJ file as [`Mesh::from_obj`] does, but for what its positions count from, metres.
pub(super) fn load_obj(
    assets: &dyn Assets,
    path: &Path,
    crease_angle_rad: f32,
) -> Result<(Mesh, ObjReport, DVec3), MeshError> {
    let (name, bytes) = read(assets, path)?;
    whole(&name, &bytes, crease_angle_rad)
}

/// The part of a file that has one material.
#[derive(Debug)]
pub(super) struct ObjPart {
    /// The material's name; empty if it has none.
    pub material: String,
    pub surface: Surface,
    pub mesh: Mesh,
    pub report: ObjReport,
}

/// A file's parts, one per material in use.
#[derive(Debug)]
pub(super) struct ObjParts {
    pub parts: Vec<ObjPart>,
    /// What their positions count from, metres.
    pub origin: DVec3,
    /// What of the materials was changed, or has no effect.
    pub notes: Vec<String>,
    /// Number of materials that have no effect because the file names no material library.
    pub undefined_materials: usize,
}

/// Reads an OBJ file and its materials.
pub(super) fn load_obj_by_material(
    assets: &dyn Assets,
    path: &Path,
    crease_angle_rad: f32,
) -> Result<ObjParts, MeshError> {
    let (name, bytes) = read(assets, path)?;
    let checked = obj::check(&name, &bytes)?;
    let mut notes = Vec::new();
    let surfaces = surfaces(assets, path, (&name, &checked), &mut notes)?;
    let models = indexed(&name, &checked, &checked.materials)?;
    let mut ids: Vec<Option<usize>> = models.iter().map(|m| m.mesh.material_id).collect();
    ids.sort_unstable();
    ids.dedup();
    if ids.is_empty() {
        ids = vec![None];
    }
    let part = |id: &Option<usize>| {
        let chosen = models.iter().filter(|model| model.mesh.material_id == *id);
        let (mesh, report) = merged(&name, chosen, crease_angle_rad)?;
        let material = id.map_or(String::new(), |id| escaped(&checked.materials[id].1));
        let surface = id.map_or_else(Surface::default, |id| surfaces[id].clone());
        Ok(ObjPart { material, surface, mesh, report })
    };
    let named = checked.materials.iter().filter(|(_, name)| !is_placeholder(name)).count();
    let undefined_materials = if checked.libraries.is_empty() { named } else { 0 };
    let parts = ids.iter().map(part).collect::<Result<_, _>>()?;
    Ok(ObjParts { parts, origin: checked.origin, notes, undefined_materials })
}

/// Whether a material's name is one that exporters write for no material.
fn is_placeholder(material: &str) -> bool {
    matches!(material, "" | "(null)" | "None")
}

/// A file's name for messages, and its bytes.
fn read(assets: &dyn Assets, path: &Path) -> Result<(String, Vec<u8>), MeshError> {
    let name = readable_name(assets, path);
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if extension != "obj" {
        return Err(MeshError::Format { origin: name, extension: format!(".{}", escaped(&extension)) });
    }
    match assets.read(path) {
        Ok(bytes) => Ok((name, bytes)),
        Err(error) => Err(MeshError::Read { origin: name, reason: error.to_string() }),
    }
}

/// The surface of each material in use. Without a material library, materials have no effect.
fn surfaces(
    assets: &dyn Assets,
    path: &Path,
    (name, checked): (&str, &obj::Checked),
    notes: &mut Vec<String>,
) -> Result<Vec<Surface>, MeshError> {
    if checked.libraries.is_empty() {
        return Ok(vec![Surface::default(); checked.materials.len()]);
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    // The last definition of a name counts.
    let mut known = HashMap::new();
    let mut files = Vec::new();
    for (line, library) in &checked.libraries {
        let libraries = library_files(assets, folder, library).map_err(|reason| MeshError::Library {
            file: name.into(),
            line: *line,
            library: escaped(library),
            reason,
        })?;
        for missing in libraries.missing {
            notes.push(format!("{name}:{line}: there is no material library '{}'; it is left out", escaped(&missing)));
        }
        for (file, bytes) in libraries.found {
            for material in mtl::materials(&file, &bytes)? {
                known.insert(material.name.clone(), (file.clone(), material));
            }
            files.push(file);
        }
    }
    let mut surface = |(line, material): &(usize, String)| match known.get(material) {
        Some((file, found)) => {
            notes.extend(found.notes.iter().map(|note| format!("{file}: material '{}': {note}", escaped(material))));
            found.surface.clone().map_err(|(line, reason)| MeshError::Statement { file: file.clone(), line, reason })
        }
        None if is_placeholder(material) => Ok(Surface::default()),
        None => {
            let reason = format!("there is no material '{}' in {}", escaped(material), files.join(", "));
            Err(MeshError::Statement { file: name.into(), line: *line, reason })
        }
    };
    checked.materials.iter().map(&mut surface).collect()
}

/// The files of one `mtllib`.
struct Libraries {
    /// Names for messages, and bytes.
    found: Vec<(String, Vec<u8>)>,
    missing: Vec<String>,
}

/// The files of one `mtllib`: a single name, which may have spaces, or several, of which some may be missing.
fn library_files(assets: &dyn Assets, folder: &Path, names: &str) -> Result<Libraries, String> {
    let file = |name: &str| {
        let path = folder.join(name);
        assets.read(&path).map(|bytes| (readable_name(assets, &path), bytes)).map_err(|error| error.to_string())
    };
    let reason = match file(names) {
        Ok(file) => return Ok(Libraries { found: vec![file], missing: Vec::new() }),
        Err(reason) => reason,
    };
    let (mut found, mut missing) = (Vec::new(), Vec::new());
    for name in names.split_whitespace() {
        match file(name) {
            Ok(file) => found.push(file),
            Err(_) => missing.push(name.to_owned()),
        }
    }
    if found.is_empty() { Err(reason) } else { Ok(Libraries { found, missing }) }
}

/// The checked file, indexed by `tobj`: a model per run of faces with the same material. Materials are numbered.
fn indexed(name: &str, checked: &obj::Checked, materials: &[(usize, String)]) -> Result<Vec<tobj::Model>, MeshError> {
    let names = || (0..materials.len()).map(|index| index.to_string());
    let known = |_: &Path| {
        let materials = names().map(|name| tobj::Material { name, ..Default::default() }).collect();
        Ok((materials, names().zip(0..).collect()))
    };
    let options = tobj::LoadOptions { single_index: true, ..Default::default() };
    let mut file = b"mtllib all\n".chain(checked.vertices.as_bytes()).chain(checked.faces.as_bytes());
    match tobj::load_obj_buf(&mut file, &options, known) {
        Ok((models, _)) => Ok(models),
        Err(error) => Err(MeshError::Damaged { origin: name.into(), reason: error.to_string() }),
    }
}

/// Models as one mesh.
fn merged<'a>(
    name: &str,
    models: impl Iterator<Item = &'a tobj::Model>,
    crease_angle_rad: f32,
) -> Result<(Mesh, ObjReport), MeshError> {
    let mut soup = Soup::default();
    for model in models {
        soup.append(&model.mesh).map_err(|reason| MeshError::Damaged { origin: name.into(), reason })?;
    }
    soup.into_mesh(name, crease_angle_rad)
}

#[derive(Default)]
struct Soup {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Soup {
    fn append(&mut self, mesh: &tobj::Mesh) -> Result<(), String> {
        let base = self.positions.len();
        if u32::try_from(base + mesh.positions.len() / 3).is_err() {
            return Err("it has more than 2³² vertices".into());
        }
        self.positions.extend(mesh.positions.as_chunks::<3>().0.iter().map(|p| Vec3::from(*p)));
        self.normals.extend(mesh.normals.as_chunks::<3>().0.iter().map(|n| direction((*n).into()).unwrap_or_default()));
        let mut rest = mesh.indices.as_slice();
        // No arities, as all faces are triangles.
        let mut arities = mesh.face_arities.iter();
        while !rest.is_empty() {
            let arity = arities.next().map_or(3, |arity| *arity as usize);
            let (face, after) = rest.split_at_checked(arity).ok_or("a face has fewer corners than it should")?;
            let vertex = |corner: usize| face[corner] + base as u32;
            let corners: Vec<Vec3> = (0..arity).map(|corner| self.positions[vertex(corner) as usize]).collect();
            self.triangles.extend(polygon::triangles(&corners).into_iter().map(|t| t.map(vertex)));
            rest = after;
        }
        Ok(())
    }

    fn into_mesh(self, name: &str, crease_angle_rad: f32) -> Result<(Mesh, ObjReport), MeshError> {
        let Self { positions, normals, triangles } = self;
        if normals.len() == positions.len() {
            let (mesh, dropped_triangles) = Mesh::new(name, positions, normals, triangles)?;
            return Ok((mesh, ObjReport { dropped_triangles, normals_made: false }));
        }
        // Validated before normals are computed, because errors would spread into them.
        let up = vec![Vec3::Y; positions.len()];
        let (valid, dropped_triangles) = Mesh::new(name, positions, up, triangles)?;
        let (positions, normals, triangles) = smooth_normals(valid.positions(), valid.triangles(), crease_angle_rad);
        let (mesh, _) = Mesh::new(name, positions, normals, triangles)?;
        Ok((mesh, ObjReport { dropped_triangles, normals_made: true }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(text: impl AsRef<[u8]>) -> Result<(Mesh, ObjReport), MeshError> {
        Mesh::from_obj("mesh.obj", text.as_ref(), 0.5)
    }

    #[test]
    fn quads_and_n_gons_become_triangles() {
        let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";
        let (mesh, report) = load(square).unwrap();
        assert_eq!((mesh.triangles().len(), report.normals_made), (2, true));
        assert!(mesh.normals()[0].abs_diff_eq(Vec3::Z, 1e-6));
        let hexagon = "v 0 0 0\nv 1 0 0\nv 2 1 0\nv 1 2 0\nv 0 2 0\nv -1 1 0\nf 1 2 3 4 5 6\n";
        let (mesh, _) = load(hexagon).unwrap();
        assert_eq!(mesh.triangles().len(), 4);
        assert!((mesh.area() - 4.0).abs() < 1e-6);
    }

    #[test]
    fn concave_polygons_keep_their_area() {
        let (mesh, _) = load("v 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 .5 0\nv 0 2 0\nf 1 2 3 4 5\nf 1 2 3\n").unwrap();
        assert!((mesh.area() - 4.5).abs() < 1e-6, "{}", mesh.area());
    }

    #[test]
    fn normals_of_the_file_are_kept() {
        for normal in ["0 0 -2", "0 0 -1e-30", "0 0 -1e30"] {
            let text = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn {normal}\nf 1//1 2//1 3/5/1\n");
            let (mesh, report) = load(text).unwrap();
            assert!(!report.normals_made);
            assert_eq!(mesh.normals()[0], -Vec3::Z);
        }
        let (_, report) = load("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 -2\nf 1//1 2//1 3\n").unwrap();
        assert!(report.normals_made);
    }

    #[test]
    fn what_other_programs_write_is_read() {
        let three = "v 1 0 0\nv 0 1 0\nv 0 0 1 1 0 0\n";
        for text in [
            format!("\u{feff}{three}f 1 2 3\n").as_bytes(),
            format!("{three}f 1 2 3 # note\n").as_bytes(),
            format!("{three}f 1 \\\n 2 3\n").as_bytes(),
            format!("{three}f -3 -2 -1\r\n").as_bytes(),
            format!("f 1 2 3\n{three}").as_bytes(),
            &[b"# gr\xfcn\nusemtl gr\xfcn\n", three.as_bytes(), b"f 1/1 2/2 3/3\n"].concat(),
        ] {
            let (mesh, _) = load(text).unwrap();
            assert_eq!((mesh.triangles().len(), mesh.positions().len()), (1, 3), "{}", text.escape_ascii());
        }
        let (mesh, _) = load("v 2 0 0 2\nv 0 2 0 2\nv 0 0 2 2\nf 1 2 3\n").unwrap();
        assert_eq!(mesh.positions()[0], Vec3::X);
    }

    #[test]
    fn unusable_files_are_named_with_line_and_reason() {
        let two = "v 0 0 0\nv 1 0 0\n";
        for (text, expected) in [
            (String::new(), "is empty"),
            (format!("{two}v 2 0 0\nf 1 2 3\n"), "1 degenerate"),
            ("v 0 0 0\nv nan 0 0\n".into(), "mesh.obj:2: the position has a number that is not finite"),
            ("vn 0 0 1e99\n".into(), "mesh.obj:1: the normal has a number that is not finite"),
            (format!("{two}f 1 2 3\n"), "mesh.obj:3: the face names vertex 3, but the file has 2"),
            (format!("{two}v 0 1 0\nf 1//1 2//1 3//1\n"), "mesh.obj:4: the face names normal 1"),
            ("v 0 0 0\nv 1 zero 0\n".into(), "mesh.obj:2: 'zero' is not a number"),
            (format!("{two}v 0 1 0\n\nf 1 2 3\nf 2 4"), "mesh.obj:6: a face has three corners or more, but here are 2"),
            (format!("{two}f 0 1 2\n"), "mesh.obj:3: '0' has the index 0"),
            (format!("{two}f -3 -2 -1\n"), "mesh.obj:3: '-3' counts back beyond"),
            (format!("{two}f 1/ /2 3\n"), "mesh.obj:3: '/2' is not a corner"),
            ("v 0 0 0 0\n".into(), "mesh.obj:1: the weight"),
        ] {
            let message = load(text).unwrap_err().to_string();
            assert!(message.contains(expected) && message.contains("mesh.obj"), "{message}");
        }
    }
}
