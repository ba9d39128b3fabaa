//! Triangle meshes with a unit normal per vertex. Independent of files and materials.

use glam::Vec3;

use super::Transform;

/// A valid triangle mesh: finite vertices, unit normals, indices in range, no triangle without area.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

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
    /// A statement of an OBJ or MTL file is wrong.
    #[error("{file}:{line}: {reason}; mend the file or export it again")]
    Statement {
        /// File.
        file: String,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// The file's material library could not be read.
    #[error(
        "{file}:{line}: cannot read the material library '{library}': {reason}; put it beside the mesh, or give the object a reflector or receiver of its own"
    )]
    Library {
        /// File of the mesh.
        file: String,
        /// Line of its `mtllib`.
        line: usize,
        /// The library's name there.
        library: String,
        /// The system's reason.
        reason: String,
    },
    /// The mesh does not survive its placement.
    #[error("object '{object}' cannot be placed: {reason}; check its scale, rotate_deg and translate")]
    Placement {
        /// Object.
        object: String,
        /// What is wrong with the result.
        reason: String,
    },
    /// An unsupported format.
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
    #[error(
        "mesh '{origin}': vertex {vertex} has a {what} that is not a finite number; repair the mesh and export it again"
    )]
    NotFinite {
        /// File or shape.
        origin: String,
        /// From 1.
        vertex: usize,
        /// `position` or `normal`.
        what: &'static str,
    },
    /// A vertex beyond [`Mesh::MAX_COORDINATE`].
    #[error("mesh '{origin}': vertex {vertex} is more than 1e9 m from the origin; scale the mesh down")]
    TooFar {
        /// File or shape.
        origin: String,
        /// From 1.
        vertex: usize,
    },
    /// The numbers of positions and normals differ.
    #[error("mesh '{origin}' has {positions} positions but {normals} normals; give one normal a position")]
    Counts {
        /// File or shape.
        origin: String,
        /// Number of positions.
        positions: usize,
        /// Number of normals.
        normals: usize,
    },
    /// A scene too small or too large for 32-bit numbers.
    #[error("the scene is {diagonal:e} m across, but must be from {least:e} to {most:e} m; scale it")]
    Extent {
        /// The diagonal of its bounds, metres.
        diagonal: f32,
        /// The least.
        least: f32,
        /// The largest.
        most: f32,
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
    /// The largest coordinate, metres: areas of larger triangles would exceed the range of 32-bit numbers.
    pub const MAX_COORDINATE: f32 = 1e9;

    /// Validates the parts of a mesh; `normals` are normalised. Degenerate triangles are dropped; their
    /// number is the second part of the result. `origin` is used in messages only.
    ///
    /// ```
    /// use pinspot::glam::Vec3;
    /// use pinspot::scene::Mesh;
    ///
    /// let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let (mesh, dropped) = Mesh::new("triangle", corners, vec![Vec3::Z; 3], vec![[0, 1, 2]])?;
    /// assert_eq!((mesh.area(), dropped), (0.5, 0));
    /// # Ok::<(), pinspot::scene::MeshError>(())
    /// ```
    pub fn new(
        origin: &str,
        positions: Vec<Vec3>,
        normals: Vec<Vec3>,
        triangles: Vec<[u32; 3]>,
    ) -> Result<(Self, usize), MeshError> {
        if positions.len() != normals.len() {
            let (positions, normals) = (positions.len(), normals.len());
            return Err(MeshError::Counts { origin: origin.into(), positions, normals });
        }
        check_finite(origin, "position", &positions)?;
        check_finite(origin, "normal", &normals)?;
        if let Some(i) = positions.iter().position(|p| p.abs().max_element() > Self::MAX_COORDINATE) {
            return Err(MeshError::TooFar { origin: origin.into(), vertex: i + 1 });
        }
        let (triangles, dropped) = drop_degenerate(origin, &positions, triangles)?;
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

    /// Unit normals, one per vertex.
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

    /// The mesh in world space, and the number of triangles that lost their area. `object` is used in messages only.
    pub fn placed(&self, placement: &Transform, object: &str) -> Result<(Self, usize), MeshError> {
        let rotation = placement.rotation();
        let positions =
            self.positions.iter().map(|p| rotation * (placement.scale * *p) + placement.translate).collect();
        let normals = self.normals.iter().map(|n| rotation * (*n * placement.scale.signum())).collect();
        Self::new(object, positions, normals, self.triangles.clone()).map_err(|error| {
            let reason = match error {
                MeshError::Empty { .. } => "it becomes too small or too far away for 32-bit numbers",
                _ => "it reaches beyond 1e9 m",
            };
            MeshError::Placement { object: object.into(), reason: reason.into() }
        })
    }

    /// Normalises normals; vertices whose normal is zero get that of a triangle to which they belong.
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
fn area([a, b, c]: [Vec3; 3]) -> f32 {
    0.5 * (b - a).cross(c - a).length()
}

fn check_finite(origin: &str, what: &'static str, vectors: &[Vec3]) -> Result<(), MeshError> {
    match vectors.iter().position(|v| !v.is_finite()) {
        Some(i) => Err(MeshError::NotFinite { origin: origin.into(), vertex: i + 1, what }),
        None => Ok(()),
    }
}

/// Drops triangles whose area is lost in rounding, and checks the indices.
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
