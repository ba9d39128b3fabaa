//! What exists: meshes, shapes, materials, cameras, scene files and the built-in scenes.
//!
//! A [`Scene`] is complete and valid once built: meshes are free of NaN and of degenerate triangles. This module must not know samples, environments' texels or wgpu.

mod assets;
mod builtin;
mod camera;
mod file;
mod fingerprint;
mod light;
mod material;
mod mesh;
mod normals;
pub mod shapes;
mod transform;
mod visibility;
mod wavefront;

use std::path::PathBuf;
use std::sync::Arc;

pub use assets::Assets;
pub use builtin::{BUILT_IN, BuiltIn};
pub use camera::{Camera, Projection, Ray};
pub use file::{Loaded, load, parse};
pub use light::{EnvironmentMap, EnvironmentSource, Light, MAX_RADIANCE, MapError, MapLayout};
pub use material::{Receiver, Reflector, Sides};
pub use mesh::{Mesh, MeshError};
pub use transform::Transform;
pub use visibility::Visibility;
pub use wavefront::ObjReport;

use crate::brdf::{Materials, TableError};
use crate::words::escaped;

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

    /// The geometry in world space, and how many triangles lost their area on the way there.
    ///
    /// # Errors
    /// A placement that is not finite, or that takes vertices out of the range of 32-bit numbers.
    pub fn checked_mesh_in_world(&self) -> Result<(Mesh, usize), MeshError> {
        self.mesh.placed(&self.placement, &self.name)
    }

    /// The geometry in world space; empty if [`Self::checked_mesh_in_world`] has none.
    pub fn mesh_in_world(&self) -> Mesh {
        self.checked_mesh_in_world().map_or_else(|_| Mesh::default(), |(mesh, _)| mesh)
    }
}

/// Why a scene could not be loaded. Each message names the place and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The scene file itself could not be read.
    #[error("cannot read scene file '{}': {source}; give a path to a .toml file or the name of a built-in scene (`pinspot scenes` lists them{})", escaped(&path.display().to_string()), hint)]
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
    /// An environment map is unusable.
    #[error(transparent)]
    Map(#[from] MapError),
    /// A receiver's table is unusable.
    #[error(transparent)]
    Table(#[from] TableError),
}
