//! The stages of image-space techniques: lights → photons → maps. The work itself is in [`crate::image_space`].

use std::sync::Arc;

use glam::{Mat3, Vec3};

use super::past_frames::PastFrames;
use super::photon_passes::{Passes, Source, until_halves_agree};
use super::{Inputs, Inspected, PassStatistics, Pending, Statistics, Sum, TechniqueStages};
use crate::backend::Backend;
use crate::differential::DifferentialSample;
use crate::environment::Environment;
#[cfg(feature = "gpu")]
use crate::image_space::gpu;
use crate::image_space::{
    Bounds, Hits, ImageSpaceOptions, Incidence, Kind, Ledger, Loss, MapInputs, MapPicture, MapView, Maps, PhotonLight,
    Profile, Segment, SegmentDirection, Surroundings, segments,
};
use crate::parallel;
use crate::pinhole::Receivers;
use crate::pinhole::cpu::TakenCell;
use crate::progress::{Progress, Stage, Uncounted};
use crate::scene::{Camera, Chain, Chains, Gloss, Interfaces, Lamp, Light, Mesh, Object, Scene, Sunlight, Visibility};
use crate::stages::{Id, LightStages, Memo, PreparedScene, StageCounts, SurfaceMaterials, View};
use crate::tracing::{Hit, SeenBy, Tracer};
use crate::{Error, OptionError};

/// Spots wider than this, radians, are divided into directions like environment maps.
const WIDEST_SPOT: f32 = 0.25;

/// The error of photons whose number follows from it, in tolerances of hierarchical sums.
const MORE_TOLERANCES: f32 = 2.0;

/// Progress of passes is counted in these.
const PASS_STEPS: u64 = 100;

/// Then every pass divides environments into so many times as many directions as the options say.
const MORE_DIRECTIONS: u32 = 16;

/// Previews send no more photons along an edge, from no more lights and directions.
const PREVIEW_PHOTONS: u32 = 192;
const PREVIEW_LIGHTS: u32 = 8;

/// The memory of a map on the CPU, at most.
const MAX_MAP_BYTES: u64 = 8 << 30;

/// Texels along an edge of a map that is shown, at most.
const MAP_PICTURE: u32 = 96;

/// What maps are made from.
#[derive(Clone, Debug, PartialEq)]
struct MapsKey {
    tracer: Id<Tracer>,
    materials: Id<SurfaceMaterials>,
    lights: Vec<PhotonLight>,
    chains: Chains,
    view: Option<(Camera, [u32; 2])>,
    options: ImageSpaceOptions,
    receives: Vec<bool>,
    seed: u64,
    /// The error that photons may leave where their number follows from it.
    tolerance: Option<f32>,
    /// Frames of just this that are averaged: it is made again until they all are.
    unchanged: u32,
}

/// The parts of an environment, by their number.
type Segments = Memo<(Id<Environment>, u32), Vec<Segment>>;

/// The stages of image-space techniques.
#[derive(Debug)]
pub(super) struct ImageSpaceStages {
    /// The parts of the environment: of pictures, and of previews.
    segments: [Segments; 2],
    receivers: Memo<(Id<Tracer>, Vec<bool>), Tracer>,
    maps: Memo<MapsKey, ImageSpaceSum>,
    /// Frames before this one: of pictures, and of previews.
    past: [Past; 2],
}

/// The frames so far, and what the last one was made from.
#[derive(Debug, Default)]
struct Past {
    frames: PastFrames,
    key: Option<MapsKey>,
}

/// Finished maps, as a sum.
#[derive(Debug)]
struct ImageSpaceSum {
    frames: PastFrames,
    statistics: Statistics,
}

impl ImageSpaceStages {
    pub fn new() -> Self {
        let segments = std::array::from_fn(|_| Memo::new(Stage::Light));
        Self { segments, receivers: Memo::new(Stage::Bvh), maps: Memo::new(Stage::Photons), past: Default::default() }
    }

