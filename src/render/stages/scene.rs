//! The prepared scene: meshes in world space, a ray tracer, the reflecting surface, materials, and light geometry.
//!
//! Independent of light and samples.

use std::sync::{Arc, LazyLock};

use glam::Vec3;

use super::StageCounts;
use super::light::DrawnGeometry;
use super::memo::{Id, Memo};
use super::near_emitters::NearEmitters;
use crate::brdf::Materials;
use crate::environment::LightGeometry;
#[cfg(feature = "gpu")]
use crate::gpu::{Gpu, GpuError};
#[cfg(feature = "gpu")]
use crate::pinhole::gpu::{Geometry, MovingGeometry};
use crate::pinhole::reflectance_curves;
use crate::progress::{Progress, Stage};
use crate::reflectance::{Curve, Finish};
use crate::sampling::Surface;
use crate::scene::{
    Emitter, EmitterDistances, Mesh, MeshError, Object, Receiver, Scene, Sides, Transform, light_centre,
};
use crate::tracing::{CameraTracer, SeenBy, Tracer};

/// A scene, ready for sampling and ray tracing.
#[derive(Clone, Debug)]
pub(crate) struct PreparedScene {
    /// What light meets.
    pub tracer: Arc<Tracer>,
    /// What the camera sees.
    pub camera: Arc<CameraTracer>,
    pub surface: Arc<LazySurface>,
    pub materials: Arc<SurfaceMaterials>,
    /// `None` where none is near.
    pub near_emitters: Option<Arc<NearEmitters>>,
    /// `None` without distant emitters.
    pub light_geometry: Option<Arc<LightGeometry>>,
    /// What light and the camera meet, on the GPU; `None` unless rays are traced there.
    #[cfg(feature = "gpu")]
    pub on_gpu: Option<Arc<Geometry>>,
    /// What the user should know about where things lie.
    pub notes: Vec<String>,
}

/// What reflects. Frames whose mirrors keep their samples never ask for it.
pub(crate) type LazySurface = LazyLock<Surface, Box<dyn FnOnce() -> Surface + Send>>;

impl PreparedScene {
    /// The light geometry, drawn as finely as its smallest emitter needs.
    pub fn drawn_geometry(&self) -> Option<DrawnGeometry> {
        let geometry = self.light_geometry.clone()?;
        Some(DrawnGeometry { cube_size: geometry.cube_size(), geometry, is_on_gpu: false })
    }

    /// The same for a moment: only as finely as is drawn quickly. On a GPU, it is drawn there, too.
    pub fn geometry_drawn_for_frame(&self, is_on_gpu: bool) -> Option<DrawnGeometry> {
        let geometry = self.light_geometry.clone()?;
        Some(DrawnGeometry { cube_size: FRAME_CUBE_SIZE, geometry, is_on_gpu })
    }
}

/// Face size of the cube map into which light geometry is drawn for one frame, unless the environment needs a finer one.
const FRAME_CUBE_SIZE: u32 = 256;

/// Reflectance of the objects' surfaces.
#[derive(Debug)]
pub(crate) struct SurfaceMaterials {
    /// Each object's BRDF as a receiver.
    pub receivers: Arc<Materials>,
    /// Each object's specular reflectance by angle of incidence.
    pub mirrors: Vec<Option<Curve>>,
}

impl SurfaceMaterials {
    fn of_scene(scene: &Scene) -> Self {
        Self { receivers: Arc::new(scene.materials()), mirrors: reflectance_curves(scene) }
    }
}

#[derive(PartialEq)]
struct PlacedMeshKey {
    mesh: Id<Mesh>,
    placement: Transform,
}

