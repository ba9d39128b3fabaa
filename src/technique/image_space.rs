//! The stages of image-space techniques: lights → photons → maps. The work itself is in [`crate::image_space`].

use std::sync::Arc;

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::{Inputs, Inspected, Pending, Statistics, Sum, TechniqueStages};
use crate::backend::Backend;
use crate::differential::DifferentialSample;
#[cfg(feature = "gpu")]
use crate::image_space::gpu;
use crate::image_space::{
    Bounds, Direction, Hits, ImageSpaceOptions, Kind, MapInputs, MapPicture, MapView, Maps, PhotonLight, Surroundings,
    segmented,
};
use crate::pinhole::Receivers;
use crate::pinhole::cpu::TakenCell;
use crate::progress::{Progress, Stage, Uncounted};
use crate::scene::{Camera, Chain, Chains, Lamp, Light, Mesh, Object, Visibility};
use crate::stages::{Id, LightStages, Memo, PreparedScene, StageCounts, SurfaceMaterials};
use crate::tracing::{Hit, SeenBy, Tracer};
use crate::{Error, OptionError};

/// Spots wider than this, radians, are divided into directions like environment maps.
const WIDEST_SPOT: f32 = 0.25;

/// Previews send no more photons along an edge, from no more lights and directions.
const PREVIEW_PHOTONS: u32 = 192;
const PREVIEW_LIGHTS: u32 = 8;

/// Texels along an edge of a map that is shown, at most.
const MAP_PICTURE: u32 = 96;

/// What maps are made from.
#[derive(PartialEq)]
struct MapsKey {
    tracer: Id<Tracer>,
    materials: Id<SurfaceMaterials>,
    lights: Vec<PhotonLight>,
    chains: Chains,
    view: Option<(Camera, [u32; 2])>,
    options: ImageSpaceOptions,
    receives: Vec<bool>,
    seed: u64,
}

/// The stages of image-space techniques.
#[derive(Debug)]
pub(super) struct ImageSpaceStages {
    receivers: Memo<(Id<Tracer>, Vec<bool>), Tracer>,
    maps: Memo<MapsKey, ImageSpaceSum>,
}

/// Finished maps, as a sum.
#[derive(Debug)]
struct ImageSpaceSum {
    maps: Maps,
    statistics: Statistics,
}

impl ImageSpaceStages {
    pub fn new() -> Self {
        Self { receivers: Memo::new(Stage::Bvh), maps: Memo::new(Stage::Photons) }
    }

    async fn make(&mut self, inputs: &Inputs<'_>) -> Result<Arc<dyn Sum>, Error> {
        check(inputs)?;
        let Inputs { scene, prepared, options, chains, progress, .. } = *inputs;
        let image_space = options_of(inputs);
        let receives: Vec<bool> = scene.objects.iter().map(|object| object.receiver.is_some()).collect();
        let key = MapsKey {
            tracer: Id::of(&prepared.tracer),
            materials: Id::of(&prepared.materials),
            lights: lights(inputs, image_space.lights),
            chains,
            view: (image_space.caustic_map == MapView::Eye).then_some((scene.camera, options.size)),
            options: image_space,
            receives: receives.clone(),
            seed: options.seed,
        };
        let of_receivers = (Id::of(&prepared.tracer), receives);
        let receivers = self.receivers.get(of_receivers, progress, || receivers_alone(&scene.objects));
        let photon_lights = key.lights.clone();
        let make = async || sum(inputs, &photon_lights, &receivers, &image_space).await;
        Ok(self.maps.wait_for(key, (1, progress), make).await?)
    }
}

