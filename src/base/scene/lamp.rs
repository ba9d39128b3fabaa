//! Lamps: lights in the scene, at a finite distance.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::{Mesh, Object, Sides, Specular};
use crate::image::RgbImage;

/// A light at a finite distance: a sphere that looks like a disc of even radiance from everywhere, or a spotlight.
///
/// Its radiant intensity is I(ω) = intensity · beam(ω). Seen from x it is a disc of the sphere's radius ρ around its position, of radiance
/// I(ω) / πρ², ω being the direction from the lamp to x. So the irradiance on a surface that faces it from a distance r is I(ω) / r²,
/// whatever its radius. Lamps throw no shadows.
#[derive(Clone, Debug, PartialEq)]
pub struct Lamp {
    /// The name in the scene file, for messages and animations.
    pub name: String,
    /// Its centre, metres.
    pub position: Vec3,
    /// ρ, metres, at least [`Self::MIN_RADIUS`]: a point light is a very small sphere.
    pub radius: f32,
    /// Radiant intensity, W/sr; of a spotlight where its beam is brightest.
    pub intensity: Vec3,
    /// The beam of a spotlight; `None`: it shines in all directions alike.
    pub beam: Option<Beam>,
    /// It is so far away that its rays are parallel: see [`Self::distant`].
    pub is_distant: bool,
}

/// Directional light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sunlight {
    /// Unit direction towards it.
    pub towards: Vec3,
    /// On a surface that faces it, W/m².
    pub irradiance: Vec3,
    /// Standard deviation of its radiance, an even disc of twice that radius; radians.
    pub sigma_rad: f32,
}

/// The beam of a spotlight: a cone, or the image of a slide.
#[derive(Clone, Debug, PartialEq)]
pub struct Beam {
    /// Along the axis, away from the lamp; unit length.
    pub direction: Vec3,
    /// Up in the slide: unit length, perpendicular to the direction.
    pub up: Vec3,
    /// From the axis to where the beam ends or, with a slide, to its upper edge; radians, less than a right angle.
    pub half_angle_rad: f32,
    /// The part of the half angle over which a cone fades at its edge, from 0 to 1.
    pub softness: f32,
    /// An image that is projected, with its first row at the top; a factor on the intensity.
    pub slide: Option<Slide>,
}

/// The image that a spotlight projects. Slides are equal if they share their pixels.
#[derive(Clone, Debug)]
pub struct Slide(pub Arc<RgbImage>);

impl PartialEq for Slide {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Sunlight {
    /// The least standard deviation but 0, radians.
    pub const MIN_SIGMA_RAD: f32 = 1e-6;
}

impl Lamp {
    /// The least radius, metres.
    pub const MIN_RADIUS: f32 = 1e-4;
    /// The largest radiance, W/(m²·sr).
    pub const MAX_RADIANCE: f32 = 1e24;

    /// How many times farther away directional lights are than the scene is large, from the origin: rays are parallel to 10⁻⁴ rad.
    const DISTANCE: f32 = 1e4;

    /// A directional light: a lamp so far from a scene, whose points are at most `extent` metres from the origin, that its rays are parallel.
    pub fn distant(name: String, light: &Sunlight, extent: f32) -> Self {
        let distance = Self::DISTANCE * extent.max(1e-3);
        let radius = (2.0 * light.sigma_rad * distance).max(Self::MIN_RADIUS);
        let intensity = light.irradiance * distance * distance;
        Self { name, position: distance * light.towards, radius, intensity, beam: None, is_distant: true }
    }

    /// What a directional light was made from; `None` of other lamps.
    pub fn sunlight(&self) -> Option<Sunlight> {
        let distance = self.position.length();
        self.is_distant.then(|| Sunlight {
            towards: self.position / distance,
            irradiance: self.intensity / (distance * distance),
            sigma_rad: if self.radius > Self::MIN_RADIUS { 0.5 * self.radius / distance } else { 0.0 },
        })
    }

    /// Turns a directional light, unless there is no such direction.
    pub fn turn_towards(&mut self, direction: Vec3) {
        if let Some(towards) = direction.try_normalize() {
            self.position = self.position.length() * towards;
        }
    }

    /// Radiant intensity in a unit direction away from it, W/sr.
    pub fn intensity_towards(&self, direction: Vec3) -> Vec3 {
        self.beam.as_ref().map_or(self.intensity, |beam| self.intensity * beam.transmittance(direction))
    }

    /// Radiance of its disc as it is seen from a point, W/(m²·sr).
    pub fn radiance_at(&self, point: Vec3) -> Vec3 {
        self.intensity_towards((point - self.position).normalize_or_zero()) / (PI * self.radius * self.radius)
    }

    /// The same where its beam is brightest, before the slide.
    pub fn max_radiance_of_disc(&self) -> Vec3 {
        self.intensity / (PI * self.radius * self.radius)
    }

    /// Irradiance on a surface that faces it, at a point, W/m².
    pub fn irradiance_at(&self, point: Vec3) -> Vec3 {
        let away = point - self.position;
        let squared = away.length_squared().max(self.radius * self.radius);
        self.intensity_towards(away.normalize_or_zero()) / squared
    }

    /// The largest radiance of any channel, seen from anywhere, W/(m²·sr).
    pub fn max_radiance(&self) -> f32 {
        let slide = self.beam.as_ref().and_then(|beam| beam.slide.as_ref());
        let brightest = slide.map_or(1.0, |slide| slide.0.pixels.as_flattened().iter().copied().fold(0.0, f32::max));
        self.intensity.max_element() * brightest / (PI * self.radius * self.radius)
    }

