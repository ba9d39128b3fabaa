//! The method: the irradiance at a receiver point is a sum over pinhole samples (Wand & Straßer, Sections 3.1, 3.3).
//!
//! For a receiver point p with normal n_p and a sample at c with normal n and area a, d = c − p and
//! r = d − 2(d·n)n, the sample adds
//!
//! ```text
//! a · ⟨n, −d̂⟩⁺ · ⟨n_p, d̂⟩⁺ / |d|² · L(r̂ filtered over the sample's footprint)
//! ```
//!
//! times the visible fraction of the receiver and the sky fraction of the footprint ([`VisibilityMaps`]). On an interface between two
//! media r is refracted for receivers behind it ([`Interface`]).
//! [`cpu`] and `gpu` of the crate `pinspot-render` implement the same steps under the same names. [`PinholeSample`] and [`GatherUniforms`] are
//! the memory layout that both read. This module must not know scene files, cameras or image files.

mod cell;
mod cell_shapes;
pub mod constants;
pub mod cpu;
mod disc;
mod interface;
pub mod layout;
mod receivers;
mod surroundings;
pub mod tree;
pub mod visibility;

pub use cell_shapes::CellShapes;
pub use constants::ESTIMATE_MAX_RECEIVERS;
pub use disc::{chord_of_sphere, filled_part, solid_angle_of};
pub use interface::Interface;
pub use layout::{BATCH_SIZE, CURVE_POINTS, GatherUniforms, PinholeParts, PinholeSample, Pinholes, ReflectanceCurve};
pub use receivers::{MEDIUM_OBJECT, NO_RECEIVER, ReceiverLayout, Receivers, ViewDirections};
pub use surroundings::{SurroundingView, Surroundings, Viewpoint};
pub use tree::PinholeTree;
pub use visibility::Edges;
pub use visibility::{SampleView, VisibilityMaps};

use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

use self::constants::{BEND_BLUR, MIN_BEND_BLUR};
use crate::differential::DifferentialSample;
use crate::progress::Progress;
use crate::reflectance::{Curve, Finish};
use crate::scene::{Chains, Interfaces, Medium, Object, Reflector, Refractor, Scene, Sides, Specular};
use crate::tracing::{Hit, Tracer};
use crate::words::NumberOrWord;

/// Which part of the surface a sample stands for.
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

/// How the environment is averaged over a footprint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Filter {
    /// One look-up in the finest level: aliased, for comparison.
    None,
    /// One look-up in the level of the footprint's major axis.
    Isotropic,
    /// Several look-ups along the major axis in the level of the minor one.
    Anisotropic,
    /// The GPU's own anisotropic filter, with the footprint as explicit gradients (`textureSampleGrad`).
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

/// What keeps 1/l² finite where a sample comes close to a receiver (Wand & Straßer, Section 3.3).
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

/// A single footprint, to evaluate a filter on its own.
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
    /// Maximum number of look-ups along a footprint's major axis, from 1 to [`MAX_TAPS`]; 0 counts as 1.
    pub taps: u32,
    /// `false` drops the 1/l².
    pub attenuation: bool,
    /// What keeps 1/l² finite.
    pub epsilon: Epsilon,
    /// With [`Epsilon::Auto`], 1/l² is 1/(l² + this times aᵢ/π) also between different objects: few samples show less as spots where a
    /// mirror touches a receiver, and what is near it gets less light.
    pub softening: f32,
    /// Counter-clockwise rotation of the environment about +Y, radians: a direction d in the world is looked up in the
    /// cube map as R(−rotation)·d.
    pub environment_rotation_rad: f32,
    /// What fills the space between mirrors and receivers, and behind interfaces.
    pub medium: Option<Medium>,
    /// Whether the medium also fills the space between lamps and mirrors.
    pub lamps_in_medium: bool,
}

/// Upper limit of [`Params::taps`].
pub const MAX_TAPS: u32 = 64;

impl Default for Params {
    fn default() -> Self {
        Self {
            filter: Filter::Anisotropic,
            taps: 16,
            attenuation: true,
            epsilon: Epsilon::Auto,
            softening: 0.0,
            environment_rotation_rad: 0.0,
            medium: None,
            lamps_in_medium: false,
        }
    }
}

/// Width of a rough mirror's lobe, radians, for a GGX surface of width 1. GGX has no finite second moment; this value comes
/// closest to the ground truth (`tests/engine/gloss.rs`).
const LOBE_PER_ALPHA: f32 = 3.75;

/// The blur that stands for the second order of a footprint with these changes of the normal, radians.
fn lobe_of_bend(changes: [Vec3; 2]) -> f32 {
    let bend = BEND_BLUR * (changes[0].length_squared() + changes[1].length_squared());
    if bend < MIN_BEND_BLUR { 0.0 } else { bend }
}

