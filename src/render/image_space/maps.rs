//! The maps of a picture: photons from all lights, and which maps they are added to.

use std::borrow::Cow;

use glam::{DVec2, Mat3, Vec2, Vec3};

use super::adaptive::{FIRST_GRID, Traverser};
use super::caster_groups::caster_groups;
use super::caustic_map::ForGloss;
use super::coverage::Coverage;
use super::emission::{Emission, Kind, Pattern, Surroundings, emit};
use super::hierarchical::Hierarchy;
use super::irradiance_map::{Incident, IrradianceMap, MapPicture};
use super::ledger::{Ledger, Loss};
use super::lights::{LightView, PhotonLight, Profile, point_of_sequence};
use super::options::{Hits, ImageSpaceOptions, Incidence, MapView, Traversal};
use super::photons::PhotonGrid;
use super::projection::{Bounds, Projection};
use super::segmentation::{Direction, Segment};
use super::strips::{Strip, strips};
use super::surface_images::{SurfaceImage, SurfaceImages};
use super::{MapBuilder, Shows};
use crate::brdf::Materials;
use crate::progress::Progress;
use crate::scene::{Camera, Chain, Ray};
use crate::tracing::Tracer;

/// A texel of the camera's map tells the light if a surface has this part of it; of smaller parts, few photons and rounding would.
const SURE_PART: f32 = 0.5;

/// A step of the golden ratio.
const GOLDEN_STEP: f32 = 0.618_034;

/// Wide parts of an environment, whose caustics are blurred, send so many times fewer photons along an edge than others,
const COARSER: u32 = 4;
/// but no fewer than these.
const LEAST_PHOTONS: u32 = 64;

/// Directions of each part of an environment whose photons tell where those of all directions land.
const DRAWS_FOR_WINDOWS: u32 = 2;

/// Their photons along each edge.
const FEW_OF_DIRECTION: u32 = 16;

/// Clusters of photons that are followed together.
const CLUSTERS_OF_BATCH: usize = 1 << 18;

/// What maps are made from.
#[derive(Clone, Copy)]
pub struct MapInputs<'a> {
    /// What photons meet.
    pub surroundings: Surroundings<'a>,
    /// The receivers alone.
    pub receivers: &'a Tracer,
    /// Their vertices.
    pub receiver_points: &'a [Vec3],
    /// Each of the closed objects alone, for images of them on the CPU.
    pub solids: &'a [(u32, Tracer)],
    /// Vertices of what casts caustics.
    pub casters: &'a [Vec3],
    /// Its triangles.
    pub triangles: &'a [[Vec3; 3]],
    /// Around everything.
    pub bounds: Bounds,
    /// The lights.
    pub lights: &'a [PhotonLight],
    /// What the passes of a picture draw out of them; `None` where there is only one pass.
    pub draws: Option<Draws<'a>>,
    /// A few photons of each light, if they have been sent already.
    pub few: Option<&'a [FewPhotons]>,
    /// The ways that count.
    pub kinds: &'a [Kind],
    /// Whose picture it is, and its size.
    pub view: (Camera, [u32; 2]),
    /// The options.
    pub options: &'a ImageSpaceOptions,
    /// Which rays of their views photons go along.
    pub pattern: Pattern,
    /// The receivers' BRDFs, if some are glossy.
    pub glossy: Option<&'a Materials>,
}

/// What a pass draws out of lights: other directions and points than the passes before.
#[derive(Clone, Copy)]
pub struct Draws<'a> {
    /// By light: the part of the environment that it stands for, if it is one, and how that is turned.
    pub segments: &'a [Option<(Segment, Mat3)>],
    /// The number of the pass.
    pub pass: u32,
}

