//! The `[medium]` table of a scene file.

use glam::Vec3;
use serde::Deserialize;

use super::Builder;
use crate::scene::{Medium, SceneError};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MediumTable {
    #[serde(default)]
    sigma_s: Coefficients,
    #[serde(default)]
    sigma_a: Coefficients,
    #[serde(default)]
    g: f32,
}

/// One coefficient, or one for each channel.
#[derive(Clone, Copy, Deserialize)]
#[serde(untagged, expecting = "expected a number, or three for red, green and blue")]
enum Coefficients {
    One(f32),
    PerChannel([f32; 3]),
}

impl Default for Coefficients {
    fn default() -> Self {
        Self::One(0.0)
    }
}

impl Builder<'_> {
    pub(super) fn medium(&self, table: &MediumTable) -> Result<Medium, SceneError> {
        let coefficients = |key: &str, value: Coefficients| {
            let value = match value {
                Coefficients::One(value) => [value; 3],
                Coefficients::PerChannel(values) => values,
            };
            self.colour(key, value, Medium::MAX_SIGMA)
        };
        let sigma_s = coefficients("medium.sigma_s", table.sigma_s)?;
        let sigma_a = coefficients("medium.sigma_a", table.sigma_a)?;
        if sigma_s + sigma_a == Vec3::ZERO {
            let message = "is a medium that does nothing: give sigma_s or sigma_a, 1/m, or remove the table";
            return Err(self.error("medium", message));
        }
        if !(-Medium::MAX_G..=Medium::MAX_G).contains(&table.g) {
            let message = format!("is {}, but must be from -0.99 (backwards) to 0.99 (forwards)", table.g);
            return Err(self.error("medium.g", message));
        }
        Ok(Medium { sigma_s, sigma_a, g: table.g })
    }
}
