//! The maps of a picture: photons from all lights, and which maps they are added to.

use glam::{DVec2, DVec3, Vec3};

use super::MapInTheMaking;
use super::caustic_map::{CausticMap, Incident, IrradianceMap};
use super::emission::{Kind, Surroundings, emit};
use super::ledger::Ledger;
use super::lights::{LightView, PhotonLight};
use super::options::{ImageSpaceOptions, MapView};
use super::photons::PhotonGrid;
use super::projection::{Bounds, Projection};
use crate::progress::Progress;
use crate::scene::{Camera, Ray};
use crate::tracing::{Hit, Tracer};

/// The part of the photons at each edge of a light's map that may lie outside of it.
const OUTLIERS: f64 = 0.002;

/// What maps are made from.
#[derive(Clone, Copy)]
pub struct MapInputs<'a> {
    /// What photons meet.
    pub surroundings: Surroundings<'a>,
    /// The receivers alone.
    pub receivers: &'a Tracer,
    /// Vertices of what casts caustics.
    pub casters: &'a [Vec3],
    /// Around everything.
    pub bounds: Bounds,
    /// The lights.
    pub lights: &'a [PhotonLight],
    /// The ways that count.
    pub kinds: &'a [Kind],
    /// Whose picture it is, and its size.
    pub view: (Camera, [u32; 2]),
    /// The options.
    pub options: &'a ImageSpaceOptions,
    /// Random seed.
    pub seed: u64,
    /// Whether glossy receivers ask for directions.
    pub has_directions: bool,
}

/// Finished maps.
#[derive(Debug)]
pub struct Maps {
    /// What the camera sees.
    eye: Option<IrradianceMap>,
    /// Lights' views. With the camera's they are for what it does not see.
    lights: Vec<IrradianceMap>,
    /// The account of the flux: in the camera's map or, without one, in those of the lights.
    pub ledger: Ledger,
    /// How many photons were sent.
    pub photons: u64,
    /// How many met a receiver.
    pub photons_used: u64,
    /// How many lights sent them.
    pub lights_used: usize,
}

impl Maps {
    /// Sends photons and adds them to maps.
    pub fn new(inputs: &MapInputs, progress: &dyn Progress) -> Self {
        let mut maps = Making::new(inputs);
        for light in inputs.lights {
            if progress.is_cancelled() {
                break;
            }
            maps.add_light(light, progress);
        }
        maps.finish()
    }

    /// The light on a point of an object, on the side of a normal.
    pub fn light_at(&self, point: Vec3, normal: Vec3, object: u32) -> Incident {
        if let Some(seen) = self.eye.as_ref().and_then(|map| map.nearest(point, normal, object)) {
            return seen;
        }
        let mut sum = Incident::default();
        for light in self.lights.iter().filter_map(|map| map.bilinear(point, normal, object)) {
            sum.irradiance += light.irradiance;
            sum.direction += light.irradiance.element_sum() * light.direction;
        }
        Incident { direction: sum.direction.normalize_or_zero(), ..sum }
    }

    /// How many maps there are.
    pub fn count(&self) -> usize {
        self.lights.len() + usize::from(self.eye.is_some())
    }
}

/// Maps, and the photons so far.
struct Making<'a> {
    inputs: &'a MapInputs<'a>,
    eye: Option<MapInTheMaking>,
    /// With the camera's map, one light's: of the first light that reaches receivers.
    shared: Vec<MapInTheMaking>,
    finished: Vec<IrradianceMap>,
    ledger: Ledger,
    photons: u64,
    photons_used: u64,
}

impl<'a> Making<'a> {
    fn new(inputs: &'a MapInputs<'a>) -> Self {
        let eye = (inputs.options.caustic_map == MapView::Eye).then(|| {
            let (camera, size) = &inputs.view;
            let tracer = inputs.surroundings.tracer;
            let objects = inputs.surroundings.objects;
            let receiver =
                |ray: Ray| tracer.camera_hit(ray).filter(|hit| objects[hit.object as usize].receiver.is_some());
            inputs.map(Projection::of_camera(camera, *size), receiver)
        });
        Self {
            inputs,
            eye,
            shared: Vec::new(),
            finished: Vec::new(),
            ledger: Ledger::default(),
            photons: 0,
            photons_used: 0,
        }
    }

    fn add_light(&mut self, light: &PhotonLight, progress: &dyn Progress) {
        let inputs = self.inputs;
        let centre = inputs.bounds.centre();
        let lights = match inputs.options.mode.needs_neighbours() {
            true => light.divided(inputs.options.light_directions, centre),
            false => vec![light.clone()],
        };
        // The map of a light shows all of its parts.
        let mut own: Vec<MapInTheMaking> = Vec::new();
        for light in &lights {
            let views = light.views(inputs.casters, &inputs.bounds, inputs.options.photons);
            let emitted: Vec<(LightView, Vec<PhotonGrid>)> =
                views.into_iter().map(|view| self.emit(view, progress)).collect();
            if let Some(eye) = &mut self.eye {
                inputs.add_all(std::slice::from_mut(eye), &emitted);
            }
            let maps = if self.eye.is_some() { &mut self.shared } else { &mut own };
            if maps.is_empty() {
                maps.extend(inputs.maps_of_light(light, &emitted));
            }
            inputs.add_all(maps, &emitted);
        }
        self.finish_maps(own);
    }

