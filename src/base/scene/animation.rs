//! Animations: key frames of placements, of the camera, of lamps and of the environment. Independent of rendering: an animation poses the
//! [`Scene`] for a moment, and the posed scene is rendered like any other.

use std::ops::{Add, Mul, Range, Sub};
use std::sync::{Arc, Mutex, PoisonError};

use glam::Vec3;
use serde::Deserialize;

use super::shapes::Shape;
use super::{Camera, Mesh, Scene};

/// How values change between key frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// At constant speed from one key frame to the next.
    #[default]
    Linear,
    /// Along a curve without kinks through all key frames (Catmull and Rom 1974).
    Smooth,
}

/// Why key frames are invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum KeyFrameError {
    /// There is none.
    #[error("has no key frame; give at least one, as [[seconds, value], …]")]
    Empty,
    /// A time that is negative or not finite.
    #[error("has a key frame whose time is not a number of seconds from 0 on")]
    Time,
    /// Times that do not ascend.
    #[error("has key frames that do not follow each other in time; sort them, one for each time")]
    Order,
}

/// Values at times, and what lies between.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyFrames<T> {
    /// Seconds, strictly ascending, and values; at least one.
    keys: Vec<(f32, T)>,
    interpolation: Interpolation,
    repeats: bool,
}

impl<T: Copy + PartialEq + Add<Output = T> + Sub<Output = T> + Mul<f32, Output = T>> KeyFrames<T> {
    /// Key frames by ascending time, seconds. With `repeats`, the time starts again after the last one.
    ///
    /// # Errors
    /// No key frame, or times that are negative, not finite or not ascending.
    pub fn new(keys: Vec<(f32, T)>, interpolation: Interpolation, repeats: bool) -> Result<Self, KeyFrameError> {
        if keys.is_empty() {
            return Err(KeyFrameError::Empty);
        }
        if keys.iter().any(|(time, _)| !(time.is_finite() && *time >= 0.0)) {
            return Err(KeyFrameError::Time);
        }
        if keys.windows(2).any(|pair| pair[0].0 >= pair[1].0) {
            return Err(KeyFrameError::Order);
        }
        Ok(Self { keys, interpolation, repeats })
    }

    /// The time of the last key frame, seconds.
    pub fn end(&self) -> f32 {
        self.keys[self.keys.len() - 1].0
    }

    /// The value at a time, seconds. Before the first key frame and, unless they repeat, after the last one, it is constant.
    pub fn at(&self, seconds: f32) -> T {
        let (first, end) = (self.keys[0].0, self.end());
        let time = if self.repeats && end > first && seconds > end {
            first + (seconds - first).rem_euclid(end - first)
        } else {
            seconds
        };
        let next = self.keys.partition_point(|(key, _)| *key <= time);
        if next == 0 || next == self.keys.len() {
            return self.keys[next.saturating_sub(1)].1;
        }
        let ((start, from), (stop, to)) = (self.keys[next - 1], self.keys[next]);
        let (span, part) = (stop - start, (time - start) / (stop - start));
        match self.interpolation {
            Interpolation::Linear => from + (to - from) * part,
            Interpolation::Smooth => {
                let (leaving, arriving) = (self.slope(next - 1) * span, self.slope(next) * span);
                let (square, cube) = (part * part, part * part * part);
                from + (to - from) * (3.0 * square - 2.0 * cube)
                    + leaving * (cube - 2.0 * square + part)
                    + arriving * (cube - square)
            }
        }
    }

    /// The change per second at a key frame: that between its neighbours. At the ends of a motion that closes on itself, these are
    /// the neighbours across the end.
    fn slope(&self, index: usize) -> T {
        let last = self.keys.len() - 1;
        let slope = |(from, a): (f32, T), (to, b): (f32, T)| (b - a) * (1.0 / (to - from));
        if index > 0 && index < last {
            return slope(self.keys[index - 1], self.keys[index + 1]);
        }
        let (leaving, arriving) = (slope(self.keys[0], self.keys[1]), slope(self.keys[last - 1], self.keys[last]));
        if self.repeats {
            return (leaving + arriving) * 0.5;
        }
        if index == 0 { leaving } else { arriving }
    }
}

