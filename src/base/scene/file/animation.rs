//! The `[[animation]]` tables of a scene file.

use glam::Vec3;
use serde::Deserialize;

use super::camera::CameraTable;
use super::objects::Animated;
use super::{Builder, Key, nearest};
use crate::scene::{
    Animation, CameraMotion, EnvironmentMotion, Interpolation, KeyFrameError, KeyFrames, Lamp, LampMotion,
    MAX_RADIANCE, ObjectMotion, SceneError, Waves,
};
use crate::words::escaped;

/// Key frames as in the file: seconds and value.
type Frames<T> = Vec<(f32, T)>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AnimationTable {
    object: String,
    translate: Option<Frames<[f32; 3]>>,
    rotate_deg: Option<Frames<[f32; 3]>>,
    scale: Option<Frames<f32>>,
    phase_deg: Option<Frames<f32>>,
    position: Option<Frames<[f32; 3]>>,
    target: Option<Frames<[f32; 3]>>,
    rotation_deg: Option<Frames<f32>>,
    intensity: Option<Frames<f32>>,
    #[serde(default)]
    interpolation: Interpolation,
    #[serde(default)]
    r#loop: bool,
}

/// Keys that move objects, the camera, the environment and lamps.
const OBJECT_KEYS: [&str; 4] = ["translate", "rotate_deg", "scale", "phase_deg"];
const CAMERA_KEYS: [&str; 2] = ["position", "target"];
const ENVIRONMENT_KEYS: [&str; 2] = ["rotation_deg", "intensity"];
const LAMP_KEYS: [&str; 2] = ["position", "intensity"];

/// One table of the file, with its place for messages.
struct Table<'a> {
    table: &'a AnimationTable,
    index: usize,
}

impl Table<'_> {
    fn key(&self, key: &str) -> Key {
        Key {
            shown: format!("animation of '{}'.{key}", escaped(&self.table.object)),
            path: format!("animation.{}.{key}", self.index),
        }
    }

    /// The keys that have key frames.
    fn given(&self) -> Vec<&'static str> {
        let AnimationTable {
            translate, rotate_deg, scale, phase_deg, position, target, rotation_deg, intensity, ..
        } = self.table;
        let all = [
            ("translate", translate.is_some()),
            ("rotate_deg", rotate_deg.is_some()),
            ("scale", scale.is_some()),
            ("phase_deg", phase_deg.is_some()),
            ("position", position.is_some()),
            ("target", target.is_some()),
            ("rotation_deg", rotation_deg.is_some()),
            ("intensity", intensity.is_some()),
        ];
        all.into_iter().filter(|(_, is_given)| *is_given).map(|(key, _)| key).collect()
    }
}