    /// The mirror or interface that encloses it with a side on which it casts nothing, so that its light is lost.
    pub(super) fn lost_within<'a>(&self, objects: &'a [Object]) -> Option<&'a Object> {
        let encloses = |object: &&Object| {
            let outward = match object.specular() {
                None => return false,
                Some(Specular::Refractor(_)) => 1.0,
                Some(Specular::Reflector(reflector)) => match reflector.sides {
                    Sides::Front => 1.0,
                    Sides::Back => -1.0,
                    Sides::Both => return false,
                },
            };
            outward * winding_number(&object.mesh_in_world(), self.position) > 0.99
        };
        objects.iter().find(encloses)
    }
}

impl Beam {
    /// The factor on the intensity in a unit direction away from the lamp.
    pub fn transmittance(&self, direction: Vec3) -> Vec3 {
        let along = direction.dot(self.direction);
        if along <= 0.0 {
            return Vec3::ZERO;
        }
        let Some(slide) = &self.slide else {
            let angle = direction.cross(self.direction).length().atan2(along);
            let from_edge = (self.half_angle_rad - angle) / (self.softness * self.half_angle_rad).max(1e-6);
            let t = from_edge.clamp(0.0, 1.0);
            return Vec3::splat(t * t * (3.0 - 2.0 * t));
        };
        let right = self.direction.cross(self.up);
        let scale = 1.0 / (along * self.half_angle_rad.tan());
        slide.at(Vec2::new(direction.dot(right), direction.dot(self.up)) * scale)
    }
}

impl Slide {
    /// The image at a place, bilinear; the upper edge is at y = 1, the right one at x = width / height. Black outside.
    pub fn at(&self, place: Vec2) -> Vec3 {
        let image = &*self.0;
        let (width, height) = (image.width as f32, image.height as f32);
        let at = Vec2::new(0.5 * (place.x * height + width), 0.5 * (1.0 - place.y) * height);
        if !(at.x >= 0.0 && at.x <= width && at.y >= 0.0 && at.y <= height) {
            return Vec3::ZERO;
        }
        let at = (at - 0.5).max(Vec2::ZERO);
        let (low, part) = (at.floor(), at - at.floor());
        let pixel = |x: f32, y: f32| {
            let (x, y) = ((x as usize).min(image.width - 1), (y as usize).min(image.height - 1));
            Vec3::from_array(image.pixels[y * image.width + x])
        };
        let row = |y: f32| pixel(low.x, y).lerp(pixel(low.x + 1.0, y), part.x);
        row(low.y).lerp(row(low.y + 1.0), part.y)
    }
}

/// The winding number of a mesh around a point, from solid angles (van Oosterom and Strackee 1983): 1 inside a closed mesh whose normals
/// point outwards.
fn winding_number(mesh: &Mesh, point: Vec3) -> f64 {
    let solid_angle = |triangle: usize| {
        let [a, b, c] = mesh.corners(triangle).map(|corner| (corner - point).as_dvec3());
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        let outward: glam::DVec3 = mesh.corner_normals(triangle).iter().map(|n| n.as_dvec3()).sum();
        // Corners may be in either order.
        2.0 * outward.dot(a).signum() * a.dot(b.cross(c)).abs().atan2(below)
    };
    (0..mesh.triangles().len()).map(solid_angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shapes::{Ring, Shape, Sphere};

    fn beam(softness: f32, slide: Option<Slide>) -> Beam {
        Beam { direction: Vec3::NEG_Y, up: Vec3::Z, half_angle_rad: 0.5, softness, slide }
    }

    #[test]
    fn cones_fade_at_their_edges() {
        let towards = |beam: &Beam, angle: f32| beam.transmittance(Vec3::new(angle.sin(), -angle.cos(), 0.0)).x;
        let hard = beam(0.0, None);
        assert_eq!([0.0, 0.49, 0.51, 2.0].map(|angle| towards(&hard, angle)), [1.0, 1.0, 0.0, 0.0]);
        let soft = beam(0.5, None);
        assert_eq!(towards(&soft, 0.2), 1.0);
        assert!((towards(&soft, 0.375) - 0.5).abs() < 1e-4);
    }

    #[test]
    fn slides_are_upright() {
        let pixels = vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]];
        let slide = Slide(Arc::new(RgbImage { width: 2, height: 2, pixels }));
        let beam = beam(0.0, Some(slide));
        let right = beam.direction.cross(beam.up);
        let at = |x: f32, y: f32| {
            let place = 0.5f32.tan() * (x * right + y * beam.up);
            beam.transmittance((beam.direction + place).normalize())
        };
        let corners = [(-0.9, 0.9), (0.9, 0.9), (-0.9, -0.9), (0.9, -0.9)].map(|(x, y)| at(x, y));
        assert_eq!(corners, [Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE]);
        assert_eq!(at(1.1, 0.0), Vec3::ZERO);
        assert!((at(0.0, 0.0) - Vec3::splat(0.5)).length() < 1e-3);
    }

    #[test]
    fn meshes_enclose_what_is_inside() {
        let ball = Shape::Sphere(Sphere::of_radius(0.5)).mesh().unwrap();
        assert!((winding_number(&ball, Vec3::new(0.1, 0.3, 0.0)) - 1.0).abs() < 1e-5);
        assert!(winding_number(&ball, Vec3::X).abs() < 1e-5);
        // The ring is open, and its normals point inwards.
        let ring = Shape::Ring(Ring::default()).mesh().unwrap();
        assert!(winding_number(&ring, Vec3::ZERO) < 0.0);
    }
}
