//! Hierarchies over triangles: built, or refitted to triangles that have moved. Knows meshes, but no rays.

use glam::Vec3;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, builder::build_bvh2};
use obvhs::triangle::Triangle;

use super::{SeenBy, Tracer, TriangleSurface};
use crate::parallel;
use crate::scene::{Mesh, Object, Scene};

/// A refitted hierarchy whose rays cost this much more than when it was built is built again.
const MAX_GROWTH: f32 = 1.3;

/// Triangles, or boxes, that one thread takes in a row.
const RUN: usize = 4096;

/// Objects, in world space unless they are alone.
type Objects<'a> = [(&'a Mesh, SeenBy)];

impl Tracer {
    /// Builds the hierarchy over a scene.
    pub fn new(scene: &Scene) -> Self {
        let meshes: Vec<Mesh> = scene.objects.iter().map(Object::mesh_in_world).collect();
        Self::of_meshes(meshes.iter().zip(scene.objects.iter().map(SeenBy::of)))
    }

    /// Builds the hierarchy over objects' meshes in world space, without those that only the camera sees.
    pub fn of_meshes<'a>(meshes: impl Iterator<Item = (&'a Mesh, SeenBy)>) -> Self {
        Self::build(&meshes.collect::<Vec<_>>(), BvhBuildParams::medium_build(), is_met_by_light)
    }

    /// The same for objects that move or deform in every frame: the hierarchy of the frame before is refitted if these are the same objects
    /// and rays do not become much slower. Otherwise it is built in a fraction of the time, and rays take a little longer, except in the first
    /// frame.
    pub fn for_frame<'a>(
        before: Option<&Self>,
        is_first: bool,
        meshes: impl Iterator<Item = (&'a Mesh, SeenBy)>,
    ) -> Self {
        Self::refitted_or_built(before, is_first, &meshes.collect::<Vec<_>>(), is_met_by_light)
    }

    /// The hierarchy over emitters, through which light passes; refitted like that of a frame.
    pub fn of_emitters<'a>(before: Option<&Self>, meshes: impl Iterator<Item = (&'a Mesh, SeenBy)>) -> Self {
        Self::refitted_or_built(before, before.is_none(), &meshes.collect::<Vec<_>>(), |seen_by| !seen_by.light)
    }

    fn refitted_or_built(
        before: Option<&Self>,
        is_first: bool,
        objects: &Objects,
        is_wanted: fn(&SeenBy) -> bool,
    ) -> Self {
        let refitted = before.and_then(|before| before.refitted(objects, is_wanted));
        let how = if is_first { BvhBuildParams::medium_build() } else { BvhBuildParams::very_fast_build() };
        refitted.unwrap_or_else(|| Self::build(objects, how, is_wanted))
    }

    /// The hierarchy over some of the objects.
    fn build(objects: &Objects, how: BvhBuildParams, is_wanted: impl Fn(&SeenBy) -> bool) -> Self {
        let triangle_counts = counts(objects, is_wanted);
        let object_of = |(object, count): (usize, &usize)| (0..*count).map(move |_| object as u32);
        let objects_of_triangles: Vec<u32> = triangle_counts.iter().enumerate().flat_map(object_of).collect();
        let triangles = Triangles::new(objects, &triangle_counts);
        let unsorted = (0..).zip(&objects_of_triangles);
        let unsorted: Vec<_> = unsorted.map(|(index, &object)| triangles.corners(object, index)).collect();
        let units = Units::of(&unsorted);
        let boxes: Vec<Aabb> = parallel::map(&unsorted, &|corners| units.bounds(std::slice::from_ref(corners)));
        let bvh = build_bvh2(&boxes, how, &mut Default::default());
        let surface = |&index: &u32| triangles.surface(objects_of_triangles[index as usize], index);
        let corners = parallel::map(&bvh.primitive_indices, &|&index| units.scaled(unsorted[index as usize]));
        let surfaces = parallel::map(&bvh.primitive_indices, &surface);
        let cost = cost(&bvh);
        let camera_visible = objects.iter().map(|(_, seen_by)| seen_by.camera).collect();
        let Units { scale, offset, .. } = units;
        Self { corners, surfaces, scale, bvh, cost, triangle_counts, camera_visible, offset }
    }

    /// The same objects at other places or in other shapes, with new boxes in the same hierarchy. `None` if there are others, or if rays
    /// would become much slower.
    fn refitted(&self, objects: &Objects, is_wanted: impl Fn(&SeenBy) -> bool) -> Option<Self> {
        if self.corners.is_empty() || counts(objects, is_wanted) != self.triangle_counts {
            return None;
        }
        let triangles = Triangles::new(objects, &self.triangle_counts);
        let (surfaces, indices) = (&self.surfaces, &self.bvh.primitive_indices);
        let corners = |k: usize| triangles.corners(surfaces[k].object, indices[k]);
        let surface = |k: usize| triangles.surface(surfaces[k].object, indices[k]);
        let mut corners = parallel::collect(surfaces.len(), &corners);
        let units = Units::of(&corners);
        let mut bvh = self.bvh.clone();
        parallel::for_each_chunk(&mut bvh.nodes, RUN, &|_, nodes| {
            for leaf in nodes.iter_mut().filter(|node| node.is_leaf()) {
                let first = leaf.first_index as usize;
                leaf.set_aabb(units.bounds(&corners[first..first + leaf.prim_count as usize]));
            }
        });
        bvh.refit_all();
        let cost = cost(&bvh);
        if cost.is_nan() || cost > MAX_GROWTH * self.cost {
            return None;
        }
        parallel::for_each_chunk(&mut corners, RUN, &|_, corners| {
            for corners in corners {
                *corners = units.scaled(*corners);
            }
        });
        Some(Self {
            corners,
            surfaces: parallel::collect(surfaces.len(), &surface),
            scale: units.scale,
            bvh,
            cost: self.cost,
            triangle_counts: self.triangle_counts.clone(),
            camera_visible: objects.iter().map(|(_, seen_by)| seen_by.camera).collect(),
            offset: units.offset,
        })
    }
}

