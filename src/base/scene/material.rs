//! Materials: reflectors, refractors, receivers and emitters. Independent of geometry.

use glam::{DVec3, Vec3};

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

/// A smooth interface between two media, such as the surface of water or one face of a lens. Light from in front of it, where its
/// normals point to, is refracted to receivers behind it and reflected to receivers in front of it. It has no thickness: what lies
/// behind it is within the other medium. A closed one has two [`Interfaces`] on the way of the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refractor {
    /// The refractive index behind the surface over that in front of it, per channel, in [`Refractor::INDICES`]; water below air has
    /// 1.333.
    pub eta: DVec3,
    /// Whether light is divided by the Fresnel equations. Otherwise all of it is refracted, except where it is totally reflected.
    pub fresnel: bool,
    /// How many of them light passes.
    pub interfaces: Interfaces,
}

/// How many interfaces light passes on its way by a refractor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interfaces {
    /// One, to receivers that lie behind it: the surface of water, the first face of a lens.
    #[default]
    One,
    /// Two: into a closed object, whose normals point outwards, and out of it again. Receivers lie outside. Only
    /// the module `reference` computes light that passes both; sums reflect at the first one.
    Two,
}

impl Refractor {
    /// The relative refractive indices that a surface may have.
    pub const INDICES: std::ops::RangeInclusive<f64> = 0.25..=4.0;
    /// The wavelengths that stand for red, green and blue in Cauchy's equation, µm: those of the primaries of Rec.709 by their dominant
    /// wavelengths.
    pub const CHANNELS_UM: DVec3 = DVec3::new(0.6112, 0.5491, 0.4643);

    /// Indices by Cauchy's equation, n(λ) = a + b/λ², with b in µm² (Born & Wolf, *Principles of Optics*, Section 2.3.4).
    pub fn cauchy(a: f64, b: f64) -> DVec3 {
        a + b / (Self::CHANNELS_UM * Self::CHANNELS_UM)
    }

    /// Whether colours are refracted differently.
    pub fn is_dispersive(&self) -> bool {
        self.eta.min_element() < self.eta.max_element()
    }
}

/// What makes a surface cast caustics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Specular {
    /// A mirror.
    Reflector(Reflector),
    /// An interface between two media.
    Refractor(Refractor),
}

impl Specular {
    /// The sides that light falls on.
    pub fn sides(&self) -> Sides {
        match self {
            Self::Reflector(reflector) => reflector.sides,
            Self::Refractor(_) => Sides::Front,
        }
    }
}

/// A surface that receives caustics and direct light.
#[derive(Clone, Debug, PartialEq)]
pub struct Receiver {
    /// Diffuse albedo, per channel, in [0, 1].
    pub albedo: Vec3,
    /// Its glossy lobe, or a measured BRDF.
    pub gloss: Gloss,
}

/// A surface that shines. A distant one is light geometry, which is part of the environment (Wand and Straßer 2003, Section 3.1): its
/// light arrives everywhere as it does at [`Scene::light_centre`](super::Scene::light_centre), and it throws no shadows. A near one is an
/// object like all others. The camera sees both where they are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emitter {
    /// Radiance of both sides in all directions, W/(m²·sr).
    pub radiance: Vec3,
    /// Whether its light comes from where it is. Scene files may leave it open: then it is so unless the emitter is farther away than 100
    /// radii of the mirrors and 20 radii of everything else.
    pub is_near: bool,
}
