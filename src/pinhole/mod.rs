//! The method: the irradiance at a receiver point is a sum over pinhole samples (Wand & Straßer, Sections 3.1, 3.3).
//!
//! For a receiver point p with normal n_p and a sample at c with normal n and area a, d = c − p and
//! r = d − 2(d·n)n, the sample adds
//!
//! ```text
//! a · ⟨n, −d̂⟩⁺ · ⟨n_p, d̂⟩⁺ / |d|² · L(r̂ filtered over the sample's footprint)
//! ```
//!
//! times the part of the receiver that the sample sees, and of the footprint that sees the environment ([`VisibilityMaps`]).
//! [`cpu`] and [`gpu`] are twins: the same steps under the same names. [`PinholeSample`] and [`GatherUniforms`] are
//! the memory layout that both read. This module must not know scene files, cameras or image files.

mod constants;
pub mod cpu;
#[cfg(feature = "gpu")]
pub mod gpu;
mod layout;
mod receivers;
mod tree;
mod visibility;

pub use layout::{BATCH_SIZE, CURVE_POINTS, GatherUniforms, PinholeParts, PinholeSample, Pinholes, ReflectanceCurve};
pub use receivers::{Arrangement, NO_RECEIVER, Receivers, Viewers};
pub use tree::PinholeTree;
pub use visibility::VisibilityMaps;

use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

use self::constants::{BEND_BLUR, MIN_BEND_BLUR};
use crate::differential::DifferentialSample;
use crate::reflectance::{Curve, Finish};
use crate::scene::{Object, Reflector, Scene, Sides};
use crate::tracing::Tracer;
use crate::words::NumberOrWord;

/// How a sample's footprint is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Footprint {
    /// The cell itself: its area, centroid and covariance.
    #[default]
    Cells,
    /// The paper's: a square of area A/N along the principal curvatures, at the sample's own position (Section 3.3).
    Curvature,
}

impl Footprint {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cells => "cells",
            Self::Curvature => "curvature",
        }
    }
}

/// How the environment is looked up under a footprint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Filter {
    /// One look-up in the finest level (WS-19).
    None,
    /// One look-up in the level of the footprint's major axis.
    Isotropic,
    /// Several look-ups along the major axis in the level of the minor one.
    Anisotropic,
    /// The GPU's own anisotropic filter, with the footprint as explicit gradients (WS-18).
    Hardware,
    /// The elliptical weighted average (Heckbert 1989): look-ups all over the ellipse. Slow; for comparison.
    Ewa,
}

impl Filter {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Isotropic => "isotropic",
            Self::Anisotropic => "anisotropic",
            Self::Hardware => "hardware",
            Self::Ewa => "ewa",
        }
    }
}

/// What keeps 1/l² finite where a sample comes close to a receiver (WS-7).
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(try_from = "NumberOrWord")]
pub enum Epsilon {
    /// Nothing between different objects; on the sample's own object 1/l² is 1/max(l², aᵢ/π).
    #[default]
    Auto,
    /// The paper's: 1/(l² + 4aᵢ/π), the squared diameter of the sample's region.
    Paper,
    /// 1/(l² + ε), m².
    Value(f32),
}

/// A footprint on its own, for asking a filter what it makes of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// Its centre, unit length.
    pub direction: glam::Vec3,
    /// The sides of the parallelogram, perpendicular to the direction, radians.
    pub sides: [glam::Vec3; 2],
}

/// Parameters of one gather.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// The filter.
    pub filter: Filter,
    /// Most look-ups along a footprint's major axis, from 1 to [`MAX_TAPS`].
    pub taps: u32,
    /// `false` drops the 1/l².
    pub attenuation: bool,
    /// What keeps 1/l² finite.
    pub epsilon: Epsilon,
    /// Counter-clockwise rotation of the environment about +Y, radians: a direction d in the world is looked up in the
    /// cube map as R(−rotation)·d.
    pub environment_rotation_rad: f32,
}

/// The most taps that can be asked for.
pub const MAX_TAPS: u32 = 64;

impl Default for Params {
    fn default() -> Self {
        Self {
            filter: Filter::Anisotropic,
            taps: 16,
            attenuation: true,
            epsilon: Epsilon::Auto,
            environment_rotation_rad: 0.0,
        }
    }
}

/// Width of a rough mirror's lobe, radians, for a GGX surface of width 1. GGX has no finite second moment; this is what comes
/// nearest to the ground truth (`tests/engine/gloss.rs`).
const LOBE_PER_ALPHA: f32 = 3.75;

/// The blur for the second order of a footprint with these changes of the normal, radians.
fn lobe_of_bend(changes: [Vec3; 2]) -> f32 {
    let bend = BEND_BLUR * (changes[0].length_squared() + changes[1].length_squared());
    if bend < MIN_BEND_BLUR { 0.0 } else { bend }
}

