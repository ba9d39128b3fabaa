//! Caustic maps: flux per texel of a picture plane, and the receivers that it shows.
//!
//! Flux is summed in fixed point, so that sums are the same whatever their order. Irradiance is flux over area: no cosines of the light's
//! direction are involved. Knows neither lights nor how photons were spread.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use bytemuck::{Pod, Zeroable};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use super::constants::{PHOTON_OFF_PLANE, PHOTON_OFF_RAY, SAME_SURFACE_COSINE};
use super::ledger::Loss;
use super::photons::Photon;
use super::projection::Projection;
use crate::scene::Ray;
use crate::tracing::Hit;

/// Steps of fixed point in the total flux: so many that a millionth of a photon in a million counts, and that sums of a thousand times the
/// total do not overflow.
const STEPS: f64 = (1u64 << 52) as f64;

/// From a place to itself and to the places in the texels around it.
const AROUND: [[f64; 2]; 9] =
    [[0.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];

/// No receiver.
const NOTHING: u32 = u32::MAX;

/// The receiver in the middle of a texel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Texel {
    /// Metres.
    pub position: Vec3,
    /// `u32::MAX`: none.
    pub object: u32,
    /// Of its triangle, towards the viewer; unit length.
    pub normal: Vec3,
    /// The edge of a square with the area that the texel covers on the receiver, metres.
    pub edge: f32,
}

/// A map that photons are added to.
#[derive(Debug)]
pub struct CausticMap {
    projection: Projection,
    texels: Arc<Vec<Texel>>,
    flux: Vec<[AtomicI64; 3]>,
    /// Directions of travel, weighted by flux; empty unless glossy receivers ask for them.
    directions: Vec<[AtomicI64; 3]>,
    /// Of a channel.
    watts_per_step: f64,
}

impl CausticMap {
    /// An empty map. `receiver`: what a ray shows, if that is a receiver. `total`: about the flux that is to be added, W.
    pub fn new(
        projection: Projection,
        (total, has_directions): (f64, bool),
        receiver: impl Fn(Ray) -> Option<Hit> + Sync,
    ) -> Self {
        let texels = (0..projection.texel_count()).into_par_iter().map(|index| texel(&projection, index, &receiver));
        Self::empty(projection, Arc::new(texels.collect()), (watts_per_step(total), has_directions))
    }

    /// A map with the sums of another program: of flux and, if there are any, of directions, in steps.
    #[cfg(feature = "gpu")]
    pub fn of_sums(
        projection: Projection,
        texels: Arc<Vec<Texel>>,
        [flux, directions]: [Vec<[i64; 3]>; 2],
        watts_per_step: f64,
    ) -> Self {
        let atomic = |sums: Vec<[i64; 3]>| sums.into_iter().map(|sum| sum.map(AtomicI64::new)).collect();
        Self { projection, texels, flux: atomic(flux), directions: atomic(directions), watts_per_step }
    }

    /// An empty map that shows the same.
    pub fn emptied(&self) -> Self {
        Self::empty(self.projection, self.texels.clone(), (self.watts_per_step, !self.directions.is_empty()))
    }

    fn empty(projection: Projection, texels: Arc<Vec<Texel>>, (watts_per_step, has_directions): (f64, bool)) -> Self {
        let zeros = |count: usize| {
            let mut sums = Vec::new();
            sums.resize_with(count, <[AtomicI64; 3]>::default);
            sums
        };
        let directions = zeros(if has_directions { texels.len() } else { 0 });
        Self { projection, flux: zeros(texels.len()), directions, texels, watts_per_step }
    }

    /// Columns and rows.
    pub fn size(&self) -> [u32; 2] {
        self.projection.size
    }

    /// Where a photon lands in the map, and the index of the texel.
    ///
    /// # Errors
    /// The map does not show it.
    pub fn place(&self, photon: &Photon) -> Result<(DVec2, usize), Loss> {
        let place = self.projection.project(photon.position).ok_or(Loss::OffMap)?;
        let index = self.projection.index(place).ok_or(Loss::OffMap)?;
        if self.shows(index, photon) { Ok((place, index)) } else { Err(Loss::Hidden) }
    }

    /// Whether something hides a photon that lands in a texel at the edge of a surface. Elsewhere the middles of texels tell.
    pub fn is_hidden(&self, photon: &Photon, receiver: impl Fn(Ray) -> Option<Hit>) -> bool {
        let Ok((place, index)) = self.place(photon) else { return false };
        let own = self.around(index, 1).count();
        if own == 9 {
            return false;
        }
        let seen = receiver(self.projection.ray(place));
        seen.is_none_or(|hit| hit.position.distance(photon.position) > PHOTON_OFF_RAY * self.texels[index].edge)
    }

    /// Where a point appears in the map, which may be outside of its window.
    pub fn project(&self, point: Vec3) -> Option<DVec2> {
        self.projection.project(point)
    }

    /// The index of the texel at a place, if it is in the map.
    pub fn texel_at(&self, place: DVec2) -> Option<usize> {
        self.projection.index(place)
    }