fn is_met_by_light(seen_by: &SeenBy) -> bool {
    seen_by.light
}

/// How many triangles of each object are wanted: all or none.
fn counts(objects: &Objects, is_wanted: impl Fn(&SeenBy) -> bool) -> Vec<usize> {
    let count = |(mesh, seen_by): &(&Mesh, SeenBy)| if is_wanted(seen_by) { mesh.triangles().len() } else { 0 };
    objects.iter().map(count).collect()
}

/// The surface areas of all boxes over that of the whole, to which the mean cost of rays is proportional (MacDonald and Booth 1990,
/// *Heuristics for Ray Tracing Using Space Subdivision*).
fn cost(bvh: &Bvh2) -> f32 {
    let Some(root) = bvh.nodes.first() else { return 0.0 };
    let sum: f32 = bvh.nodes.iter().map(|node| node.aabb().half_area()).sum();
    sum / root.aabb().half_area().max(f32::MIN_POSITIVE)
}

/// The wanted triangles of all objects, numbered object by object.
struct Triangles<'a> {
    objects: &'a Objects<'a>,
    /// The number of each object's first triangle.
    first: Vec<u32>,
}

impl<'a> Triangles<'a> {
    fn new(objects: &'a Objects, counts: &[usize]) -> Self {
        let mut first = vec![0];
        first.extend(counts.iter().scan(0, |sum, count| {
            *sum += *count as u32;
            Some(*sum)
        }));
        Self { objects, first }
    }

    fn place(&self, object: u32, index: u32) -> (&'a Mesh, usize) {
        (self.objects[object as usize].0, (index - self.first[object as usize]) as usize)
    }

    /// Metres.
    fn corners(&self, object: u32, index: u32) -> [Vec3; 3] {
        let (mesh, triangle) = self.place(object, index);
        mesh.corners(triangle)
    }

    fn surface(&self, object: u32, index: u32) -> TriangleSurface {
        let (mesh, triangle) = self.place(object, index);
        TriangleSurface { normals: mesh.corner_normals(triangle), object }
    }
}

/// A tracer's unit of length.
struct Units {
    scale: f32,
    /// Boxes are larger than triangles by what is lost by rounding: rays must not slip between them.
    padding: f32,
    offset: f32,
}

