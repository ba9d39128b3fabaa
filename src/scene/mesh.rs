//! Triangle meshes with a unit normal per vertex. Knows no files and no materials.

use glam::Vec3;

use super::Transform;

/// A valid triangle mesh: finite vertices, unit normals, indices in range, no triangle without area.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

/// The largest coordinate of a mesh in world space, metres: squares of distances stay within 32-bit numbers.
pub const MAX_COORDINATE: f32 = 1e15;

/// Why a mesh is unusable. `origin` names the file or the built-in shape.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The file could not be opened.
    #[error("cannot read mesh '{origin}': {reason}; check the path (it is relative to the scene file)")]
    Read {
        /// File.
        origin: String,
        /// The system's reason.
        reason: String,
    },
    /// The file's contents are not a mesh.
    #[error("mesh '{origin}' is damaged or not a Wavefront OBJ: {reason}; export it again")]
    Damaged {
        /// File.
        origin: String,
        /// The parser's reason.
        reason: String,
    },
    /// A material of the file is of no use.
    #[error("mesh '{origin}': {reason}; mend its .mtl file, or give the object a receiver or reflector of its own")]
    Material {
        /// File.
        origin: String,
        /// Which number is wrong.
        reason: String,
    },
    /// A format that is not read.
    #[error("mesh '{origin}': the format '{extension}' is not read yet; export it as Wavefront OBJ (.obj)")]
    Format {
        /// File.
        origin: String,
        /// Extension.
        extension: String,
    },
    /// No triangle with an area is left.
    #[error(
        "mesh '{origin}' is empty: it has no triangle with an area ({dropped} degenerate ones were dropped); export it with faces"
    )]
    Empty {
        /// File or shape.
        origin: String,
        /// How many triangles had no area.
        dropped: usize,
    },
    /// A NaN or an infinity.
    #[error("mesh '{origin}': {place} has a {what} that is not a finite number; repair the mesh and export it again")]
    NotFinite {
        /// File or shape.
        origin: String,
        /// `vertex 3`, or `line 12` of a file; both from 1.
        place: String,
        /// `position` or `normal`.
        what: &'static str,
    },
    /// The placement takes it out of the range of 32-bit numbers.
    #[error(
        "object '{object}' reaches further than {MAX_COORDINATE:e} m from the origin once it is placed, or nowhere at all; check its scale, rotation and translation"
    )]
    OutOfWorld {
        /// The object's name.
        object: String,
    },
    /// An index past the vertices.
    #[error(
        "mesh '{origin}': triangle {triangle} names a vertex that does not exist (the file may be truncated); export it again"
    )]
    IndexOutOfRange {
        /// File or shape.
        origin: String,
        /// Triangle, from 1.
        triangle: usize,
    },
}

impl Mesh {
    /// Validates the parts of a mesh; `normals` are normalised. Degenerate triangles are dropped; their
    /// number is the second part of the result. `origin` is used in messages only.
    pub fn new(
        origin: &str,
        positions: Vec<Vec3>,
        normals: Vec<Vec3>,
        triangles: Vec<[u32; 3]>,
    ) -> Result<(Self, usize), MeshError> {
        check_finite(origin, "position", &positions)?;
        check_finite(origin, "normal", &normals)?;
        let triangles = drop_degenerate(origin, &positions, triangles)?;
        let (triangles, dropped) = triangles;
        if triangles.is_empty() {
            return Err(MeshError::Empty { origin: origin.into(), dropped });
        }
        let mut mesh = Self { positions, normals, triangles };
        mesh.repair_normals();
        Ok((mesh, dropped))
    }

