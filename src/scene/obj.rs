//! Wavefront OBJ through `tobj`: triangles, quads, n-gons; with or without normals; as one mesh, or one for each material.

use std::path::Path;

use glam::Vec3;

use super::Assets;
use super::assets::readable_name;
use super::mesh::{Mesh, MeshError};
use super::normals::smooth_normals;

/// What was repaired while reading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ObjReport {
    /// Triangles without area that were dropped.
    pub dropped_triangles: usize,
    /// The file had no normals and smooth ones were made.
    pub normals_made: bool,
}

/// Reads every object and group of an OBJ file as one mesh. `crease_angle_rad` is used only where the file
/// has no normals. Materials are not read.
pub fn load_obj(assets: &dyn Assets, path: &Path, crease_angle_rad: f32) -> Result<(Mesh, ObjReport), MeshError> {
    let file = read(assets, path, |_| Ok(Default::default()))?;
    let (mesh, report) = file.merged(|_| true, crease_angle_rad)?;
    Ok((mesh, report))
}

/// The part of a file that has one material.
#[derive(Debug)]
pub(super) struct ObjPart {
    pub material: Option<tobj::Material>,
    pub mesh: Mesh,
    pub report: ObjReport,
}

/// Reads an OBJ file and its materials, a mesh for each. What kept the materials from being read is the second part of the
/// result; there is a single mesh then.
pub(super) fn load_obj_by_material(
    assets: &dyn Assets,
    path: &Path,
    crease_angle_rad: f32,
) -> Result<(Vec<ObjPart>, Option<String>), MeshError> {
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let file = read(assets, path, |name| {
        let bytes = assets.read(&folder.join(name)).map_err(|_| tobj::LoadError::OpenFileFailed)?;
        tobj::load_mtl_buf(&mut bytes.as_slice())
    })?;
    let (materials, failure) = match &file.materials {
        Ok(materials) => (materials.as_slice(), None),
        Err(error) => (&[][..], Some(error.clone())),
    };
    let mut ids: Vec<Option<usize>> = file.models.iter().map(|m| m.mesh.material_id).collect();
    ids.sort_unstable();
    ids.dedup();
    if failure.is_some() || ids.is_empty() {
        ids = vec![None];
    }
    let part = |id: &Option<usize>| {
        let chosen = |model: &tobj::Model| failure.is_some() || model.mesh.material_id == *id;
        let (mesh, report) = file.merged(chosen, crease_angle_rad)?;
        Ok(ObjPart { material: id.and_then(|id| materials.get(id).cloned()), mesh, report })
    };
    Ok((ids.iter().map(part).collect::<Result<_, MeshError>>()?, failure))
}

/// A file as it is.
struct ObjFile {
    origin: String,
    bytes: Vec<u8>,
    models: Vec<tobj::Model>,
    materials: Result<Vec<tobj::Material>, String>,
}

fn read(
    assets: &dyn Assets,
    path: &Path,
    load_materials: impl Fn(&Path) -> tobj::MTLLoadResult,
) -> Result<ObjFile, MeshError> {
    let origin = readable_name(assets, path);
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if extension != "obj" {
        return Err(MeshError::Format { origin, extension: format!(".{extension}") });
    }
    let bytes = assets.read(path).map_err(|e| MeshError::Read { origin: origin.clone(), reason: e.to_string() })?;
    let damaged = |reason: String| MeshError::Damaged { origin: origin.clone(), reason };
    let options = tobj::LoadOptions { triangulate: true, single_index: true, ignore_points: true, ignore_lines: true };
    let (models, materials) =
        tobj::load_obj_buf(&mut bytes.as_slice(), &options, load_materials).map_err(|e| damaged(e.to_string()))?;
    Ok(ObjFile { origin, bytes, models, materials: materials.map_err(|e| e.to_string()) })
}

