//! Rays against the scene's triangles, through a BVH from `obvhs`. Knows meshes, but neither light nor samples.

use std::fmt;

use glam::Vec3;
use obvhs::BvhBuildParams;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh};
use obvhs::ray::RayHit;
use obvhs::triangle::Triangle;

use crate::scene::{Mesh, Object, Ray, Scene};

/// What a ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index of the object in the scene.
    pub object: u32,
    /// World position, metres.
    pub position: Vec3,
    /// Distance along the ray, in lengths of its direction.
    pub distance: f32,
    /// Interpolated unit normal, turned towards the ray's origin.
    pub normal: Vec3,
    /// The triangle's own unit normal, turned towards the ray's origin.
    pub face_normal: Vec3,
    /// The ray came from the side that the mesh's normals point to.
    pub front: bool,
}

/// A piece of a surface that looks around.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Its middle, metres.
    pub position: Vec3,
    /// Index of the object in the scene.
    pub object: u32,
    /// It looks to the side that the mesh's normals point to.
    pub front: bool,
    /// From end to end, metres.
    pub extent: f32,
}

/// All triangles of a scene.
pub struct Tracer {
    /// In the order of the hierarchy's leaves. Scaled, so that all scenes are of about one size: the hierarchy loses what is nearer
    /// than a ten-thousandth of a unit.
    corners: Vec<[Vec3; 3]>,
    /// In the same order.
    surfaces: Vec<TriangleSurface>,
    /// Units per metre; a power of two, which rounds nothing.
    scale: f32,
    bvh: CwBvh,
    camera_visible: Vec<bool>,
    /// Rays start this far off a surface, units.
    offset: f32,
}

/// What a triangle belongs to.
struct TriangleSurface {
    normals: [Vec3; 3],
    object: u32,
}

impl fmt::Debug for Tracer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Tracer({} triangles)", self.corners.len())
    }
}

impl Tracer {
    /// Builds the hierarchy over a scene.
    pub fn new(scene: &Scene) -> Self {
        let meshes: Vec<Mesh> = scene.objects.iter().map(Object::mesh_in_world).collect();
        Self::of_meshes(meshes.iter().zip(scene.objects.iter().map(|o| o.camera_visible)))
    }

