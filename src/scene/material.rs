//! Materials: reflectors and receivers. Independent of geometry.

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