/// The stages that make a [`PreparedScene`].
#[derive(Debug)]
pub(crate) struct SceneStages {
    /// One per object.
    meshes: Vec<Memo<PlacedMeshKey, Mesh>>,
    /// Counts of objects that were removed.
    meshes_made_before: u64,
    tracer: Memo<TracerKey, Tracer>,
    /// For previews, while there is no other for the same meshes.
    tracer_of_frame: Memo<TracerKey, Tracer>,
    emitters: Memo<TracerKey, Tracer>,
    camera: Memo<CameraKey, CameraTracer>,
    surface: Memo<SurfaceKey, LazySurface>,
    materials: Memo<MaterialsKey, SurfaceMaterials>,
    near_emitters: Memo<EmittersKey, NearEmitters>,
    /// Where there are near emitters, too.
    distant_emitters: Memo<EmittersKey, Tracer>,
    light_geometry: Memo<LightGeometryKey, LightGeometry>,
    #[cfg(feature = "gpu")]
    moving: MovingGeometry,
    /// For one frame, or for a whole picture.
    #[cfg(feature = "gpu")]
    on_gpu: Memo<(Vec<PlacedObject>, bool), Geometry>,
}

/// Where an object on the GPU is, and who sees it.
#[cfg(feature = "gpu")]
type PlacedObject = (Id<Mesh>, Transform, SeenBy);

/// Objects' meshes, and which rays meet them.
type TracerKey = Vec<(Id<Mesh>, SeenBy)>;

/// What light meets, all emitters, and the near ones.
type CameraKey = (Id<Tracer>, Option<Id<Tracer>>, Option<Id<NearEmitters>>);

/// The numbers of some objects that shine, their meshes and radiance.
type EmittersKey = Vec<(u32, Id<Mesh>, Emitter)>;

/// Distant emitters, and the point from which they are seen.
type LightGeometryKey = (EmittersKey, Vec3);

/// The mesh of each object that mirrors, and on which sides.
type SurfaceKey = Vec<Option<(Id<Mesh>, Sides)>>;

/// Each object's materials as a receiver and as a mirror.
type MaterialsKey = Vec<(Option<Receiver>, Option<Finish>)>;

impl SceneStages {
    pub fn new() -> Self {
        Self {
            meshes: Vec::new(),
            meshes_made_before: 0,
            tracer: Memo::new(Stage::Bvh),
            tracer_of_frame: Memo::new(Stage::Bvh),
            emitters: Memo::new(Stage::Bvh),
            camera: Memo::new(Stage::Bvh),
            surface: Memo::new(Stage::Surface),
            materials: Memo::new(Stage::Materials),
            near_emitters: Memo::new(Stage::LightGeometry),
            distant_emitters: Memo::new(Stage::Bvh),
            light_geometry: Memo::new(Stage::LightGeometry),
            #[cfg(feature = "gpu")]
            moving: MovingGeometry::default(),
            #[cfg(feature = "gpu")]
            on_gpu: Memo::new(Stage::Upload),
        }
    }

    pub fn prepare(&mut self, scene: &Scene, progress: &dyn Progress) -> Result<PreparedScene, MeshError> {
        let mut prepared = self.prepare_with(scene, progress, false, |stages, key, meshes| {
            stages.tracer.get(key, progress, || Tracer::of_meshes(seen(meshes, scene)))
        })?;
        // It may be that of a frame.
        LazyLock::force(&prepared.surface);
        if prepared.light_geometry.is_some() {
            prepared.notes.extend(misplaced_emitter(&self.place_meshes(scene, progress)?, scene));
        }
        Ok(prepared)
    }

    /// Like [`Self::prepare`], for a scene that is different in the next frame.
    pub fn prepare_for_frame(&mut self, scene: &Scene, progress: &dyn Progress) -> Result<PreparedScene, MeshError> {
        self.prepare_with(scene, progress, true, |stages, key, meshes| {
            let kept = stages.tracer.kept(&key);
            kept.unwrap_or_else(|| {
                let of_picture = stages.tracer.latest();
                let update = |before: Option<Arc<Tracer>>| {
                    let before = before.or(of_picture);
                    Tracer::for_frame(before.as_deref(), before.is_none(), seen(meshes, scene))
                };
                stages.tracer_of_frame.get_by_update(key, progress, update)
            })
        })
    }