    /// Builds the hierarchy over objects' meshes in world space; the second part says whether the camera sees one.
    pub fn of_meshes<'a>(meshes: impl Iterator<Item = (&'a Mesh, bool)>) -> Self {
        let (mut corners, mut surfaces, mut camera_visible) = (Vec::new(), Vec::new(), Vec::new());
        for (object, (mesh, is_visible)) in meshes.enumerate() {
            camera_visible.push(is_visible);
            for t in 0..mesh.triangles().len() {
                corners.push(mesh.corners(t));
                surfaces.push((mesh.corner_normals(t), object as u32));
            }
        }
        let all = corners.iter().flatten();
        let (low, high) = all.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
        let scale = if corners.is_empty() { 1.0 } else { unit_scale(0.5 * high - 0.5 * low) };
        let corners: Vec<_> = corners.into_iter().map(|triangle| triangle.map(|corner| scale * corner)).collect();
        let bounds = |corners: &[Vec3; 3]| {
            let [v0, v1, v2] = corners.map(Into::into);
            Triangle { v0, v1, v2 }.aabb()
        };
        let bounds: Vec<_> = corners.iter().map(bounds).collect();
        let bvh = build_cwbvh(&bounds, BvhBuildParams::medium_build(), &mut Default::default());
        let offset = if corners.is_empty() { 0.0 } else { offset(scale * low, scale * high) };
        let order = || bvh.primitive_indices.iter().map(|&index| index as usize);
        let surface = |(normals, object)| TriangleSurface { normals, object };
        Self {
            corners: order().map(|index| corners[index]).collect(),
            surfaces: order().map(|index| surface(surfaces[index])).collect(),
            scale,
            bvh,
            camera_visible,
            offset,
        }
    }

    /// The first thing that the camera sees along a ray.
    pub fn camera_hit(&self, ray: Ray) -> Option<Hit> {
        self.hit(ray, 0.0, |surface, _| self.camera_visible[surface.object as usize])
    }

    /// The first thing along a ray that leaves a surface.
    pub fn secondary_hit(&self, ray: Ray) -> Option<Hit> {
        self.hit(ray, self.offset, |_, _| true)
    }

    /// The first thing that a piece of a surface sees in a direction; itself it does not see.
    pub fn seen_by(&self, piece: &Piece, direction: Vec3) -> Option<Hit> {
        let itself = self.itself(piece, direction);
        self.hit(Ray { origin: piece.position, direction }, self.offset, |surface, t| !itself(surface, t))
    }

    /// Whether a piece of a surface sees nothing in a unit direction, up to a distance in metres; itself it does not see.
    pub fn is_open(&self, piece: &Piece, direction: Vec3, distance: f32) -> bool {
        let itself = self.itself(piece, direction);
        let ray = self.scaled(Ray { origin: piece.position, direction });
        // What lies at the end does not count.
        let to = self.scale * distance * (1.0 - END_SLACK) - self.offset;
        let traced = obvhs::ray::Ray::new(ray.origin.into(), ray.direction.into(), self.offset, to);
        self.corners.is_empty()
            || self.bvh.ray_traverse_miss(traced, |r, index| {
                match intersect(&self.corners[index], ray, self.offset, r.tmax) {
                    Some((t, _)) if !itself(&self.surfaces[index], t) => t,
                    _ => f32::INFINITY,
                }
            })
    }

    /// Whether a triangle, at a distance in units, belongs to the piece of a surface that looks in a direction.
    fn itself(&self, piece: &Piece, direction: Vec3) -> impl Fn(&TriangleSurface, f32) -> bool {
        let (object, side) = (piece.object, if piece.front { 1.0 } else { -1.0 });
        // A piece is a little curved, and its middle may lie below its triangles.
        let extent = self.scale * piece.extent;
        move |surface, distance| {
            surface.object == object
                && distance < extent
                && side * surface.normals.iter().sum::<Vec3>().dot(direction) > 0.0
        }
    }

    /// Whether anything lies in a direction from a surface.
    pub fn is_blocked(&self, ray: Ray) -> bool {
        let from = self.offset;
        let ray = self.scaled(ray);
        let traced = obvhs::ray::Ray::new(ray.origin.into(), ray.direction.into(), from, f32::INFINITY);
        !self.corners.is_empty()
            && !self.bvh.ray_traverse_miss(traced, |r, index| {
                intersect(&self.corners[index], ray, from, r.tmax).map_or(f32::INFINITY, |(t, _)| t)
            })
    }

    /// A ray of the world in units.
    fn scaled(&self, ray: Ray) -> Ray {
        Ray { origin: self.scale * ray.origin, ..ray }
    }

    /// The first triangle along a ray that is seen; distances are in units.
    fn hit(&self, ray: Ray, from: f32, sees: impl Fn(&TriangleSurface, f32) -> bool) -> Option<Hit> {
        if self.corners.is_empty() {
            return None;
        }
        let ray = self.scaled(ray);
        let traced = obvhs::ray::Ray::new(ray.origin.into(), ray.direction.into(), from, f32::INFINITY);
        let mut found = RayHit::none();
        let mut barycentric = (0, [0.0; 3]);
        self.bvh.ray_traverse(traced, &mut found, |r, index| {
            match intersect(&self.corners[index], ray, from, r.tmax) {
                Some((t, weights)) if sees(&self.surfaces[index], t) => {
                    barycentric = (index, weights);
                    t
                }
                _ => f32::INFINITY,
            }
        });
        found.t.is_finite().then(|| self.describe(ray, found.t, barycentric.0, barycentric.1))
    }

    /// A hit of a scaled ray, in the world.
    fn describe(&self, ray: Ray, distance: f32, index: usize, weights: [f32; 3]) -> Hit {
        let (corners, surface) = (self.corners[index], &self.surfaces[index]);
        let mix = |v: [Vec3; 3]| weights[0] * v[0] + weights[1] * v[1] + weights[2] * v[2];
        let normal = mix(surface.normals).normalize();
        // The geometric side decides, so that a shading normal that tips over at a silhouette does not turn the surface.
        let [a, b, c] = corners;
        let face = (b - a).cross(c - a);
        let towards_normal = if face.dot(normal) >= 0.0 { face } else { -face };
        let front = towards_normal.dot(ray.direction) <= 0.0;
        Hit {
            object: surface.object,
            position: mix(corners) / self.scale,
            distance: distance / self.scale,
            normal: if front { normal } else { -normal },
            face_normal: if front { towards_normal } else { -towards_normal }.normalize(),
            front,
        }
    }
}

