//! The `[environment]` table of a scene file.

use std::path::Path;

use serde::Deserialize;

use super::{Builder, one};
use crate::scene::{EnvironmentMap, EnvironmentSource, Light, MAX_RADIANCE, MapLayout, SceneError};
use crate::vectors::direction as direction_of;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct EnvironmentTable {
    map: Option<String>,
    faces: Option<[String; 6]>,
    layout: Option<MapLayout>,
    spot: Option<SpotTable>,
    constant: Option<[f32; 3]>,
    #[serde(default)]
    rotation_deg: f32,
    #[serde(default = "one")]
    intensity: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SpotTable {
    direction: [f32; 3],
    sigma_rad: f32,
    radiance: [f32; 3],
}

impl Builder<'_> {
    pub(super) fn environment(
        &self,
        table: EnvironmentTable,
        notes: &mut Vec<String>,
    ) -> Result<EnvironmentSource, SceneError> {
        if !table.rotation_deg.is_finite() {
            return Err(self.error("environment.rotation_deg", "must be a finite number of degrees"));
        }
        let intensity = table.intensity;
        if !(0.0..=MAX_RADIANCE).contains(&intensity) {
            return Err(self.error("environment.intensity", format!("is {intensity:e}, but must be from 0 to 1e36")));
        }
        let rotation_rad = table.rotation_deg.to_radians();
        let light = self.light(table, notes)?;
        if light.brightest().is_some_and(|radiance| radiance * intensity > MAX_RADIANCE) {
            return Err(self.error("environment.intensity", "times the radiance of the light must be at most 1e36"));
        }
        Ok(EnvironmentSource { light, rotation_rad, intensity })
    }

    fn light(&self, table: EnvironmentTable, notes: &mut Vec<String>) -> Result<Light, SceneError> {
        let is_file = table.faces.is_some() || table.map.as_ref().is_some_and(|m| Path::new(m).extension().is_some());
        if table.layout.is_some() && !is_file {
            return Err(self.error("environment.layout", "is for environment images from files"));
        }
        let layout = table.layout.unwrap_or(MapLayout::Auto);
        match (table.map, table.faces, table.spot, table.constant) {
            (Some(_), None, None, None) if layout == MapLayout::Faces => {
                Err(self.error("environment.layout", "\"faces\" needs faces = [six files] instead of map"))
            }
            (Some(map), None, None, None) => {
                let (light, repaired) = Light::map(self.assets, &map, layout)?;
                notes.extend(repaired);
                Ok(light)
            }
            (None, Some(faces), None, None) if matches!(layout, MapLayout::Auto | MapLayout::Faces) => {
                let faces = faces.each_ref().map(String::as_str);
                let (map, repaired) = EnvironmentMap::load(self.assets, &faces, MapLayout::Faces)?;
                notes.extend(repaired);
                Ok(Light::Map(map))
            }
            (None, Some(_), None, None) => {
                Err(self.error("environment.layout", "must be \"faces\" where six faces are given"))
            }
            (None, None, Some(spot), None) => self.spot(&spot),
            (None, None, None, Some(constant)) => {
                Ok(Light::Constant(self.colour("environment.constant", constant, MAX_RADIANCE)?))
            }
            _ => Err(self.error("environment", "give exactly one of map, faces, spot and constant")),
        }
    }

    fn spot(&self, spot: &SpotTable) -> Result<Light, SceneError> {
        let direction = self.vector("environment.spot.direction", spot.direction)?;
        let direction =
            direction_of(direction).ok_or_else(|| self.error("environment.spot.direction", "must not be zero"))?;
        if !(spot.sigma_rad >= 1e-4 && spot.sigma_rad <= 1.0) {
            return Err(self
                .error("environment.spot.sigma_rad", format!("is {}, but must be from 0.0001 to 1", spot.sigma_rad)));
        }
        let radiance = self.colour("environment.spot.radiance", spot.radiance, MAX_RADIANCE)?;
        Ok(Light::Spot { direction, sigma_rad: spot.sigma_rad, radiance })
    }
}
