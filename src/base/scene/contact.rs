//! Faces of different objects in one plane, such as the foot of a glass on a table: which of the two a ray meets is left to rounding. Whoever
//! stands there is set off by little. This module must not know scene files.

use std::collections::HashMap;

use glam::{DVec2, DVec3, Vec3};

use super::{Mesh, Scene};

/// How far a touching object is set off, as a share of its size: .2 mm for one metre.
const GAP: f32 = 2e-4;
/// Planes are the same if they are nearer than this share of the smaller object's size, or of the scene's: rays start off surfaces by
/// 10⁻⁶ of the latter.
const SAME_PLANE: [f32; 2] = [1e-5, 4e-6];
/// Normals are the same, or opposite, if each component differs by less.
const SAME_NORMAL: f32 = 1e-4;
/// Directions are one if the cosine between them is larger.
const SAME_SIDE: f32 = 0.999;
/// Triangles overlap if they do by more than this share of the smaller one's size: neighbours share their edges.
const OVERLAP: f64 = 1e-3;

/// An object in the world.
struct Placed {
    mesh: Mesh,
    low: Vec3,
    high: Vec3,
}

impl Placed {
    fn size(&self) -> f32 {
        (self.high - self.low).length()
    }

    fn middle(&self) -> Vec3 {
        0.5 * self.low + 0.5 * self.high
    }

    /// Whether the boxes are nearer to each other than `distance`.
    fn is_near(&self, (low, high): (Vec3, Vec3), distance: f32) -> bool {
        self.low.cmple(high + distance).all() && low.cmple(self.high + distance).all()
    }
}

impl Scene {
    /// Sets objects off whose faces lie in a face of a larger object, to the side on which most of them is. Returns one sentence for
    /// each of them, and for each that no small move can free, which stays where it is.
    ///
    /// ```
    /// use pinspot::scene::shapes::{Cuboid, Plane, Shape};
    /// # use pinspot::scene::Object;
    /// # let (mut scene, _) = pinspot::load("ring-natural")?;
    /// # scene.objects.clear();
    /// let block = Shape::Box(Cuboid { size: [1.0, 1.0, 1.0] }).mesh().expect("its dimensions are in range");
    /// let table = Shape::Plane(Plane { size: [9.0, 9.0] }).mesh().expect("so are these");
    /// scene.objects = vec![Object::new("block", block), Object::new("table", table)];
    /// scene.objects[0].placement.translate.y = 0.5; // its base is at 0, and so is the table
    /// assert_eq!(scene.separate_touching_faces().len(), 1);
    /// assert!(scene.objects[0].placement.translate.y > 0.5);
    /// # Ok::<(), pinspot::Error>(())
    /// ```
    pub fn separate_touching_faces(&mut self) -> Vec<String> {
        let mut placed: Vec<Option<Placed>> =
            self.objects.iter().map(|object| placed(object.mesh_in_world())).collect();
        let farthest = placed.iter().flatten().map(|p| p.low.abs().max(p.high.abs()).max_element()).fold(0.0, f32::max);
        let scene_size = placed.iter().flatten().map(Placed::size).fold(0.0, f32::max);
        let mut by_size: Vec<usize> = (0..placed.len()).filter(|k| placed[*k].is_some()).collect();
        let size = |k: usize| placed[k].as_ref().map_or(0.0, Placed::size);
        by_size.sort_by(|a, b| size(*b).total_cmp(&size(*a)).then(a.cmp(b)));

        let mut notes = Vec::new();
        for rank in 1..by_size.len() {
            let smaller = by_size[rank];
            let Some(moved) = &placed[smaller] else { continue };
            let tolerance =
                (SAME_PLANE[0] * moved.size()).max(SAME_PLANE[1] * scene_size).max(4.0 * f32::EPSILON * farthest);
            let mut away = Vec::new();
            let mut touched = None;
            for larger in &by_size[..rank] {
                let Some(other) = &placed[*larger] else { continue };
                let sides = sides_touching(moved, other, tolerance);
                if !sides.is_empty() {
                    touched = touched.or(Some(*larger));
                    away.extend(sides);
                }
            }
            let Some(larger) = touched else { continue };
            let [name, other] = [smaller, larger].map(|k| &self.objects[k].name);
            let gap = (GAP * moved.size()).max(4.0 * tolerance);
            match step_away(&away) {
                Some(direction) => {
                    notes.push(format!(
                        "faces of '{name}' lie in faces of '{other}': it is set off by {} mm",
                        three_digits(1e3 * gap)
                    ));
                    self.objects[smaller].placement.translate += gap * direction;
                    placed[smaller] = self::placed(self.objects[smaller].mesh_in_world());
                }
                None => notes.push(format!(
                    "faces of '{name}' lie in faces of '{other}' on several sides: which of the two is seen there is left to rounding; \
                     make one of them a little smaller"
                )),
            }
        }
        notes
    }
}