impl ObjFile {
    /// Some of the models as one mesh.
    fn merged(
        &self,
        chosen: impl Fn(&tobj::Model) -> bool,
        crease_angle_rad: f32,
    ) -> Result<(Mesh, ObjReport), MeshError> {
        let damaged = |reason: String| MeshError::Damaged { origin: self.origin.clone(), reason };
        let mut soup = Soup::default();
        for model in self.models.iter().filter(|model| chosen(model)) {
            soup.append(&model.mesh).map_err(damaged)?;
        }
        soup.into_mesh(&self.origin, crease_angle_rad).map_err(|error| with_line(error, &self.bytes))
    }
}

/// Names the line of the file where a number is not finite; `tobj` renumbers the vertices.
fn with_line(error: MeshError, bytes: &[u8]) -> MeshError {
    let MeshError::NotFinite { origin, place, what } = error else { return error };
    let keyword = if what == "normal" { "vn" } else { "v" };
    let is_finite = |token: &str| token.parse::<f32>().is_ok_and(f32::is_finite);
    let is_culprit = |line: &str| {
        let mut tokens = line.split_whitespace();
        tokens.next() == Some(keyword) && !tokens.take(3).all(is_finite)
    };
    let line = String::from_utf8_lossy(bytes).lines().position(is_culprit);
    MeshError::NotFinite { origin, place: line.map_or(place, |l| format!("line {}", l + 1)), what }
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
        let (indices, rest) = mesh.indices.as_chunks::<3>();
        if !rest.is_empty() {
            return Err("a face has fewer than three vertices".into());
        }
        if u32::try_from(base + mesh.positions.len() / 3).is_err() {
            return Err("it has more than 2³² vertices".into());
        }
        self.positions.extend(mesh.positions.as_chunks::<3>().0.iter().map(|p| Vec3::from(*p)));
        self.normals.extend(mesh.normals.as_chunks::<3>().0.iter().map(|n| Vec3::from(*n)));
        // One group without normals makes the whole file one without: half-given normals are rare and never meant.
        self.triangles.extend(indices.iter().map(|t| t.map(|v| v + base as u32)));
        Ok(())
    }

    fn into_mesh(self, origin: &str, crease_angle_rad: f32) -> Result<(Mesh, ObjReport), MeshError> {
        let Self { positions, normals, triangles } = self;
        if normals.len() == positions.len() {
            let (mesh, dropped_triangles) = Mesh::new(origin, positions, normals, triangles)?;
            return Ok((mesh, ObjReport { dropped_triangles, normals_made: false }));
        }
        // Validate before the normals are made: a NaN would spread into them.
        let up = vec![Vec3::Y; positions.len()];
        let (valid, dropped_triangles) = Mesh::new(origin, positions, up, triangles)?;
        let (positions, normals, triangles) = smooth_normals(valid.positions(), valid.triangles(), crease_angle_rad);
        let (mesh, _) = Mesh::new(origin, positions, normals, triangles)?;
        Ok((mesh, ObjReport { dropped_triangles, normals_made: true }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(text: &str) -> Result<(Mesh, ObjReport), MeshError> {
        let assets = std::collections::HashMap::from([("mesh.obj".into(), text)]);
        load_obj(&assets, Path::new("mesh.obj"), 0.5)
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
    fn normals_of_the_file_are_kept() {
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 -2\nf 1//1 2//1 3//1\n";
        let (mesh, report) = load(text).unwrap();
        assert!(!report.normals_made);
        assert_eq!(mesh.normals()[0], -Vec3::Z);
    }

    #[test]
    fn unusable_files_are_named_with_the_reason() {
        for (text, expected) in [
            ("", "is empty"),
            ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "1 degenerate"),
            ("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "not a finite number"),
            ("v 0 0 0\nv 1 0 0\nf 1 2 3\n", "damaged"),
            ("v 0 0 0\nv 1 zero 0\n", "damaged"),
        ] {
            let message = load(text).unwrap_err().to_string();
            assert!(message.contains(expected) && message.contains("mesh.obj"), "{message}");
        }
    }
}