    fn prepare_with(
        &mut self,
        scene: &Scene,
        progress: &dyn Progress,
        is_for_frame: bool,
        tracer: impl FnOnce(&mut Self, TracerKey, &[Arc<Mesh>]) -> Arc<Tracer>,
    ) -> Result<PreparedScene, MeshError> {
        let meshes = self.place_meshes(scene, progress)?;
        let near = meshes.iter().zip(&scene.objects).filter(|(_, o)| !o.is_distant_light());
        let notes: Vec<String> = check_extent(near.map(|(mesh, _)| &**mesh))?.into_iter().collect();
        let key = |is_wanted: fn(&Object) -> bool| -> TracerKey {
            let objects = meshes.iter().zip(&scene.objects).filter(|(_, o)| is_wanted(o));
            objects.map(|(mesh, o)| (Id::of(mesh), SeenBy::of(o))).collect()
        };
        let tracer = tracer(self, key(|o| o.emitter.is_none()), &meshes);
        let shining = key(|o| o.emitter.is_some());
        let near_emitters = self.near_emitters(&meshes, scene, progress);
        let update = |before: Option<Arc<Tracer>>| Tracer::of_emitters(before.as_deref(), seen(&meshes, scene));
        let emitters = (!shining.is_empty()).then(|| self.emitters.get_by_update(shining, progress, update));
        let camera_key = (Id::of(&tracer), emitters.as_ref().map(Id::of), near_emitters.as_ref().map(Id::of));
        let camera = self.camera.get(camera_key, progress, || {
            let near = near_emitters.as_ref().map(|near| near.tracer.clone());
            CameraTracer::new(tracer.clone(), emitters.clone(), near)
        });
        let mirrors = |(mesh, o): (&Arc<Mesh>, &Object)| Some((Id::of(mesh), o.specular()?.sides()));
        let mirrors = meshes.iter().zip(&scene.objects).map(mirrors).collect();
        let surface = self.surface.get(mirrors, progress, || {
            let surface = reflecting_surface(&meshes, scene);
            if !is_for_frame {
                LazyLock::force(&surface);
            }
            surface
        });
        let materials = scene.objects.iter().map(|o| (o.receiver.clone(), o.reflector.map(|r| r.finish))).collect();
        let materials = self.materials.get(materials, progress, || SurfaceMaterials::of_scene(scene));
        let emitters = emitters
            .filter(|_| scene.objects.iter().any(Object::is_distant_light))
            .map(|all| if near_emitters.is_none() { all } else { self.distant_emitters(&meshes, scene, progress) });
        let light_geometry = emitters.map(|emitters| self.light_geometry(&meshes, scene, emitters, progress));
        Ok(PreparedScene {
            tracer,
            camera,
            surface,
            materials,
            near_emitters,
            light_geometry,
            #[cfg(feature = "gpu")]
            on_gpu: None,
            notes,
        })
    }

    /// Uploads the scene's triangles for rays on a GPU; the hierarchies of meshes that come later than the first ones are built quickly if
    /// these are there `for_one_frame`.
    #[cfg(feature = "gpu")]
    pub fn upload(
        &mut self,
        scene: &Scene,
        gpu: &Gpu,
        for_one_frame: bool,
        progress: &dyn Progress,
    ) -> Result<Arc<Geometry>, GpuError> {
        let placed = scene.objects.iter().map(|o| (Id::of(&o.mesh), o.placement, SeenBy::of(o)));
        let key = (placed.collect(), for_one_frame);
        let moving = &mut self.moving;
        self.on_gpu.try_get(key, progress, || moving.update(&gpu.device, &gpu.queue, &scene.objects, for_one_frame))
    }