fn placed(mesh: Mesh) -> Option<Placed> {
    let positions = mesh.positions().iter();
    let (low, high) = positions.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    (low.x <= high.x).then_some(Placed { mesh, low, high })
}

fn three_digits(value: f32) -> f32 {
    let digits = 10f32.powi(2 - value.log10().floor() as i32);
    (value * digits).round() / digits
}

/// The directions away from the faces that two objects share, one for each plane.
fn sides_touching(moved: &Placed, other: &Placed, tolerance: f32) -> Vec<Vec3> {
    if !moved.is_near((other.low, other.high), tolerance) {
        return Vec::new();
    }
    let middle = moved.middle();
    let planes = Planes::near(other, moved, tolerance);
    let mut sides: Vec<Vec3> = Vec::new();
    for triangle in 0..moved.mesh.triangles().len() {
        let corners = moved.mesh.corners(triangle);
        let Some(normal) = face_normal(corners) else { continue };
        let from_plane = (middle - corners[0]).dot(normal);
        let side = normal * 1f32.copysign(from_plane);
        if !other.is_near(bounds(corners), tolerance) || sides.iter().any(|known| known.dot(side) > SAME_SIDE) {
            continue;
        }
        if let Some(shared) = planes.touching(corners, normal, tolerance) {
            // What is as flat as the face that it lies on goes to the front of it.
            let is_flat = from_plane.abs() <= tolerance;
            let front: Vec3 = other.mesh.corner_normals(shared).iter().sum();
            sides.push(if is_flat { normal * 1f32.copysign(front.dot(normal)) } else { side });
        }
    }
    sides
}

/// The smallest step that leads a unit away from each plane, if there is one.
fn step_away(sides: &[Vec3]) -> Option<Vec3> {
    // Three planes of a corner at most; directions that differ little are one.
    let mut distinct: Vec<Vec3> = Vec::new();
    for side in sides {
        if !distinct.iter().any(|d| d.dot(*side) > SAME_SIDE) {
            distinct.push(*side);
        }
    }
    if distinct.len() > 3 {
        return None;
    }
    let sum: Vec3 = distinct.iter().sum();
    let least = distinct.iter().map(|d| d.dot(sum)).fold(f32::INFINITY, f32::min);
    (least > 0.1).then(|| sum / least)
}

/// An object's triangles by their planes.
struct Planes<'a> {
    mesh: &'a Mesh,
    /// What distances are counted from: near to all of the triangles, so that errors of their normals count little.
    origin: Vec3,
    cell: f32,
    triangles: HashMap<[i64; 4], Vec<u32>>,
}

impl<'a> Planes<'a> {
    /// The planes of what is near to another object.
    fn near(of: &'a Placed, other: &Placed, tolerance: f32) -> Self {
        let cell = 4.0 * tolerance;
        let mut planes = Self { mesh: &of.mesh, origin: other.middle(), cell, triangles: HashMap::new() };
        for triangle in 0..of.mesh.triangles().len() {
            let corners = of.mesh.corners(triangle);
            let Some(normal) = face_normal(corners) else { continue };
            if other.is_near(bounds(corners), tolerance) {
                let place = planes.place(normal, corners[0]).map(|x| x.round() as i64);
                planes.triangles.entry(place).or_default().push(triangle as u32);
            }
        }
        planes
    }

