//! Points → differential samples: the surface around each sample to second order (Wand & Straßer, Section 3.3).
//!
//! Data flows points and candidates → cells (which candidates belong to which sample) → a fit per cell: area,
//! centroid, covariance, and the gradient of the normal. This module must not know environments or receivers.

mod cells;
mod fit;
mod ply;
mod symmetric;

pub use cells::{Cells, NearestSample, nearest_samples};
pub use ply::write_ply;
pub(crate) use symmetric::Symmetric2;

use std::sync::LazyLock;

use glam::{Mat3, Vec3};

use crate::parallel;
use crate::sampling::{PointSet, PointTree, SurfacePoint};

/// A sample with its surroundings. Lengths in metres, curvatures in 1/m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DifferentialSample {
    /// Where the strategy put the sample.
    pub position: Vec3,
    /// Unit normal there, towards the reflecting side.
    pub normal: Vec3,
    /// The area that the strategy gave it, m²: its part of the surface's, whatever its cell is.
    pub area: f32,
    /// Index of the object in the scene.
    pub object: u32,
    /// The cell: the part of the surface that is nearest to this sample.
    pub cell: Cell,
    /// Principal curvatures, the larger first; positive where the normals diverge (convex from the front).
    pub curvatures: [f32; 2],
    /// The principal directions, unit and orthogonal to each other and to the mean normal.
    pub directions: [Vec3; 2],
}

/// The region that a sample stands for, as the parallelogram with the same area moments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Area, m². All cells sum up to the surface's.
    pub area: f32,
    /// Centroid, lifted onto the surface.
    pub centroid: Vec3,
    /// Mean normal, unit.
    pub normal: Vec3,
    /// Full sides of the rectangle with the cell's covariance: e = √12·√λ·u for each of its eigenpairs (λ, u).
    pub sides: [Vec3; 2],
}

impl DifferentialSample {
    /// Change of the unit normal along a tangent vector: ∇n·v.
    pub fn normal_change(&self, v: Vec3) -> Vec3 {
        let [a, b] = self.directions;
        self.curvatures[0] * a.dot(v) * a + self.curvatures[1] * b.dot(v) * b
    }

    /// The sample of the same surface after a rotation about the origin and a translation.
    #[must_use]
    pub fn moved(&self, rotation: Mat3, translation: Vec3) -> Self {
        let Cell { area, centroid, normal, sides } = self.cell;
        Self {
            position: rotation * self.position + translation,
            normal: rotation * self.normal,
            cell: Cell {
                area,
                centroid: rotation * centroid + translation,
                normal: rotation * normal,
                sides: sides.map(|side| rotation * side),
            },
            directions: self.directions.map(|direction| rotation * direction),
            ..*self
        }
    }
}

/// Fits the surface around every sample.
pub fn differentials(set: &PointSet) -> Vec<DifferentialSample> {
    let cells = if set.nearest_samples.is_empty() {
        Cells::new(set.points.len(), &nearest_samples(&NearestSample::new(&set.points), &set.candidates))
    } else {
        Cells::new(set.points.len(), &set.nearest_samples)
    };
    // Only cells with few members of their own look around; often there is none.
    let tree = LazyLock::new(|| PointTree::new(&set.candidates));
    let cells: Vec<&[u32]> = cells.iter().collect();
    let fit = |k: usize| fit::fit(&set.points[k], cells[k], &set.candidates, &tree);
    parallel::collect(set.points.len(), &fit).into_iter().flatten().collect()
}