async fn sum(
    inputs: &Inputs<'_>,
    lights: &[PhotonLight],
    receivers: &Tracer,
    image_space: &ImageSpaceOptions,
) -> Result<ImageSpaceSum, Error> {
    let backend = inputs.backend;
    let Inputs { scene, prepared, options, chains, progress, .. } = *inputs;
    let PreparedScene { tracer, materials, .. } = prepared;
    let meshes: Vec<Mesh> = scene.objects.iter().map(Object::mesh_in_world).collect();
    let of = |is_wanted: fn(&Object) -> bool| {
        meshes.iter().zip(&scene.objects).filter(move |(_, object)| is_wanted(object)).map(|(mesh, _)| mesh)
    };
    let casting = || of(|object| object.specular().is_some());
    let casters: Vec<Vec3> = casting().flat_map(Mesh::positions).copied().collect();
    let triangles: Vec<[Vec3; 3]> =
        casting().flat_map(|mesh| (0..mesh.triangles().len()).map(|k| mesh.corners(k))).collect();
    let receiver_points: Vec<Vec3> =
        of(|object| object.receiver.is_some()).flat_map(Mesh::positions).copied().collect();
    let bounds = Bounds::around(of(|object| object.emitter.is_none()).flat_map(Mesh::positions).copied());
    let is_solid = |object: &Object| object.casts(Chain::TT) && image_space.hits != Hits::Traced;
    let solids = alone(&meshes, &scene.objects, is_solid);
    let kinds = Kind::of_scene(&scene.objects, chains);
    let has_directions =
        (0..).zip(&scene.objects).any(|(k, o)| o.receiver.is_some() && materials.receivers.is_glossy(k));
    let inputs = MapInputs {
        surroundings: Surroundings { tracer, objects: &scene.objects, mirrors: &materials.mirrors },
        receivers,
        receiver_points: &receiver_points,
        solids: &solids,
        casters: &casters,
        triangles: &triangles,
        bounds: bounds.unwrap_or(Bounds { corners: [Vec3::ZERO; 2] }),
        lights,
        kinds: &kinds,
        view: (scene.camera, options.size),
        options: image_space,
        seed: options.seed,
        has_directions,
    };
    let maps = maps(&inputs, (backend, prepared), &Uncounted(progress)).await?;
    let warning = without_light(&maps);
    let statistics = Statistics {
        samples: 0,
        positions: Arc::new(maps.places.clone()),
        evaluation: None,
        filter: None,
        photons: Some(super::PhotonStatistics {
            mode: image_space.mode,
            hits: image_space.hits,
            traversal: image_space.traversal,
            caustic_map: image_space.caustic_map,
            photons: maps.photons,
            photons_used: maps.photons_used,
            lights: maps.lights_used,
            flux: maps.ledger,
        }),
        warning,
    };
    Ok(ImageSpaceSum { maps, statistics })
}

/// What to say of maps that can show nothing.
fn without_light(maps: &Maps) -> Option<String> {
    let is_dark = maps.photons > 0 && maps.ledger.cast == 0.0;
    is_dark.then(|| "no light meets a mirror or an interface, so that there is no caustic".into())
}

/// Sends the photons: on the GPU if there is one, else on the CPU.
#[cfg_attr(not(feature = "gpu"), expect(clippy::unused_async, reason = "only a GPU has to be waited for"))]
async fn maps(
    inputs: &MapInputs<'_>,
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "there is none"))] (backend, prepared): (
        &Backend,
        &PreparedScene,
    ),
    progress: &dyn Progress,
) -> Result<Maps, Error> {
    #[cfg(feature = "gpu")]
    if let (Some(shared), Some(geometry)) = (backend.shared_gpu(), &prepared.on_gpu) {
        let pipelines = shared.pipelines.photons(&shared.gpu.device);
        let device = gpu::Device { gpu: &shared.gpu, pipelines: &pipelines, geometry };
        return gpu::maps(device, inputs, progress).await;
    }
    Ok(Maps::new(inputs, progress))
}

/// What of the scene the technique does not know, or options that mean nothing to it.
fn check(inputs: &Inputs) -> Result<(), OptionError> {
    let Inputs { scene, options, .. } = *inputs;
    let refuse = |key: &'static str, message: String| Err(OptionError::invalid(key, message));
    if let Some(reason) = super::Technique::ImageSpace.unsupported(scene) {
        return refuse("technique", format!("is image-space, which does not know {reason}; choose pinhole"));
    }
    if options.visibility == Visibility::None {
        return refuse(
            "visibility",
            "is none, but photons of image-space techniques meet every object: choose full".into(),
        );
    }
    if !options.attenuation {
        return refuse("attenuation", "is off, but the density of photons falls with distance: choose on".into());
    }
    if scene.objects.iter().all(|object| object.specular().is_none()) {
        return refuse(
            "reflector",
            "is missing: give an object `reflector = { sides = \"front\" }` or a refractor".into(),
        );
    }
    Ok(())
}

fn options_of(inputs: &Inputs) -> ImageSpaceOptions {
    let options = inputs.options.image_space;
    if !inputs.is_preview {
        return options;
    }
    ImageSpaceOptions {
        photons: options.photons.min(PREVIEW_PHOTONS),
        caustic_map_size: options.caustic_map_size.min(2 * PREVIEW_PHOTONS),
        lights: options.lights.min(PREVIEW_LIGHTS),
        light_directions: options.light_directions.min(PREVIEW_LIGHTS),
        ..options
    }
}

