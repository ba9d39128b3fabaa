//! Caustic maps: flux per texel of the receivers that a view shows.
//!
//! Flux is summed in fixed point, so that sums are the same whatever their order. Irradiance is flux over area: no cosines of the light's
//! direction are involved. Knows neither lights nor how photons were spread.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use super::constants::PHOTON_OFF_RAY;
use super::ledger::Loss;
use super::photons::Photon;
use super::projection::Projection;
use super::receiver_layers::ReceiverLayers;
use crate::scene::Ray;
use crate::tracing::Hit;

/// Steps of fixed point in the total flux: so many that a millionth of a photon in a million counts, and that sums of a thousand times the
/// total do not overflow.
const STEPS: f64 = (1u64 << 52) as f64;

/// A map that photons are added to.
#[derive(Debug)]
pub struct CausticMap {
    shown: Arc<ReceiverLayers>,
    flux: Vec<[AtomicI64; 3]>,
    /// Directions of travel, weighted by flux; empty unless glossy receivers ask for them.
    directions: Vec<[AtomicI64; 3]>,
    /// Of a channel.
    watts_per_step: f64,
}

impl CausticMap {
    /// An empty map of what a view shows. `total`: about the flux that is to be added, W.
    pub fn new(shown: ReceiverLayers, (total, has_directions): (f64, bool)) -> Self {
        Self::empty(Arc::new(shown), (watts_per_step(total), has_directions))
    }

    /// A map with the sums of another program: of flux and, if there are any, of directions, in steps.
    #[cfg(feature = "gpu")]
    pub fn of_sums(shown: Arc<ReceiverLayers>, [flux, directions]: [Vec<[i64; 3]>; 2], watts_per_step: f64) -> Self {
        let atomic = |sums: Vec<[i64; 3]>| sums.into_iter().map(|sum| sum.map(AtomicI64::new)).collect();
        Self { shown, flux: atomic(flux), directions: atomic(directions), watts_per_step }
    }

    /// An empty map that shows the same.
    pub fn emptied(&self) -> Self {
        Self::empty(self.shown.clone(), (self.watts_per_step, !self.directions.is_empty()))
    }

    fn empty(shown: Arc<ReceiverLayers>, (watts_per_step, has_directions): (f64, bool)) -> Self {
        let zeros = |count: usize| {
            let mut sums = Vec::new();
            sums.resize_with(count, <[AtomicI64; 3]>::default);
            sums
        };
        let directions = zeros(if has_directions { shown.len() } else { 0 });
        Self { flux: zeros(shown.len()), directions, shown, watts_per_step }
    }

    fn projection(&self) -> &Projection {
        self.shown.projection()
    }

    /// Columns and rows.
    pub fn size(&self) -> [u32; 2] {
        self.projection().size
    }

    /// Texels of all layers.
    pub fn len(&self) -> usize {
        self.shown.len()
    }

    /// Where a photon lands in the map, and the index of the texel.
    ///
    /// # Errors
    /// The map does not show it.
    pub fn place(&self, photon: &Photon) -> Result<(DVec2, usize), Loss> {
        let place = self.project(photon.position).filter(|place| self.has(*place)).ok_or(Loss::OffMap)?;
        let index = self.shown.place_of(place, photon).ok_or(Loss::Hidden)?;
        Ok((place, index))
    }

    /// Whether something hides a photon that lands in a texel at the edge of a surface, in a map of what is seen first. Elsewhere the middles of
    /// texels tell.
    pub fn is_hidden(&self, photon: &Photon, receiver: impl Fn(Ray) -> Option<Hit>) -> bool {
        let Ok((place, index)) = self.place(photon) else { return false };
        let own = self.around(index, 1).count();
        if own == 9 {
            return false;
        }
        let seen = receiver(self.projection().ray(place));
        let far = PHOTON_OFF_RAY * self.shown.texel(index).edge;
        seen.is_none_or(|hit| hit.position.distance(photon.position) > far)
    }

    /// Where a point appears in the map, which may be outside of its window.
    pub fn project(&self, point: Vec3) -> Option<DVec2> {
        self.projection().project(point)
    }

    /// Whether a place is in the map.
    pub fn has(&self, place: DVec2) -> bool {
        self.projection().index(place).is_some()
    }

    /// The index of the texel at a place that shows the receiver which a photon lands on, about as it is oriented there.
    pub fn surface_of(&self, place: DVec2, photon: &Photon) -> Option<usize> {
        self.shown.surface_of(place, photon)
    }

    /// The edge of a square with the area that a texel covers on its receiver, metres.
    pub fn texel_edge(&self, index: usize) -> f32 {
        self.shown.texel(index).edge
    }

    /// The edge of a texel across its ray at the distance of a point, metres: the same in all faces of a cube.
    pub fn texel_across(&self, point: Vec3) -> f64 {
        let Projection { texel, is_parallel, origin, .. } = *self.projection();
        if is_parallel { texel } else { texel * point.as_dvec3().distance(origin) }
    }

    /// Adds flux, W, that travels in a direction.
    pub fn add(&self, index: usize, flux: DVec3, direction: Vec3) {
        self.add_steps(&self.flux[index], flux);
        if let Some(sums) = self.directions.get(index) {
            self.add_steps(sums, direction.as_dvec3() * flux.element_sum());
        }
    }