impl Builder<'_> {
    pub(super) fn animations(
        &self,
        tables: &[AnimationTable],
        (animated, lamps): (&[Animated], &[Lamp]),
        camera: &CameraTable,
    ) -> Result<Vec<Animation>, SceneError> {
        let tables = tables.iter().enumerate();
        tables.map(|(index, table)| self.animation(&Table { table, index }, (animated, lamps), camera)).collect()
    }

    /// An animation of the object of that name or, where there is none, of the light, the camera or the environment.
    fn animation(
        &self,
        table: &Table,
        (animated, lamps): (&[Animated], &[Lamp]),
        camera: &CameraTable,
    ) -> Result<Animation, SceneError> {
        let name = table.table.object.as_str();
        if let Some(object) = animated.iter().find(|object| object.name.as_deref() == Some(name)) {
            self.check_keys(table, &OBJECT_KEYS, "an object")?;
            return Ok(Animation::Objects(self.object_motion(table, object)?));
        }
        if let Some(index) = lamps.iter().position(|lamp| lamp.name == escaped(name)) {
            self.check_keys(table, &LAMP_KEYS, "a light")?;
            return Ok(Animation::Lamp(self.lamp_motion(table, index, &lamps[index])?));
        }
        match name {
            "camera" => {
                self.check_keys(table, &CAMERA_KEYS, "the camera")?;
                Ok(Animation::Camera(self.camera_motion(table, camera)?))
            }
            "environment" => {
                self.check_keys(table, &ENVIRONMENT_KEYS, "the environment")?;
                Ok(Animation::Environment(self.environment_motion(table)?))
            }
            _ => {
                let objects = animated.iter().filter_map(|object| object.name.as_deref());
                let names = objects.chain(lamps.iter().map(|lamp| lamp.name.as_str()));
                let known = nearest(name, names.chain(["camera", "environment"]));
                let hint = known.map_or_else(
                    || "name an object, a light, \"camera\" or \"environment\"".to_owned(),
                    |known| format!("did you mean '{}'?", escaped(known)),
                );
                let message = format!("there is no object '{}'; {hint}", escaped(name));
                Err(self.error(table.key("object"), message))
            }
        }
    }

    /// Refuses key frames of properties that the target does not have, and animations without any.
    fn check_keys(&self, table: &Table, known: &[&str], target: &str) -> Result<(), SceneError> {
        let given = table.given();
        if let Some(other) = given.iter().find(|key| !known.contains(key)) {
            let message = format!("is not a property of {target}; these are: {}", known.join(", "));
            return Err(self.error(table.key(other), message));
        }
        if given.is_empty() {
            let message = format!("has no key frames; give some for {}", known.join(", "));
            return Err(self.error(table.key("object"), message));
        }
        Ok(())
    }

    fn object_motion(&self, table: &Table, object: &Animated) -> Result<ObjectMotion, SceneError> {
        let AnimationTable { translate, rotate_deg, scale, phase_deg, .. } = table.table;
        if object.is_far {
            let message = "cannot move: its vertices are so far from its origin that 32-bit numbers would round their places; \
                           move the mesh to its origin in the modelling program";
            return Err(self.error(table.key("object"), message));
        }
        let wave = match (self.numbers(table, "phase_deg", phase_deg.as_ref())?, object.shape) {
            (None, _) => None,
            (Some(phase), shape) => {
                let missing =
                    || self.error(table.key("phase_deg"), "is a property of the shapes 'sheet' and 'water' alone");
                Some(shape.and_then(|shape| Waves::new(shape, phase)).ok_or_else(missing)?)
            }
        };
        if scale.iter().flatten().any(|(_, scale)| !(scale.is_finite() && *scale > 0.0)) {
            return Err(self.error(table.key("scale"), "must be greater than zero in every key frame"));
        }
        Ok(ObjectMotion {
            objects: object.objects.clone(),
            translate: self.places(table, "translate", translate.as_ref())?,
            rotate_rad: self.vectors(table, "rotate_deg", rotate_deg.as_ref(), f32::to_radians)?,
            scale: self.frames(table, "scale", scale.as_ref().map(|frames| frames.clone().into_iter()))?,
            wave,
        })
    }

    fn camera_motion(&self, table: &Table, camera: &CameraTable) -> Result<CameraMotion, SceneError> {
        let AnimationTable { position, target, .. } = table.table;
        // What is not animated stays where the camera's own table has it.
        let (still_position, still_target) = (vec![(0.0, camera.position)], vec![(0.0, camera.target)]);
        let position = self.places(table, "position", Some(position.as_ref().unwrap_or(&still_position)))?;
        let target = self.places(table, "target", Some(target.as_ref().unwrap_or(&still_target)))?;
        let missing = || self.error(table.key("object"), "has no key frames");
        Ok(CameraMotion {
            position: position.ok_or_else(missing)?,
            target: target.ok_or_else(missing)?,
            up: Vec3::from(camera.up),
        })
    }

    fn environment_motion(&self, table: &Table) -> Result<EnvironmentMotion, SceneError> {
        Ok(EnvironmentMotion {
            rotation_rad: self.numbers(table, "rotation_deg", table.table.rotation_deg.as_ref())?,
            intensity: self.factors(table, MAX_RADIANCE)?,
        })
    }

    fn lamp_motion(&self, table: &Table, index: usize, lamp: &Lamp) -> Result<LampMotion, SceneError> {
        if lamp.is_distant && table.table.position.is_some() {
            let message = "is of a directional light, which has none; animate its intensity instead";
            return Err(self.error(table.key("position"), message));
        }
        Ok(LampMotion {
            lamp: index,
            position: self.places(table, "position", table.table.position.as_ref())?,
            intensity: self.factors(table, Lamp::MAX_RADIANCE / lamp.max_radiance())?,
            full_intensity: lamp.intensity,
        })
    }

    /// The key frames of an intensity, as factors.
    fn factors(&self, table: &Table, most: f32) -> Result<Option<KeyFrames<f32>>, SceneError> {
        let Some(frames) = &table.table.intensity else { return Ok(None) };
        if frames.iter().any(|(_, value)| !(0.0..=most).contains(value)) {
            let message = format!("must be from 0 to {most:e} in every key frame");
            return Err(self.error(table.key("intensity"), message));
        }
        self.frames(table, "intensity", Some(frames.clone().into_iter()))
    }

    /// Angles, in degrees in the file.
    fn numbers(
        &self,
        table: &Table,
        key: &str,
        frames: Option<&Frames<f32>>,
    ) -> Result<Option<KeyFrames<f32>>, SceneError> {
        let Some(frames) = frames else { return Ok(None) };
        if frames.iter().any(|(_, degrees)| !degrees.is_finite()) {
            return Err(self.error(table.key(key), "must be a finite number of degrees in every key frame"));
        }
        self.frames(table, key, Some(frames.iter().map(|(time, degrees)| (*time, degrees.to_radians()))))
    }

    /// Points in the world.
    fn places(
        &self,
        table: &Table,
        key: &str,
        frames: Option<&Frames<[f32; 3]>>,
    ) -> Result<Option<KeyFrames<Vec3>>, SceneError> {
        frames.into_iter().flatten().try_for_each(|(_, value)| self.place(table.key(key), *value).map(drop))?;
        self.vectors(table, key, frames, |value| value)
    }

    fn vectors(
        &self,
        table: &Table,
        key: &str,
        frames: Option<&Frames<[f32; 3]>>,
        convert: fn(f32) -> f32,
    ) -> Result<Option<KeyFrames<Vec3>>, SceneError> {
        let Some(frames) = frames else { return Ok(None) };
        let converted = |(time, value): &(f32, [f32; 3])| {
            Ok((*time, Vec3::from(self.vector(table.key(key), *value)?.to_array().map(convert))))
        };
        let frames: Vec<(f32, Vec3)> = frames.iter().map(converted).collect::<Result<_, SceneError>>()?;
        self.frames(table, key, Some(frames.into_iter()))
    }

    fn frames<T>(
        &self,
        table: &Table,
        key: &str,
        frames: Option<impl Iterator<Item = (f32, T)>>,
    ) -> Result<Option<KeyFrames<T>>, SceneError>
    where
        T: Copy + PartialEq + std::ops::Add<Output = T> + std::ops::Sub<Output = T> + std::ops::Mul<f32, Output = T>,
    {
        let AnimationTable { interpolation, r#loop, .. } = *table.table;
        let of = |frames| {
            KeyFrames::new(frames, interpolation, r#loop)
                .map_err(|error: KeyFrameError| self.error(table.key(key), error.to_string()))
        };
        frames.map(|frames| of(frames.collect())).transpose()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::scene::parse;

    const SCENE: &str = r#"
environment = { constant = [1.0, 1.0, 1.0] }
camera = { position = [0.0, 5.0, 5.0], target = [0.0, 0.0, 0.0], perspective = { fov_y_deg = 40.0 } }
[[object]]
name = "ring"
shape = { ring = {} }
reflector = {}
[[object]]
name = "sheet"
shape = { sheet = {} }
reflector = {}
[[animation]]
object = "ring"
translate = [[0.0, [0.0, 0.0, 0.0]], [2.0, [2.0, 0.0, 0.0]]]
rotate_deg = [[0.0, [0.0, 0.0, 0.0]], [4.0, [0.0, 360.0, 0.0]]]
loop = true
[[animation]]
object = "camera"
position = [[0.0, [0.0, 5.0, 5.0]], [1.0, [0.0, 5.0, 3.0]]]
[[animation]]
object = "environment"
rotation_deg = [[0.0, 0.0], [10.0, 90.0]]
[[animation]]
object = "sheet"
phase_deg = [[0.0, 0.0], [3.0, 360.0]]
"#;

    fn load(text: &str) -> Result<crate::scene::Scene, SceneError> {
        parse::<toml::Table>("scene.toml", text, Path::new(".")).map(|loaded| loaded.scene)
    }

    #[test]
    fn animations_pose_what_they_name() {
        let mut scene = load(SCENE).unwrap();
        assert_eq!(scene.duration(), 10.0);
        let flat = scene.objects[1].mesh.positions().to_vec();
        scene.pose(1.0);
        assert_eq!(scene.objects[0].placement.translate, Vec3::X);
        assert!((scene.objects[0].placement.rotate_rad.y.to_degrees() - 90.0).abs() < 1e-3);
        assert_eq!(scene.camera.position, Vec3::new(0.0, 5.0, 3.0));
        assert!((scene.environment.rotation_rad.to_degrees() - 9.0).abs() < 1e-3);
        assert_ne!(scene.objects[1].mesh.positions(), flat);
        scene.pose(3.0);
        assert_eq!(scene.objects[0].placement.translate, Vec3::X, "it repeats");
    }

    #[test]
    fn wrong_animations_are_refused_with_line_and_key() {
        for (from, to, expected) in [
            ("object = \"ring\"", "object = \"rign\"", "scene.toml:13: animation of 'rign'.object: there is no object"),
            ("object = \"ring\"", "object = \"camera\"", "translate: is not a property of the camera"),
            ("phase_deg = [[0.0, 0.0], [3.0, 360.0]]", "", "has no key frames; give some for translate"),
            ("[2.0, [2.0, 0.0, 0.0]]", "[0.0, [2.0, 0.0, 0.0]]", "follow each other in time"),
            ("[2.0, [2.0, 0.0, 0.0]]", "[2.0, [nan, 0.0, 0.0]]", "three finite numbers"),
            ("[[0.0, 0.0], [10.0, 90.0]]", "[[0.0, 0.0], [10.0, inf]]", "finite number of degrees"),
            ("[[0.0, 0.0], [3.0, 360.0]]", "[]", "has no key frame; give at least one"),
            ("object = \"sheet\"", "object = \"ring\"", "is a property of the shapes 'sheet' and 'water' alone"),
            ("loop = true", "lop = true", "did you mean 'loop'?"),
            ("loop = true", "scale = [[0.0, 0.0]]", "greater than zero"),
            ("loop = true", "interpolation = \"smoth\"", "did you mean 'smooth'?"),
        ] {
            assert!(SCENE.contains(from), "{from}");
            let message = load(&SCENE.replace(from, to)).unwrap_err().to_string();
            assert!(message.contains(expected), "{to}: {message}");
        }
    }
}