/// The lights for an environment of intensity 1: the environment as one direction with an extent, or as many, and the lamps.
fn lights(inputs: &Inputs, count: u32) -> Vec<PhotonLight> {
    let Inputs { scene, prepared, light, .. } = *inputs;
    let rotation = Mat3::from_rotation_y(light.rotation_rad);
    let from_far = match scene.environment.light {
        Light::Spot { direction, sigma_rad, radiance }
            if sigma_rad <= WIDEST_SPOT && prepared.light_geometry.is_none() =>
        {
            let irradiance = std::f32::consts::TAU * sigma_rad * sigma_rad * radiance;
            vec![PhotonLight::Directional { towards: rotation * direction, irradiance, sigma_rad }]
        }
        _ => {
            let directions = segmented(&light.environment.cube, count).into_iter();
            let light = |d: Direction| PhotonLight::Directional {
                towards: rotation * d.towards,
                irradiance: d.irradiance,
                sigma_rad: 0.0,
            };
            directions.map(light).collect()
        }
    };
    let lamps = light.lamps.iter().map(|lamp: &Lamp| PhotonLight::Lamp(lamp.clone()));
    from_far.into_iter().filter(|light| light.power_on(1.0) > 0.0).chain(lamps).collect()
}

fn receivers_alone(objects: &[Object]) -> Tracer {
    let meshes: Vec<_> = objects.iter().map(Object::mesh_in_world).collect();
    alone(&meshes, objects, |object| object.receiver.is_some())
}

/// What rays meet of some of the objects.
fn alone(meshes: &[Mesh], objects: &[Object], is_met: impl Fn(&Object) -> bool) -> Tracer {
    let seen = objects.iter().map(|object| SeenBy::all_but_camera(is_met(object)));
    Tracer::of_meshes(meshes.iter().zip(seen))
}

impl Sum for ImageSpaceSum {
    fn irradiance<'a>(&'a self, receivers: &'a Receivers, progress: &'a dyn Progress) -> Pending<'a, Vec<[f32; 4]>> {
        let places = receivers.positions.par_iter().zip(&receivers.normals).enumerate();
        let sums = places.map(|(index, (&[x, y, z, _], &[nx, ny, nz, _]))| {
            let Some(object) = receivers.object(index).filter(|_| receivers.lengths.is_none()) else { return [0.0; 4] };
            let normal = Vec3::new(nx, ny, nz);
            let light = self.maps.light_at(Vec3::new(x, y, z), normal, object);
            let value = match &receivers.view_directions {
                None => light.irradiance,
                Some(viewers) => {
                    let [vx, vy, vz, _] = viewers.directions[index];
                    let towards = -light.direction;
                    light.irradiance * viewers.materials.value(object, normal, towards, Vec3::new(vx, vy, vz), 0.0)
                }
            };
            value.extend(self.maps.count() as f32).to_array()
        });
        let sums = sums.collect();
        progress.advance(receivers.positions.len() as u64);
        Box::pin(std::future::ready(Ok(sums)))
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    fn caustic_map(&self) -> Option<MapPicture> {
        self.maps.picture(MAP_PICTURE)
    }
}

impl TechniqueStages for ImageSpaceStages {
    fn prepare<'a>(&'a mut self, inputs: Inputs<'a>, _: &'a mut LightStages) -> Pending<'a, Arc<dyn Sum>> {
        Box::pin(async move {
            let made = self.make(&inputs).await;
            if inputs.progress.is_cancelled() { Err(Error::Cancelled) } else { made }
        })
    }

    fn surface_samples(&mut self, _: &Inputs) -> Result<Arc<Vec<DifferentialSample>>, Error> {
        Ok(Arc::default())
    }

    fn inspect(&mut self, _: &Inputs, _: &Hit) -> Result<Inspected, Error> {
        Ok(Inspected { contributions: Vec::new(), view: None })
    }

    fn cells_taken(&mut self, _: &Inputs, _: &mut LightStages, _: &Hit) -> Result<Option<Vec<TakenCell>>, Error> {
        Ok(None)
    }

    fn count(&self, counts: &mut StageCounts) {
        counts.add_memo(&self.maps);
    }
}
