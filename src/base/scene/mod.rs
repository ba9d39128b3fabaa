//! The scene description: meshes, shapes, materials, cameras, scene files and the built-in scenes.
//!
//! A [`Scene`] is complete and valid once built: meshes are free of NaN and of degenerate triangles. This module must
//! not know samples, prefiltered environments or wgpu.

mod animation;
mod assets;
mod builtin;
mod camera;
mod chains;
mod closed;
mod coplanar;
mod emitters;
mod file;
mod fingerprint;
mod lamp;
mod light;
mod material;
mod medium;
mod mesh;
mod normals;
pub mod shapes;
mod transform;
mod visibility;
mod wavefront;

use std::path::PathBuf;
use std::sync::Arc;

use glam::Vec3;

pub use animation::{
    Animation, CameraMotion, EnvironmentMotion, Interpolation, KeyFrameError, KeyFrames, LampMotion, ObjectMotion,
    Waves,
};
pub use assets::Assets;
pub use builtin::{BUILT_IN, BuiltIn};
pub use camera::{Camera, Projection, Ray};
pub use chains::{Chain, Chains};
pub use closed::is_closed;
pub use emitters::EmitterDistances;
pub use file::{Loaded, load, parse};
pub use lamp::{Beam, Lamp, Slide, Sunlight};
pub use light::{EnvironmentMap, EnvironmentSource, Light, MAX_RADIANCE, MapError, MapLayout};
pub use material::{Emitter, Interfaces, Receiver, Reflector, Refractor, Sides, Specular};
pub use medium::Medium;
pub use mesh::{Mesh, MeshError};
pub use transform::Transform;
pub use visibility::Visibility;
pub use wavefront::ObjReport;

pub use crate::brdf::{BrdfTable, Gloss, TableError};
pub use crate::reflectance::{Finish, Metal};

use crate::OptionError;
use crate::brdf::Materials;
use crate::words::escaped;

/// A complete scene, from a file ([`load`], [`parse`]) or made in code.
///
/// ```
/// use pinspot::glam::{DVec3, Vec3};
/// use pinspot::scene::shapes::{Plane, Ring, Shape};
/// use pinspot::scene::{Camera, EnvironmentSource, Finish, Gloss, Light, Object, Projection};
/// use pinspot::scene::{Receiver, Reflector, Scene, Sides};
///
/// let mut ring = Object::new("ring", Shape::Ring(Ring::default()).mesh().expect("its dimensions are in range"));
/// let finish = Finish { reflectance: DVec3::ONE, metal: None, coat: None, roughness: 0.0 };
/// ring.reflector = Some(Reflector { sides: Sides::Front, finish });
/// let mut table = Object::new("table", Shape::Plane(Plane { size: [3.0, 3.0] }).mesh().expect("so are these"));
/// table.receiver = Some(Receiver { albedo: Vec3::splat(0.5), gloss: Gloss::None });
///
/// let projection = Projection::Perspective { fov_y_rad: 0.7 };
/// let camera = Camera::look_at(Vec3::new(0.0, 2.0, 4.0), Vec3::ZERO, Vec3::Y, projection).expect("a frame");
/// let light = Light::Constant(Vec3::ONE);
/// let scene = Scene {
///     name: "ring".to_owned(),
///     environment: EnvironmentSource { light, rotation_rad: 0.0, intensity: 1.0 },
///     lamps: Vec::new(),
///     medium: None,
///     camera,
///     objects: vec![ring, table],
///     animations: Vec::new(),
///     notes: Vec::new(),
/// };
///
/// # use pinspot::{Backend, Engine, NoProgress, Options, blocking};
/// let options = Options::default().with_size([16, 16]).with_samples(20);
/// let rendered = blocking::wait(None, Engine::new(scene, options, Backend::cpu()).render(&NoProgress))?;
/// assert!(rendered.layers[0].1.mean().x > 0.0);
/// # Ok::<(), pinspot::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The file's stem or the built-in scene's name; used in reports only.
    pub name: String,
    /// The environment lighting.
    pub environment: EnvironmentSource,
    /// The lights at a finite distance.
    pub lamps: Vec<Lamp>,
    /// What fills the space between objects; `None`: nothing that light meets.
    pub medium: Option<Medium>,
    /// The camera.
    pub camera: Camera,
    /// All objects.
    pub objects: Vec<Object>,
    /// What moves, and how; [`Self::pose`] moves it.
    pub animations: Vec<Animation>,
    /// What was repaired while loading (dropped triangles, for example), one sentence each.
    pub notes: Vec<String>,
}

