//! Built-in shapes as meshes with exact normals.
//!
//! The vertices lie on the ideal surface and carry its normal there; triangles are counter-clockwise
//! seen from the side that the normals point to.

mod cuboid;
mod dimensions;
mod disco_ball;
mod height_field;
mod knot;
mod lathe;
mod parametric;
mod plane;
mod sheet;
mod sphere;
mod spoon;
mod tiles;
mod water;

use glam::Vec3;
use serde::Deserialize;

use super::mesh::Mesh;

/// A built-in shape and its dimensions, metres.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shape {
    /// A thin vertical cylindrical wall that stands on y = 0; normals point inwards.
    Ring(Ring),
    /// A ring with a thick wall and rounded edges; normals point outwards.
    SolidRing(SolidRing),
    /// A spoon along X that lies on y = 0, bowl up; normals point outwards.
    Spoon(Spoon),
    /// A cup without a handle that stands on y = 0; normals point out of the wall, on the inside too.
    Cup(Cup),
    /// A sphere about the origin.
    Sphere(Sphere),
    /// An ellipsoid about the origin.
    Ellipsoid(Ellipsoid),
    /// A box about the origin, with sharp edges; normals point outwards.
    Box(Cuboid),
    /// A torus about +Y around the origin; normals point outwards.
    Torus(Torus),
    /// A tube around a torus knot about +Y; normals point outwards.
    Knot(Knot),
    /// A sphere made of flat mirror tiles.
    DiscoBall(DiscoBall),
    /// A rectangle in the plane y = 0, normal +Y.
    Plane(Plane),
    /// A rectangle in waves about the plane y = 0, its front above.
    Sheet(Sheet),
    /// The surface of water in a basin, in waves about the plane y = 0, its front above.
    Water(Water),
    /// A rectangle of tiles in the plane y = 0, normal +Y, with gaps between them.
    Tiles(Tiles),
    /// What lies between such tiles, in the same plane.
    Joints(Tiles),
}

/// Dimensions of [`Shape::Ring`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Ring {
    /// Radius.
    pub radius: f32,
    /// Height.
    pub height: f32,
}

/// Dimensions of [`Shape::SolidRing`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SolidRing {
    /// Radius of the wall's middle.
    pub radius: f32,
    /// Height.
    pub height: f32,
    /// Thickness of the wall.
    pub thickness: f32,
}

/// Dimensions of [`Shape::Spoon`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Spoon {
    /// From tip to tip.
    pub length: f32,
    /// Width of the bowl.
    pub width: f32,
    /// Depth of the bowl.
    pub depth: f32,
    /// Thickness of the sheet.
    pub thickness: f32,
}

/// Dimensions of [`Shape::Cup`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Cup {
    /// Outer radius at the rim.
    pub radius: f32,
    /// Height.
    pub height: f32,
    /// Thickness of the wall.
    pub thickness: f32,
}

/// Dimensions of [`Shape::Sphere`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sphere {
    /// Radius.
    pub radius: f32,
    /// Parts of the edges of the icosahedron that it is made from, 1 to 128: it has 20 times their square of triangles. Lamps need few.
    pub divisions: u32,
}

impl Sphere {
    /// A sphere fine enough for a mirror.
    pub fn of_radius(radius: f32) -> Self {
        Self { radius, ..Self::default() }
    }
}

/// Dimensions of [`Shape::Ellipsoid`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Ellipsoid {
    /// Half of its extent along each axis.
    pub radii: [f32; 3],
    /// As of a [`Sphere`].
    pub divisions: u32,
}

/// Dimensions of [`Shape::Box`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Cuboid {
    /// Extent along each axis.
    pub size: [f32; 3],
}

/// Dimensions of [`Shape::Knot`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Knot {
    /// Radius of the circle around which the knot winds.
    pub radius: f32,
    /// Radius of the tube.
    pub tube: f32,
    /// How often it goes around the axis, and around the circle, before it closes: without a common divisor.
    pub turns: [u32; 2],
}

/// Dimensions of [`Shape::Torus`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Torus {
    /// Radius of the circle inside the tube.
    pub radius: f32,
    /// Radius of the tube.
    pub tube: f32,
}

/// Dimensions of [`Shape::DiscoBall`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DiscoBall {
    /// Radius of the sphere on which the tiles' corners lie.
    pub radius: f32,
    /// Rows of tiles from pole to pole.
    pub rows: u32,
    /// The joint between tiles, as a share of a tile's edges; from 0 to 0.5. What lies behind it shows through.
    pub joint: f32,
}

/// Dimensions of [`Shape::Plane`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Plane {
    /// Extent along X and Z.
    pub size: [f32; 2],
}

/// Dimensions of [`Shape::Sheet`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sheet {
    /// Extent along X and Z.
    pub size: [f32; 2],
    /// Height of the waves above y = 0, at most.
    pub amplitude: f32,
    /// From crest to crest.
    pub wavelength: f32,
    /// How far the waves have travelled, in degrees: 360 bring them back to where they were.
    pub phase_deg: f32,
}

/// Dimensions of [`Shape::Water`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Water {
    /// Extent along X and Z.
    pub size: [f32; 2],
    /// Root mean square of the waves' height.
    pub amplitude: f32,
    /// Length of the dominant waves, which travel along X.
    pub wavelength: f32,
    /// How deep the water is.
    pub depth: f32,
    /// Seconds until the waves are back where they were. The longer, the more exactly they have their natural speeds.
    pub period: f32,
    /// How far they are, in degrees: 360 are a period.
    pub phase_deg: f32,
}

