//! Rays against the scene's triangles, through a BVH from `obvhs`. Knows meshes, but neither light nor samples.

mod camera;
mod construction;
mod packet;
mod stackless;

use std::fmt;

use glam::Vec3;
use obvhs::bvh2::Bvh2;
use obvhs::ray::RayHit;

use self::packet::{HitFilter, PacketHits, any_hit, nearest_hits};
use crate::lanes::{ALL, F, LANES, Simd, SimdBase, V3, bits, dispatch, level, splat3};
use crate::scene::{Object, Ray};

pub use self::camera::CameraTracer;
pub use self::packet::RayPacket;
pub use self::stackless::{BottomLevel, Instance, TopLevel, unpacked_normal};

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

/// Which rays meet an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SeenBy {
    /// Those of the camera.
    pub camera: bool,
    /// All others. Light passes through emitters.
    pub light: bool,
    /// Those that mirrors show to the camera: they meet near emitters, too.
    pub mirrored: bool,
}

impl SeenBy {
    /// All rays.
    pub const ALL: Self = Self { camera: true, light: true, mirrored: true };

    /// All rays but those of the camera, or none.
    pub fn all_but_camera(is_met: bool) -> Self {
        Self { camera: false, light: is_met, mirrored: is_met }
    }

    /// How many bits these are.
    pub const BITS: u32 = 3;

    /// One bit for the camera, above it one for light, then one for mirrors.
    pub fn bits(self) -> u32 {
        u32::from(self.camera) | u32::from(self.light) << 1 | u32::from(self.mirrored) << 2
    }

    /// Which rays meet an object of a scene.
    pub fn of(object: &Object) -> Self {
        let light = object.emitter.is_none();
        Self { camera: object.camera_visible, light, mirrored: light || object.is_near_light() }
    }
}

/// All triangles of a scene.
pub struct Tracer {
    /// In the order of the hierarchy's leaves. Scaled, so that all scenes are of about one size, far from the limits of floats.
    corners: Vec<[Vec3; 3]>,
    /// In the same order.
    surfaces: Vec<TriangleSurface>,
    /// Units per metre; a power of two, which rounds nothing.
    scale: f32,
    bvh: Bvh2,
    /// What rays cost when the hierarchy was built, see [`construction`].
    cost: f32,
    /// By object; none of those that rays pass.
    triangle_counts: Vec<usize>,
    /// By object.
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
    /// The first thing that the camera sees along a ray.
    pub fn camera_hit(&self, ray: Ray) -> Option<Hit> {
        self.hit(ray, 0.0, |surface, _| self.camera_visible[surface.object as usize])
    }

    /// The first things that the camera sees along sixteen rays, in the lanes asked for.
    pub fn camera_hits(&self, rays: &[Ray; LANES], lanes: u32) -> [Option<Hit>; LANES] {
        self.nearest(rays, lanes, 0.0, &InvisibleToCamera(self))
    }

    /// The first things along sixteen rays that leave surfaces, in the lanes asked for.
    pub fn secondary_hits(&self, rays: &[Ray; LANES], lanes: u32) -> [Option<Hit>; LANES] {
        self.nearest(rays, lanes, self.offset, &NoFilter)
    }

    fn nearest(&self, rays: &[Ray; LANES], lanes: u32, start: f32, filter: &impl HitFilter) -> [Option<Hit>; LANES] {
        if self.corners.is_empty() {
            return [const { None }; LANES];
        }
        let rays = rays.map(|ray| self.scaled(ray));
        let packet = RayPacket {
            origins: [0, 1, 2].map(|axis| rays.map(|ray| ray.origin[axis])),
            directions: [0, 1, 2].map(|axis| rays.map(|ray| ray.direction[axis])),
            ends: [f32::INFINITY; LANES],
            lanes,
        };
        let tree = (&self.bvh, &self.corners[..]);
        let hits = dispatch!(level(), simd => nearest_hits(simd, tree, &packet, start, filter));
        std::array::from_fn(|lane| self.hit_in_lane(&hits, lane, rays[lane]))
    }