impl Scene {
    /// Whether every object has a place in the world.
    ///
    /// # Errors
    /// A placement that is not finite, or that takes vertices out of the range of 32-bit numbers.
    pub fn check_placements(&self) -> Result<(), MeshError> {
        self.objects.iter().try_for_each(|object| object.checked_mesh_in_world().map(drop))
    }

    /// Whether a medium fills all space, not only what lies behind refractors.
    pub fn has_medium_everywhere(&self) -> bool {
        self.medium.is_some() && !self.objects.iter().any(|object| object.has_interfaces(Interfaces::One))
    }

    /// What is wrong with the medium, if anything is.
    pub fn check_medium(&self) -> Result<(), OptionError> {
        let Some(medium) = &self.medium else { return Ok(()) };
        if self.has_medium_around_solids() {
            return Err(OptionError::invalid("medium", Medium::NOT_AROUND_SOLIDS));
        }
        medium.check()
    }

    /// Whether there are closed refractors in a medium, which nothing computes.
    pub(crate) fn has_medium_around_solids(&self) -> bool {
        self.medium.is_some() && self.objects.iter().any(|object| object.has_interfaces(Interfaces::Two))
    }

    /// Where the light of emitters is taken from: the centre of the box around what casts caustics or, without that, around everything
    /// that does not shine.
    pub fn light_centre(&self) -> Vec3 {
        let meshes: Vec<Mesh> = self.objects.iter().map(Object::mesh_in_world).collect();
        light_centre(&meshes.iter().collect::<Vec<_>>(), &self.objects)
    }

    /// The objects' BRDFs as receivers.
    pub fn materials(&self) -> Materials {
        Materials::new(self.objects.iter().map(|o| o.receiver.as_ref().map(|r| (r.albedo, &r.gloss))))
    }
}

/// [`Scene::light_centre`], from the objects' meshes in world space.
pub fn light_centre(meshes: &[&Mesh], objects: &[Object]) -> Vec3 {
    let centre = |is_of: fn(&Object) -> bool| {
        let meshes = meshes.iter().zip(objects).filter(|(_, object)| is_of(object)).map(|(mesh, _)| mesh);
        let positions = meshes.flat_map(|mesh| mesh.positions());
        let (low, high) = positions.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
        (low.x <= high.x).then(|| 0.5 * low + 0.5 * high)
    };
    let of_casters = centre(|object| object.specular().is_some());
    of_casters.or_else(|| centre(|object| object.emitter.is_none())).unwrap_or(Vec3::ZERO)
}

/// An object: a mesh, its placement and its materials.
#[derive(Clone, Debug)]
pub struct Object {
    /// The name in the scene file, for messages.
    pub name: String,
    /// Geometry in object space; objects may share it.
    pub mesh: Arc<Mesh>,
    /// From object to world space.
    pub placement: Transform,
    /// `Some`: its surface is a mirror that casts caustics.
    pub reflector: Option<Reflector>,
    /// `Some`: its surface is an interface between two media, which casts caustics; it is neither reflector nor receiver.
    pub refractor: Option<Refractor>,
    /// `Some`: it receives caustics and direct light.
    pub receiver: Option<Receiver>,
    /// `Some`: it shines, and is neither reflector nor receiver.
    pub emitter: Option<Emitter>,
    /// `false`: invisible to camera rays, though not to light.
    pub camera_visible: bool,
}