    async fn make(&mut self, inputs: &Inputs<'_>) -> Result<Arc<dyn Sum>, Error> {
        check(inputs)?;
        let Inputs { scene, prepared, options, chains, progress, .. } = *inputs;
        let image_space = options_of(inputs);
        let receives: Vec<bool> = scene.objects.iter().map(|object| object.receiver.is_some()).collect();
        let follows_tolerance = image_space.follows_tolerance() && !inputs.is_preview;
        let directions = image_space.lights * if follows_tolerance { MORE_DIRECTIONS } else { 1 };
        let environment = &inputs.light.environment;
        let memo = &mut self.segments[usize::from(inputs.is_preview)];
        let make = || segments(&environment.cube, directions);
        let segmented = || memo.get((Id::of(environment), directions), progress, make);
        let sources = sources(inputs, segmented);
        let tolerance = follows_tolerance.then_some(MORE_TOLERANCES * options.tolerance);
        let mut key = MapsKey {
            tracer: Id::of(&prepared.tracer),
            materials: Id::of(&prepared.materials),
            lights: sources.iter().map(|(light, _)| light.clone()).collect(),
            chains,
            view: (image_space.caustic_map == MapView::Eye).then_some((scene.camera, options.size)),
            options: image_space,
            receives: receives.clone(),
            seed: options.seed,
            tolerance,
            unchanged: 0,
        };
        let of_receivers = (Id::of(&prepared.tracer), receives);
        let receivers = self.receivers.get(of_receivers, progress, || receivers_alone(&scene.objects));
        let past = &mut self.past[usize::from(inputs.is_preview)];
        let frames = past.frames.with(&image_space);
        let is_same = past.key.as_ref() == Some(&key);
        let inputs_alone = key.clone();
        key.unchanged = frames.unchanged_after(is_same);
        let steps = if tolerance.is_some() { PASS_STEPS } else { 1 };
        let make = async || sum(inputs, (sources, &receivers), (frames, is_same), tolerance).await;
        let made = self.maps.wait_for(key, (steps, progress), make).await?;
        if !progress.is_cancelled() {
            *past = Past { frames: made.frames.clone(), key: Some(inputs_alone) };
        }
        Ok(made)
    }
}

async fn sum(
    inputs: &Inputs<'_>,
    (sources, receivers): (Vec<Source>, &Tracer),
    (mut frames, mut is_same): (PastFrames, bool),
    tolerance: Option<f32>,
) -> Result<ImageSpaceSum, Error> {
    let backend = inputs.backend;
    let (lights, segments): (Vec<PhotonLight>, Vec<_>) = sources.into_iter().unzip();
    let options_of_frame = options_of(inputs);
    let fixed = ImageSpaceOptions { mode: options_of_frame.mode.fixed(options_of_frame.traversal), ..options_of_frame };
    let image_space = &fixed;
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
    // A GPU draws its images.
    let has_images = image_space.hits != Hits::Traced && backend.device().is_none();
    let of_solid = |(number, object): (usize, &Object)| {
        let is_shown = has_images && object.casts(Chain::TT);
        is_shown.then(|| (number as u32, alone(&meshes, &scene.objects, |other| std::ptr::eq(other, object))))
    };
    let solids: Vec<(u32, Tracer)> = scene.objects.iter().enumerate().filter_map(of_solid).collect();
    let kinds = Kind::of_scene(&scene.objects, chains);
    let is_glossy = (0..).zip(&scene.objects).any(|(k, o)| o.receiver.is_some() && materials.receivers.is_glossy(k));
    let mut inputs = MapInputs {
        surroundings: Surroundings { tracer, objects: &scene.objects, mirrors: &materials.mirrors },
        receivers,
        receiver_points: &receiver_points,
        solids: &solids,
        casters: &casters,
        triangles: &triangles,
        bounds: bounds.unwrap_or(Bounds { corners: [Vec3::ZERO; 2] }),
        lights: &lights,
        draws: None,
        few: None,
        kinds: &kinds,
        view: (scene.camera, options.size),
        options: image_space,
        pattern: frames.pattern(options.seed),
        glossy: is_glossy.then_some(&materials.receivers),
    };
    let shown = Shown {
        solids: scene.objects.iter().filter(|object| object.has_interfaces(Interfaces::Two)).count(),
        mirrors_are_seen: sees_mirrors(scene, prepared),
    };
    let uncounted = Uncounted(progress);
    if let Some(tolerance) = tolerance {
        let send = async |inputs: &MapInputs<'_>| {
            let sent = maps(inputs, (backend, prepared), &uncounted).await?;
            if progress.is_cancelled() { Err(Error::Cancelled) } else { Ok(sent) }
        };
        let told = std::cell::Cell::new(0);
        let is_done = |part: f64| {
            let steps = (part * PASS_STEPS as f64) as u64;
            progress.advance(steps.saturating_sub(told.get()));
            told.set(steps.max(told.get()));
        };
        let Passes { maps, mode, count, error } =
            until_halves_agree(&inputs, (&segments, tolerance.into()), send, &is_done).await?;
        let photons = [maps.photons, maps.photons_used];
        frames.push(maps, is_same);
        let image_space = ImageSpaceOptions { mode, ..*image_space };
        let passes = PassStatistics { photon_passes: count, photon_error: error };
        let statistics = statistics(&frames, &image_space, (photons, Some(passes)), (&shown, tolerance));
        return Ok(ImageSpaceSum { frames, statistics });
    }
    let mut photons = [0; 2];
    for _ in 0..frames.missing() {
        inputs.pattern = frames.pattern(options.seed);
        let maps = maps(&inputs, (backend, prepared), &uncounted).await?;
        photons = [photons[0] + maps.photons, photons[1] + maps.photons_used];
        frames.push(maps, is_same);
        is_same = true;
    }
    let statistics = statistics(&frames, image_space, (photons, None), (&shown, f32::INFINITY));
    Ok(ImageSpaceSum { frames, statistics })
}