/// The motion of one thing. Properties without key frames are left as they are.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Animation {
    /// Objects that share a name in the scene file.
    Objects(ObjectMotion),
    /// The camera.
    Camera(CameraMotion),
    /// The environment.
    Environment(EnvironmentMotion),
    /// A lamp.
    Lamp(LampMotion),
}

/// The motion of objects.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectMotion {
    /// Their indices in the scene.
    pub objects: Range<usize>,
    /// Translation, metres.
    pub translate: Option<KeyFrames<Vec3>>,
    /// Rotations about x, y and z, radians.
    pub rotate_rad: Option<KeyFrames<Vec3>>,
    /// Uniform scale.
    pub scale: Option<KeyFrames<f32>>,
    /// The waves of a sheet or of water.
    pub wave: Option<Waves>,
}

/// A surface whose waves travel. The mesh of the last moment is kept, so that nothing is made again while time stands still.
#[derive(Clone, Debug)]
pub struct Waves {
    shape: Shape,
    phase_rad: KeyFrames<f32>,
    last: Arc<Mutex<Option<PhaseMesh>>>,
}

/// A phase, degrees, and the mesh there.
type PhaseMesh = (f32, Arc<Mesh>);

impl PartialEq for Waves {
    /// Whether both have the same phases, and share their meshes in memory.
    fn eq(&self, other: &Self) -> bool {
        self.phase_rad == other.phase_rad && Arc::ptr_eq(&self.last, &other.last)
    }
}

impl Waves {
    /// A sheet or water, and the phase of its waves, radians; `None` for shapes without waves.
    pub fn new(shape: Shape, phase_rad: KeyFrames<f32>) -> Option<Self> {
        shape.at_phase(0.0).map(|shape| Self { shape, phase_rad, last: Arc::default() })
    }

    /// The shape at a time, seconds; `None` if its dimensions are out of their ranges.
    fn mesh(&self, seconds: f32) -> Option<Arc<Mesh>> {
        let phase_deg = self.phase_rad.at(seconds).to_degrees();
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, mesh)) = last.as_ref().filter(|(known, _)| *known == phase_deg) {
            return Some(mesh.clone());
        }
        let mesh = Arc::new(self.shape.at_phase(phase_deg)?.mesh().ok()?);
        *last = Some((phase_deg, mesh.clone()));
        Some(mesh)
    }
}

/// The motion of the camera.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraMotion {
    /// Position, metres.
    pub position: KeyFrames<Vec3>,
    /// The point that it looks at, metres.
    pub target: KeyFrames<Vec3>,
    /// The direction that is up in the picture.
    pub up: Vec3,
}

/// The motion of the environment.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentMotion {
    /// Rotation about +Y, radians.
    pub rotation_rad: Option<KeyFrames<f32>>,
    /// Factor on the radiance.
    pub intensity: Option<KeyFrames<f32>>,
}

/// The motion of a lamp.
#[derive(Clone, Debug, PartialEq)]
pub struct LampMotion {
    /// Its index in the scene.
    pub lamp: usize,
    /// Position, metres.
    pub position: Option<KeyFrames<Vec3>>,
    /// Factor on `full_intensity`.
    pub intensity: Option<KeyFrames<f32>>,
    /// Radiant intensity at a factor of 1, W/sr.
    pub full_intensity: Vec3,
}

