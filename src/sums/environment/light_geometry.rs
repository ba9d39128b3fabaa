//! Light geometry: surfaces that shine, as part of the environment (Wand and Straßer 2003, Sections 3.1 and 4.2). Knows meshes and
//! their radiance, but neither mirrors nor receivers.

use std::fmt;
use std::sync::Arc;

use glam::{Mat3, Vec3};

use super::cube::{CubeMap, FACES};
use super::rasterization::{FaceImage, ShiningMesh};
use crate::parallel;
use crate::scene::{Mesh, Ray};
use crate::tracing::Tracer;

/// Texels of a cube map across the radius of the smallest light, where there may be so many.
const TEXELS_PER_RADIUS: f32 = 6.0;
/// Face sizes that light geometry asks for. It is drawn every frame.
const CUBE_SIZES: std::ops::RangeInclusive<u32> = 256..=1024;

/// Emitters as they are seen from one point, which stands for the whole scene.
pub struct LightGeometry {
    /// In world space.
    tracer: Arc<Tracer>,
    /// Relative to the centre, in the world's axes.
    meshes: Vec<ShiningMesh>,
    /// By object; zero for those that do not shine.
    radiance: Vec<Vec3>,
    centre: Vec3,
    angular_radius_rad: f32,
}

impl fmt::Debug for LightGeometry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let triangles: usize = self.meshes.iter().map(|mesh| mesh.triangles.len()).sum();
        write!(f, "LightGeometry({triangles} triangles, seen from {})", self.centre)
    }
}

impl LightGeometry {
    /// Objects' numbers and their meshes in world space with their radiance, W/(m²·sr), seen from a point. The tracer knows no other
    /// objects.
    pub fn new(emitters: &[(u32, &Mesh, Vec3)], tracer: Arc<Tracer>, centre: Vec3) -> Self {
        let shining = |&(_, mesh, radiance): &(u32, &Mesh, Vec3)| ShiningMesh::new(mesh, radiance, centre);
        let radius = |(_, mesh, _): &(u32, &Mesh, Vec3)| {
            let (low, high) = bounds(mesh);
            let distance = (0.5 * (low + high)).distance(centre);
            // Of a ball, half the box's edge; of a plate, half the middle one.
            let mut edges = (high - low).to_array();
            edges.sort_by(f32::total_cmp);
            (0.5 * edges[1]).atan2(distance)
        };
        let mut by_object =
            vec![Vec3::ZERO; emitters.iter().map(|(object, ..)| *object as usize + 1).max().unwrap_or(0)];
        for (object, _, radiance) in emitters {
            by_object[*object as usize] = *radiance;
        }
        Self {
            tracer,
            meshes: emitters.iter().map(shining).collect(),
            radiance: by_object,
            centre,
            angular_radius_rad: emitters.iter().map(radius).fold(std::f32::consts::PI, f32::min),
        }
    }

    /// The largest radiance of a channel, W/(m²·sr).
    pub fn brightest(&self) -> f32 {
        self.radiance.iter().map(|radiance| radiance.max_element()).fold(0.0, f32::max)
    }

    /// That of the smallest emitter.
    pub(super) fn angular_radius_rad(&self) -> f32 {
        self.angular_radius_rad
    }

    /// The cube map's face size that resolves the smallest emitter, if it is not tiny. A power of two.
    pub fn cube_size(&self) -> u32 {
        // A face spans [−1, 1].
        let wanted = (2.0 * TEXELS_PER_RADIUS / self.angular_radius_rad.max(1e-3)).ceil() as u32;
        wanted.next_power_of_two().clamp(*CUBE_SIZES.start(), *CUBE_SIZES.end())
    }

    /// From where it is seen.
    pub fn centre(&self) -> Vec3 {
        self.centre
    }

    /// Radiance of what is seen first from the centre in a direction of the world; `None` where nothing shines.
    fn radiance(&self, direction_in_world: Vec3) -> Option<Vec3> {
        let hit = self.tracer.secondary_hit(Ray { origin: self.centre, direction: direction_in_world })?;
        Some(self.radiance[hit.object as usize])
    }
}

