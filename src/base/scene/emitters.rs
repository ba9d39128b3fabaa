//! Which emitters are so far away that their light is that of the environment.

use super::{Mesh, Object, light_centre};

/// An emitter is far away from this many radii of the mirrors on, from which its direction changes by no more than the sun is wide,
const FAR_FROM_MIRRORS: f32 = 100.0;
/// and from this many radii of everything together, which gets its direct light.
const FAR_FROM_ALL: f32 = 20.0;

/// How far away emitters are from the centre of the mirrors.
pub struct EmitterDistances {
    /// By object, metres; infinite for those that do not shine.
    pub distances: Vec<f32>,
    /// From here on they are far away, metres.
    pub far: f32,
}

impl EmitterDistances {
    /// Of objects with these meshes in world space.
    pub fn new(meshes: &[&Mesh], objects: &[Object]) -> Self {
        let centre = light_centre(meshes, objects);
        let of = |mesh: &Mesh| mesh.positions().iter().map(|p| p.distance(centre)).collect::<Vec<f32>>();
        let radius = |is_of: fn(&Object) -> bool| {
            let chosen = meshes.iter().zip(objects).filter(|(_, object)| is_of(object));
            chosen.flat_map(|(mesh, _)| of(mesh)).fold(0.0, f32::max)
        };
        let (mirrors, all) = (radius(|o| o.specular().is_some()), radius(|o| o.emitter.is_none()));
        let distance = |(mesh, object): (&&Mesh, &Object)| {
            if object.emitter.is_some() { of(mesh).into_iter().fold(f32::INFINITY, f32::min) } else { f32::INFINITY }
        };
        let distances = meshes.iter().zip(objects).map(distance).collect();
        Self { distances, far: (FAR_FROM_MIRRORS * mirrors).max(FAR_FROM_ALL * all) }
    }
}

/// Makes emitters near ones that are not far enough away, where the scene file leaves it open.
pub(super) fn decide_near(objects: &mut [Object], is_open: &[bool]) {
    if !objects.iter().zip(is_open).any(|(object, is_open)| *is_open && object.emitter.is_some()) {
        return;
    }
    let meshes: Vec<Mesh> = objects.iter().map(Object::mesh_in_world).collect();
    let EmitterDistances { distances, far } = EmitterDistances::new(&meshes.iter().collect::<Vec<_>>(), objects);
    for ((object, distance), is_open) in objects.iter_mut().zip(distances).zip(is_open) {
        if let Some(emitter) = object.emitter.as_mut().filter(|_| *is_open) {
            emitter.is_near = distance < far;
        }
    }
}