    fn near_emitters(
        &mut self,
        meshes: &[Arc<Mesh>],
        scene: &Scene,
        progress: &dyn Progress,
    ) -> Option<Arc<NearEmitters>> {
        let key = emitters_key(meshes, scene, Object::is_near_light);
        (!key.is_empty()).then(|| self.near_emitters.get(key, progress, || NearEmitters::new(meshes, &scene.objects)))
    }

    /// What rays meet of distant emitters alone.
    fn distant_emitters(&mut self, meshes: &[Arc<Mesh>], scene: &Scene, progress: &dyn Progress) -> Arc<Tracer> {
        let key = emitters_key(meshes, scene, Object::is_distant_light);
        let seen_by = |object: &Object| SeenBy::all_but_camera(object.is_distant_light());
        let seen = || meshes.iter().zip(&scene.objects).map(|(mesh, object)| (&**mesh, seen_by(object)));
        self.distant_emitters.get(key, progress, || Tracer::of_meshes(seen()))
    }

    fn light_geometry(
        &mut self,
        meshes: &[Arc<Mesh>],
        scene: &Scene,
        tracer: Arc<Tracer>,
        progress: &dyn Progress,
    ) -> Arc<LightGeometry> {
        let objects = (0..).zip(meshes).zip(&scene.objects);
        let emitters: Vec<_> = objects
            .filter(|(_, object)| object.is_distant_light())
            .filter_map(|((index, mesh), object)| Some((index, mesh, object.emitter?)))
            .collect();
        let centre = light_centre(&meshes.iter().map(|mesh| &**mesh).collect::<Vec<_>>(), &scene.objects);
        let key = (emitters_key(meshes, scene, Object::is_distant_light), centre);
        let shining: Vec<_> = emitters.iter().map(|(index, mesh, e)| (*index, &***mesh, e.radiance)).collect();
        self.light_geometry.get(key, progress, || LightGeometry::new(&shining, tracer, centre))
    }

    fn place_meshes(&mut self, scene: &Scene, progress: &dyn Progress) -> Result<Vec<Arc<Mesh>>, MeshError> {
        while self.meshes.len() > scene.objects.len() {
            self.meshes_made_before += self.meshes.pop().map_or(0, |memo| memo.times_made());
        }
        self.meshes.resize_with(scene.objects.len(), || Memo::new(Stage::Geometry));
        let place = |(memo, object): (&mut Memo<PlacedMeshKey, Mesh>, &Object)| {
            let key = PlacedMeshKey { mesh: Id::of(&object.mesh), placement: object.placement };
            memo.try_get(key, progress, || Ok(object.checked_mesh_in_world()?.0))
        };
        self.meshes.iter_mut().zip(&scene.objects).map(place).collect()
    }

    pub fn count(&self, counts: &mut StageCounts) {
        counts.add(Stage::Geometry, self.meshes_made_before);
        self.meshes.iter().for_each(|memo| counts.add_memo(memo));
        counts.add_memo(&self.tracer);
        counts.add_memo(&self.emitters);
        counts.add_memo(&self.camera);
        counts.add_memo(&self.surface);
        counts.add_memo(&self.materials);
        counts.add_memo(&self.light_geometry);
        #[cfg(feature = "gpu")]
        counts.add_memo(&self.on_gpu);
    }
}

fn emitters_key(meshes: &[Arc<Mesh>], scene: &Scene, is_wanted: fn(&Object) -> bool) -> EmittersKey {
    let objects = (0u32..).zip(meshes).zip(&scene.objects).filter(|(_, object)| is_wanted(object));
    objects.filter_map(|((index, mesh), object)| Some((index, Id::of(mesh), object.emitter?))).collect()
}

/// The objects' meshes, and which rays meet them.
fn seen<'a>(meshes: &'a [Arc<Mesh>], scene: &'a Scene) -> impl Iterator<Item = (&'a Mesh, SeenBy)> {
    meshes.iter().zip(&scene.objects).map(|(mesh, object)| (&**mesh, SeenBy::of(object)))
}