impl ShiningMesh {
    /// As it is seen from a point.
    fn new(mesh: &Mesh, radiance: Vec3, from: Vec3) -> Self {
        let (low, high) = bounds(mesh);
        let corners = |t: usize| mesh.corners(t).map(|p| p - from);
        Self {
            triangles: (0..mesh.triangles().len()).map(corners).collect(),
            radiance,
            centre: 0.5 * (low + high) - from,
            radius: 0.5 * low.distance(high),
        }
    }
}

fn bounds(mesh: &Mesh) -> (Vec3, Vec3) {
    let positions = mesh.positions().iter();
    positions.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)))
}

/// A cube map of an emitter alone, as it is seen from a point, in the world's axes; its edges are anti-aliased.
pub fn emitter_from(mesh: &Mesh, radiance: Vec3, viewpoint: Vec3, size: u32) -> CubeMap {
    let shining = [ShiningMesh::new(mesh, radiance, viewpoint)];
    let faces: Vec<FaceImage> = parallel::collect(FACES, &|face| FaceImage::draw(face, size, Mat3::IDENTITY, &shining));
    let black = CubeMap::from_texels(size, &vec![Vec3::ZERO; FACES * (size * size) as usize], true);
    black.with_base(|face, y, row| faces[face].blend(y, row))
}

/// Light geometry in front of an environment.
#[derive(Clone, Debug)]
pub struct LitBy {
    /// The geometry.
    pub geometry: Arc<LightGeometry>,
    /// Rotation of the environment behind it about +Y, counter-clockwise, radians.
    pub rotation_rad: f32,
    /// Factor on the radiance of the environment behind it.
    pub intensity: f32,
}

impl LitBy {
    /// Radiance from a direction in the environment's frame; `None` where only the environment shines.
    pub(super) fn radiance(&self, direction: Vec3) -> Option<Vec3> {
        self.geometry.radiance(Mat3::from_rotation_y(self.rotation_rad) * direction)
    }