impl Units {
    /// Of triangles, metres.
    fn of(triangles: &[[Vec3; 3]]) -> Self {
        if triangles.is_empty() {
            return Self { scale: 1.0, padding: 0.0, offset: 0.0 };
        }
        let none = || (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let of_some = |some: &[[Vec3; 3]]| some.as_flattened().iter().fold(none(), |(l, h), p| (l.min(*p), h.max(*p)));
        let bounds = parallel::map_chunks(triangles, 4096, &of_some);
        let (low, high) = bounds.into_iter().fold(none(), |(l, h), (low, high)| (l.min(low), h.max(high)));
        let scale = unit_scale(0.5 * high - 0.5 * low);
        let padding = 4.0 * f32::EPSILON * scale * low.abs().max(high.abs()).max_element();
        Self { scale, padding, offset: offset(scale * low, scale * high) }
    }

    fn scaled(&self, corners: [Vec3; 3]) -> [Vec3; 3] {
        corners.map(|corner| self.scale * corner)
    }

    /// Of triangles, in units.
    fn bounds(&self, triangles: &[[Vec3; 3]]) -> Aabb {
        let of_triangle = |corners: &[Vec3; 3]| {
            let [v0, v1, v2] = self.scaled(*corners).map(Into::into);
            Triangle { v0, v1, v2 }.aabb()
        };
        let bounds = triangles.iter().map(of_triangle).fold(Aabb::empty(), |all, bounds| all.union(&bounds));
        Aabb { min: bounds.min - self.padding, max: bounds.max + self.padding }
    }
}

/// The power of two that brings half the size of a scene's bounds, metres, to between 4,096 and 8,192.
fn unit_scale(half_size: Vec3) -> f32 {
    let exponent = half_size.max_element().max(f32::MIN_POSITIVE).log2().floor() as i32;
    2f32.powi((12 - exponent).clamp(-126, 126))
}

/// How far off a surface rays start in a scene with these bounds: more than what is lost by rounding, and little enough that from the
/// foot of a wall they do not leave through the floor.
pub(super) fn offset(low: Vec3, high: Vec3) -> f32 {
    let farthest = low.abs().max(high.abs()).max_element();
    (1e-6 * (high - low).length()).max(4.0 * f32::EPSILON * farthest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Ray;
    use crate::scene::shapes::{Shape, Sphere};

    fn ball(moved: impl Fn(Vec3) -> Vec3) -> Mesh {
        let unit = Shape::Sphere(Sphere::of_radius(1.0)).mesh().unwrap();
        let positions = unit.positions().iter().map(|p| moved(*p)).collect();
        Mesh::new("ball", positions, unit.normals().to_vec(), unit.triangles().to_vec()).unwrap().0
    }

    fn seen<'a>(meshes: &[&'a Mesh]) -> Vec<(&'a Mesh, SeenBy)> {
        meshes.iter().map(|mesh| (*mesh, SeenBy::ALL)).collect()
    }

    /// Rays find in a refitted hierarchy what they find in a new one.
    #[test]
    fn moved_and_deformed_objects_are_found_where_they_are() {
        let [still, before] = [ball(|p| p), ball(|p| p + 3.0 * Vec3::X)];
        let after = ball(|p| Vec3::new(1.2, 0.9, 1.0) * p + Vec3::new(2.8, 0.3, 0.1 * p.x));
        let first = Tracer::for_frame(None, true, seen(&[&still, &before]).into_iter());
        let refitted = first.refitted(&seen(&[&still, &after]), is_met_by_light).unwrap();
        assert_eq!(refitted.bvh.primitive_indices, first.bvh.primitive_indices);
        let new = Tracer::of_meshes(seen(&[&still, &after]).into_iter());
        let mut hits = [0; 2];
        for k in 0..2000 {
            let origin = Vec3::new(-1.3 + 0.003 * k as f32, 1.2 * (2.4 * k as f32).sin(), 5.0);
            let [found, expected] =
                [&refitted, &new].map(|tracer| tracer.secondary_hit(Ray { origin, direction: Vec3::NEG_Z }));
            assert_eq!(found.map(|hit| hit.object), expected.map(|hit| hit.object));
            if let Some((found, expected)) = found.zip(expected) {
                assert!(found.position.abs_diff_eq(expected.position, 1e-5));
                hits[found.object as usize] += 1;
            }
        }
        assert!(hits.iter().all(|count| *count > 300), "{hits:?}");
    }

    #[test]
    fn other_objects_and_slow_hierarchies_are_built_anew() {
        let [still, beside] = [ball(|p| p), ball(|p| p + 3.0 * Vec3::X)];
        let first = Tracer::for_frame(None, true, seen(&[&still, &beside]).into_iter());
        assert!(first.refitted(&seen(&[&still]), is_met_by_light).is_none());
        // Each of its triangles is somewhere else.
        let torn = ball(|p| 50.0 * Vec3::new((900.0 * p.x).sin(), (900.0 * p.y).sin(), (900.0 * p.z).sin()));
        assert!(first.refitted(&seen(&[&still, &torn]), is_met_by_light).is_none());
        assert!(Tracer::for_frame(Some(&first), false, seen(&[&still, &torn]).into_iter()).cost > 0.0);
    }
}
