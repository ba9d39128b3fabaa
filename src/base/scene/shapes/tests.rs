use super::*;
use std::f64::consts::PI;

fn all() -> Vec<Shape> {
    vec![
        Shape::Ring(Ring::default()),
        Shape::SolidRing(SolidRing::default()),
        Shape::Spoon(Spoon::default()),
        Shape::Cup(Cup::default()),
        Shape::Sphere(Sphere::default()),
        Shape::Torus(Torus::default()),
        Shape::Ellipsoid(Ellipsoid::default()),
        Shape::Box(Cuboid { size: [0.5, 1.0, 2.0] }),
        Shape::Knot(Knot::default()),
        Shape::DiscoBall(DiscoBall::default()),
        Shape::Plane(Plane::default()),
        Shape::Sheet(Sheet::default()),
        Shape::Water(Water::default()),
        Shape::Tiles(Tiles::default()),
        Shape::Joints(Tiles::default()),
    ]
}

#[test]
fn every_triangle_faces_where_its_normals_point() {
    for shape in all() {
        let mesh = shape.mesh().unwrap();
        for t in 0..mesh.triangles().len() {
            let [a, b, c] = mesh.corners(t);
            let face = (b - a).cross(c - a).normalize();
            for normal in mesh.corner_normals(t) {
                assert!(face.dot(normal) > 0.5, "{} triangle {t}: {face} against {normal}", shape.name());
            }
        }
    }
}

#[test]
fn areas_are_those_of_the_ideal_surfaces() {
    let area = |shape: Shape| shape.mesh().unwrap().area();
    let close = |got: f64, expected: f64| assert!((got / expected - 1.0).abs() < 1e-3, "{got} against {expected}");
    close(area(Shape::Ring(Ring::default())), PI);
    close(area(Shape::Sphere(Sphere::of_radius(0.5))), PI);
    close(area(Shape::Torus(Torus { radius: 2.0, tube: 0.5 })), 4.0 * PI * PI);
    close(area(Shape::Plane(Plane { size: [2.0, 3.0] })), 6.0);
    close(area(Shape::Ellipsoid(Ellipsoid { radii: [0.5; 3], divisions: 48 })), PI);
    close(area(Shape::Box(Cuboid { size: [1.0, 2.0, 3.0] })), 22.0);
    // A tube's area is its circumference times the length of its curve (Pappus), here of about 4 π and a little for the windings.
    let knot = area(Shape::Knot(Knot { radius: 1.0, tube: 0.05, turns: [2, 3] })) / (0.1 * PI);
    assert!((13.5..16.0).contains(&knot), "{knot}");
}

#[test]
fn closed_shapes_are_closed() {
    // The vector area of a closed surface is zero.
    let is_closed = |s: &Shape| {
        !matches!(
            s,
            Shape::Ring(_) | Shape::Plane(_) | Shape::Sheet(_) | Shape::Water(_) | Shape::Tiles(_) | Shape::Joints(_)
        )
    };
    for shape in all().into_iter().filter(is_closed) {
        let mesh = shape.mesh().unwrap();
        let vector_area: Vec3 = (0..mesh.triangles().len())
            .map(|t| {
                let [a, b, c] = mesh.corners(t);
                0.5 * (b - a).cross(c - a)
            })
            .sum();
        assert!(f64::from(vector_area.length()) < 1e-3 * mesh.area(), "{}: {vector_area}", shape.name());
        // Outwards: the divergence theorem gives a positive volume.
        let volume = |t: usize| {
            let [a, b, c] = mesh.corners(t);
            a.dot(b.cross(c))
        };
        assert!((0..mesh.triangles().len()).map(volume).sum::<f32>() > 0.0, "{} is inside out", shape.name());
    }
}

#[test]
fn measures_out_of_range_are_named() {
    let message = Shape::Ring(Ring { radius: -1.0, height: 0.5 }).mesh().unwrap_err();
    assert!(message.contains("radius") && message.contains("ring"), "{message}");
    let twice = Shape::Knot(Knot { turns: [2, 4], ..Knot::default() });
    assert!(twice.mesh().unwrap_err().contains("common divisor"));
    assert!(Shape::DiscoBall(DiscoBall { joint: 0.6, ..Default::default() }).mesh().unwrap_err().contains("joint"));
    assert!(Shape::DiscoBall(DiscoBall { radius: 1.0, rows: 1, joint: 0.0 }).mesh().unwrap_err().contains("rows"));
}