/// The power of two that brings half the size of a scene's bounds, metres, to between 4,096 and 8,192: far more than what the
/// hierarchy loses, also compared with the offset of rays.
fn unit_scale(half_size: Vec3) -> f32 {
    let exponent = half_size.max_element().max(f32::MIN_POSITIVE).log2().floor() as i32;
    2f32.powi((12 - exponent).clamp(-126, 126))
}

/// Part of a distance by which rays towards a point end before it: more than what is lost by rounding.
const END_SLACK: f32 = 1e-4;

/// How far off a surface rays start in a scene with these bounds: more than what is lost by rounding.
fn offset(low: Vec3, high: Vec3) -> f32 {
    let farthest = low.abs().max(high.abs()).max_element();
    (1e-5 * (high - low).length()).max(4.0 * f32::EPSILON * farthest)
}

/// Möller–Trumbore with inclusive edges, so that a ray through a shared edge meets one triangle or both, never neither:
/// distance and barycentric weights.
#[inline(always)]
fn intersect([a, b, c]: &[Vec3; 3], ray: Ray, from: f32, to: f32) -> Option<(f32, [f32; 3])> {
    const SLACK: f32 = 1e-6;
    let (ab, ac) = (*b - *a, *c - *a);
    let p = ray.direction.cross(ac);
    let determinant = ab.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let inverse = 1.0 / determinant;
    let s = ray.origin - *a;
    let u = s.dot(p) * inverse;
    if !(-SLACK..=1.0 + SLACK).contains(&u) {
        return None;
    }
    let q = s.cross(ab);
    let v = ray.direction.dot(q) * inverse;
    if v < -SLACK || u + v > 1.0 + SLACK {
        return None;
    }
    let t = ac.dot(q) * inverse;
    (t > from && t < to).then_some((t, [1.0 - u - v, u, v]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shapes::{Shape, Sphere};

    /// A unit sphere, scaled.
    fn sphere(scale: f32) -> Tracer {
        let unit = Shape::Sphere(Sphere { radius: 1.0 }).mesh().unwrap();
        let positions = unit.positions().iter().map(|p| scale * *p).collect();
        let mesh = Mesh::new("sphere", positions, unit.normals().to_vec(), unit.triangles().to_vec()).unwrap().0;
        Tracer::of_meshes([(&mesh, true)].into_iter())
    }

    #[test]
    fn scenes_of_every_scale_stop_the_same_rays() {
        for scale in [1e-6, 1e-4, 1e-2, 1.0, 1e3, 1e6, 9e8] {
            let tracer = sphere(scale);
            let mut hits = 0;
            for k in 0..1000 {
                let turn = k as f32 * 2.4;
                let radius = 0.98 * (k as f32 / 999.0).sqrt();
                let origin = scale * Vec3::new(radius * turn.cos(), radius * turn.sin(), 3.0);
                let hit = tracer.secondary_hit(Ray { origin, direction: Vec3::NEG_Z });
                let on_sphere = |hit: Hit| (hit.position.length() / scale - 1.0).abs() < 1e-3 && hit.normal.is_finite();
                hits += usize::from(hit.is_some_and(on_sphere));
                assert!(tracer.is_blocked(Ray { origin, direction: Vec3::NEG_Z }), "{scale}: ray {k}");
            }
            assert_eq!(hits, 1000, "scale {scale}");
        }
    }
}
