//! The `[[light]]` tables of a scene file: lamps.

use std::f32::consts::PI;
use std::path::Path;
use std::sync::Arc;

use glam::Vec3;
use serde::Deserialize;

use super::{Builder, Key};
use crate::image::RgbImage;
use crate::scene::assets::readable_name;
use crate::scene::{Beam, Lamp, Mesh, Object, SceneError, Slide, Sunlight};
use crate::vectors::direction as direction_of;
use crate::words::escaped;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LampTable {
    name: Option<String>,
    position: Option<[f32; 3]>,
    #[serde(default)]
    radius: f32,
    intensity: Option<[f32; 3]>,
    radiance: Option<[f32; 3]>,
    spot: Option<BeamTable>,
    directional: Option<DirectionalTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DirectionalTable {
    direction: [f32; 3],
    irradiance: [f32; 3],
    #[serde(default)]
    sigma_rad: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BeamTable {
    target: [f32; 3],
    #[serde(default = "up")]
    up: [f32; 3],
    angle_deg: f32,
    #[serde(default = "softness")]
    softness: f32,
    slide: Option<String>,
}

/// The largest irradiance of directional lights, W/m²: many suns.
const MAX_IRRADIANCE: f32 = 1e5;

fn up() -> [f32; 3] {
    [0.0, 1.0, 0.0]
}
fn softness() -> f32 {
    0.1
}

impl Builder<'_> {
    pub(super) fn lamps(
        &self,
        tables: &[LampTable],
        objects: &[Object],
        notes: &mut Vec<String>,
    ) -> Result<Vec<Lamp>, SceneError> {
        tables.iter().enumerate().map(|(index, table)| self.lamp(index, table, objects, notes)).collect()
    }

    fn lamp(
        &self,
        index: usize,
        table: &LampTable,
        objects: &[Object],
        notes: &mut Vec<String>,
    ) -> Result<Lamp, SceneError> {
        let name = table.name.as_ref().map_or_else(|| format!("light {}", index + 1), |name| escaped(name));
        let key = |k: &str| Key { shown: format!("light '{name}'.{k}"), path: format!("light.{index}.{k}") };
        if let Some(directional) = &table.directional {
            return self.directional_light((name.clone(), &key), (table, directional), objects);
        }
        let Some(position) = table.position else {
            let message = "is missing: give position = [x, y, z], or directional = { direction = [x, y, z], irradiance = [r, g, b] }";
            return Err(self.error(key("position"), message));
        };
        let position = self.place(key("position"), position)?;
        if table.radius != 0.0 && !(Lamp::MIN_RADIUS..=Mesh::MAX_COORDINATE).contains(&table.radius) {
            let message = format!("is {}, but must be 0, for a point, or from 0.0001 to 1e9 m", table.radius);
            return Err(self.error(key("radius"), message));
        }
        let radius = table.radius.max(Lamp::MIN_RADIUS);
        let disc = PI * radius * radius;
        let (intensity, given) = match (table.intensity, table.radiance) {
            (Some(intensity), None) => {
                (self.colour(key("intensity"), intensity, Lamp::MAX_RADIANCE * disc.min(1.0))?, "intensity")
            }
            (None, Some(_)) if table.radius == 0.0 => {
                let message = "is that of a sphere; give its radius, or the intensity of a point light";
                return Err(self.error(key("radiance"), message));
            }
            (None, Some(radiance)) => (disc * self.colour(key("radiance"), radiance, Lamp::MAX_RADIANCE)?, "radiance"),
            _ => {
                let message = "give either intensity = [r, g, b], W/sr, or radiance = [r, g, b] and a radius";
                return Err(self.error(key("position"), message));
            }
        };
        if intensity == Vec3::ZERO {
            return Err(self.error(key(given), "is zero: a light that lights nothing; remove it, or animate it"));
        }
        let beam = match &table.spot {
            None => None,
            Some(beam) => Some(self.beam(beam, position, &key, notes)?),
        };
        let lamp = Lamp { name: name.clone(), position, radius, intensity, beam, is_distant: false };
        if lamp.max_radiance() > Lamp::MAX_RADIANCE {
            return Err(self.error(key(given), "is too bright for its size: its radiance must be at most 1e24"));
        }
        if let Some(object) = lamp.lost_within(objects) {
            let message = format!(
                "lies inside '{}', which casts nothing on that side: move the light out, or choose the sides of the reflector",
                object.name
            );
            return Err(self.error(key("position"), message));
        }
        Ok(lamp)
    }

    fn directional_light(
        &self,
        (name, key): (String, &dyn Fn(&str) -> Key),
        (table, directional): (&LampTable, &DirectionalTable),
        objects: &[Object],
    ) -> Result<Lamp, SceneError> {
        /// Wider ones are for environment maps.
        const WIDEST_RAD: f32 = 0.25;
        let is_lamp = table.position.is_some() || table.intensity.is_some() || table.radiance.is_some();
        if is_lamp || table.spot.is_some() || table.radius != 0.0 {
            let message = "is far away: it has a direction and an irradiance, but no position, radius, intensity, radiance or spot";
            return Err(self.error(key("directional"), message));
        }
        let towards = direction_of(self.vector(key("directional.direction"), directional.direction)?)
            .ok_or_else(|| self.error(key("directional.direction"), "must not be zero; it is towards the light"))?;
        let irradiance = self.colour(key("directional.irradiance"), directional.irradiance, MAX_IRRADIANCE)?;
        if irradiance == Vec3::ZERO {
            let message = "is zero: a light that lights nothing; remove it, or animate it";
            return Err(self.error(key("directional.irradiance"), message));
        }
        let sigma_rad = directional.sigma_rad;
        if sigma_rad != 0.0 && !(Sunlight::MIN_SIGMA_RAD..=WIDEST_RAD).contains(&sigma_rad) {
            let message = format!("is {sigma_rad}, but must be 0, for parallel light, or from 1e-6 to {WIDEST_RAD}");
            return Err(self.error(key("directional.sigma_rad"), message));
        }
        let farthest =
            |object: &Object| object.mesh_in_world().positions().iter().map(|p| p.length()).fold(0.0, f32::max);
        let extent = objects.iter().map(farthest).fold(0.0, f32::max);
        Ok(Lamp::distant(name, &Sunlight { towards, irradiance, sigma_rad }, extent))
    }

    fn beam(
        &self,
        table: &BeamTable,
        position: Vec3,
        key: &dyn Fn(&str) -> Key,
        notes: &mut Vec<String>,
    ) -> Result<Beam, SceneError> {
        let target = self.place(key("spot.target"), table.target)?;
        let direction = direction_of(target - position)
            .ok_or_else(|| self.error(key("spot.target"), "must differ from the light's position"))?;
        if !(table.angle_deg > 0.0 && table.angle_deg < 89.0) {
            let message = format!("is {}, but must be between 0 and 89, from the axis to the edge", table.angle_deg);
            return Err(self.error(key("spot.angle_deg"), message));
        }
        if !(0.0..=1.0).contains(&table.softness) {
            return Err(self.error(key("spot.softness"), "must be from 0 to 1"));
        }
        let up = self.vector(key("spot.up"), table.up)?;
        let across = direction_of(up - up.dot(direction) * direction);
        let slide = match &table.slide {
            None => None,
            Some(file) => Some(self.slide(file, notes).map_err(|message| self.error(key("spot.slide"), message))?),
        };
        let up = match (across, &slide) {
            (Some(up), _) => up,
            (None, None) => direction.any_orthonormal_vector(),
            (None, Some(_)) => {
                return Err(self.error(key("spot.up"), "must not be along the beam; it turns the slide"));
            }
        };
        let half_angle_rad = table.angle_deg.to_radians();
        Ok(Beam { direction, up, half_angle_rad, softness: table.softness, slide })
    }

    /// The image of a slide, or why there is none.
    fn slide(&self, file: &str, notes: &mut Vec<String>) -> Result<Slide, String> {
        let (file, layer) = RgbImage::split_layer(file);
        let name = readable_name(self.assets, Path::new(file));
        RgbImage::check_format(&name).map_err(|error| error.to_string())?;
        let bytes = self.assets.read(Path::new(file));
        let bytes = bytes.map_err(|error| format!("cannot read '{name}': {error}; check the path"))?;
        let (image, repaired) = RgbImage::decode_layer(&name, layer, &bytes).map_err(|error| error.to_string())?;
        notes.extend(repaired);
        Ok(Slide(Arc::new(image)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Scene, parse};

    const SCENE: &str = r#"
environment = { constant = [0, 0, 0] }
camera = { position = [0, 5, 5], target = [0, 0, 0], perspective = { fov_y_deg = 40 } }
[[object]]
name = "ball"
shape = { sphere = { radius = 0.5 } }
reflector = { sides = "front" }
[[light]]
name = "bulb"
position = [0, 2, 0]
radius = 0.1
intensity = [1, 2, 3]
[[animation]]
object = "bulb"
intensity = [[0, 1], [1, 0.5]]
position = [[0, [0, 2, 0]], [1, [0, 3, 0]]]
"#;

    fn load(text: &str) -> Result<Scene, String> {
        let loaded = parse::<toml::Table>("scene.toml", text, Path::new("."));
        loaded.map(|loaded| loaded.scene).map_err(|error| error.to_string())
    }

    #[test]
    fn lamps_are_read_and_move() {
        let mut scene = load(SCENE).unwrap();
        let lamp = &scene.lamps[0];
        assert_eq!((lamp.position, lamp.radius, lamp.intensity), (2.0 * Vec3::Y, 0.1, Vec3::new(1.0, 2.0, 3.0)));
        scene.pose(1.0);
        assert_eq!((scene.lamps[0].position, scene.lamps[0].intensity.y), (3.0 * Vec3::Y, 1.0));
        let by_radiance = load(&SCENE.replace("intensity = [1, 2, 3]", "radiance = [10, 10, 10]")).unwrap();
        assert!((by_radiance.lamps[0].intensity.x - 0.1 * PI).abs() < 1e-6);
        let spot = "radius = 0.1\nspot = { target = [0, 0, 0], angle_deg = 20 }";
        let beam = load(&SCENE.replace("radius = 0.1", spot)).unwrap().lamps[0].beam.clone().unwrap();
        assert_eq!((beam.direction, beam.softness), (Vec3::NEG_Y, 0.1));
    }

    #[test]
    fn lamps_that_light_nothing_are_refused() {
        for (from, to, expected) in [
            ("radius = 0.1", "radius = -1", "scene.toml:11: light 'bulb'.radius: is -1"),
            ("intensity = [1, 2, 3]", "intensity = [0, 0, 0]", "light 'bulb'.intensity: is zero"),
            ("intensity = [1, 2, 3]", "intensity = [-1, 2, 3]", "must be three numbers from 0"),
            ("intensity = [1, 2, 3]", "", "give either intensity"),
            ("intensity = [1, 2, 3]", "intensity = [1, 1, 1]\nradiance = [1, 1, 1]", "give either intensity"),
            ("radius = 0.1\nintensity", "radiance", "give its radius"),
            ("position = [0, 2, 0]", "position = [0, 0.2, 0]", "lies inside 'ball'"),
            ("position = [0, 2, 0]", "position = [0, nan, 0]", "three finite numbers"),
            ("radius = 0.1", "spot = { target = [0, 2, 0], angle_deg = 20 }", "must differ from the light's position"),
            ("radius = 0.1", "spot = { target = [0, 0, 0], angle_deg = 90 }", "spot.angle_deg: is 90"),
            (
                "radius = 0.1",
                "spot = { target = [0, 0, 0], angle_deg = 9, slide = \"no.exr\" }",
                "spot.slide: cannot read './no.exr'",
            ),
            ("[[0, 1], [1, 0.5]]", "[[0, -1]]", "must be from 0 to"),
            ("object = \"bulb\"", "object = \"bulp\"", "did you mean 'bulb'?"),
            ("name = \"bulb\"", "nam = \"bulb\"", "did you mean 'name'?"),
        ] {
            assert!(SCENE.contains(from), "{from}");
            let message = load(&SCENE.replacen(from, to, 1)).unwrap_err();
            assert!(message.starts_with("scene.toml:") && message.contains(expected), "{to}: {message}");
        }
        assert!(
            load(&SCENE.replace("sides = \"front\"", "sides = \"both\"").replace("[0, 2, 0]", "[0, 0.2, 0]")).is_ok()
        );
    }
}