    /// The hit of a scaled ray of a packet, in the world.
    fn hit_in_lane(&self, hits: &PacketHits, lane: usize, ray: Ray) -> Option<Hit> {
        let [u, v] = hits.weights.map(|weight| weight[lane]);
        (hits.lanes >> lane & 1 == 1)
            .then(|| self.describe(ray, hits.distances[lane], hits.triangles[lane] as usize, [1.0 - u - v, u, v]))
    }

    /// The first thing along a ray that leaves a surface.
    pub fn secondary_hit(&self, ray: Ray) -> Option<Hit> {
        self.hit(ray, self.offset, |_, _| true)
    }

    /// The first things that a piece of a surface sees in sixteen directions, in the lanes asked for; itself it does not see.
    pub fn seen_by(&self, piece: &Piece, directions: &[Vec3; LANES], lanes: u32) -> [Option<Hit>; LANES] {
        if self.corners.is_empty() {
            return [const { None }; LANES];
        }
        let packet = self.packet_of_piece(piece, directions, [f32::INFINITY; LANES], lanes);
        let (tree, itself) = ((&self.bvh, &self.corners[..]), SelfIntersection::new(self, piece));
        let hits = dispatch!(level(), simd => nearest_hits(simd, tree, &packet, self.offset, &itself));
        std::array::from_fn(|lane| {
            self.hit_in_lane(&hits, lane, Ray { origin: self.scale * piece.position, direction: directions[lane] })
        })
    }

    /// The lanes, of those asked for, in which a piece of a surface sees nothing in a unit direction up to a distance in metres;
    /// itself it does not see.
    pub(crate) fn unoccluded_lanes(
        &self,
        piece: &Piece,
        directions: &[Vec3; LANES],
        distances: &[f32; LANES],
        lanes: u32,
    ) -> u32 {
        if self.corners.is_empty() {
            return lanes;
        }
        // What lies at the end does not count.
        let ends = distances.map(|distance| self.scale * distance * (1.0 - END_SLACK) - self.offset);
        let packet = self.packet_of_piece(piece, directions, ends, lanes);
        let (tree, itself) = ((&self.bvh, &self.corners[..]), SelfIntersection::new(self, piece));
        lanes & !dispatch!(level(), simd => any_hit(simd, tree, &packet, self.offset, &itself))
    }

    /// The lanes in which anything lies on rays that leave surfaces, in unit directions up to their ends, metres.
    pub fn occluded_lanes(&self, rays: &RayPacket) -> u32 {
        if self.corners.is_empty() {
            return 0;
        }
        let origins = rays.origins.map(|axis| axis.map(|x| self.scale * x));
        let ends = rays.ends.map(|distance| self.scale * distance * (1.0 - END_SLACK) - self.offset);
        let scaled = RayPacket { origins, ends, ..*rays };
        let tree = (&self.bvh, &self.corners[..]);
        dispatch!(level(), simd => any_hit(simd, tree, &scaled, self.offset, &NoFilter))
    }

    /// The lanes in which anything lies in a unit direction from a surface, up to a distance in metres.
    pub fn hidden_lanes(&self, from: Vec3, directions: &[Vec3; LANES], distance: f32) -> u32 {
        if self.corners.is_empty() {
            return 0;
        }
        let rays = RayPacket {
            origins: (self.scale * from).to_array().map(|x| [x; LANES]),
            directions: [0, 1, 2].map(|axis| directions.map(|d| d[axis])),
            ends: [self.scale * distance * (1.0 - END_SLACK) - self.offset; LANES],
            lanes: ALL,
        };
        let tree = (&self.bvh, &self.corners[..]);
        dispatch!(level(), simd => any_hit(simd, tree, &rays, self.offset, &NoFilter))
    }

