//! A fingerprint of everything in a scene that a picture depends on, which identifies results kept in files.
//!
//! The hashed bytes are written explicitly, so that a fingerprint changes only when the scene does: it does not depend
//! on how Rust prints a type, nor on the code that renders, which whoever keeps a file names beside it.

use glam::{DVec3, Vec3};

use super::{
    Camera, Interfaces, Lamp, Light, MapLayout, Medium, Object, Projection, Receiver, Reflector, Refractor, Scene,
    Sides,
};
use crate::brdf::Gloss;

impl Scene {
    /// A hash of the scene's contents (meshes and environment images by value, not by name) and of `more`.
    pub fn fingerprint(&self, more: &str) -> String {
        let mut hash = Hash(blake3::Hasher::new());
        hash.bytes(more.as_bytes());
        hash.camera(&self.camera);
        hash.number(self.objects.len() as u64);
        self.objects.iter().for_each(|object| hash.object(object));
        hash.float(self.environment.rotation_rad);
        hash.float(self.environment.intensity);
        hash.light(&self.environment.light);
        self.lamps.iter().for_each(|lamp| hash.lamp(lamp));
        self.medium.iter().for_each(|medium| hash.medium(medium));
        hash.0.finalize().to_hex()[..32].to_owned()
    }
}

/// An unambiguous sequence of bytes for a scene. Each variant of an enum has a number of its own.
struct Hash(blake3::Hasher);

impl Hash {
    fn bytes(&mut self, bytes: &[u8]) {
        self.number(bytes.len() as u64);
        self.0.update(bytes);
    }

    fn number(&mut self, number: u64) {
        self.0.update(&number.to_le_bytes());
    }

    fn float(&mut self, number: f32) {
        self.0.update(&number.to_le_bytes());
    }

    fn double(&mut self, number: f64) {
        self.0.update(&number.to_le_bytes());
    }

    fn vector(&mut self, vector: Vec3) {
        vector.to_array().into_iter().for_each(|c| self.float(c));
    }

    fn camera(&mut self, camera: &Camera) {
        let Camera { position, forward, right, up, projection } = *camera;
        for vector in [position, forward, right, up] {
            self.vector(vector);
        }
        match projection {
            Projection::Perspective { fov_y_rad } => {
                self.number(0);
                self.float(fov_y_rad);
            }
            Projection::Orthographic { height } => {
                self.number(1);
                self.float(height);
            }
        }
    }

    fn object(&mut self, object: &Object) {
        let mesh = object.mesh_in_world();
        self.bytes(bytemuck::cast_slice(mesh.positions()));
        self.bytes(bytemuck::cast_slice(mesh.normals()));
        self.bytes(bytemuck::cast_slice(mesh.triangles()));
        self.number(u64::from(object.camera_visible));
        self.number(u64::from(object.reflector.is_some()));
        object.reflector.iter().for_each(|reflector| self.reflector(reflector));
        self.number(u64::from(object.receiver.is_some()));
        object.receiver.iter().for_each(|receiver| self.receiver(receiver));
        // 2: where it is; 1 stood for its light from infinitely far away.
        self.number(if object.emitter.is_some() { 2 } else { 0 });
        object.emitter.iter().for_each(|emitter| self.vector(emitter.radiance));
        if object.is_near_light() {
            self.number(1);
        }
        object.refractor.iter().for_each(|refractor| self.refractor(refractor));
    }

    fn lamp(&mut self, lamp: &Lamp) {
        let Lamp { position, radius, intensity, ref beam, .. } = *lamp;
        self.vector(position);
        self.float(radius);
        self.vector(intensity);
        if lamp.is_distant {
            self.number(2);
        }
        self.number(u64::from(beam.is_some()));
        if let Some(beam) = beam {
            self.vector(beam.direction);
            self.vector(beam.up);
            self.float(beam.half_angle_rad);
            self.float(beam.softness);
            self.number(u64::from(beam.slide.is_some()));
            if let Some(slide) = &beam.slide {
                self.number(slide.0.width as u64);
                self.bytes(bytemuck::cast_slice(&slide.0.pixels));
            }
        }
    }

    fn medium(&mut self, medium: &Medium) {
        let Medium { sigma_s, sigma_a, g } = *medium;
        self.vector(sigma_s);
        self.vector(sigma_a);
        self.float(g);
    }

    fn refractor(&mut self, refractor: &Refractor) {
        let Refractor { eta, fresnel, interfaces } = *refractor;
        eta.to_array().into_iter().for_each(|index| self.double(index));
        self.number(match (interfaces, fresnel) {
            (Interfaces::One, fresnel) => u64::from(fresnel),
            (Interfaces::Two, fresnel) => 2 + u64::from(fresnel),
        });
    }