    fn place(&self, normal: Vec3, point: Vec3) -> [f64; 4] {
        let (normal, point) = (upwards(normal).as_dvec3(), point - self.origin);
        let [x, y, z] = (normal / f64::from(4.0 * SAME_NORMAL)).to_array();
        [x, y, z, normal.dot(point.as_dvec3()) / f64::from(self.cell)]
    }

    /// A triangle in the same plane that overlaps the one with these corners.
    fn touching(&self, corners: [Vec3; 3], normal: Vec3, tolerance: f32) -> Option<usize> {
        let place = self.place(normal, corners[0]);
        let candidates = (0..16).filter_map(|k| {
            // The two cells on each axis that are nearest.
            let cell: [i64; 4] = std::array::from_fn(|axis| {
                let x = place[axis];
                if k >> axis & 1 == 0 { x.floor() as i64 } else { x.floor() as i64 + 1 }
            });
            self.triangles.get(&cell)
        });
        candidates.flatten().map(|triangle| *triangle as usize).find(|triangle| {
            let other = self.mesh.corners(*triangle);
            let is_in_plane = |p: Vec3| (p - corners[0]).dot(normal).abs() <= tolerance;
            face_normal(other).is_some_and(|n| n.dot(normal).abs() > 1.0 - SAME_NORMAL)
                && (other.into_iter().all(is_in_plane) || is_near_plane(corners, other, tolerance))
                && overlap(corners, other, normal)
        })
    }
}

/// Whether one triangle's corners lie in another's plane: of a large and a small one, only the small one's are.
fn is_near_plane(corners: [Vec3; 3], of: [Vec3; 3], tolerance: f32) -> bool {
    face_normal(of).is_some_and(|normal| corners.into_iter().all(|p| (p - of[0]).dot(normal).abs() <= tolerance))
}

/// Of a normal and its opposite, the one whose last component that is not near zero is positive.
fn upwards(normal: Vec3) -> Vec3 {
    let largest = normal.to_array().into_iter().rev().find(|x| x.abs() > 0.1).unwrap_or(1.0);
    normal * largest.signum()
}

fn face_normal([a, b, c]: [Vec3; 3]) -> Option<Vec3> {
    let [a, b, c] = [a, b, c].map(Vec3::as_dvec3);
    (b - a).cross(c - a).try_normalize().map(DVec3::as_vec3)
}

fn bounds([a, b, c]: [Vec3; 3]) -> (Vec3, Vec3) {
    (a.min(b).min(c), a.max(b).max(c))
}

