//! What exists: meshes, shapes, materials, cameras, scene files and the built-in scenes.
//!
//! A [`Scene`] is complete and valid once built: meshes are free of NaN and of degenerate triangles. This module must not know samples, environments' texels or wgpu.

mod builtin;
mod camera;
mod file;
mod fingerprint;
mod material;
mod mesh;
mod mtl;
mod normals;
mod obj;
pub mod shapes;
mod transform;
mod visibility;

use std::path::{Path, PathBuf};
use std::sync::Arc;

pub use builtin::{BUILT_IN, BuiltIn};
pub use camera::{Camera, Projection, Ray};
pub use file::{Loaded, load, parse};
pub use material::{Receiver, Reflector, Sides};
pub use mesh::{Mesh, MeshError};
pub(crate) use normals::DisjointSets;
pub use obj::{ObjReport, load_obj};
pub use transform::Transform;
pub use visibility::Visibility;

use glam::Vec3;

use crate::brdf::{Materials, TableError};

/// A whole scene, ready to be sampled and looked at.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The file's stem or the built-in scene's name; used in reports only.
    pub name: String,
    /// Where the light comes from.
    pub environment: EnvironmentSource,
    /// Who looks.
    pub camera: Camera,
    /// Everything that can be seen, mirrored or lit.
    pub objects: Vec<Object>,
    /// What was repaired while loading, one sentence each (dropped triangles, say).
    pub notes: Vec<String>,
}

impl Scene {
    /// What the objects' surfaces do with light that they receive.
    pub fn materials(&self) -> Materials {
        Materials::new(self.objects.iter().map(|o| o.receiver.as_ref().map(|r| (r.albedo, &r.gloss))))
    }
}

/// One object: a mesh, where it stands, and what it does with light.
#[derive(Clone, Debug)]
pub struct Object {
    /// The name in the scene file, for messages.
    pub name: String,
    /// Geometry in object space; objects may share it.
    pub mesh: Arc<Mesh>,
    /// From object to world space.
    pub placement: Transform,
    /// `Some`: its surface mirrors light.
    pub reflector: Option<Reflector>,
    /// `Some`: caustics and diffuse light show on it.
    pub receiver: Option<Receiver>,
    /// `false`: the camera looks through it (light does not).
    pub camera_visible: bool,
}

impl Object {
    /// An object that neither mirrors nor receives, at the origin.
    pub fn new(name: impl Into<String>, mesh: impl Into<Arc<Mesh>>) -> Self {
        Self {
            name: name.into(),
            mesh: mesh.into(),
            placement: Transform::default(),
            reflector: None,
            receiver: None,
            camera_visible: true,
        }
    }

    /// The geometry in world space.
    pub fn mesh_in_world(&self) -> Mesh {
        self.mesh.placed(&self.placement)
    }
}

/// Which light a scene stands in, before any of it is read from disk.
#[derive(Clone, Debug)]
pub struct EnvironmentSource {
    /// The light itself.
    pub light: Light,
    /// Turns the light about +Y, counter-clockwise, radians.
    pub rotation_rad: f32,
    /// Multiplies every radiance.
    pub intensity: f32,
}

/// The kinds of light a scene file can name.
#[derive(Clone, Debug)]
pub enum Light {
    /// An image file.
    Map {
        /// The files: one, or six for [`MapLayout::Faces`] in the order +X −X +Y −Y +Z −Z.
        files: Vec<PathBuf>,
        /// How the directions are laid out in the image.
        layout: MapLayout,
    },
    /// One of the maps embedded in the library, by name.
    BuiltInMap(String),
    /// A Gaussian spot in an otherwise black environment: L(θ) = radiance · exp(−θ²/2σ²).
    Spot {
        /// Towards the light; unit length.
        direction: Vec3,
        /// Standard deviation σ, radians.
        sigma_rad: f32,
        /// Peak radiance, W/(m²·sr).
        radiance: Vec3,
    },
    /// The same radiance from everywhere, W/(m²·sr).
    Constant(Vec3),
}

impl Light {
    /// A map as scene files and `--env` name it: a built-in map's name (no extension), or a file relative to `base`.
    pub fn map(base: &Path, name: &str, layout: MapLayout) -> Self {
        if Path::new(name).extension().is_none() {
            Self::BuiltInMap(name.to_owned())
        } else {
            Self::Map { files: vec![base.join(name)], layout }
        }
    }
}

/// How an environment image lays out directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MapLayout {
    /// By aspect ratio: 2:1 latlong, 1:1 angular, 3:4 vertical cross, 4:3 horizontal cross.
    Auto,
    /// Equirectangular.
    Latlong,
    /// Debevec's light probe.
    Angular,
    /// Three faces wide, four high.
    VerticalCross,
    /// Four faces wide, three high.
    HorizontalCross,
    /// Six square images.
    Faces,
}

/// Why a scene could not be loaded. Each message names the place and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The scene file itself could not be read.
    #[error("cannot read scene file '{}': {source}; give a path to a .toml file or the name of a built-in scene (`pinspot scenes` lists them{})", path.display(), hint)]
    Read {
        /// The path as given.
        path: PathBuf,
        /// The nearest built-in name, phrased, or nothing.
        hint: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The file is not TOML, or a key is unknown, missing or of the wrong type.
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
    /// A receiver's table is unusable.
    #[error(transparent)]
    Table(#[from] TableError),
}
