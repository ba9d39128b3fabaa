//! The output variables that can be rendered.

use serde::{Deserialize, Serialize};

use crate::scene::Chain;

/// An output variable, per pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Aov {
    /// Radiance towards the camera, W/(m²·sr), before exposure and tone mapping.
    Beauty,
    /// Caustic: irradiance of the receiver via mirrors and interfaces, W/m², before albedo.
    Caustic,
    /// The part of the caustic that is reflected once.
    #[serde(rename = "caustic.R")]
    CausticR,
    /// The part of the caustic that is refracted once.
    #[serde(rename = "caustic.T")]
    CausticT,
    /// The part of the caustic that is refracted twice, by closed objects.
    #[serde(rename = "caustic.TT")]
    CausticTT,
    /// The part of the caustic that is refracted four times, by two closed objects one after the other.
    #[serde(rename = "caustic.TTTT")]
    CausticTTTT,
    /// Direct light: irradiance of the receiver from the environment, W/m², before albedo.
    Direct,
    /// Light of caustics that the medium scatters once towards the camera, before it reaches a surface: radiance, W/(m²·sr).
    Scattered,
    /// The same of direct light.
    #[serde(rename = "scattered.direct")]
    ScatteredDirect,
    /// Diffuse albedo of the receiver.
    Albedo,
    /// World-space normal, facing the camera.
    Normal,
    /// World-space position, metres.
    Position,
    /// Depth along the view axis, metres; −1 for background.
    Depth,
}

impl Aov {
    /// The chain whose light it shows alone.
    pub fn chain(self) -> Option<Chain> {
        match self {
            Self::CausticR => Some(Chain::R),
            Self::CausticT => Some(Chain::T),
            Self::CausticTT => Some(Chain::TT),
            Self::CausticTTTT => Some(Chain::TTTT),
            _ => None,
        }
    }

    /// Its name on the command line and in EXR layers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Beauty => "beauty",
            Self::Caustic => "caustic",
            Self::CausticR => "caustic.R",
            Self::CausticT => "caustic.T",
            Self::CausticTT => "caustic.TT",
            Self::CausticTTTT => "caustic.TTTT",
            Self::Direct => "direct",
            Self::Scattered => "scattered",
            Self::ScatteredDirect => "scattered.direct",
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Position => "position",
            Self::Depth => "depth",
        }
    }
}