impl<'a> Draws<'a> {
    /// The part of the environment that a light stands for, and how it is turned.
    fn segment(&self, light: usize) -> Option<&'a (Segment, Mat3)> {
        self.segments.get(light)?.as_ref()
    }

    /// One direction of it.
    fn of_segment(&self, light: usize) -> Option<PhotonLight> {
        let (segment, turned) = self.segment(light)?;
        // Neighbouring parts are drawn from at other places, in each pass and in all passes together.
        let Vec2 { x, y } = point_of_sequence(light as u32);
        let number = (x + self.pass as f32 * GOLDEN_STEP).fract();
        let within = (point_of_sequence(self.pass) + y).fract();
        let Direction { towards, irradiance } = segment.draw(number, within);
        let profile = Profile::Gaussian;
        Some(PhotonLight::Directional { towards: *turned * towards, irradiance, sigma_rad: 0.0, profile })
    }
}

/// A light's view, and the photons from it.
pub type Emitted = (LightView, Vec<PhotonGrid>);

/// A few photons of a light.
pub type FewPhotons = Vec<Emitted>;

/// Finished maps.
#[derive(Debug)]
pub struct Maps {
    /// What the camera sees.
    eye: Option<IrradianceMap>,
    /// Lights' views. With the camera's they are for what it does not see.
    lights: Vec<IrradianceMap>,
    /// The account of the flux: in the camera's map or, without one, in those of the lights.
    pub ledger: Ledger,
    /// How many photons were followed.
    pub photons: u64,
    /// How many were added to maps: they met a receiver, or several were one.
    pub photons_used: u64,
    /// How many lights sent them.
    pub lights_used: usize,
    /// Where some of them met receivers, metres.
    pub places: Vec<Vec3>,
}

/// How many places of photons are kept at most.
const PLACES: usize = 4096;

/// Where photons landed, evenly chosen if there are many.
pub(super) fn places_of(few: &[FewPhotons]) -> Vec<Vec3> {
    let landed = || few.iter().flatten().flat_map(|(_, grids)| grids).flat_map(|grid| &grid.photons);
    let step = landed().count().div_ceil(PLACES).max(1);
    landed().step_by(step).map(|photon| photon.position).collect()
}

impl Maps {
    /// Sends photons and adds them to maps.
    pub fn new(inputs: &MapInputs, progress: &dyn Progress) -> Self {
        let mut maps = MapsBuilder::new(inputs, progress);
        for index in 0..inputs.lights.len() {
            if progress.is_cancelled() {
                break;
            }
            maps.add_light(index, progress);
        }
        maps.finish()
    }

    /// Finished maps of the camera and of lights, the account of their flux with the numbers of photons, and a few photons of each light.
    #[cfg(feature = "gpu")]
    pub(super) fn of_parts(
        eye: Option<IrradianceMap>,
        lights: Vec<IrradianceMap>,
        (ledger, photons, photons_used): (Ledger, u64, u64),
        few: &[FewPhotons],
    ) -> Self {
        let (lights_used, places) = (few.len(), places_of(few));
        Self { eye, lights, ledger, photons, photons_used, lights_used, places }
    }

    /// The light on a point of an object, on the side of a normal; `None` where no map shows it.
    pub fn light_at(&self, point: Vec3, normal: Vec3, object: u32) -> Option<Incident> {
        let seen = self.eye.as_ref().and_then(|map| map.nearest(point, normal, object));
        if let Some((light, _)) = seen.filter(|(_, part)| *part >= SURE_PART) {
            return Some(light);
        }
        let mut shown = self.lights.iter().filter_map(|map| map.bilinear(point, normal, object)).peekable();
        if shown.peek().is_none() {
            return seen.map(|(light, _)| light);
        }
        let mut sum = Incident::default();
        for light in shown {
            sum.irradiance += light.irradiance;
            sum.direction += light.irradiance.element_sum() * light.direction;
        }
        Some(Incident { direction: sum.direction.normalize_or_zero(), ..sum })
    }

