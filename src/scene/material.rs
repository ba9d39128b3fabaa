//! What a surface does with light. Knows no geometry.

use glam::Vec3;

use crate::brdf::Gloss;
use crate::reflectance::Finish;

/// Which sides of a surface mirror.
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

/// A smooth mirror.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflector {
    /// The mirroring sides.
    pub sides: Sides,
    /// What it is made of.
    pub finish: Finish,
}

/// A surface that light shows on.
#[derive(Clone, Debug, PartialEq)]
pub struct Receiver {
    /// Diffuse albedo, per channel, in [0, 1].
    pub albedo: Vec3,
    /// What it reflects besides.
    pub gloss: Gloss,
}