/// What a picture shows of what casts caustics.
struct Shown {
    /// Closed objects of glass in the scene.
    solids: usize,
    /// The camera sees something by way of mirrors or interfaces.
    mirrors_are_seen: bool,
}

/// Whether the camera sees anything that reflects or refracts, along some rays.
fn sees_mirrors(scene: &Scene, prepared: &PreparedScene) -> bool {
    const EDGE: u32 = 24;
    let view = View { camera: scene.camera, size: [EDGE; 2], pixel_samples: 1, first_row: 0, rows: EDGE };
    let hits = (0..EDGE * EDGE).filter_map(|k| prepared.camera.hit(view.ray(k)));
    hits.map(|hit| &scene.objects[hit.object as usize]).any(|object| object.specular().is_some())
}

/// What the newest maps say, with the numbers of photons of all new ones.
fn statistics(
    frames: &PastFrames,
    image_space: &ImageSpaceOptions,
    ([photons, photons_used], passes): ([u64; 2], Option<PassStatistics>),
    (in_picture, tolerance): (&Shown, f32),
) -> Statistics {
    let Some(maps) = frames.newest() else { return Statistics::default() };
    let shown = lost_light(&maps.ledger, in_picture.solids).or_else(|| without_light(maps, in_picture));
    let beside = off_map(&maps.ledger, image_space);
    let error = passes.and_then(|passes| uncertain(&passes, tolerance));
    let warnings = shown.into_iter().chain(beside).chain(error).collect();
    Statistics {
        samples: 0,
        positions: Arc::new(maps.places.clone()),
        evaluation: None,
        filter: None,
        photons: Some(super::PhotonStatistics {
            mode: image_space.mode,
            hits: image_space.hits,
            traversal: image_space.traversal,
            caustic_map: image_space.caustic_map,
            incidence: image_space.incidence,
            temporal_frames: image_space.temporal_frames,
            paper: image_space.paper,
            passes,
            photons,
            photons_used,
            lights: maps.lights_used,
            flux: maps.ledger,
        }),
        warnings,
    }
}

/// What to say of maps that can show nothing.
fn without_light(maps: &Maps, in_picture: &Shown) -> Option<String> {
    let flux = maps.ledger;
    let is_dark = maps.photons > 0 && flux.cast == 0.0;
    // By way of mirrors and interfaces the camera may see other maps.
    let is_missing = flux.cast > 0.0 && flux.deposited == 0.0 && !(in_picture.mirrors_are_seen && maps.has_light());
    match (is_dark, is_missing) {
        (true, _) => Some("no light meets a mirror or an interface, so that there is no caustic".into()),
        (_, true) => Some(
            "none of the light that mirrors and interfaces cast lands on a receiver that the caustic maps show, so that there is no caustic: \
             give an object a receiver, or move the camera"
                .into(),
        ),
        _ => None,
    }
}

/// What to say of light that lands beside the maps of lights, which are to show all of it.
fn off_map(flux: &Ledger, options: &ImageSpaceOptions) -> Option<String> {
    let share = if flux.cast > 0.0 { flux[Loss::OffMap] / flux.cast } else { 0.0 };
    (options.caustic_map == MapView::Light && share > MOST_LOST).then(|| {
        format!(
            "{:.0} % of the light that mirrors and glass cast lands beside the maps of the lights, which a few photons framed: give \
             --caustic-map eye",
            100.0 * share
        )
    })
}

/// What to say of photons whose halves differ by too much.
fn uncertain(passes: &PassStatistics, tolerance: f32) -> Option<String> {
    let PassStatistics { photon_passes, photon_error } = *passes;
    (photon_error > f64::from(tolerance)).then(|| {
        format!(
            "the caustic may be wrong by {:.1} %, as two halves of the photons in {photon_passes} passes show: photons need many directions of wide \
             lights, which pinholes (--technique pinhole) know as a whole; for small lights give more --photons",
            100.0 * photon_error
        )
    })
}

/// Light of which less is lost is not worth a warning.
const MOST_LOST: f64 = 0.03;