impl Animation {
    /// The time of the last key frame, seconds.
    pub fn end(&self) -> f32 {
        let ends: Vec<Option<f32>> = match self {
            Self::Objects(motion) => vec![
                motion.translate.as_ref().map(KeyFrames::end),
                motion.rotate_rad.as_ref().map(KeyFrames::end),
                motion.scale.as_ref().map(KeyFrames::end),
                motion.wave.as_ref().map(|waves| waves.phase_rad.end()),
            ],
            Self::Camera(motion) => vec![Some(motion.position.end()), Some(motion.target.end())],
            Self::Environment(motion) => {
                vec![motion.rotation_rad.as_ref().map(KeyFrames::end), motion.intensity.as_ref().map(KeyFrames::end)]
            }
            Self::Lamp(motion) => {
                vec![motion.position.as_ref().map(KeyFrames::end), motion.intensity.as_ref().map(KeyFrames::end)]
            }
        };
        ends.into_iter().flatten().fold(0.0, f32::max)
    }

    fn pose(&self, scene: &mut Scene, seconds: f32) {
        match self {
            Self::Objects(motion) => motion.pose(scene, seconds),
            Self::Camera(motion) => motion.pose(&mut scene.camera, seconds),
            Self::Environment(motion) => {
                let environment = &mut scene.environment;
                set(&mut environment.rotation_rad, motion.rotation_rad.as_ref(), seconds);
                set(&mut environment.intensity, motion.intensity.as_ref(), seconds);
            }
            Self::Lamp(motion) => motion.pose(scene, seconds),
        }
    }
}

impl ObjectMotion {
    fn pose(&self, scene: &mut Scene, seconds: f32) {
        let mesh = self.wave.as_ref().and_then(|waves| waves.mesh(seconds));
        for object in scene.objects.get_mut(self.objects.clone()).unwrap_or_default() {
            set(&mut object.placement.translate, self.translate.as_ref(), seconds);
            set(&mut object.placement.rotate_rad, self.rotate_rad.as_ref(), seconds);
            set(&mut object.placement.scale, self.scale.as_ref(), seconds);
            if let Some(mesh) = &mesh {
                object.mesh = mesh.clone();
            }
        }
    }
}

impl LampMotion {
    fn pose(&self, scene: &mut Scene, seconds: f32) {
        let Some(lamp) = scene.lamps.get_mut(self.lamp) else { return };
        set(&mut lamp.position, self.position.as_ref(), seconds);
        if let Some(factor) = &self.intensity {
            // A smooth curve may swing below its key frames.
            lamp.intensity = factor.at(seconds).max(0.0) * self.full_intensity;
        }
    }
}

impl CameraMotion {
    /// The camera stays where it is at moments at which it would look nowhere or straight along its up direction.
    fn pose(&self, camera: &mut Camera, seconds: f32) {
        let (position, target) = (self.position.at(seconds), self.target.at(seconds));
        if let Some(moved) = Camera::look_at(position, target, self.up, camera.projection) {
            *camera = moved;
        }
    }
}

fn set<T>(value: &mut T, keys: Option<&KeyFrames<T>>, seconds: f32)
where
    T: Copy + PartialEq + Add<Output = T> + Sub<Output = T> + Mul<f32, Output = T>,
{
    if let Some(keys) = keys {
        *value = keys.at(seconds);
    }
}

impl Scene {
    /// Moves everything that is animated to where it is at a time, seconds.
    ///
    /// ```
    /// let (mut scene, _) = pinspot::load("ring-natural")?;
    /// let before = scene.environment.rotation_rad;
    /// scene.pose(1.0);
    /// assert_ne!(scene.environment.rotation_rad, before);
    /// # Ok::<(), pinspot::Error>(())
    /// ```
    pub fn pose(&mut self, seconds: f32) {
        let animations = std::mem::take(&mut self.animations);
        for animation in &animations {
            animation.pose(self, seconds);
        }
        self.animations = animations;
    }

