//! Materials: reflectors, receivers and emitters. Independent of geometry.

use glam::Vec3;

use crate::brdf::Gloss;
use crate::reflectance::Finish;

/// The sides of a surface that reflect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sides {
    /// The side that the normals point to.
    #[default]
    Front,
    /// The other side.
    Back,
    /// Both sides of a thin sheet.
    Both,
}

/// A mirror.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflector {
    /// The reflecting sides.
    pub sides: Sides,
    /// Its material.
    pub finish: Finish,
}

/// A surface that receives caustics and direct light.
#[derive(Clone, Debug, PartialEq)]
pub struct Receiver {
    /// Diffuse albedo, per channel, in [0, 1].
    pub albedo: Vec3,
    /// Its glossy lobe, or a measured BRDF.
    pub gloss: Gloss,
}

/// A surface that shines: light geometry, which is part of the environment (Wand and Straßer 2003, Section 3.1). Its light arrives
/// everywhere as it does at [`Scene::light_centre`](super::Scene::light_centre), so that it should be several times as far away as
/// mirrors and receivers are large. The camera sees it where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emitter {
    /// Radiance of both sides in all directions, W/(m²·sr).
    pub radiance: Vec3,
}