/// Dimensions of [`Shape::Tiles`] and [`Shape::Joints`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Tiles {
    /// Extent along X and Z.
    pub size: [f32; 2],
    /// Tiles along X and Z.
    pub count: [u32; 2],
    /// Between neighbouring tiles.
    pub gap: f32,
}

impl Default for Ring {
    fn default() -> Self {
        Self { radius: 1.0, height: 0.5 }
    }
}

impl Default for SolidRing {
    fn default() -> Self {
        Self { radius: 1.0, height: 0.5, thickness: 0.1 }
    }
}

impl Default for Spoon {
    fn default() -> Self {
        Self { length: 2.0, width: 0.44, depth: 0.12, thickness: 0.03 }
    }
}

impl Default for Cup {
    fn default() -> Self {
        Self { radius: 0.5, height: 0.6, thickness: 0.03 }
    }
}

impl Default for Sphere {
    fn default() -> Self {
        Self { radius: 1.0, divisions: 48 }
    }
}

impl Default for Ellipsoid {
    fn default() -> Self {
        Self { radii: [1.0, 0.6, 0.8], divisions: 48 }
    }
}

impl Default for Cuboid {
    fn default() -> Self {
        Self { size: [1.0; 3] }
    }
}

impl Default for Knot {
    fn default() -> Self {
        Self { radius: 1.0, tube: 0.2, turns: [2, 3] }
    }
}

impl Default for Torus {
    fn default() -> Self {
        Self { radius: 1.0, tube: 0.25 }
    }
}

impl Default for DiscoBall {
    fn default() -> Self {
        Self { radius: 1.0, rows: 16, joint: 0.0 }
    }
}

impl Default for Plane {
    fn default() -> Self {
        Self { size: [1.0, 1.0] }
    }
}

impl Default for Sheet {
    fn default() -> Self {
        Self { size: [1.0, 1.0], amplitude: 0.03, wavelength: 0.6, phase_deg: 0.0 }
    }
}

impl Default for Tiles {
    fn default() -> Self {
        Self { size: [2.0, 2.0], count: [10, 10], gap: 0.01 }
    }
}

impl Default for Water {
    fn default() -> Self {
        Self { size: [4.0, 4.0], amplitude: 0.01, wavelength: 0.8, depth: 1.0, period: 12.0, phase_deg: 0.0 }
    }
}

impl Shape {
    /// The shape as a mesh in object space. The error says which dimension is out of its range.
    pub fn mesh(&self) -> Result<Mesh, String> {
        self.check()?;
        let parts = match self {
            Self::Ring(ring) => lathe::ring(ring),
            Self::SolidRing(ring) => lathe::solid_ring(ring),
            Self::Cup(cup) => lathe::cup(cup),
            Self::Spoon(spoon) => spoon::spoon(spoon),
            Self::Sphere(sphere) => sphere::sphere(sphere),
            Self::Ellipsoid(ellipsoid) => sphere::ellipsoid(ellipsoid),
            Self::Box(cuboid) => cuboid::cuboid(cuboid),
            Self::Torus(torus) => lathe::torus(torus),
            Self::Knot(knot) => knot::knot(knot),
            Self::DiscoBall(ball) => disco_ball::disco_ball(ball),
            Self::Plane(plane) => plane::plane(plane),
            Self::Sheet(sheet) => sheet::sheet(sheet),
            Self::Water(water) => water::water(water),
            Self::Tiles(tiles) => tiles::tiles(tiles),
            Self::Joints(tiles) => tiles::joints(tiles),
        };
        let (mesh, _) =
            Mesh::new(self.name(), parts.positions, parts.normals, parts.triangles).map_err(|e| e.to_string())?;
        Ok(mesh)
    }

    /// The shape's name in scene files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Ring(_) => "ring",
            Self::SolidRing(_) => "solid-ring",
            Self::Spoon(_) => "spoon",
            Self::Cup(_) => "cup",
            Self::Sphere(_) => "sphere",
            Self::Ellipsoid(_) => "ellipsoid",
            Self::Box(_) => "box",
            Self::Torus(_) => "torus",
            Self::Knot(_) => "knot",
            Self::DiscoBall(_) => "disco-ball",
            Self::Plane(_) => "plane",
            Self::Sheet(_) => "sheet",
            Self::Water(_) => "water",
            Self::Tiles(_) => "tiles",
            Self::Joints(_) => "joints",
        }
    }

    /// The shape with its waves at this phase, degrees; `None` if it has none.
    pub(in crate::scene) fn at_phase(self, phase_deg: f32) -> Option<Self> {
        match self {
            Self::Sheet(sheet) => Some(Self::Sheet(Sheet { phase_deg, ..sheet })),
            Self::Water(water) => Some(Self::Water(Water { phase_deg, ..water })),
            _ => None,
        }
    }
}

/// A mesh before it is validated.
#[derive(Default)]
struct Parts {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Parts {
    fn vertex(&mut self, position: Vec3, normal: Vec3) -> u32 {
        self.positions.push(position);
        self.normals.push(normal);
        (self.positions.len() - 1) as u32
    }

    /// Two triangles; the corners are counter-clockwise seen from the front.
    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.triangles.push([a, b, c]);
        self.triangles.push([a, c, d]);
    }
}

#[cfg(test)]
mod tests;