    /// Rays from a piece, in units.
    fn packet_of_piece(&self, piece: &Piece, directions: &[Vec3; LANES], ends: [f32; LANES], lanes: u32) -> RayPacket {
        let origins = (self.scale * piece.position).to_array().map(|x| [x; LANES]);
        RayPacket { origins, directions: [0, 1, 2].map(|axis| directions.map(|d| d[axis])), ends, lanes }
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

/// The piece of a surface that rays leave. It is a little curved, and its middle may lie below its triangles.
struct SelfIntersection<'a> {
    surfaces: &'a [TriangleSurface],
    object: u32,
    /// 1 where it looks to the side that the mesh's normals point to, else -1.
    side: f32,
    /// Units.
    extent: f32,
}

impl<'a> SelfIntersection<'a> {
    fn new(tracer: &'a Tracer, piece: &Piece) -> Self {
        let side = if piece.front { 1.0 } else { -1.0 };
        Self { surfaces: &tracer.surfaces, object: piece.object, side, extent: tracer.scale * piece.extent }
    }
}

impl HitFilter for SelfIntersection<'_> {
    #[inline(always)]
    fn ignored<S: Simd>(&self, simd: S, triangle: usize, direction: V3<S>, distance: F<S>, hit: u32) -> u32 {
        let surface = &self.surfaces[triangle];
        if surface.object != self.object {
            return 0;
        }
        let normal = splat3(simd, self.side * surface.normals.iter().sum::<Vec3>());
        hit & bits(distance.simd_lt(self.extent)) & bits(direction.dot(normal).simd_gt(0.0))
    }
}

/// Hits on objects that the camera looks through.
struct InvisibleToCamera<'a>(&'a Tracer);

impl HitFilter for InvisibleToCamera<'_> {
    #[inline(always)]
    fn ignored<S: Simd>(&self, _: S, triangle: usize, _: V3<S>, _: F<S>, hit: u32) -> u32 {
        let object = self.0.surfaces[triangle].object;
        if self.0.camera_visible[object as usize] { 0 } else { hit }
    }
}

/// Accepts every hit.
struct NoFilter;

impl HitFilter for NoFilter {
    #[inline(always)]
    fn ignored<S: Simd>(&self, _: S, _: usize, _: V3<S>, _: F<S>, _: u32) -> u32 {
        0
    }
}

/// Part of a distance by which rays towards a point end before it: more than what is lost by rounding.
pub const END_SLACK: f32 = 1e-4;

/// Edges of triangles are inclusive by this much of a barycentric weight: rays from far away must not slip between small triangles, whose
/// weights suffer from cancellation.
pub const SLACK: f32 = 1e-4;

