//! What a picture can show.

use serde::{Deserialize, Serialize};

/// An output variable, per pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Aov {
    /// Radiance towards the camera, W/(m²·sr), before exposure and tone map.
    Beauty,
    /// Irradiance that mirrors throw on the receiver, W/m², before albedo.
    Caustic,
    /// Irradiance from the environment without the mirrors, W/m², before albedo.
    Direct,
    /// Diffuse albedo of the receiver.
    Albedo,
    /// World-space normal, facing the camera.
    Normal,
    /// World-space position, metres.
    Position,
    /// Metres along the view axis; −1 where there is nothing.
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