    /// Mixes them with other maps of the same receivers, of which they are so much afterwards.
    pub fn mix(&mut self, other: &Self, part: f32) {
        let own = self.eye.iter_mut().chain(&mut self.lights);
        own.zip(other.eye.iter().chain(&other.lights)).for_each(|(map, other)| map.mix(other, part));
        self.ledger = self.ledger.mixed(&other.ledger, f64::from(part));
        self.photons += other.photons;
        self.photons_used += other.photons_used;
    }

    /// The root of the mean squared difference to other maps of the same receivers, relative to that of the irradiance; in the camera's map, if there
    /// is one.
    pub fn relative_difference(&self, other: &Self) -> f64 {
        let count = if self.eye.is_some() { 1 } else { self.lights.len() };
        let pairs = self.eye.iter().chain(&self.lights).zip(other.eye.iter().chain(&other.lights)).take(count);
        let texels = pairs.flat_map(|(one, other)| one.irradiance.iter().zip(&other.irradiance));
        let (difference, sum) = texels.fold((0.0, 0.0), |(difference, sum), (one, other)| {
            let (one, other) = (one.as_dvec3(), other.as_dvec3());
            (difference + (one - other).length_squared(), sum + (one + other).length_squared())
        });
        if sum > 0.0 { 2.0 * (difference / sum).sqrt() } else { 0.0 }
    }

    /// A picture of a map with at most so many texels along an edge: that of a light if there is one.
    pub fn picture(&self, most: u32) -> Option<MapPicture> {
        self.lights.first().or(self.eye.as_ref()).map(|map| map.picture(most))
    }

    /// Whether any map shows light.
    pub fn has_light(&self) -> bool {
        self.eye.iter().chain(&self.lights).any(|map| map.irradiance.iter().any(|light| *light != Vec3::ZERO))
    }

    /// How many maps there are.
    pub fn count(&self) -> usize {
        self.lights.len() + usize::from(self.eye.is_some())
    }
}

/// Maps, and the photons so far.
struct MapsBuilder<'a> {
    inputs: &'a MapInputs<'a>,
    eye: Option<MapBuilder<'a>>,
    /// With the camera's map, one for each chain, along the mean direction in which its photons travel.
    shared: Vec<(Chain, MapBuilder<'a>)>,
    finished: Vec<IrradianceMap>,
    few: Cow<'a, [FewPhotons]>,
    ledger: Ledger,
    photons: u64,
    used: u64,
}

impl<'a> MapsBuilder<'a> {
    fn new(inputs: &'a MapInputs<'a>, progress: &dyn Progress) -> Self {
        let eye = (inputs.options.caustic_map == MapView::Eye).then(|| {
            let (camera, size) = &inputs.view;
            let tracer = inputs.surroundings.tracer;
            let objects = inputs.surroundings.objects;
            let receiver =
                move |ray: Ray| tracer.camera_hit(ray).filter(|hit| objects[hit.object as usize].receiver.is_some());
            let shows = Shows::First(Box::new(receiver));
            inputs.map(Projection::of_camera(camera, *size), shows, inputs.for_gloss(true))
        });
        let few = inputs.few_photons(progress);
        let shared = if eye.is_some() { inputs.maps_of_chains(&few) } else { Vec::new() };
        Self { inputs, eye, shared, finished: Vec::new(), few, ledger: Ledger::default(), photons: 0, used: 0 }
    }

    fn add_light(&mut self, index: usize, progress: &dyn Progress) {
        let (inputs, light) = (self.inputs, &self.inputs.lights[index]);
        let lights = inputs.parts_of(index);
        // The map of a light shows all of its parts.
        let own = if self.eye.is_some() { Vec::new() } else { inputs.maps_of_light(light, &self.few[index]) };
        for light in &lights {
            match inputs.options.traversal {
                Traversal::Dense => self.add_all_photons((light, inputs.photons_of(index)), &own, progress),
                Traversal::Hierarchical | Traversal::MaximalLevel | Traversal::TexelError => {
                    self.add_clusters(light, &own);
                }
            }
        }
        self.finish_maps(own);
    }

