//! The output variables that can be rendered.

use serde::{Deserialize, Serialize};

/// An output variable, per pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Aov {
    /// Radiance towards the camera, W/(m²·sr), before exposure and tone mapping.
    Beauty,
    /// Caustic: irradiance of the receiver via mirrors, W/m², before albedo.
    Caustic,
    /// Direct light: irradiance of the receiver from the environment, W/m², before albedo.
    Direct,
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
    /// Its name on the command line and in EXR layers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Beauty => "beauty",
            Self::Caustic => "caustic",
            Self::Direct => "direct",
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Position => "position",
            Self::Depth => "depth",
        }
    }
}