/// A sample's region, as a footprint is made of it.
struct Region {
    position: Vec3,
    normal: Vec3,
    area: f32,
    sides: [Vec3; 2],
    changes: [Vec3; 2],
    object: u32,
    /// Whether reflected directions bend within it.
    bends: bool,
}

/// Packs differential samples for the gather, with their object's finish and sides.
pub fn pinholes(scene: &Scene, samples: &[DifferentialSample], footprint: Footprint) -> Pinholes {
    let region = |s: &DifferentialSample| {
        let (position, normal, area, sides) = match footprint {
            Footprint::Cells => (s.cell.centroid, s.cell.normal, s.cell.area, s.cell.sides),
            Footprint::Curvature => (s.position, s.normal, s.area, s.directions.map(|u| s.area.sqrt() * u)),
        };
        let changes = sides.map(|side| s.normal_change(side));
        Region { position, normal, area, sides, changes, object: s.object, bends: footprint == Footprint::Cells }
    };
    let mirrors = Mirrors::of_scene(scene);
    let sample = |s| {
        let region = region(s);
        Some(mirrors.of_object[region.object as usize]?.sample(&region))
    };
    Pinholes { samples: samples.iter().filter_map(sample).collect(), curves: mirrors.curves, visibility: None }
}

impl Mirror {
    /// The sample that stands for a region of the mirror.
    #[inline]
    fn sample(&self, region: &Region) -> PinholeSample {
        let Region { position, normal, area, sides, changes, object, bends } = *region;
        let Self { reflectance, curve, two_sided, .. } = *self;
        // Independent blurs: their second moments add.
        let lobe = if bends { Vec2::new(lobe_of_bend(changes), self.lobe).length() } else { self.lobe };
        PinholeParts { position, normal, area, sides, changes, reflectance, curve, lobe, object, two_sided }.into()
    }
}

impl Pinholes {
    /// Lets every sample look around, so that what hides the receivers or the environment from it counts. `scene` is the one
    /// that the samples and the tracer were made of.
    pub fn look_around(&mut self, scene: &Scene, tracer: &Tracer) {
        self.visibility = Some(VisibilityMaps::trace(scene, tracer, &mut self.samples));
    }
}

/// How the scene's objects mirror.
#[derive(Clone, Debug, Default)]
struct Mirrors {
    of_object: Vec<Option<Mirror>>,
    curves: Vec<ReflectanceCurve>,
}

/// How an object mirrors.
#[derive(Clone, Copy, Debug)]
struct Mirror {
    reflectance: Vec3,
    /// Which of the curves holds instead, if one does.
    curve: Option<u32>,
    /// No channel reflects more at any angle.
    most: f32,
    /// Width of the lobe of a rough one, radians.
    lobe: f32,
    two_sided: bool,
}

impl Mirrors {
    fn of_scene(scene: &Scene) -> Self {
        let mut finishes: Vec<Finish> = Vec::new();
        let mut number = |finish: Finish| {
            let known = finishes.iter().position(|f| *f == finish);
            known.unwrap_or_else(|| {
                finishes.push(finish);
                finishes.len() - 1
            }) as u32
        };
        let mirror = |o: &Object| {
            let Reflector { sides, finish } = o.reflector?;
            let reflectance = finish.reflectance.as_vec3();
            let curve = (!finish.is_constant()).then(|| number(finish));
            let at_angles = Curve::new(&finish, CURVE_POINTS);
            let most = at_angles.values().iter().map(|v| v.as_vec3().max_element()).fold(0.0, f32::max);
            let lobe = LOBE_PER_ALPHA * finish.alpha() as f32;
            Some(Mirror { reflectance, curve, most, lobe, two_sided: sides == Sides::Both })
        };
        let of_object = scene.objects.iter().map(mirror).collect();
        let row = |finish: &Finish| {
            let curve = Curve::new(finish, CURVE_POINTS);
            std::array::from_fn(|k| curve.values()[k].as_vec3().extend(0.0).to_array())
        };
        Self { of_object, curves: finishes.iter().map(row).collect() }
    }
}

impl TryFrom<NumberOrWord> for Epsilon {
    type Error = String;
    fn try_from(value: NumberOrWord) -> Result<Self, String> {
        value.to_string().parse()
    }
}

impl std::str::FromStr for Epsilon {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match (text, text.parse::<f32>()) {
            ("auto", _) => Ok(Self::Auto),
            ("paper", _) => Ok(Self::Paper),
            (_, Ok(n)) if n >= 0.0 && n.is_finite() => Ok(Self::Value(n)),
            (_, Ok(n)) => Err(format!("epsilon is {n}, but must be a number of m² that is not negative")),
            _ => Err(format!("'{text}' is no epsilon; give auto, paper or a number of m²")),
        }
    }
}