    fn reflector(&mut self, reflector: &Reflector) {
        let Reflector { sides, finish } = *reflector;
        self.number(match sides {
            Sides::Front => 0,
            Sides::Back => 1,
            Sides::Both => 2,
        });
        let DVec3 { x, y, z } = finish.reflectance;
        for number in [x, y, z, finish.roughness] {
            self.double(number);
        }
        // By its name in scene files.
        let metal = finish.metal.map(|metal| serde_json::to_string(&metal).expect("a metal is a word"));
        self.bytes(metal.unwrap_or_default().as_bytes());
        // An index of 0 means that there is no coat.
        self.double(finish.coat.unwrap_or(0.0));
    }

    fn receiver(&mut self, receiver: &Receiver) {
        self.vector(receiver.albedo);
        match &receiver.gloss {
            Gloss::None => self.number(0),
            Gloss::Phong { specular, exponent } => {
                self.number(1);
                self.vector(*specular);
                self.float(*exponent);
            }
            Gloss::Ggx { specular, roughness } => {
                self.number(2);
                self.vector(*specular);
                self.float(*roughness);
            }
            Gloss::Table(table) => {
                self.number(3);
                self.bytes(bytemuck::cast_slice(table.entries()));
            }
        }
    }

    fn light(&mut self, light: &Light) {
        match light {
            Light::Map(map) => {
                self.number(0);
                self.number(match map.layout() {
                    MapLayout::Auto => 0,
                    MapLayout::Latlong => 1,
                    MapLayout::Angular => 2,
                    MapLayout::VerticalCross => 3,
                    MapLayout::HorizontalCross => 4,
                    MapLayout::Faces => 5,
                });
                self.number(map.images().len() as u64);
                for image in map.images() {
                    self.number(image.width as u64);
                    self.bytes(bytemuck::cast_slice(&image.pixels));
                }
            }
            Light::BuiltInMap(name) => {
                self.number(1);
                self.bytes(name.as_bytes());
            }
            Light::Spot { direction, sigma_rad, radiance } => {
                self.number(2);
                self.vector(*direction);
                self.float(*sigma_rad);
                self.vector(*radiance);
            }
            Light::Constant(radiance) => {
                self.number(3);
                self.vector(*radiance);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A change of a scene.
    type Change = fn(&mut Scene);

    #[test]
    fn whatever_changes_a_picture_changes_the_name() {
        let scene = crate::scene::load::<toml::Table>("varnish").unwrap().scene;
        let name = |change: &dyn Fn(&mut Scene)| {
            let mut scene = scene.clone();
            change(&mut scene);
            scene.fingerprint("")
        };
        let first = |scene: &Scene, wanted: fn(&Object) -> bool| scene.objects.iter().position(wanted).unwrap();
        let mirror = first(&scene, |o| o.reflector.is_some());
        let floor = first(&scene, |o| o.receiver.is_some());
        let changes: [Change; 9] = [
            |s| s.camera.position.x += 1e-6,
            |s| s.camera.projection = Projection::Orthographic { height: 1.0 },
            |s| s.environment.rotation_rad += 1e-6,
            |s| s.environment.intensity *= 2.0,
            |s| s.environment.light = Light::BuiltInMap("city".into()),
            |s| s.environment.light = Light::Constant(Vec3::ONE),
            |s| s.objects[0].camera_visible ^= true,
            |s| s.objects[0].placement.translate.y += 1e-3,
            |s| drop(s.objects.pop()),
        ];
        let mut names: Vec<String> = changes.iter().map(|change| name(change)).collect();
        names.push(name(&|_| ()));
        names.push(name(&|s| s.objects[mirror].reflector.as_mut().unwrap().finish.roughness = 0.3));
        names.push(name(&|s| s.objects[mirror].reflector.as_mut().unwrap().finish.coat = Some(1.7)));
        names.push(name(&|s| s.objects[mirror].reflector.as_mut().unwrap().sides = Sides::Back));
        names.push(name(&|s| s.objects[floor].receiver.as_mut().unwrap().albedo.y *= 0.5));
        names.push(name(&|s| s.objects[floor].receiver.as_mut().unwrap().gloss = Gloss::None));
        names.push(scene.fingerprint("other options"));
        let count = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), count, "two of them have one name");
        let mut renamed = scene.clone();
        renamed.name = "another".into();
        assert_eq!(renamed.fingerprint(""), scene.fingerprint(""));
    }
}