    /// Whether a texel shows a photon's place on the receiver, from the side that it arrives on.
    fn shows(&self, index: usize, photon: &Photon) -> bool {
        let texel = &self.texels[index];
        let is_on_plane =
            || (photon.position - texel.position).dot(texel.normal).abs() <= PHOTON_OFF_PLANE * texel.edge;
        self.is_surface_of(index, photon) && is_on_plane()
    }

    /// Whether a texel shows the receiver that a photon lands on, about as it is oriented there.
    pub fn is_surface_of(&self, index: usize, photon: &Photon) -> bool {
        let texel = &self.texels[index];
        texel.object == photon.object && texel.normal.dot(photon.normal) >= SAME_SURFACE_COSINE
    }

    /// The edge of a square with the area that a texel covers on its receiver, metres.
    pub fn texel_edge(&self, index: usize) -> f32 {
        self.texels[index].edge
    }

    /// The edge of a texel across its ray at the distance of a point, metres: the same in all faces of a cube.
    pub fn texel_across(&self, point: Vec3) -> f64 {
        let Projection { texel, is_parallel, origin, .. } = self.projection;
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
        let [width, height] = self.size().map(i64::from);
        let (x, y) = (index as i64 % width, index as i64 / width);
        let own = self.texels[index];
        let offsets = (-reach..=reach).flat_map(move |dy| (-reach..=reach).map(move |dx| [dx, dy]));
        offsets.filter_map(move |[dx, dy]| {
            let is_inside = (0..width).contains(&(x + dx)) && (0..height).contains(&(y + dy));
            let other = is_inside.then(|| ((y + dy) * width + x + dx) as usize)?;
            let texel = &self.texels[other];
            let is_same = texel.object == own.object && texel.normal.dot(own.normal) >= SAME_SURFACE_COSINE;
            (own.object != NOTHING && is_same).then_some((other, [dx, dy]))
        })
    }

    /// The irradiance in every texel.
    pub fn resolve(self) -> IrradianceMap {
        let irradiance = |index: usize| {
            let Texel { object, edge, .. } = self.texels[index];
            if object == NOTHING { Vec3::ZERO } else { self.flux(index).as_vec3() / (edge * edge) }
        };
        let irradiance = (0..self.texels.len()).into_par_iter().map(irradiance).collect();
        let directions = (0..self.directions.len()).map(|index| self.direction(index)).collect();
        IrradianceMap { projection: self.projection, texels: self.texels, irradiance, directions }
    }
}

/// The step of fixed point for about so much flux, W.
pub fn watts_per_step(total: f64) -> f64 {
    total.max(f64::MIN_POSITIVE * STEPS) / STEPS
}

fn texel(projection: &Projection, index: usize, receiver: &impl Fn(Ray) -> Option<Hit>) -> Texel {
    let width = projection.size[0] as usize;
    let place = DVec2::new((index % width) as f64, (index / width) as f64) + 0.5;
    let Some(hit) = receiver(projection.ray(place)) else {
        return Texel { position: Vec3::ZERO, normal: Vec3::ZERO, object: NOTHING, edge: 0.0 };
    };
    let cosine = hit.face_normal.dot(projection.direction_to(hit.position)).abs().max(f32::MIN_POSITIVE);
    let edge = (projection.area_at(hit.position) / f64::from(cosine)).sqrt() as f32;
    Texel { position: hit.position, normal: hit.face_normal, object: hit.object, edge }
}

/// Irradiance on the receivers that a map shows.
#[derive(Clone, Debug)]
pub struct IrradianceMap {
    projection: Projection,
    texels: Arc<Vec<Texel>>,
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

impl IrradianceMap {
    /// The light at a point of an object on the side of a normal, as the mean over the texel that shows it; `None` where none does.
    pub fn nearest(&self, point: Vec3, normal: Vec3, object: u32) -> Option<Incident> {
        let place = self.projection.project(point)?;
        // At the edges of surfaces, the middle of the texel may show something else.
        let around = AROUND.iter().filter_map(|step| self.projection.index(place + DVec2::from_array(*step)));
        let index = around.into_iter().find(|index| self.shows(*index, point, normal, object))?;
        Some(Incident { irradiance: self.irradiance[index], direction: self.direction(index) })
    }

    /// The same, interpolated between those of the four texels around that show it or, if none does, from the nearest one.
    pub fn bilinear(&self, point: Vec3, normal: Vec3, object: u32) -> Option<Incident> {
        let place = self.projection.project(point)?;
        // What lies beyond the edge of a cube's face belongs to another one.
        self.projection.index(place)?;
        let place = place - 0.5;
        let (low, part) = (place.floor(), (place - place.floor()).as_vec2());
        let (mut light, mut weights) = (Incident::default(), 0.0);
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let index = self.projection.index(low + DVec2::new(dx, dy) + 0.5);
            let Some(index) = index.filter(|index| self.shows(*index, point, normal, object)) else { continue };
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

    fn shows(&self, index: usize, point: Vec3, normal: Vec3, object: u32) -> bool {
        let texel = &self.texels[index];
        // As far off as the neighbouring texel may be.
        let is_near = || (point - texel.position).dot(texel.normal).abs() <= 2.0 * PHOTON_OFF_PLANE * texel.edge;
        texel.object == object && texel.normal.dot(normal) > 0.0 && is_near()
    }
}