/// Says which emitter is too near for its light to be that of the environment.
fn misplaced_emitter(meshes: &[Arc<Mesh>], scene: &Scene) -> Option<String> {
    let meshes: Vec<&Mesh> = meshes.iter().map(|mesh| &**mesh).collect();
    let EmitterDistances { distances, far } = EmitterDistances::new(&meshes, &scene.objects);
    let distant = scene.objects.iter().zip(distances).filter(|(object, _)| object.is_distant_light());
    let (object, distance) = distant.min_by(|(_, one), (_, other)| one.total_cmp(other))?;
    (distance < far).then(|| {
        format!(
            "emitter '{}' is {distance:.3} m from the centre of the mirrors; its light arrives everywhere as it does there, which is \
             accurate for mirrors and receivers of this size from about {far:.3} m on: give it near = true",
            object.name
        )
    })
}

/// The diagonals of scenes that 32-bit numbers carry through all products of areas and distances, metres.
const EXTENTS: std::ops::RangeInclusive<f32> = 1e-4..=1e5;
/// Farther from the origin than this, in diagonals, positions are coarse.
const FAR_FROM_ORIGIN: f32 = 1e3;

/// Refuses scenes that are too small or too large; says where one lies so far away that its positions are coarse.
fn check_extent<'a>(meshes: impl Iterator<Item = &'a Mesh>) -> Result<Option<String>, MeshError> {
    let positions = meshes.flat_map(Mesh::positions);
    let (low, high) = positions.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    if low.x > high.x {
        return Ok(None);
    }
    let (diagonal, distance) = ((high - low).length(), (0.5 * (low + high)).length());
    if !EXTENTS.contains(&diagonal) {
        return Err(MeshError::Extent { diagonal, least: *EXTENTS.start(), most: *EXTENTS.end() });
    }
    Ok((distance > FAR_FROM_ORIGIN * diagonal).then(|| {
        format!(
            "the scene is {diagonal} m across but {distance} m from the origin, where positions are coarse; light may be lost: move it to the origin"
        )
    }))
}

fn reflecting_surface(meshes: &[Arc<Mesh>], scene: &Scene) -> LazySurface {
    let mirror = |((index, mesh), object): ((u32, &Arc<Mesh>), &Object)| {
        Some((index, mesh.clone(), object.specular()?.sides() == Sides::Back))
    };
    let mirrors: Vec<(u32, Arc<Mesh>, bool)> = (0..).zip(meshes).zip(&scene.objects).filter_map(mirror).collect();
    LazyLock::new(Box::new(move || {
        let mut surface = Surface::default();
        for (index, mesh, is_flipped) in &mirrors {
            surface.append(mesh, *index, *is_flipped);
        }
        surface
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NoProgress;
    use crate::scene::shapes::{Shape, Sphere};

    fn prepared(scale: f32, translate: Vec3) -> Result<PreparedScene, MeshError> {
        let mut scene = crate::scene::load::<toml::Table>("mirror-sphere").unwrap().scene;
        let mut object = Object::new("ball", Shape::Sphere(Sphere::of_radius(0.5)).mesh().unwrap());
        object.placement = Transform { scale, translate, ..Transform::default() };
        scene.objects = vec![object];
        SceneStages::new().prepare(&scene, &NoProgress)
    }

    #[test]
    fn scenes_too_small_too_large_or_too_far_away_are_told() {
        assert!(prepared(1.0, Vec3::ZERO).unwrap().notes.is_empty());
        assert!(prepared(1.0, Vec3::X * 1e5).unwrap().notes[0].contains("from the origin"));
        for scale in [1e-6, 1e6] {
            let message = prepared(scale, Vec3::ZERO).unwrap_err().to_string();
            assert!(message.contains("m across"), "{message}");
        }
        assert!(prepared(1.0, Vec3::splat(f32::NAN)).is_err());
    }
}