/// What to say of the light that photons stop following: they pass one mirror, one surface of water or one or two solids of glass.
fn lost_light(flux: &Ledger, solids: usize) -> Option<String> {
    let share = |loss: Loss| if flux.cast > 0.0 { flux[loss] / flux.cast } else { 0.0 };
    let (met, kept) = (share(Loss::NoReceiver), share(Loss::TotalReflection));
    if met + kept <= MOST_LOST {
        return None;
    }
    let per_cent = |share: f64| format!("{:.0} %", 100.0 * share);
    let parts = [
        (met, "meets another mirror, glass or what receives nothing, where it is not followed"),
        (kept, "is reflected inside of glass"),
    ];
    let parts: Vec<String> = parts
        .into_iter()
        .filter(|(share, _)| *share >= 0.005)
        .map(|(share, what)| format!("{} {what}", per_cent(share)))
        .collect();
    let remedy = if solids > 1 && met > MOST_LOST {
        "; --aov caustic.TTTT has what passes through two objects"
    } else {
        "; neither technique follows it further"
    };
    Some(format!(
        "{} of the light that mirrors and glass cast is missing in the caustic: {}{remedy}",
        per_cent(met + kept),
        parts.join(", ")
    ))
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
    let has_table = |o: &Object| o.receiver.as_ref().is_some_and(|receiver| matches!(receiver.gloss, Gloss::Table(_)));
    let is_of_each_photon = options.image_space.incidence == Incidence::Photon;
    if is_of_each_photon && inputs.backend.device().is_some() && scene.objects.iter().any(has_table) {
        return refuse(
            "incidence",
            "is photon, which a GPU does not know of measured BRDFs: choose mean, or the CPU".into(),
        );
    }
    let bytes = options_of(inputs).map_bytes();
    if inputs.backend.device().is_none() && bytes > MAX_MAP_BYTES {
        let size = options.image_space.caustic_map_size;
        let [takes, most] = [bytes, MAX_MAP_BYTES].map(|bytes| bytes as f64 / f64::from(1 << 30));
        let message = format!(
            "is {size}: maps in this mode take {takes:.0} GiB, and at most {most:.0} are used; make it smaller"
        );
        return refuse("caustic_map_size", message);
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
fn sources(inputs: &Inputs, parts: impl FnOnce() -> Arc<Vec<Segment>>) -> Vec<Source> {
    let Inputs { scene, prepared, light, .. } = *inputs;
    let rotation = Mat3::from_rotation_y(light.rotation_rad);
    let from_far = match scene.environment.light {
        Light::Spot { direction, sigma_rad, radiance }
            if sigma_rad <= WIDEST_SPOT && prepared.light_geometry.is_none() =>
        {
            let irradiance = std::f32::consts::TAU * sigma_rad * sigma_rad * radiance;
            let towards = rotation * direction;
            vec![(PhotonLight::Directional { towards, irradiance, sigma_rad, profile: Profile::Gaussian }, None)]
        }
        _ => {
            let of_segment = |segment: &Segment| {
                let SegmentDirection { towards, irradiance } = segment.whole;
                let (towards, profile) = (rotation * towards, Profile::Gaussian);
                let whole = PhotonLight::Directional { towards, irradiance, sigma_rad: 0.0, profile };
                (whole, Some((segment.clone(), rotation)))
            };
            parts().iter().map(of_segment).collect()
        }
    };
    let lamps = light.lamps.iter().map(|lamp| (of_lamp(lamp), None));
    from_far.into_iter().filter(|(light, _)| light.power_on(1.0) > 0.0).chain(lamps).collect()
}

/// The light of a lamp; of one that is far away, parallel rays.
fn of_lamp(lamp: &Lamp) -> PhotonLight {
    match lamp.sunlight() {
        None => PhotonLight::Lamp(lamp.clone()),
        Some(Sunlight { towards, irradiance, sigma_rad }) => {
            PhotonLight::Directional { towards, irradiance, sigma_rad, profile: Profile::Disc }
        }
    }
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
        let count = self.frames.newest().map_or(0, Maps::count) as f32;
        let sums = parallel::collect(receivers.positions.len(), &|index| {
            let ([x, y, z, _], [nx, ny, nz, _]) = (receivers.positions[index], receivers.normals[index]);
            let Some(object) = receivers.object(index).filter(|_| receivers.lengths.is_none()) else { return [0.0; 4] };
            let normal = Vec3::new(nx, ny, nz);
            let light = self.frames.light_at(Vec3::new(x, y, z), normal, object);
            let value = match (&receivers.view_directions, light.reflected) {
                (None, _) => light.irradiance,
                (Some(_), Some(reflected)) => reflected,
                (Some(viewers), None) => {
                    let [vx, vy, vz, _] = viewers.directions[index];
                    let towards = -light.direction;
                    light.irradiance * viewers.materials.value(object, normal, towards, Vec3::new(vx, vy, vz), 0.0)
                }
            };
            value.extend(count).to_array()
        });
        progress.advance(receivers.positions.len() as u64);
        Box::pin(std::future::ready(Ok(sums)))
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    fn caustic_map(&self) -> Option<MapPicture> {
        self.frames.newest()?.picture(MAP_PICTURE)
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
