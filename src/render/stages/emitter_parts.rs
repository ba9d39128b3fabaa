//! Divides a mesh into parts of about the same size, which stand for it where it lights something.

use glam::{Vec3, Vec4};

use crate::scene::Mesh;

/// Places by which a part is found, on average.
const PLACES_PER_PART: usize = 48;
/// How much a normal that is turned by a radian counts, in extents of the mesh: the sides of a thin plate are different parts.
const OF_NORMALS: f32 = 0.3;

/// A part of a mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeshPart {
    /// Its middle.
    pub position: Vec3,
    /// The integral of the unit normal over it, m².
    pub area: Vec3,
}

/// A place on a mesh, with the unit normal of its triangle towards its front.
#[derive(Clone, Copy)]
struct Place {
    position: Vec3,
    normal: Vec3,
}

/// So many parts, or fewer if the mesh has no area: the neighbourhoods of places that are as far from each other as can be (Gonzalez 1985).
/// A part of a curved surface shows less than its area from every side; of a closed one (`is_closed`), all parts together are given their
/// whole area: a convex body then shows a quarter of it on average, as it must (Cauchy).
pub(super) fn divide(mesh: &Mesh, count: usize, is_closed: bool) -> Vec<MeshPart> {
    let places = places(mesh, PLACES_PER_PART * count);
    let Some(first) = places.first() else { return Vec::new() };
    let extent = places.iter().map(|place| place.position.distance(first.position)).fold(f32::MIN_POSITIVE, f32::max);
    let squared = |a: &Place, b: &Place| {
        a.position.distance_squared(b.position) + (OF_NORMALS * extent).powi(2) * a.normal.distance_squared(b.normal)
    };
    let mut owners = vec![(f32::INFINITY, 0); places.len()];
    let mut next = 0;
    for part in 0..count {
        let centre = places[next];
        for (place, owner) in places.iter().zip(&mut owners) {
            let distance = squared(place, &centre);
            if distance < owner.0 {
                *owner = (distance, part);
            }
        }
        next = (0..places.len()).max_by(|a, b| owners[*a].0.total_cmp(&owners[*b].0)).unwrap_or(0);
    }
    let mut sums = vec![(Vec4::ZERO, Vec3::ZERO); count];
    for (place, (_, part)) in places.iter().zip(owners) {
        sums[part].0 += place.position.extend(1.0);
        sums[part].1 += place.normal;
    }
    let shown: f32 = sums.iter().map(|(_, normals)| normals.length()).sum();
    let area = mesh.area() as f32 / if is_closed { shown } else { places.len() as f32 };
    let part = |(positions, normals): (Vec4, Vec3)| MeshPart {
        position: positions.truncate() / positions.w,
        area: area * normals,
    };
    sums.into_iter().filter(|(positions, _)| positions.w > 0.0).map(part).collect()
}

/// Places that stand for equal parts of the area.
fn places(mesh: &Mesh, count: usize) -> Vec<Place> {
    // The two numbers of the plane's sequence that fills it most evenly (Roberts 2018).
    const PLASTIC: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3];
    let areas = (0..mesh.triangles().len()).scan(0.0, |sum, triangle| {
        *sum += f64::from(mesh.triangle_area(triangle));
        Some(*sum)
    });
    let cumulative: Vec<f64> = areas.collect();
    let total = cumulative.last().copied().unwrap_or(0.0);
    let place = |k: usize| {
        let wanted = total * (k as f64 + 0.5) / count as f64;
        let triangle = cumulative.partition_point(|sum| *sum <= wanted).min(cumulative.len() - 1);
        let [u, v] = PLASTIC.map(|step| (k as f64 * step).fract() as f32);
        let [a, b, c] = mesh.corners(triangle);
        let across = (b - a).cross(c - a).normalize_or_zero();
        let outward: Vec3 = mesh.corner_normals(triangle).iter().sum();
        let normal = if across.dot(outward) < 0.0 { -across } else { across };
        Place { position: a + u.sqrt() * ((b - a) + v * (c - b)), normal }
    };
    if total > 0.0 { (0..count).map(place).collect() } else { Vec::new() }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn mesh_of(shape: &str) -> Mesh {
        let text = format!(
            "[environment]\nconstant = [1, 1, 1]\n[camera]\nposition = [0, 1, 1]\ntarget = [0, 0, 0]\n\
             perspective = {{ fov_y_deg = 40 }}\n[[object]]\nshape = {{ {shape} }}\nreceiver = {{}}\n"
        );
        let scene = crate::scene::parse::<toml::Table>("t", &text, Path::new(".")).unwrap().scene;
        scene.objects[0].mesh_in_world()
    }

    #[test]
    fn parts_of_a_plane_are_of_about_the_same_size() {
        let plane = mesh_of("plane = { size = [2.0, 1.0] }");
        for count in [16, 64] {
            let parts = divide(&plane, count, false);
            assert_eq!(parts.len(), count);
            let total: Vec3 = parts.iter().map(|part| part.area).sum();
            assert!(total.distance(2.0 * Vec3::Y) < 1e-4, "{total}");
            for part in parts {
                let relative = part.area.y * count as f32 / 2.0;
                assert!((0.3..2.5).contains(&relative), "{relative}");
            }
        }
    }

    /// From everywhere a ball looks as large as it is.
    #[test]
    fn parts_of_a_ball_have_its_form_factor() {
        let ball = mesh_of("sphere = { radius = 0.1, divisions = 16 }");
        let parts = divide(&ball, 64, true);
        for direction in [Vec3::X, Vec3::Y, Vec3::new(0.6, 0.0, -0.8), Vec3::ONE.normalize()] {
            let from = 0.5 * direction;
            let of_part = |part: &MeshPart| {
                let to = part.position - from;
                (-part.area.dot(to) / to.length()).max(0.0) / to.length_squared()
            };
            let solid_angle: f32 = parts.iter().map(of_part).sum();
            let expected = std::f32::consts::TAU * (1.0 - (1.0f32 - 0.04).sqrt());
            assert!((solid_angle / expected - 1.0).abs() < 0.012, "{direction}: {}", solid_angle / expected);
        }
    }
}