    fn emit(&mut self, view: LightView, progress: &dyn Progress) -> (LightView, Vec<PhotonGrid>) {
        let MapInputs { surroundings, kinds, seed, .. } = self.inputs;
        let (grids, ledger) = emit(surroundings, &view, kinds, *seed, progress);
        self.photons += view.projection.texel_count() as u64;
        self.photons_used += grids.iter().map(|grid| grid.photons.len() as u64).sum::<u64>();
        self.ledger += ledger;
        (view, grids)
    }

    /// Finishes the maps of a light.
    fn finish_maps(&mut self, maps: Vec<MapInTheMaking>) {
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
        let lights: Vec<IrradianceMap> = shared.into_iter().map(|map| map.finish().0).chain(self.finished).collect();
        let (photons, photons_used) = (self.photons, self.photons_used);
        let lights_used = self.inputs.lights.len();
        Maps { eye, lights, ledger: self.ledger, photons, photons_used, lights_used }
    }
}

impl MapInputs<'_> {
    fn map(&self, projection: Projection, receiver: impl Fn(Ray) -> Option<Hit> + Sync) -> MapInTheMaking {
        // The flux of all lights on the bounds is more than what is cast, but not by much.
        let area = self.bounds.diagonal().powi(2);
        let total: f64 = self.lights.iter().map(|light| light.power_on(area)).sum();
        MapInTheMaking::new(CausticMap::new(projection, (total, self.has_directions), receiver), self.options)
    }

    /// Adds photons to maps. Where these are the faces of a cube, each gets those that land on it.
    fn add_all(&self, maps: &mut [MapInTheMaking], emitted: &[(LightView, Vec<PhotonGrid>)]) {
        let is_cube = maps.len() > 1;
        for (view, grid) in emitted.iter().flat_map(|(view, grids)| grids.iter().map(move |grid| (view, grid))) {
            for map in maps.iter_mut() {
                if is_cube {
                    map.add(&grid.retained(|photon| map.is_in_window(photon)), view, self.surroundings.objects);
                } else {
                    map.add(grid, view, self.surroundings.objects);
                }
            }
        }
    }

    /// Maps from a light's point of view around where its photons land: one, or six around a lamp that they surround.
    fn maps_of_light(&self, light: &PhotonLight, emitted: &[(LightView, Vec<PhotonGrid>)]) -> Vec<MapInTheMaking> {
        let grids = || emitted.iter().flat_map(|(_, grids)| grids);
        let landed = || grids().flat_map(|grid| grid.photons.iter().map(|photon| photon.position));
        let Some((view, _)) = emitted.first().filter(|_| landed().next().is_some()) else { return Vec::new() };
        let size = self.options.caustic_map_size;
        let projections = match light {
            PhotonLight::Directional { towards, .. } => {
                let axes = view.projection.axes;
                let kept = without_outliers(landed(), axes[0], axes[1]);
                vec![Projection::parallel(-*towards, kept.into_iter(), &self.bounds, size)]
            }
            PhotonLight::Lamp(lamp) => {
                let points: Vec<Vec3> = landed().collect();
                let one = Projection::central(lamp.position, points.iter().copied(), size);
                one.map_or_else(|| Projection::cube(lamp.position, size, 0).to_vec(), |view| vec![view])
            }
        };
        let receiver = |ray: Ray| self.receivers.secondary_hit(ray);
        projections.into_iter().map(|projection| self.map(projection, receiver)).collect()
    }
}

/// Points between whose extremes along two axes nearly all of them lie.
fn without_outliers(points: impl Iterator<Item = Vec3> + Clone, right: DVec3, down: DVec3) -> Vec<Vec3> {
    let within = |axis: DVec3| {
        let mut places: Vec<f64> = points.clone().map(|p| p.as_dvec3().dot(axis)).collect();
        places.sort_by(f64::total_cmp);
        let outliers = (OUTLIERS * places.len() as f64) as usize;
        [places[outliers], places[places.len() - 1 - outliers]]
    };
    let [left, top] = [right, down].map(within);
    let (low, high) = (DVec2::new(left[0], top[0]), DVec2::new(left[1], top[1]));
    let place = |p: &Vec3| DVec2::new(p.as_dvec3().dot(right), p.as_dvec3().dot(down));
    points.filter(|p| place(p).cmpge(low).all() && place(p).cmple(high).all()).collect()
}