    /// Vertex positions, metres.
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Unit normals, one a vertex.
    pub fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    /// Vertex indices.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// A triangle's corners.
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }

    /// A triangle's vertex normals.
    pub fn corner_normals(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|v| self.normals[v as usize])
    }

    /// A triangle's area, m².
    pub fn triangle_area(&self, triangle: usize) -> f32 {
        area(self.corners(triangle))
    }

    /// Total area, m².
    pub fn area(&self) -> f64 {
        (0..self.triangles.len()).map(|t| f64::from(self.triangle_area(t))).sum()
    }

    /// The mesh in world space.
    #[must_use]
    pub fn placed(&self, placement: &Transform) -> Self {
        Self {
            positions: self.positions.iter().map(|p| placement.point_in_world(*p)).collect(),
            normals: self.normals.iter().map(|n| placement.normal_in_world(*n)).collect(),
            triangles: self.triangles.clone(),
        }
    }

    /// Whether a mesh in world space is finite and within [`MAX_COORDINATE`]; `object` is used in messages.
    pub(super) fn check_placed(&self, object: &str) -> Result<(), MeshError> {
        let fits = |p: &Vec3| p.is_finite() && p.abs().max_element() <= MAX_COORDINATE;
        if self.positions.iter().all(fits) && self.normals.iter().all(|n| n.is_finite()) {
            return Ok(());
        }
        Err(MeshError::OutOfWorld { object: object.into() })
    }

    /// Gives vertices whose normal is zero the normal of a triangle they belong to, and makes all unit length.
    fn repair_normals(&mut self) {
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|v| self.positions[v as usize]);
            for &vertex in triangle {
                let normal = &mut self.normals[vertex as usize];
                if normal.length_squared() < 1e-12 {
                    *normal = (b - a).cross(c - a).normalize();
                }
            }
        }
        for normal in &mut self.normals {
            *normal = normal.try_normalize().unwrap_or(Vec3::Y);
        }
    }
}

/// A triangle's area, m².
pub fn area([a, b, c]: [Vec3; 3]) -> f32 {
    0.5 * (b - a).cross(c - a).length()
}

fn check_finite(origin: &str, what: &'static str, vectors: &[Vec3]) -> Result<(), MeshError> {
    match vectors.iter().position(|v| !v.is_finite()) {
        Some(i) => Err(MeshError::NotFinite { origin: origin.into(), place: format!("vertex {}", i + 1), what }),
        None => Ok(()),
    }
}

/// Keeps the triangles whose area is not lost in rounding; also checks the indices.
fn drop_degenerate(
    origin: &str,
    positions: &[Vec3],
    mut triangles: Vec<[u32; 3]>,
) -> Result<(Vec<[u32; 3]>, usize), MeshError> {
    let out_of_range = |t: &[u32; 3]| t.iter().any(|&v| v as usize >= positions.len());
    if let Some(i) = triangles.iter().position(out_of_range) {
        return Err(MeshError::IndexOutOfRange { origin: origin.into(), triangle: i + 1 });
    }
    let before = triangles.len();
    triangles.retain(|t| {
        let [a, b, c] = t.map(|v| positions[v as usize]);
        let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
        area([a, b, c]) > 1e-7 * longest
    });
    let dropped = before - triangles.len();
    Ok((triangles, dropped))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> (Vec<Vec3>, Vec<Vec3>) {
        (vec![Vec3::ZERO, Vec3::X, Vec3::ONE, Vec3::Y], vec![Vec3::Z; 4])
    }

    #[test]
    fn degenerate_triangles_are_dropped_and_counted() {
        let (positions, normals) = square();
        let (mesh, dropped) = Mesh::new("m", positions, normals, vec![[0, 1, 3], [0, 1, 1], [2, 2, 2]]).unwrap();
        assert_eq!((mesh.triangles().len(), dropped), (1, 2));
        assert!((mesh.area() - 0.5).abs() < 1e-6);
    }

    #[test]
    fn a_nan_vertex_is_named() {
        let (mut positions, normals) = square();
        positions[2].y = f32::NAN;
        let message = Mesh::new("m.obj", positions, normals, vec![[0, 1, 2]]).unwrap_err().to_string();
        assert!(message.contains("m.obj") && message.contains("vertex 3"), "{message}");
    }
}
