//! Coplanar faces of different objects, such as the foot of a glass and the table below it: rounding decides which of the two a ray meets, so
//! that the smaller object is moved away a little. This module must not know scene files.

use std::collections::HashMap;

use glam::{DVec2, DVec3, Vec3};

use super::{Animation, Mesh, Scene};

/// How far an object is moved, as a share of its size: .2 mm for one metre.
const GAP: f32 = 2e-4;
/// Planes are the same if they are nearer than this share of the smaller object's size,
const SAME_PLANE: f32 = 1e-5;
/// or of the scene's size: rays start off surfaces by 10⁻⁶ of it.
const SAME_IN_SCENE: f32 = 1.5e-6;
/// An object is moved by at least so many times the distance up to which planes are the same.
const LEAST_GAP: f32 = 3.5;
/// Triangles are grouped by the components of their normals in steps of this size.
const NORMAL_STEP: f32 = 4e-4;
/// Planes are parallel if the cosine between their normals differs from 1 by less.
const PARALLEL: f32 = 1e-6;
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
    /// Moves objects with faces that are coplanar with, and overlap, faces of a larger object: away from these, to the side where most of the object
    /// lies. An object that stands on one that is moved moves with it. Objects whose translation is animated stay, and so do those that touch
    /// on opposite sides. Returns a sentence for each object with coplanar faces, but for the animated ones.
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
    /// assert_eq!(scene.separate_coplanar_faces().len(), 1);
    /// assert!(scene.objects[0].placement.translate.y > 0.5);
    /// # Ok::<(), pinspot::Error>(())
    /// ```
    pub fn separate_coplanar_faces(&mut self) -> Vec<String> {
        let placed: Vec<Option<Placed>> = self.objects.iter().map(|object| placed(object.mesh_in_world())).collect();
        let farthest = placed.iter().flatten().map(|p| p.low.abs().max(p.high.abs()).max_element()).fold(0.0, f32::max);
        let scene_size = placed.iter().flatten().map(Placed::size).fold(0.0, f32::max);
        let least = (SAME_IN_SCENE * scene_size).max(4.0 * f32::EPSILON * farthest);
        let mut by_size: Vec<(usize, &Placed)> =
            placed.iter().enumerate().filter_map(|(k, placed)| Some((k, placed.as_ref()?))).collect();
        by_size.sort_by(|a, b| b.1.size().total_cmp(&a.1.size()).then(a.0.cmp(&b.0)));

        let mut notes = Vec::new();
        let mut steps = vec![Vec3::ZERO; placed.len()];
        for (rank, (object, moved)) in by_size.iter().enumerate() {
            let tolerance = (SAME_PLANE * moved.size()).max(least);
            let touched: Vec<(usize, Vec<Vec3>)> = by_size[..rank]
                .iter()
                .map(|(larger, other)| (*larger, sides_touching(moved, other, tolerance)))
                .filter(|(_, sides)| !sides.is_empty())
                .collect();
            let Some((larger, _)) = touched.first() else { continue };
            if self.has_animated_translation(*object) {
                continue;
            }
            let [name, other] = [*object, *larger].map(|k| &self.objects[k].name);
            let gap = (GAP * moved.size()).max(LEAST_GAP * tolerance);
            let sides: Vec<Vec3> = touched.iter().flat_map(|(_, sides)| sides).copied().collect();
            let own = step_away(&sides).map(|direction| gap * direction);
            let note = match own {
                Some(_) => {
                    let millimetres = three_digits(1e3 * gap);
                    format!("'{name}' and '{other}' have coplanar faces: '{name}' is moved by {millimetres} mm")
                }
                None => format!(
                    "'{name}' and '{other}' have coplanar faces on several sides, where rounding decides which of them is seen: make one a \
                     little smaller"
                ),
            };
            notes.push((*object, note));
            steps[*object] = own.unwrap_or(Vec3::ZERO) + steps[*larger];
        }
        self.objects.iter_mut().zip(steps).for_each(|(object, step)| object.placement.translate += step);
        notes.sort_unstable();
        notes.into_iter().map(|(_, note)| note).collect()
    }

    fn has_animated_translation(&self, object: usize) -> bool {
        self.animations.iter().any(|animation| {
            matches!(animation, Animation::Objects(motion) if motion.translate.is_some() && motion.objects.contains(&object))
        })
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
        if !other.is_near(bounds(corners), tolerance) {
            continue;
        }
        let Some(normal) = face_normal(corners) else { continue };
        let from_plane = (middle - corners[0]).dot(normal);
        let side = normal * 1f32.copysign(from_plane);
        if sides.iter().any(|known| known.dot(side) > SAME_SIDE) {
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
    triangles: HashMap<[i64; 4], InPlane>,
}

/// Triangles of one plane, by where they begin along the axis of their longest extent.
#[derive(Default)]
struct InPlane {
    axis: usize,
    /// The longest triangle along the axis.
    longest: f32,
    /// Beginning, end, and number.
    spans: Vec<(f32, f32, u32)>,
}

impl InPlane {
    fn new(mesh: &Mesh, triangles: &[u32]) -> Self {
        let boxes = || triangles.iter().map(|triangle| bounds(mesh.corners(*triangle as usize)));
        let (low, high) = boxes().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), (a, b)| (l.min(a), h.max(b)));
        let axis = (high - low).max_position();
        let mut spans: Vec<_> =
            boxes().zip(triangles).map(|((a, b), triangle)| (a[axis], b[axis], *triangle)).collect();
        spans.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self { axis, longest: spans.iter().map(|(begin, end, _)| end - begin).fold(0.0, f32::max), spans }
    }

    /// The triangles that may overlap a box.
    fn within(&self, (low, high): (Vec3, Vec3)) -> impl Iterator<Item = usize> {
        let (low, high) = (low[self.axis], high[self.axis]);
        let first = self.spans.partition_point(|(begin, ..)| *begin < low - self.longest);
        let spans = self.spans[first..].iter().take_while(move |(begin, ..)| *begin <= high);
        spans.filter(move |(_, end, _)| *end >= low).map(|(.., triangle)| *triangle as usize)
    }
}