/// Packs differential samples for the gather, with the material and the sides of their objects. Samples of objects that cast no
/// caustics in `scene` are left out; interfaces that disperse light get one for each channel.
pub fn pinholes(scene: &Scene, samples: &[DifferentialSample], footprint: Footprint) -> Pinholes {
    pinholes_with(scene, &reflectance_curves(scene), samples, footprint, Chains::ALL)
}

/// The same for some chains, with the [`reflectance_curves`] of the scene, which take long for rough mirrors.
pub fn pinholes_with(
    scene: &Scene,
    curves: &[Option<Curve>],
    samples: &[DifferentialSample],
    footprint: Footprint,
    chains: Chains,
) -> Pinholes {
    let casters = Casters::new(scene, curves, chains);
    let pack = |s: &DifferentialSample| {
        let caster = casters.of_object.get(s.object as usize)?.as_ref()?;
        let (position, normal, area, sides) = match footprint {
            Footprint::Cells => (s.cell.centroid, s.cell.normal, s.cell.area, s.cell.sides),
            Footprint::Curvature => (s.position, s.normal, s.area, s.directions.map(|u| s.area.sqrt() * u)),
        };
        let changes = sides.map(|side| s.normal_change(side));
        let lobe = if footprint == Footprint::Cells { caster.lobe_with_bend(changes) } else { caster.lobe };
        let Caster { curve, lights, .. } = *caster;
        let object = s.object;
        let of_channels = move |channels: &Channels| {
            let (reflectance, interface) = caster.for_channels(*channels);
            let parts = PinholeParts {
                position,
                normal,
                area,
                sides,
                changes,
                reflectance,
                curve,
                lobe,
                object,
                lights,
                interface,
            };
            PinholeSample::from(parts)
        };
        Some(caster.channels().iter().map(of_channels))
    };
    let samples: Vec<PinholeSample> = samples.iter().filter_map(pack).flatten().collect();
    let shapes = CellShapes::new(samples.iter().map(PinholeSample::area).collect(), 1, 0.0);
    Pinholes { samples, curves: casters.curves.clone(), visibility: None, shapes }
}

impl Pinholes {
    /// Traces a visibility map for every sample, so that occlusion of receivers and of the environment counts. `scene` is the
    /// one that the samples and the tracer were made of. Once it is cancelled, nothing is occluded.
    pub fn trace_visibility(&mut self, scene: &Scene, tracer: &Tracer, progress: &dyn Progress) {
        self.trace_maps(scene, tracer, Edges::Fine, progress);
    }

    /// Whether any sample is on an interface between two media.
    pub fn refracts(&self) -> bool {
        self.samples.iter().any(|sample| sample.interface().is_some())
    }

    /// What the sample of a mirror sees that is nearest to a place on it, on the side that is seen there; `None` without visibility
    /// maps or samples.
    pub fn view_from(&self, place: &Hit) -> Option<SampleView> {
        let distance = |sample: &&PinholeSample| sample.position().distance_squared(place.position);
        let own = self.samples.iter().filter(|sample| sample.object() == place.object);
        let nearest = own.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        // Normals of samples point to the reflecting side; a map for the other side comes after the first.
        let is_behind = nearest.has_two_maps() && nearest.normal().dot(place.normal) < 0.0;
        self.visibility.as_ref()?.view(nearest.map() + u32::from(is_behind))
    }

    /// Traces the visibility maps of all samples.
    pub fn trace_maps(&mut self, scene: &Scene, tracer: &Tracer, edges: Edges, progress: &dyn Progress) {
        self.visibility = VisibilityMaps::trace(scene, tracer, &mut self.samples, edges, progress);
    }
}

/// The materials of a scene's objects that cast caustics.
#[derive(Clone, Debug, Default)]
struct Casters {
    of_object: Vec<Option<Caster>>,
    curves: Vec<ReflectanceCurve>,
}

/// The material of an object that casts caustics: a mirror or an interface.
#[derive(Clone, Copy, Debug)]
pub struct Caster {
    /// Of a mirror; of an interface the channels that it concerns.
    reflectance: Vec3,
    /// Index of the reflectance curve that holds instead, if one does.
    curve: Option<u32>,
    /// Upper bound of the reflectance over channels and angles.
    pub max_reflectance: f32,
    /// Width of a rough mirror's lobe, radians; 0 for a smooth one.
    pub lobe: f32,
    /// The sides on which it lights receivers.
    lights: Sides,
    /// Whether the side that reflects, or that the samples' normals point to, is the one that the mesh's normals point to.
    pub faces_front: bool,
    /// The interface between two media, if it is one.
    pub interface: Option<Refractor>,
}