    /// Draws the geometry over the environment's cube map, with a z-buffer; edges are anti-aliased.
    pub(super) fn draw(&self, background: &CubeMap) -> CubeMap {
        let world_from_environment = Mat3::from_rotation_y(self.rotation_rad);
        let size = background.size();
        let draw = |face| FaceImage::draw(face, size, world_from_environment, &self.geometry.meshes);
        let faces: Vec<FaceImage> = parallel::collect(FACES, &draw);
        background.with_base(|face, y, row| {
            for texel in row.iter_mut() {
                *texel = (self.intensity * texel.truncate()).extend(1.0);
            }
            faces[face].blend(y, row);
        })
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::TAU;

    use super::*;
    use crate::environment::{CubeSize, Environment, texel_solid_angle_sr};
    use crate::scene::Light;
    use crate::scene::shapes::{Plane, Shape, Sphere};
    use crate::tracing::SeenBy;

    fn ball(radius: f32, centre: Vec3) -> Mesh {
        let mesh = Shape::Sphere(Sphere::of_radius(radius)).mesh().unwrap();
        let placement = crate::scene::Transform { translate: centre, ..Default::default() };
        mesh.placed(&placement, "ball").unwrap().0
    }

    fn lit(emitters: &[(&Mesh, Vec3)], centre: Vec3, size: u32) -> Environment {
        let sky = Environment::new(&Light::Constant(Vec3::new(0.0, 0.0, 0.5)), CubeSize::Texels(size)).unwrap();
        let seen_by = SeenBy { camera: true, light: false, mirrored: false };
        let tracer = Tracer::of_emitters(None, emitters.iter().map(|(mesh, _)| (*mesh, seen_by)));
        let numbered: Vec<_> =
            (0..).zip(emitters).map(|(object, (mesh, radiance))| (object, *mesh, *radiance)).collect();
        let geometry = Arc::new(LightGeometry::new(&numbered, Arc::new(tracer), centre));
        sky.behind(LitBy { geometry, rotation_rad: 0.7, intensity: 2.0 })
    }

    /// ∫ L dω over the cube map's texels.
    fn power(cube: &CubeMap) -> Vec3 {
        let n = cube.size();
        let texel = |(k, t): (usize, &glam::Vec4)| {
            let k = k as u32 % (n * n);
            t.truncate() * texel_solid_angle_sr(n, k % n, k / n) as f32
        };
        cube.level(0).iter().enumerate().map(texel).sum()
    }

    /// A ball of radius R at a distance d covers 2π(1 − √(1 − R²/d²)) sr, wherever it lies on the cube.
    #[test]
    fn balls_have_the_solid_angle_of_their_caps() {
        let centre = Vec3::new(1.0, -2.0, 0.5);
        for towards in [Vec3::Y, Vec3::NEG_X, Vec3::new(1.0, 1.0, 0.02), Vec3::new(-1.0, 1.0, -0.98)] {
            for ratio in [0.05f32, 0.3, 0.8] {
                let mesh = ball(ratio * 7.0, centre + 7.0 * towards.normalize());
                let environment = lit(&[(&mesh, Vec3::X)], centre, 128);
                let expected = TAU * (1.0 - (1.0 - ratio * ratio).sqrt());
                let found = power(&environment.cube);
                // Facets lie a little within the ball.
                assert!((found.x / expected - 1.0).abs() < 0.01, "{towards} {ratio}: {} {expected}", found.x);
                let behind = 2.0 * 0.5 * (2.0 * TAU - found.x);
                assert!((found.z / behind - 1.0).abs() < 1e-3, "{towards} {ratio}: {} {behind}", found.z);
            }
        }
    }

    /// The nearest surface is seen; look-ups and texels agree, though the former trace rays and the latter are drawn.
    #[test]
    fn texels_show_what_rays_meet() {
        let centre = Vec3::new(0.2, 0.3, -0.1);
        let near = ball(0.5, centre + Vec3::new(0.3, 1.8, 0.4));
        let far = ball(1.5, centre + Vec3::new(0.3, 6.0, 0.4));
        let floor = Shape::Plane(Plane { size: [3.0, 5.0] }).mesh().unwrap();
        let environment = lit(
            &[(&far, Vec3::new(0.0, 4.0, 0.0)), (&near, Vec3::new(3.0, 0.0, 0.0)), (&floor, Vec3::ONE)],
            centre,
            64,
        );
        let (mut agreed, mut checked) = (0, [0; 4]);
        for (k, texel) in environment.cube.level(0).iter().enumerate() {
            let (face, k) = (k / 4096, k % 4096);
            let place = |i: usize| (2.0 * i as f32 + 1.0) / 64.0 - 1.0;
            let d = crate::environment::face_direction(face, place(k % 64), place(k / 64)).normalize();
            let seen = environment.radiance.radiance(d);
            agreed += usize::from(seen.abs_diff_eq(texel.truncate(), 1e-5));
            let kinds = [Vec3::new(0.0, 4.0, 0.0), Vec3::new(3.0, 0.0, 0.0), Vec3::ONE, Vec3::new(0.0, 0.0, 1.0)];
            kinds.iter().zip(&mut checked).for_each(|(kind, count)| *count += usize::from(seen == *kind));
        }
        assert!(checked.iter().all(|count| *count > 30), "{checked:?}");
        // All but the texels that edges cross.
        assert!(agreed > 24_576 - 700, "{agreed}");
        assert_eq!(environment.radiance.background(Vec3::Y), Vec3::new(0.0, 0.0, 1.0));
    }

    #[test]
    fn a_shell_around_the_centre_is_seen_in_all_directions() {
        let shell = ball(3.0, Vec3::new(0.5, 0.2, -0.4));
        let cube = lit(&[(&shell, Vec3::new(1.0, 2.0, 3.0))], Vec3::ZERO, 32).cube;
        for level in 0..cube.level_count() {
            assert!(cube.level(level).iter().all(|t| t.abs_diff_eq(glam::Vec4::new(1.0, 2.0, 3.0, 1.0), 1e-5)));
        }
    }
}