/// Whether two triangles in one plane overlap: no edge of either separates them.
fn overlap(one: [Vec3; 3], other: [Vec3; 3], normal: Vec3) -> bool {
    let origin = one[0].as_dvec3();
    let normal = normal.as_dvec3();
    let x = normal.any_orthonormal_vector();
    let y = normal.cross(x);
    let flat =
        |corners: [Vec3; 3]| corners.map(|p| p.as_dvec3() - origin).map(|p: DVec3| DVec2::new(p.dot(x), p.dot(y)));
    let [one, other] = [flat(one), flat(other)];
    let size = |[a, b, c]: [DVec2; 3]| a.distance(b).max(b.distance(c)).max(c.distance(a));
    let least = OVERLAP * size(one).min(size(other));
    let is_separated = |of: [DVec2; 3]| {
        (0..3).any(|k| {
            let Some(across) = (of[(k + 1) % 3] - of[k]).perp().try_normalize() else { return false };
            let range = |corners: [DVec2; 3]| {
                let along = corners.map(|p| p.dot(across));
                [along.into_iter().fold(f64::INFINITY, f64::min), along.into_iter().fold(f64::NEG_INFINITY, f64::max)]
            };
            let [[low, high], [other_low, other_high]] = [range(one), range(other)];
            high - other_low < least || other_high - low < least
        })
    };
    !is_separated(one) && !is_separated(other)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shapes::{Cuboid, Plane, Shape, Sphere};
    use crate::scene::{BUILT_IN, BuiltIn, Object, Transform, load};

    fn scene(objects: Vec<Object>) -> Scene {
        let mut scene = load::<toml::Table>("mirror-sphere").unwrap().scene;
        scene.objects = objects;
        scene
    }

    fn block(size: f32, at: Vec3) -> Object {
        let mut object = Object::new("block", Shape::Box(Cuboid { size: [size; 3] }).mesh().unwrap());
        object.placement.translate = at;
        object
    }

    fn table() -> Object {
        Object::new("table", Shape::Plane(Plane { size: [4.0, 4.0] }).mesh().unwrap())
    }

    fn step(objects: Vec<Object>) -> (Vec3, Vec<String>) {
        let mut scene = scene(objects);
        let before = scene.objects[0].placement.translate;
        let notes = scene.separate_touching_faces();
        (scene.objects[0].placement.translate - before, notes)
    }

    #[test]
    fn what_stands_on_a_table_is_raised_and_what_hangs_lowered() {
        for (height, up) in [(0.05, 1.0), (-0.05, -1.0)] {
            let (moved, notes) = step(vec![block(0.1, Vec3::new(0.3, height, 0.2)), table()]);
            assert!(moved.x == 0.0 && moved.z == 0.0 && (3e-5..3e-4).contains(&(up * moved.y)), "{moved}");
            assert!(notes[0].contains("'block'") && notes[0].contains("'table'"), "{notes:?}");
        }
    }

    #[test]
    fn turned_objects_far_from_the_origin_touch_too() {
        let place =
            Transform { rotate_rad: Vec3::new(0.4, 0.2, -0.7), translate: Vec3::new(40.0, -7.0, 3.0), scale: 1.0 };
        let mut objects = vec![block(0.1, Vec3::ZERO), table()];
        objects[1].placement = place;
        objects[0].placement = Transform { translate: place.point_in_world(Vec3::new(0.3, 0.05, 0.2)), ..place };
        let (moved, notes) = step(objects);
        assert_eq!(notes.len(), 1);
        assert!(moved.dot(place.normal_in_world(Vec3::Y)) > 3e-5, "{moved}");
    }

    #[test]
    fn a_block_in_a_corner_leaves_both_walls() {
        let mut wall = table();
        wall.placement =
            Transform { rotate_rad: Vec3::new(std::f32::consts::FRAC_PI_2, 0.0, 0.0), ..Default::default() };
        let (moved, notes) = step(vec![block(0.1, Vec3::new(0.0, 0.05, 0.05)), table(), wall]);
        assert_eq!(notes.len(), 1);
        assert!(moved.y > 3e-5 && moved.z > 3e-5, "{moved}");
    }

    #[test]
    fn a_panel_in_a_table_lies_on_its_front() {
        let mut panel = table();
        panel.placement.scale = 0.1;
        assert!(step(vec![panel, table()]).0.y > 3e-5);
    }

    #[test]
    fn neighbours_and_what_is_apart_stay() {
        let apart = Vec3::new(0.0, 0.0504, 0.0);
        let ball = Object::new("ball", Shape::Sphere(Sphere::of_radius(0.05)).mesh().unwrap());
        let mut other = table();
        other.placement.translate.x = 4.0;
        other.placement.scale = 0.999_9;
        for objects in [
            vec![block(0.1, apart), table()],
            vec![other, table()],
            vec![
                Object { placement: Transform { translate: Vec3::new(0.0, 0.05, 0.0), ..Default::default() }, ..ball },
                table(),
            ],
        ] {
            assert_eq!(step(objects), (Vec3::ZERO, vec![]));
        }
    }

    #[test]
    fn what_fits_exactly_stays_with_a_note() {
        let mut inner = block(0.1, Vec3::ZERO);
        inner.placement.scale = 0.999_999_9;
        let (moved, notes) = step(vec![inner, block(0.1, Vec3::ZERO)]);
        assert_eq!(moved, Vec3::ZERO);
        assert!(notes[0].contains("several sides"), "{notes:?}");
    }

    #[test]
    fn no_built_in_scene_has_touching_faces() {
        let notes_of = |b: &'static BuiltIn| {
            load::<toml::Table>(b.name).unwrap().scene.notes.into_iter().map(|note| (b.name, note))
        };
        assert_eq!(BUILT_IN.iter().flat_map(notes_of).collect::<Vec<_>>(), vec![]);
    }
}