impl PartialEq for Object {
    /// Whether both are the same, and share the same mesh in memory. Vertices are not compared.
    fn eq(&self, other: &Self) -> bool {
        let Self { name, mesh, placement, reflector, refractor, receiver, emitter, camera_visible } = self;
        let materials = (reflector, refractor, receiver, emitter, camera_visible);
        let others = (&other.reflector, &other.refractor, &other.receiver, &other.emitter, &other.camera_visible);
        *name == other.name && Arc::ptr_eq(mesh, &other.mesh) && *placement == other.placement && materials == others
    }
}

impl Object {
    /// An object at the origin that is neither reflector nor receiver.
    pub fn new(name: impl Into<String>, mesh: impl Into<Arc<Mesh>>) -> Self {
        Self {
            name: name.into(),
            mesh: mesh.into(),
            placement: Transform::default(),
            reflector: None,
            refractor: None,
            receiver: None,
            emitter: None,
            camera_visible: true,
        }
    }

    /// Whether it casts a caustic of this kind.
    pub fn casts(&self, chain: Chain) -> bool {
        match chain {
            Chain::R => self.reflector.is_some() || self.refractor.is_some_and(|refractor| refractor.fresnel),
            Chain::T => self.has_interfaces(Interfaces::One),
            Chain::TT | Chain::TTTT => self.has_interfaces(Interfaces::Two),
        }
    }

    /// Whether it is part of the environment.
    pub fn is_distant_light(&self) -> bool {
        self.emitter.is_some_and(|emitter| !emitter.is_near)
    }

    /// Whether it shines from where it is.
    pub fn is_near_light(&self) -> bool {
        self.emitter.is_some_and(|emitter| emitter.is_near)
    }

    /// Whether it is a refractor of so many interfaces.
    pub fn has_interfaces(&self, interfaces: Interfaces) -> bool {
        self.refractor.is_some_and(|refractor| refractor.interfaces == interfaces)
    }

    /// What makes it cast caustics, if it does.
    pub fn specular(&self) -> Option<Specular> {
        self.reflector.map(Specular::Reflector).or_else(|| self.refractor.map(Specular::Refractor))
    }

    /// The geometry in world space, and the number of triangles that lost their area by the placement.
    ///
    /// # Errors
    /// A placement that is not finite, or that takes vertices out of the range of 32-bit numbers.
    pub fn checked_mesh_in_world(&self) -> Result<(Mesh, usize), MeshError> {
        self.mesh.placed(&self.placement, &self.name)
    }

    /// The geometry in world space; empty where [`Self::checked_mesh_in_world`] fails.
    pub fn mesh_in_world(&self) -> Mesh {
        self.checked_mesh_in_world().map_or_else(|_| Mesh::default(), |(mesh, _)| mesh)
    }
}

/// Why a scene could not be loaded. Each message names the place and a remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The scene file itself could not be read.
    #[error("cannot read scene file '{}': {source}; give a path to a .toml file or the name of a built-in scene{}", escaped(&path.display().to_string()), hint)]
    Read {
        /// The path as given.
        path: PathBuf,
        /// A suggestion: the most similar built-in name, or empty.
        hint: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The file is not valid TOML, or a key is unknown, missing or of the wrong type.
    #[error("{file}:{line}: {message}")]
    Syntax {
        /// Scene file.
        file: String,
        /// Line, from 1.
        line: usize,
        /// What is wrong and what to do.
        message: String,
    },
    /// A value is out of its range.
    #[error("{file}:{line}: {key}: {message}")]
    Value {
        /// Scene file.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Key path, such as `camera.position`.
        key: String,
        /// What is wrong and what to do.
        message: String,
    },
    /// A mesh is unusable.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// An environment map is unusable.
    #[error(transparent)]
    Map(#[from] MapError),
    /// A receiver's table is unusable.
    #[error(transparent)]
    Table(#[from] TableError),
}
