//! Rays against the scene's triangles, through a BVH from `obvhs`.

use std::fmt;

use glam::Vec3;
use obvhs::BvhBuildParams;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh};
use obvhs::ray::RayHit;
use obvhs::triangle::Triangle;

use crate::scene::{Ray, Scene};

/// What a ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hit {
    pub object: u32,
    pub position: Vec3,
    /// Interpolated unit normal, turned towards the ray's origin.
    pub normal: Vec3,
    /// The ray came from the side that the mesh's normals point to.
    pub front: bool,
}

/// All triangles of a scene.
pub(super) struct Tracer {
    triangles: Vec<TraceTriangle>,
    bvh: CwBvh,
    camera_visible: Vec<bool>,
    /// Rays start this far off a surface, metres.
    offset: f32,
}

struct TraceTriangle {
    corners: [Vec3; 3],
    normals: [Vec3; 3],
    object: u32,
}

impl fmt::Debug for Tracer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Tracer({} triangles)", self.triangles.len())
    }
}

impl Tracer {
    pub fn new(scene: &Scene) -> Self {
        let mut triangles = Vec::new();
        for (object, o) in scene.objects.iter().enumerate() {
            for t in 0..o.mesh.triangles().len() {
                let (corners, normals) = (o.mesh.corners(t), o.mesh.corner_normals(t));
                triangles.push(TraceTriangle { corners, normals, object: object as u32 });
            }
        }
        let bounds: Vec<_> = triangles
            .iter()
            .map(|t| {
                let [v0, v1, v2] = t.corners.map(Into::into);
                Triangle { v0, v1, v2 }.aabb()
            })
            .collect();
        let bvh = build_cwbvh(&bounds, BvhBuildParams::fast_build(), &mut Default::default());
        let all = triangles.iter().flat_map(|t| t.corners);
        let (low, high) = all.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        let extent = if triangles.is_empty() { 0.0 } else { (high - low).length() };
        let camera_visible = scene.objects.iter().map(|o| o.camera_visible).collect();
        Self { triangles, bvh, camera_visible, offset: 1e-5 * extent }
    }

    /// The first thing that the camera sees along a ray.
    pub fn camera_hit(&self, ray: Ray) -> Option<Hit> {
        self.hit(ray, 0.0, |object| self.camera_visible[object as usize])
    }

    /// The first thing along a ray that leaves a surface.
    pub fn secondary_hit(&self, ray: Ray) -> Option<Hit> {
        self.hit(ray, self.offset, |_| true)
    }

    fn hit(&self, ray: Ray, from: f32, sees: impl Fn(u32) -> bool) -> Option<Hit> {
        if self.triangles.is_empty() {
            return None;
        }
        let traced = obvhs::ray::Ray::new(ray.origin.into(), ray.direction.into(), from, f32::INFINITY);
        let mut found = RayHit::none();
        let mut barycentric = (0, [0.0; 3]);
        self.bvh.ray_traverse(traced, &mut found, |r, index| {
            let id = self.bvh.primitive_indices[index] as usize;
            let triangle = &self.triangles[id];
            if !sees(triangle.object) {
                return f32::INFINITY;
            }
            match intersect(&triangle.corners, ray, from, r.tmax) {
                Some((t, weights)) => {
                    barycentric = (id, weights);
                    t
                }
                None => f32::INFINITY,
            }
        });
        found.t.is_finite().then(|| self.describe(ray, barycentric.0, barycentric.1))
    }

    fn describe(&self, ray: Ray, id: usize, weights: [f32; 3]) -> Hit {
        let triangle = &self.triangles[id];
        let mix = |v: [Vec3; 3]| weights[0] * v[0] + weights[1] * v[1] + weights[2] * v[2];
        let normal = mix(triangle.normals).normalize();
        // The geometric side decides, so that a shading normal that tips over at a silhouette does not turn the surface.
        let [a, b, c] = triangle.corners;
        let face = (b - a).cross(c - a);
        let towards_normal = if face.dot(normal) >= 0.0 { face } else { -face };
        let front = towards_normal.dot(ray.direction) <= 0.0;
        Hit {
            object: triangle.object,
            position: mix(triangle.corners),
            normal: if front { normal } else { -normal },
            front,
        }
    }
}

/// Möller–Trumbore with inclusive edges, so that a ray through a shared edge meets one triangle or both, never neither:
/// distance and barycentric weights.
fn intersect([a, b, c]: &[Vec3; 3], ray: Ray, from: f32, to: f32) -> Option<(f32, [f32; 3])> {
    let (ab, ac) = (*b - *a, *c - *a);
    let p = ray.direction.cross(ac);
    let determinant = ab.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let s = ray.origin - *a;
    let u = s.dot(p) / determinant;
    let q = s.cross(ab);
    let v = ray.direction.dot(q) / determinant;
    const SLACK: f32 = 1e-6;
    if u < -SLACK || v < -SLACK || u + v > 1.0 + SLACK {
        return None;
    }
    let t = ac.dot(q) / determinant;
    (t > from && t < to).then_some((t, [1.0 - u - v, u, v]))
}