/// A right-handed tangent frame of a unit normal.
pub(crate) fn tangent_frame(normal: Vec3) -> [Vec3; 2] {
    let (u, v) = normal.any_orthonormal_pair();
    [u, v]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Options, Strategy, Surface, sample};
    use crate::scene::Mesh;
    use crate::scene::shapes::{DiscoBall, Plane, Ring, Shape, SolidRing, Sphere, Spoon};

    fn samples_of(mesh: &Mesh, samples: u32, strategy: Strategy) -> (Surface, Vec<DifferentialSample>) {
        let mut surface = Surface::default();
        surface.append(mesh, 0, false);
        let set = sample(&surface, &Options { samples, strategy, seed: 1 }).unwrap();
        (surface, differentials(&set))
    }

    fn median_error(samples: &[DifferentialSample], exact: impl Fn(&DifferentialSample) -> [f32; 2]) -> f32 {
        let error = |s: &DifferentialSample| {
            let [a, b] = exact(s);
            (s.curvatures[0] - a).abs().max((s.curvatures[1] - b).abs())
        };
        let mut errors: Vec<f32> = samples.iter().map(error).collect();
        errors.sort_by(f32::total_cmp);
        errors[errors.len() / 2]
    }

    /// A grid over (u, v) in [0, 1]² as a mesh.
    fn grid(n: u32, wrap: bool, at: impl Fn(f32, f32) -> (Vec3, Vec3)) -> Mesh {
        let (mut positions, mut normals, mut triangles) = (vec![], vec![], vec![]);
        let columns = if wrap { n } else { n + 1 };
        for j in 0..columns {
            for i in 0..columns {
                let (p, n) = at(i as f32 / n as f32, j as f32 / n as f32);
                positions.push(p);
                normals.push(n);
            }
        }
        let index = |i: u32, j: u32| (j % columns) * columns + i % columns;
        for j in 0..n {
            for i in 0..n {
                let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        Mesh::new("grid", positions, normals, triangles).unwrap().0
    }

    #[test]
    fn curvatures_of_sphere_cylinder_and_plane() {
        let sphere = Shape::Sphere(Sphere::of_radius(0.5)).mesh().unwrap();
        let (_, samples) = samples_of(&sphere, 500, Strategy::Neighbourhood);
        assert!(median_error(&samples, |_| [2.0, 2.0]) < 0.02 * 2.0);

        // The ring's normals point inwards: it is concave around, flat along.
        let ring = Shape::Ring(Ring { radius: 2.0, height: 1.0 }).mesh().unwrap();
        let (_, samples) = samples_of(&ring, 500, Strategy::Neighbourhood);
        assert!(median_error(&samples, |_| [0.0, -0.5]) < 0.01);
        let upright = samples.iter().filter(|s| s.directions[0].y.abs() > 0.99).count();
        assert!(upright > 490, "{upright}");

        let plane = Shape::Plane(Plane { size: [1.0, 2.0] }).mesh().unwrap();
        let (_, samples) = samples_of(&plane, 200, Strategy::Neighbourhood);
        assert!(median_error(&samples, |_| [0.0, 0.0]) < 1e-4);
    }

    #[test]
    fn curvatures_of_a_torus() {
        let (major, minor) = (1.0f32, 0.4f32);
        let torus = grid(200, true, |u, v| {
            let (around, section) = (std::f32::consts::TAU * u, std::f32::consts::TAU * v);
            let out = Vec3::new(around.cos(), 0.0, -around.sin());
            let normal = section.cos() * out + section.sin() * Vec3::Y;
            (major * out + minor * normal, normal)
        });
        let (_, samples) = samples_of(&torus, 2000, Strategy::Neighbourhood);
        let error = median_error(&samples, |s| {
            let ring = Vec3::new(s.position.x, 0.0, s.position.z).length();
            [1.0 / minor, (ring - major) / minor / ring]
        });
        assert!(error < 0.06, "{error}");
    }

    #[test]
    fn curvatures_of_a_saddle() {
        // y = ½(x² − z²): at the origin the curvatures are ±1.
        let saddle = grid(60, false, |u, v| {
            let (x, z) = (0.4 * (v - 0.5), 0.4 * (u - 0.5));
            (Vec3::new(x, 0.5 * (x * x - z * z), z), Vec3::new(-x, 1.0, z).normalize())
        });
        let (_, samples) = samples_of(&saddle, 400, Strategy::Neighbourhood);
        let centre = samples.iter().min_by(|a, b| a.position.length().total_cmp(&b.position.length())).unwrap();
        assert!((centre.curvatures[0] - 1.0).abs() < 0.05 && (centre.curvatures[1] + 1.0).abs() < 0.05);
        assert!(centre.directions[0].z.abs() > 0.98, "{}", centre.directions[0]);
    }

    #[test]
    fn creases_do_not_bend() {
        // Flat tiles: whatever the neighbours' normals are, the curvature is zero and the normal the tile's.
        let ball = Shape::DiscoBall(DiscoBall { radius: 1.0, rows: 8, joint: 0.0 }).mesh().unwrap();
        for samples in [60, 1000] {
            let (_, samples) = samples_of(&ball, samples, Strategy::Neighbourhood);
            let worst = samples.iter().map(|s| s.curvatures[0].abs().max(s.curvatures[1].abs())).fold(0.0, f32::max);
            assert!(worst < 1e-2, "{worst}");
        }
    }

    #[test]
    fn the_faces_of_a_thin_sheet_stay_apart() {
        for shape in [
            Shape::Spoon(Spoon { thickness: 0.004, ..Default::default() }),
            Shape::SolidRing(SolidRing { thickness: 0.01, ..Default::default() }),
        ] {
            let mesh = shape.mesh().unwrap();
            let (surface, samples) = samples_of(&mesh, 800, Strategy::Neighbourhood);
            assert!(samples.len().abs_diff(800) <= 16, "{}", samples.len());
            // A cell that mixed two faces would have a mean normal unlike the sample's.
            let mixed = samples.iter().filter(|s| s.cell.normal.dot(s.normal) < 0.5).count();
            assert!(mixed * 50 <= samples.len(), "{}: {mixed} mixed cells", shape.name());
            let area: f64 = samples.iter().map(|s| f64::from(s.cell.area)).sum();
            assert!((area / surface.area() - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn cells_share_out_the_area_for_every_strategy() {
        let ring = Shape::Ring(Ring::default()).mesh().unwrap();
        for strategy in [Strategy::Random, Strategy::Grid, Strategy::QuantisedGrid, Strategy::Neighbourhood] {
            let (surface, samples) = samples_of(&ring, 300, strategy);
            let area: f64 = samples.iter().map(|s| f64::from(s.cell.area)).sum();
            assert!((area / surface.area() - 1.0).abs() < 1e-4, "{strategy:?}");
            for s in &samples {
                let sides = s.cell.sides[0].length() * s.cell.sides[1].length();
                assert!(
                    sides > 0.5 * s.cell.area && sides < 4.0 * s.cell.area,
                    "{strategy:?}: {sides} {}",
                    s.cell.area
                );
                // The centroid lies on the cylinder.
                let radius = Vec3::new(s.cell.centroid.x, 0.0, s.cell.centroid.z).length();
                assert!((radius - 1.0).abs() < 0.01, "{strategy:?}: {radius}");
            }
        }
    }
}