/// The channels of the light that an interface refracts alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Channels {
    All,
    One(usize),
}

impl Caster {
    /// From its reflectance by angle, and the number of that curve unless it is constant.
    fn mirror(reflector: &Reflector, curve: Option<u32>, at_angles: &Curve) -> Self {
        let Reflector { sides, finish } = reflector;
        Self {
            reflectance: finish.reflectance.as_vec3(),
            curve,
            max_reflectance: at_angles.values().iter().map(|v| v.as_vec3().max_element()).fold(0.0, f32::max),
            lobe: LOBE_PER_ALPHA * finish.alpha() as f32,
            lights: if *sides == Sides::Both { Sides::Both } else { Sides::Front },
            faces_front: *sides != Sides::Back,
            interface: None,
        }
    }

    /// An interface whose light arrives by these chains; `None` if it lights nothing.
    fn interface(refractor: Refractor, chains: Chains) -> Option<Self> {
        let refracts = chains.refracted && refractor.interfaces == Interfaces::One;
        let lights = match (chains.reflected && refractor.fresnel, refracts) {
            (true, true) => Sides::Both,
            (true, false) => Sides::Front,
            (false, true) => Sides::Back,
            (false, false) => return None,
        };
        Some(Self {
            reflectance: Vec3::ONE,
            curve: None,
            max_reflectance: 1.0,
            lobe: 0.0,
            lights,
            faces_front: true,
            interface: Some(refractor),
        })
    }

    /// Whether channels are refracted differently.
    fn is_dispersive(&self) -> bool {
        self.interface.is_some_and(|refractor| refractor.is_dispersive())
    }

    /// What it is for some channels: the factor on their light, and the interface.
    fn for_channels(&self, channels: Channels) -> (Vec3, Option<Interface>) {
        let (reflectance, eta) = match channels {
            Channels::All => (self.reflectance, self.interface.map(|r| r.eta.element_sum() / 3.0)),
            Channels::One(k) => (self.reflectance * Vec3::AXES[k], self.interface.map(|r| r.eta[k])),
        };
        let fresnel = self.interface.is_some_and(|refractor| refractor.fresnel);
        (reflectance, eta.map(|eta| Interface { eta: eta as f32, fresnel }))
    }

    /// The channels that are to be summed one after the other.
    fn channels(&self) -> &'static [Channels] {
        const EACH: [Channels; 3] = [Channels::One(0), Channels::One(1), Channels::One(2)];
        if self.is_dispersive() { &EACH } else { &[Channels::All] }
    }

    /// Width of the lobe with the blur of a footprint's bend. Independent blurs: their second moments add.
    #[inline]
    fn lobe_with_bend(&self, changes: [Vec3; 2]) -> f32 {
        Vec2::new(lobe_of_bend(changes), self.lobe).length()
    }
}

/// Each object's specular reflectance by angle of incidence.
pub fn reflectance_curves(scene: &Scene) -> Vec<Option<Curve>> {
    let curve = |o: &Object| o.reflector.map(|r| Curve::new(&r.finish, CURVE_POINTS));
    scene.objects.iter().map(curve).collect()
}

impl Casters {
    /// From the [`reflectance_curves`] of the scene. Objects that light nothing by these chains are none.
    fn new(scene: &Scene, curves: &[Option<Curve>], chains: Chains) -> Self {
        let mut finishes: Vec<Finish> = Vec::new();
        let mut new = Self::default();
        for (object, curve) in scene.objects.iter().zip(curves) {
            let caster = match object.specular() {
                Some(Specular::Reflector(reflector)) if chains.reflected => {
                    curve.as_ref().map(|curve| new.mirror(&reflector, curve, &mut finishes))
                }
                Some(Specular::Refractor(refractor)) => Caster::interface(refractor, chains),
                _ => None,
            };
            new.of_object.push(caster);
        }
        new
    }

    fn mirror(&mut self, reflector: &Reflector, curve: &Curve, finishes: &mut Vec<Finish>) -> Caster {
        let finish = reflector.finish;
        if !finish.is_constant() && !finishes.contains(&finish) {
            finishes.push(finish);
            self.curves.push(std::array::from_fn(|k| curve.values()[k].as_vec3().extend(0.0).to_array()));
        }
        let number = finishes.iter().position(|known| *known == finish);
        Caster::mirror(reflector, number.map(|number| number as u32), curve)
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
            (_, Ok(n)) => Err(format!("epsilon is {n}, but must be a non-negative number of m²")),
            _ => Err(format!("'{text}' is not an epsilon; give auto, paper or a number of m²")),
        }
    }
}