/// Möller–Trumbore with inclusive edges, so that a ray through a shared edge meets one triangle or both, never neither:
/// distance and barycentric weights.
#[inline(always)]
fn intersect([a, b, c]: &[Vec3; 3], ray: Ray, from: f32, to: f32) -> Option<(f32, [f32; 3])> {
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
    use crate::lanes::set_bits;
    use crate::scene::Mesh;
    use crate::scene::shapes::{Shape, Sphere};

    /// A unit sphere, scaled.
    fn sphere(scale: f32) -> Tracer {
        let unit = Shape::Sphere(Sphere::of_radius(1.0)).mesh().unwrap();
        let positions = unit.positions().iter().map(|p| scale * *p).collect();
        let mesh = Mesh::new("sphere", positions, unit.normals().to_vec(), unit.triangles().to_vec()).unwrap().0;
        Tracer::of_meshes([(&mesh, SeenBy::ALL)].into_iter())
    }

    /// The nearest of all triangles along a ray in units that a piece sees, without a hierarchy.
    fn nearest(tracer: &Tracer, ray: Ray, piece: Option<&Piece>, end: f32) -> Option<f32> {
        let is_own = |index: usize, distance: f32| {
            piece.is_some_and(|piece| {
                let surface = &tracer.surfaces[index];
                let side = if piece.front { 1.0 } else { -1.0 };
                let away = side * surface.normals.iter().sum::<Vec3>().dot(ray.direction) > 0.0;
                surface.object == piece.object && distance < tracer.scale * piece.extent && away
            })
        };
        (0..tracer.corners.len())
            .filter_map(|index| Some((index, intersect(&tracer.corners[index], ray, tracer.offset, end)?.0)))
            .filter(|&(index, distance)| !is_own(index, distance))
            .map(|(_, distance)| distance)
            .min_by(f32::total_cmp)
    }

    /// Packets find what each of their rays meets first of all triangles, whether they are coherent or not.
    #[test]
    fn packets_find_what_their_rays_meet() {
        let tracer = sphere(1.0);
        let piece = Piece { position: Vec3::new(0.0, 0.0, 0.99), object: 0, front: false, extent: 0.2 };
        let lanes = 0xbfff;
        let (mut seen, mut hidden, mut stopped) = (0, 0, 0);
        for (k, spread) in (0..60).flat_map(|k| [(k, 0.01f32), (k, 3.0)]) {
            let places: [Vec3; LANES] = std::array::from_fn(|lane| {
                let (sin, cos) = (k as f32 * 2.4 + spread * lane as f32 / LANES as f32).sin_cos();
                Vec3::new(cos, sin, 0.5 - 0.02 * k as f32) * (0.3 + 0.03 * k as f32)
            });
            let directions = places.map(|place| (place - piece.position).normalize());
            let distances = places.map(|place| place.distance(piece.position));
            let all = tracer.seen_by(&piece, &directions, lanes);
            let open = tracer.unoccluded_lanes(&piece, &directions, &distances, lanes);
            let blocked = tracer.occluded_lanes(&RayPacket {
                origins: [0, 1, 2].map(|axis| places.map(|place| place[axis])),
                directions: [0, 1, 2].map(|axis| directions.map(|d| d[axis])),
                ends: [f32::INFINITY; LANES],
                lanes,
            });
            assert!(all[14].is_none() && (open | blocked) & !lanes == 0);
            for lane in set_bits(lanes) {
                let ray = |origin: Vec3| Ray { origin: tracer.scale * origin, direction: directions[lane] };
                let expected = nearest(&tracer, ray(piece.position), Some(&piece), f32::INFINITY);
                let found = all[lane].map(|hit| hit.distance * tracer.scale);
                assert!(
                    expected.zip(found).map_or(expected == found, |(e, f)| (e - f).abs() < 1e-4 * e),
                    "{expected:?} {found:?}"
                );
                let end = tracer.scale * distances[lane] * (1.0 - END_SLACK) - tracer.offset;
                let is_open = nearest(&tracer, ray(piece.position), Some(&piece), end).is_none();
                assert_eq!(open >> lane & 1 == 1, is_open);
                let is_blocked = nearest(&tracer, ray(places[lane]), None, f32::INFINITY).is_some();
                assert_eq!(blocked >> lane & 1 == 1, is_blocked);
                (seen, hidden) = (seen + usize::from(found.is_some()), hidden + usize::from(!is_open));
                stopped += usize::from(is_blocked);
            }
        }
        assert!(seen > 500 && hidden > 100 && stopped > 100, "{seen} {hidden} {stopped}");
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

    /// Packets find what single rays do, in the lanes asked for alone, and look through what the camera does not see.
    #[test]
    fn packets_of_rays_find_what_single_rays_do() {
        let near = Shape::Sphere(Sphere::of_radius(0.4)).mesh().unwrap();
        let far = Shape::Sphere(Sphere::of_radius(1.0)).mesh().unwrap();
        let hidden = SeenBy::all_but_camera(true);
        let tracer = Tracer::of_meshes([(&near, hidden), (&far, SeenBy::ALL)].into_iter());
        let rays: [Ray; LANES] = std::array::from_fn(|lane| {
            let origin = Vec3::new(0.15 * lane as f32 - 1.1, 0.1, 3.0);
            Ray { origin, direction: Vec3::NEG_Z }
        });
        let lanes = 0b1111_1111_1101_1111;
        let (seen, met) = (tracer.camera_hits(&rays, lanes), tracer.secondary_hits(&rays, lanes));
        for lane in 0..LANES {
            let is_asked = lanes >> lane & 1 == 1;
            let single = [tracer.camera_hit(rays[lane]), tracer.secondary_hit(rays[lane])];
            for (packet, single) in [seen[lane], met[lane]].into_iter().zip(single) {
                let single = single.filter(|_| is_asked);
                assert_eq!(packet.map(|hit| hit.object), single.map(|hit| hit.object), "lane {lane}");
                if let (Some(packet), Some(single)) = (packet, single) {
                    assert!(packet.position.abs_diff_eq(single.position, 1e-4), "lane {lane}");
                }
            }
            assert!(seen[lane].is_none_or(|hit| hit.object == 1));
        }
    }
}