    fn add_all_photons(
        &mut self,
        (light, photons): (&PhotonLight, u32),
        own: &[MapBuilder<'a>],
        progress: &dyn Progress,
    ) {
        let inputs = self.inputs;
        for view in light.views(inputs.casters, &inputs.bounds, photons) {
            let images = inputs.images_of(&view);
            let emission = Emission { images: images.as_ref(), ..inputs.emission(&view) };
            self.photons += view.projection.texel_count() as u64;
            for strip in strips(view.projection.size) {
                let (grids, ledger) = emit(&emission, inputs.kinds, strip, progress);
                self.ledger += ledger;
                for (kind, grid) in inputs.kinds.iter().zip(&grids) {
                    self.used += grid.own.len() as u64;
                    self.ledger += self.deposit(own, grid, (&view, kind.chain));
                }
            }
        }
    }

    /// Follows clusters of photons as far as the first map needs them, or puts them together there.
    fn add_clusters(&mut self, light: &PhotonLight, own: &[MapBuilder<'a>]) {
        let inputs = self.inputs;
        let traversal = inputs.options.traversal;
        for view in light.views(inputs.casters, &inputs.bounds, inputs.options.photons) {
            let images = inputs.images_of(&view);
            // The hierarchical traversal follows all photons, whatever the casters cover.
            let coverage = (traversal != Traversal::Hierarchical)
                .then(|| Coverage::new(&view.projection, view.spread, inputs.triangles.iter().copied()));
            for kind in inputs.kinds {
                let Some(map) = self.eye.as_ref().or_else(|| own.first()) else { continue };
                let (kind, map, photons) = (*kind, map.map(), inputs.options.photons);
                let emission = Emission { images: images.as_ref(), ..inputs.emission(&view) };
                let mut deposited = Ledger::default();
                let mut add = |grid: &PhotonGrid| deposited += self.deposit(own, grid, (&view, kind.chain));
                let batch = CLUSTERS_OF_BATCH;
                let (cast, effort) = match &coverage {
                    None => Hierarchy { emission, kind, map, photons, batch: 4 * batch }.run(&mut add),
                    Some(coverage) => {
                        Traverser { emission, coverage, kind, map, traversal, finest: photons, batch }.run(&mut add)
                    }
                };
                self.ledger += cast;
                self.ledger += deposited;
                self.photons += effort.evaluations;
                self.used += effort.photons;
            }
        }
    }

    /// Adds photons to all maps. Returns their account: that of the camera's map, if there is one.
    fn deposit(&self, own: &[MapBuilder<'a>], grid: &PhotonGrid, (view, chain): (&LightView, Chain)) -> Ledger {
        let Some(eye) = &self.eye else { return self.inputs.deposit(own, grid, view) };
        let objects = self.inputs.surroundings.objects;
        if let Some((_, map)) = self.shared.iter().find(|(of, _)| *of == chain) {
            map.add(grid, view, objects);
        }
        eye.add(grid, view, objects)
    }

    /// Finishes the maps of a light.
    fn finish_maps(&mut self, maps: Vec<MapBuilder<'a>>) {
        for map in maps {
            let (map, ledger) = map.finish();
            self.ledger += ledger;
            self.finished.push(map);
        }
    }

    fn finish(mut self) -> Maps {
        let shared = std::mem::take(&mut self.shared);
        let eye = self.eye.take().map(|eye| {
            let (map, ledger) = eye.finish();
            self.ledger += ledger;
            map
        });
        let lights: Vec<IrradianceMap> =
            shared.into_iter().map(|(_, map)| map.finish().0).chain(self.finished).collect();
        let (photons, photons_used) = (self.photons, self.used);
        let (lights_used, places) = (self.inputs.lights.len(), places_of(&self.few));
        Maps { eye, lights, ledger: self.ledger, photons, photons_used, lights_used, places }
    }
}

impl<'a> MapInputs<'a> {
    fn map(&self, projection: Projection, shows: Shows<'a>, kept: ForGloss<'a>) -> MapBuilder<'a> {
        MapBuilder::new(projection, (self.total_watts(), kept), shows, self.options)
    }

    /// What is kept for glossy receivers, in the camera's map or in another one, which has no viewer.
    pub fn for_gloss(&self, is_camera: bool) -> ForGloss<'a> {
        match (self.glossy, self.options.incidence) {
            (None, _) => ForGloss::Nothing,
            (Some(_), Incidence::Light) => ForGloss::Undeflected,
            (Some(materials), Incidence::Photon) if is_camera => ForGloss::Reflected(materials),
            (Some(_), Incidence::Photon | Incidence::Mean) => ForGloss::Directions,
        }
    }

    /// A map of all receivers along its rays.
    fn map_of_receivers(&self, projection: Projection) -> MapBuilder<'a> {
        let tracer = self.receivers;
        let shows = Shows::All(Box::new(move |ray: Ray| tracer.secondary_hit(ray)));
        self.map(projection, shows, self.for_gloss(false))
    }