    fn add_steps(&self, sums: &[AtomicI64; 3], watts: DVec3) {
        let steps = watts / self.watts_per_step;
        for (sum, steps) in sums.iter().zip(steps.to_array()) {
            sum.fetch_add(steps.round() as i64, Ordering::Relaxed);
        }
    }

    fn watts(&self, sums: &[AtomicI64; 3]) -> DVec3 {
        let steps = sums.each_ref().map(|sum| sum.load(Ordering::Relaxed) as f64);
        DVec3::from_array(steps) * self.watts_per_step
    }

    /// The flux in a texel, W.
    pub fn flux(&self, index: usize) -> DVec3 {
        self.watts(&self.flux[index])
    }

    /// The mean direction in which the light of a texel travels, unit length; zero where it has none, or where nobody asked for it.
    pub fn direction(&self, index: usize) -> Vec3 {
        self.directions.get(index).map_or(Vec3::ZERO, |sums| self.watts(sums).normalize_or_zero().as_vec3())
    }

    /// The texels at most so far from one in columns and rows that show the same surface, and how far they are.
    pub fn around(&self, index: usize, reach: i64) -> impl Iterator<Item = (usize, [i64; 2])> {
        self.shown.around(index, reach)
    }

    /// The irradiance in every texel.
    pub fn resolve(self) -> IrradianceMap {
        let irradiance = |index: usize| {
            let texel = self.shown.texel(index);
            if texel.is_there() { self.flux(index).as_vec3() / (texel.edge * texel.edge) } else { Vec3::ZERO }
        };
        let irradiance = (0..self.len()).into_par_iter().map(irradiance).collect();
        let directions = (0..self.directions.len()).map(|index| self.direction(index)).collect();
        IrradianceMap { shown: self.shown, irradiance, directions }
    }
}

/// The step of fixed point for about so much flux, W.
pub fn watts_per_step(total: f64) -> f64 {
    total.max(f64::MIN_POSITIVE * STEPS) / STEPS
}

/// Irradiance on the receivers that a map shows.
#[derive(Clone, Debug)]
pub struct IrradianceMap {
    shown: Arc<ReceiverLayers>,
    irradiance: Vec<Vec3>,
    directions: Vec<Vec3>,
}

/// Light on a receiver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Incident {
    /// W/m².
    pub irradiance: Vec3,
    /// The mean direction in which it travels, unit length; zero where maps have none.
    pub direction: Vec3,
}

/// A picture of a map.
#[derive(Clone, Debug, PartialEq)]
pub struct MapPicture {
    /// Columns and rows.
    pub size: [u32; 2],
    /// The brightest of the layers in each texel, as a mean over texels of the map; W/m².
    pub irradiance: Vec<Vec3>,
}

impl IrradianceMap {
    /// A picture with at most so many texels along an edge.
    pub fn picture(&self, most: u32) -> MapPicture {
        let [width, height] = self.shown.projection().size;
        let step = width.max(height).div_ceil(most).max(1);
        let count = self.shown.projection().texel_count();
        let brightest = |x: u32, y: u32| {
            let layers = ((y * width + x) as usize..self.irradiance.len()).step_by(count);
            layers.fold(Vec3::ZERO, |most, index| most.max(self.irradiance[index]))
        };
        let size = [width, height].map(|edge| edge.div_ceil(step));
        let mean = |k: u32| {
            let [x, y] = [k % size[0] * step, k / size[0] * step];
            let texels = (y..(y + step).min(height)).flat_map(|y| (x..(x + step).min(width)).map(move |x| (x, y)));
            let (sum, count) = texels.fold((Vec3::ZERO, 0.0), |(sum, n), (x, y)| (sum + brightest(x, y), n + 1.0));
            sum / count
        };
        MapPicture { size, irradiance: (0..size[0] * size[1]).map(mean).collect() }
    }

    /// The light at a point of an object on the side of a normal, as the mean over the texel that shows it; `None` where none does.
    pub fn nearest(&self, point: Vec3, normal: Vec3, object: u32) -> Option<Incident> {
        let place = self.shown.projection().project(point)?;
        let index = self.shown.point_near(place, point, (normal, object))?;
        Some(Incident { irradiance: self.irradiance[index], direction: self.direction(index) })
    }

    /// The same, interpolated between those of the four texels around that show it or, if none does, from the nearest one.
    pub fn bilinear(&self, point: Vec3, normal: Vec3, object: u32) -> Option<Incident> {
        let view = self.shown.projection();
        let place = view.project(point)?;
        // What lies beyond the edge of a cube's face belongs to another one.
        view.index(place)?;
        let place = place - 0.5;
        let (low, part) = (place.floor(), (place - place.floor()).as_vec2());
        let (mut light, mut weights) = (Incident::default(), 0.0);
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let place = low + DVec2::new(dx, dy) + 0.5;
            let Some(index) = self.shown.point_at(place, point, (normal, object)) else { continue };
            let along = |step: f64, part: f32| if step == 0.0 { 1.0 - part } else { part };
            let weight = along(dx, part.x) * along(dy, part.y);
            light.irradiance += weight * self.irradiance[index];
            light.direction += weight * self.irradiance[index].element_sum() * self.direction(index);
            weights += weight;
        }
        let (irradiance, direction) = (light.irradiance / weights, light.direction.normalize_or_zero());
        let mean = (weights > 1e-3).then_some(Incident { irradiance, direction });
        mean.or_else(|| self.nearest(point, normal, object))
    }

    fn direction(&self, index: usize) -> Vec3 {
        self.directions.get(index).copied().unwrap_or_default()
    }
}