    /// The time of the last key frame, seconds; 0 if nothing is animated.
    pub fn duration(&self) -> f32 {
        self.animations.iter().map(Animation::end).fold(0.0, f32::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(keys: &[(f32, f32)], interpolation: Interpolation, repeats: bool) -> KeyFrames<f32> {
        KeyFrames::new(keys.to_vec(), interpolation, repeats).unwrap()
    }

    #[test]
    fn values_lie_between_their_key_frames() {
        let once = frames(&[(1.0, 10.0), (3.0, 20.0)], Interpolation::Linear, false);
        assert_eq!([0.0, 1.0, 2.0, 3.0, 9.0].map(|t| once.at(t)), [10.0, 10.0, 15.0, 20.0, 20.0]);
        let repeated = frames(&[(0.0, 0.0), (4.0, 360.0)], Interpolation::Linear, true);
        assert_eq!([1.0, 4.0, 5.0, 9.0].map(|t| repeated.at(t)), [90.0, 360.0, 90.0, 90.0]);
        assert_eq!(frames(&[(0.0, 7.0)], Interpolation::Smooth, true).at(3.0), 7.0);
    }

    #[test]
    fn smooth_motion_has_no_kinks_and_passes_its_key_frames() {
        let keys = [(0.0, 0.0), (1.0, 1.0), (2.0, 0.0), (3.0, -1.0), (4.0, 0.0)];
        let smooth = frames(&keys, Interpolation::Smooth, true);
        assert!(keys.iter().all(|&(time, value)| (smooth.at(time) - value).abs() < 1e-6));
        let speed = |t: f32| (smooth.at(t + 1e-3) - smooth.at(t - 1e-3)) / 2e-3;
        for k in 0..200 {
            let t = 0.02 * k as f32 + 0.5;
            assert!((speed(t + 0.01) - speed(t - 0.01)).abs() < 0.1, "at {t}: {} {}", speed(t - 0.01), speed(t + 0.01));
        }
        let steady = frames(&[(0.0, 0.0), (1.0, 2.0), (3.0, 6.0)], Interpolation::Smooth, false);
        assert!((0..30).all(|k| (steady.at(0.1 * k as f32) - 0.2 * k as f32).abs() < 1e-5), "even speed stays even");
    }

    #[test]
    fn invalid_key_frames_are_refused() {
        let of = |keys: &[(f32, f32)]| KeyFrames::new(keys.to_vec(), Interpolation::Linear, false).unwrap_err();
        assert_eq!(of(&[]), KeyFrameError::Empty);
        assert_eq!(of(&[(f32::NAN, 0.0)]), KeyFrameError::Time);
        assert_eq!(of(&[(-1.0, 0.0)]), KeyFrameError::Time);
        assert_eq!(of(&[(1.0, 0.0), (1.0, 2.0)]), KeyFrameError::Order);
    }

    /// Every built-in scene moves, and comes back to where it began.
    #[test]
    fn every_built_in_scene_moves() {
        for built_in in crate::scene::BUILT_IN {
            let scene = crate::scene::load::<toml::Table>(built_in.name).unwrap().scene;
            let duration = scene.duration();
            assert!(duration > 0.0, "{} has no animation", built_in.name);
            let at = |seconds: f32| {
                let mut posed = scene.clone();
                posed.pose(seconds);
                posed.fingerprint("")
            };
            assert_ne!(at(0.0), at(0.37 * duration), "{}", built_in.name);
            let positions = |seconds: f32| {
                let mut posed = scene.clone();
                posed.pose(seconds);
                let meshes = posed.objects.iter().map(|object| object.mesh_in_world().positions().to_vec());
                (meshes.collect::<Vec<_>>().concat(), posed.environment.rotation_rad)
            };
            let ((first, turn), (last, whole_turn)) = (positions(0.0), positions(duration));
            assert!(first.iter().zip(&last).all(|(a, b)| a.abs_diff_eq(*b, 1e-3)), "{}", built_in.name);
            assert!((turn.cos() - whole_turn.cos()).abs() < 1e-3, "{}", built_in.name);
        }
    }
}