    /// The flux of all lights on the bounds: more than what is cast, but not by much; W.
    pub fn total_watts(&self) -> f64 {
        let area = self.bounds.diagonal().powi(2);
        self.lights.iter().map(|light| light.power_on(area)).sum()
    }

    /// Photons along each edge of the views of a light.
    pub fn photons_of(&self, index: usize) -> u32 {
        let photons = self.options.photons;
        let is_wide =
            self.draws.and_then(|draws| draws.segment(index)).is_some_and(|(segment, _)| !segment.is_narrow());
        if is_wide { (photons / COARSER).max(LEAST_PHOTONS.min(photons)) } else { photons }
    }

    /// What one of the lights sends photons as: where these need neighbours, as many lights without extent.
    pub fn parts_of(&self, index: usize) -> Vec<PhotonLight> {
        let light = &self.lights[index];
        if let Some(drawn) = self.draws.and_then(|draws| draws.of_segment(index)) {
            return vec![drawn];
        }
        if let Some(Draws { pass, .. }) = self.draws.filter(|_| self.options.mode.needs_neighbours()) {
            let count = self.options.light_directions;
            return light.drawn(pass * count..(pass + 1) * count, self.bounds.centre());
        }
        // Images are seen from one point or in one direction.
        if self.options.mode.needs_neighbours() || self.options.hits != Hits::Traced {
            light.divided(self.options.light_directions, self.bounds.centre())
        } else {
            vec![light.clone()]
        }
    }

    fn emission<'b>(&'b self, view: &'b LightView) -> Emission<'b> {
        Emission { surroundings: &self.surroundings, images: None, view, pattern: self.pattern }
    }

    /// Images of what photons of a view meet, if these are not traced.
    pub(super) fn images_of(&self, view: &LightView) -> Option<SurfaceImages> {
        let size = self.options.hits.image_size(view.projection.size[0])?;
        let plane = view.projection.resized(size);
        let tracer = self.surroundings.tracer;
        let diagonal = self.bounds.diagonal() as f32;
        let from_behind = |solid: &Tracer, ray: Ray| {
            // Rays of parallel views start close before the scene; what a lamp sees lies within the scene, too.
            let end =
                if plane.is_parallel { 1.1 * diagonal } else { diagonal + ray.origin.distance(self.bounds.centre()) };
            let back = Ray { origin: ray.origin + end * ray.direction, direction: -ray.direction };
            solid.secondary_hit(back).filter(|hit| hit.distance < end)
        };
        let last = |(object, solid): &(u32, Tracer)| (*object, SurfaceImage::new(plane, |ray| from_behind(solid, ray)));
        let entry =
            |(object, solid): &(u32, Tracer)| (*object, SurfaceImage::new(plane, |ray| solid.secondary_hit(ray)));
        let several = if self.solids.len() > 1 { self.solids } else { &[] };
        let receivers = self.receiver_planes(view, size);
        let of_receivers = |ray: Ray| self.receivers.secondary_hit(ray);
        Some(SurfaceImages {
            first: SurfaceImage::new(plane, |ray: Ray| tracer.secondary_hit(ray)),
            last: self.solids.iter().map(last).collect(),
            entries: several.iter().map(entry).collect(),
            receivers: receivers.into_iter().map(|plane| SurfaceImage::new(plane, of_receivers)).collect(),
            diagonal: f64::from(diagonal),
        })
    }

