//! Whether a mesh encloses a volume, with normals that point out of it. Meshes are examined in their own space: rounding opens the seams of
//! what is placed far from the origin.

use std::collections::HashMap;

use glam::Vec3;

use super::Mesh;

/// Vertices nearer to each other than a tenth of this part of the mesh's extent are one.
const CELL: f32 = 1e-5;

/// Why a mesh is no closed surface.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub(super) enum NotClosed {
    /// An edge that does not belong to two triangles.
    #[error("the edge from {from} to {to} belongs to {count} of its triangles, not to 2")]
    Edge {
        /// One end.
        from: Vec3,
        /// The other one.
        to: Vec3,
        /// How many triangles have it.
        count: usize,
    },
    /// The normals point inwards.
    #[error("its normals point inwards")]
    InsideOut,
}

/// Whether a mesh, not placed yet, is the surface of a solid.
pub fn is_closed(mesh: &Mesh) -> bool {
    check_closed(mesh).is_ok()
}

/// What keeps a mesh from being the surface of a solid, if anything does.
pub(super) fn check_closed(mesh: &Mesh) -> Result<(), NotClosed> {
    let vertices = welded(mesh.positions());
    let mut counts: HashMap<[u32; 2], usize> = HashMap::new();
    for triangle in mesh.triangles() {
        let corners = triangle.map(|corner| vertices[corner as usize]);
        for k in 0..3 {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            if from != to {
                *counts.entry([from.min(to), from.max(to)]).or_default() += 1;
            }
        }
    }
    // The first one in the order of the vertices, so that the message is the same every time.
    if let Some((edge, count)) = counts.into_iter().filter(|(_, count)| *count != 2).min() {
        let [from, to] = edge.map(|vertex| mesh.positions()[vertex as usize]);
        return Err(NotClosed::Edge { from, to, count });
    }
    if volume(mesh) > 0.0 { Ok(()) } else { Err(NotClosed::InsideOut) }
}

/// For each position the index of the first one at the same place: seams have several vertices, for their normals.
fn welded(positions: &[Vec3]) -> Vec<u32> {
    let extent = positions.iter().map(|p| p.distance(positions[0])).fold(0.0, f32::max);
    let cell = (CELL * extent).max(f32::MIN_POSITIVE);
    let cell_of = |p: Vec3| (p / cell).as_dvec3().floor().to_array().map(|x| x as i64);
    let mut first_in: HashMap<[i64; 3], u32> = HashMap::new();
    let weld = |(index, position): (usize, &Vec3)| {
        let from_first = *position - positions[0];
        let around =
            (0..8).map(|k| Vec3::from_array([0, 1, 2].map(|axis| if k >> axis & 1 == 0 { -0.1 } else { 0.1 })));
        let known = around.filter_map(|offset| first_in.get(&cell_of(from_first + cell * offset))).min().copied();
        known.unwrap_or_else(|| *first_in.entry(cell_of(from_first)).or_insert(index as u32))
    };
    positions.iter().enumerate().map(weld).collect()
}

/// The volume, negative if normals point inwards.
fn volume(mesh: &Mesh) -> f64 {
    let origin = mesh.positions()[0];
    let of_triangle = |triangle: usize| {
        let [a, b, c] = mesh.corners(triangle).map(|corner| (corner - origin).as_dvec3());
        let across = (b - a).cross(c - a);
        let outward: Vec3 = mesh.corner_normals(triangle).iter().sum();
        across.dot(outward.as_dvec3()).signum() * across.dot(a)
    };
    (0..mesh.triangles().len()).map(of_triangle).sum::<f64>() / 6.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Object;

    fn mesh_of(shape: &str) -> Mesh {
        let text = format!(
            "[environment]\nconstant = [1, 1, 1]\n[camera]\nposition = [0, 1, 1]\ntarget = [0, 0, 0]\n\
             perspective = {{ fov_y_deg = 40 }}\n[[object]]\nshape = {{ {shape} }}\nrefractor = {{ eta = 1.5 }}\n"
        );
        let scene = crate::scene::parse::<toml::Table>("t", &text, std::path::Path::new(".")).unwrap().scene;
        Object::mesh_in_world(&scene.objects[0])
    }

    #[test]
    fn spheres_and_solid_rings_are_closed_and_others_are_not() {
        for shape in ["sphere = { radius = 0.3 }", "solid-ring = {}"] {
            assert_eq!(check_closed(&mesh_of(shape)), Ok(()), "{shape}");
        }
        for shape in ["ring = {}", "plane = { size = [1.0, 1.0] }"] {
            assert!(matches!(check_closed(&mesh_of(shape)), Err(NotClosed::Edge { count: 1, .. })), "{shape}");
        }
    }

    #[test]
    fn normals_must_point_outwards() {
        let ball = mesh_of("sphere = { radius = 0.5 }");
        assert!((volume(&ball) - std::f64::consts::FRAC_PI_6).abs() < 0.01, "{}", volume(&ball));
        let inwards = ball.normals().iter().map(|normal| -*normal).collect();
        let (turned, _) = Mesh::new("ball", ball.positions().to_vec(), inwards, ball.triangles().to_vec()).unwrap();
        assert_eq!(check_closed(&turned), Err(NotClosed::InsideOut));
    }
}
