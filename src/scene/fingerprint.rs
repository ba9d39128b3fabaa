//! A name for everything in a scene that a picture depends on, so that results kept in files can be told apart.

use super::{Light, Scene};

impl Scene {
    /// A hash of the scene's contents (meshes and environment images by value, not by name) and of `more`.
    pub fn fingerprint(&self, more: &str) -> String {
        let mut hasher = blake3::Hasher::new();
        let mut add = |bytes: &[u8]| {
            hasher.update(&(bytes.len() as u64).to_le_bytes());
            hasher.update(bytes);
        };
        add(concat!("pinspot ", env!("CARGO_PKG_VERSION")).as_bytes());
        add(more.as_bytes());
        add(format!("{:?}", self.camera).as_bytes());
        for object in &self.objects {
            let mesh = object.mesh_in_world();
            add(bytemuck::cast_slice(mesh.positions()));
            add(bytemuck::cast_slice(mesh.normals()));
            add(bytemuck::cast_slice(mesh.triangles()));
            add(format!("{:?} {:?} {}", object.reflector, object.receiver, object.camera_visible).as_bytes());
        }
        let environment = &self.environment;
        add(format!("{} {}", environment.rotation_rad, environment.intensity).as_bytes());
        match &environment.light {
            Light::Map(map) => {
                add(format!("{map:?}").as_bytes());
                for image in map.images() {
                    add(bytemuck::cast_slice(&image.pixels));
                }
            }
            light => add(format!("{light:?}").as_bytes()),
        }
        hasher.finalize().to_hex()[..32].to_owned()
    }
}