    /// Planes of images in which a light sees the receivers: one, or six around a lamp between them, all of one size.
    pub fn receiver_planes(&self, view: &LightView, size: u32) -> Vec<Projection> {
        let points = || self.receiver_points.iter().copied();
        match &view.light {
            PhotonLight::Directional { towards, .. } => {
                vec![Projection::parallel(-*towards, points(), &self.bounds, size)]
            }
            PhotonLight::Lamp(lamp) => Projection::central(lamp.position, points(), size)
                .map_or_else(|| Projection::cube(lamp.position, size, 0).to_vec(), |view| vec![view]),
        }
    }

    /// Adds photons to maps. Where these are the faces of a cube, what lies beside one belongs to another.
    fn deposit(&self, maps: &[MapBuilder<'a>], grid: &PhotonGrid, view: &LightView) -> Ledger {
        let objects = self.surroundings.objects;
        if let [map] = maps {
            return map.add(grid, view, objects);
        }
        let mut ledger = Ledger::default();
        for map in maps {
            let mut part = map.add(grid, view, objects);
            part[Loss::OffMap] = 0.0;
            ledger += part;
        }
        ledger
    }

    /// A few photons of each light, which tell where all of them will land.
    pub fn few_photons(&self, progress: &dyn Progress) -> Cow<'a, [FewPhotons]> {
        let send = || {
            let groups = caster_groups(self.triangles);
            (0..self.lights.len()).map(|index| self.few_of(index, &groups, progress)).collect()
        };
        self.few.map_or_else(|| Cow::Owned(send()), Cow::Borrowed)
    }

    fn few_of(&self, index: usize, groups: &[Vec<Vec3>], progress: &dyn Progress) -> FewPhotons {
        let of_pass = |pass: u32| self.draws.and_then(|draws| Draws { pass, ..draws }.of_segment(index));
        let drawn = (0..DRAWS_FOR_WINDOWS).filter_map(of_pass);
        let lights: Vec<PhotonLight> = std::iter::once(self.lights[index].clone()).chain(drawn).collect();
        let photons = if lights.len() > 1 { FEW_OF_DIRECTION } else { FIRST_GRID };
        let views = lights
            .iter()
            .flat_map(|light| groups.iter().flat_map(move |group| light.views(group, &self.bounds, photons)));
        let emitted = views.map(|view| {
            // Windows of maps that follow from them are the same in every frame and pass.
            let pattern = Pattern { offset: DVec2::splat(0.5), seed: 0, ..self.pattern };
            let emission = Emission { pattern, ..self.emission(&view) };
            let grids = emit(&emission, self.kinds, Strip::whole(view.projection.size), progress).0;
            (view, grids)
        });
        emitted.collect()
    }

    /// Maps for what the camera does not see.
    fn maps_of_chains(&self, few: &[FewPhotons]) -> Vec<(Chain, MapBuilder<'a>)> {
        let projections = self.projections_of_chains(few).into_iter();
        projections.map(|(chain, projection)| (chain, self.map_of_receivers(projection))).collect()
    }

    fn maps_of_light(&self, light: &PhotonLight, few: &FewPhotons) -> Vec<MapBuilder<'a>> {
        self.projections_of_light(light, few).into_iter().map(|projection| self.map_of_receivers(projection)).collect()
    }
}