impl<'a> Planes<'a> {
    /// The planes of what is near to another object.
    fn near(of: &'a Placed, other: &Placed, tolerance: f32) -> Self {
        let mut planes =
            Self { mesh: &of.mesh, origin: other.middle(), cell: 4.0 * tolerance, triangles: HashMap::new() };
        let mut by_plane: HashMap<[i64; 4], Vec<u32>> = HashMap::new();
        for triangle in 0..of.mesh.triangles().len() {
            let corners = of.mesh.corners(triangle);
            if !other.is_near(bounds(corners), tolerance) {
                continue;
            }
            if let Some(normal) = face_normal(corners) {
                let place = planes.place(normal, corners[0]).map(|x| x.round() as i64);
                by_plane.entry(place).or_default().push(triangle as u32);
            }
        }
        planes.triangles =
            by_plane.into_iter().map(|(place, triangles)| (place, InPlane::new(&of.mesh, &triangles))).collect();
        planes
    }

    fn place(&self, normal: Vec3, point: Vec3) -> [f64; 4] {
        let (normal, point) = (upwards(normal).as_dvec3(), point - self.origin);
        let [x, y, z] = (normal / f64::from(NORMAL_STEP)).to_array();
        [x, y, z, normal.dot(point.as_dvec3()) / f64::from(self.cell)]
    }

    /// A triangle in the same plane that overlaps the one with these corners.
    fn touching(&self, corners: [Vec3; 3], normal: Vec3, tolerance: f32) -> Option<usize> {
        let place = self.place(normal, corners[0]);
        let of_plane = (0..16).filter_map(|k| {
            // The two cells on each axis that are nearest.
            let cell = std::array::from_fn(|axis| place[axis].floor() as i64 + (k >> axis & 1));
            self.triangles.get(&cell)
        });
        of_plane.flat_map(|of_plane| of_plane.within(bounds(corners))).find(|triangle| {
            let other = self.mesh.corners(*triangle);
            let is_in_plane = |p: Vec3| (p - corners[0]).dot(normal).abs() <= tolerance;
            face_normal(other).is_some_and(|n| n.dot(normal).abs() > 1.0 - PARALLEL)
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
        scene.animations.clear();
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
        let notes = scene.separate_coplanar_faces();
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
    fn what_stands_on_something_that_is_moved_moves_with_it() {
        let tray = Object { mesh: block(0.5, Vec3::ZERO).mesh, ..block(0.5, Vec3::new(0.0, 0.25, 0.0)) };
        let mut scene = scene(vec![block(0.1, Vec3::new(0.1, 0.55, 0.1)), tray, table()]);
        assert_eq!(scene.separate_coplanar_faces().len(), 2);
        let [glass, tray] = [0, 1].map(|k| scene.objects[k].placement.translate.y);
        assert!(glass - tray > 0.3 + 3e-5, "{glass} on {tray}");
        assert!(scene.separate_coplanar_faces().is_empty());
    }

    #[test]
    fn what_moves_by_itself_stays() {
        let text = "environment = { constant = [1, 1, 1] }
            camera = { position = [0, 5, 5], target = [0, 0, 0], perspective = { fov_y_deg = 40 } }
            object = [{ name = 'block', shape = { box = { size = [0.1, 0.1, 0.1] } }, translate = [0, 0.05, 0], reflector = {} },
                      { shape = { plane = {} }, receiver = {} }]
            animation = [{ object = 'block', translate = [[0, [0, 0.05, 0]], [1, [1, 0.05, 0]]] }]";
        let scene = crate::scene::parse::<toml::Table>("moves.toml", text, std::path::Path::new(".")).unwrap().scene;
        assert_eq!((scene.notes, scene.objects[0].placement.translate.y), (vec![], 0.05));
    }

    #[test]
    fn joints_between_many_tiles_are_told_apart_quickly() {
        let tiles = crate::scene::shapes::Tiles { size: [10.0, 10.0], count: [100, 100], gap: 0.01 };
        let [tiles, joints] =
            [Shape::Tiles(tiles), Shape::Joints(tiles)].map(|shape| Object::new("floor", shape.mesh().unwrap()));
        assert_eq!(step(vec![tiles, joints]), (Vec3::ZERO, vec![]));
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
