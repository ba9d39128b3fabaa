//! Caustic maps: flux per texel of the receivers that a view shows.
//!
//! Flux is summed in fixed point, so that sums are the same whatever their order. Irradiance is flux over area: no cosines of the light's
//! direction are involved. Knows neither lights nor how photons were spread.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use glam::{DVec2, DVec3, Vec3};

use super::constants::PHOTON_OFF_RAY;
use super::irradiance_map::{GlossOfTexels, IrradianceMap};
use super::ledger::Loss;
use super::photons::Photon;
use super::projection::Projection;
use super::receiver_layers::ReceiverLayers;
use crate::brdf::Materials;
use crate::parallel;
use crate::scene::Ray;
use crate::tracing::Hit;

/// Steps of fixed point in the total flux: so many that a millionth of a photon in a million counts, and that sums of a thousand times the
/// total do not overflow.
const STEPS: f64 = (1u64 << 52) as f64;

/// What maps keep for glossy receivers, beside flux.
#[derive(Clone, Copy, Debug)]
pub enum ForGloss<'a> {
    /// Nothing: there are none.
    Nothing,
    /// Directions in which photons travel, weighted by their flux (Wyman and Davis 2006, Equation 10).
    Directions,
    /// Directions in which the light would arrive that nothing has turned (Equation 11).
    Undeflected,
    /// What each photon reflects to the viewer (Equation 9).
    Reflected(&'a Materials),
}

impl ForGloss<'_> {
    fn is_nothing(self) -> bool {
        matches!(self, Self::Nothing)
    }
}

/// A map that photons are added to.
#[derive(Debug)]
pub struct CausticMap<'a> {
    shown: Arc<ReceiverLayers>,
    flux: Vec<[AtomicI64; 3]>,
    /// Of each texel; empty without glossy receivers.
    for_gloss: Vec<[AtomicI64; 3]>,
    kept: ForGloss<'a>,
    /// Of a channel.
    watts_per_step: f64,
}

impl<'a> CausticMap<'a> {
    /// An empty map of what a view shows. `total`: about the flux that is to be added, W.
    pub fn new(shown: ReceiverLayers, (total, kept): (f64, ForGloss<'a>)) -> Self {
        Self::empty(Arc::new(shown), (watts_per_step(total), kept))
    }

    /// A map with the sums of another program: of flux and of what is kept for glossy receivers, in steps.
    #[cfg(feature = "gpu")]
    pub fn of_sums(
        shown: Arc<ReceiverLayers>,
        [flux, for_gloss]: [Vec<[i64; 3]>; 2],
        (watts_per_step, kept): (f64, ForGloss<'a>),
    ) -> Self {
        let atomic = |sums: Vec<[i64; 3]>| sums.into_iter().map(|sum| sum.map(AtomicI64::new)).collect();
        Self { shown, flux: atomic(flux), for_gloss: atomic(for_gloss), kept, watts_per_step }
    }

    /// An empty map that shows the same.
    pub fn emptied(&self) -> Self {
        Self::empty(self.shown.clone(), (self.watts_per_step, self.kept))
    }

    fn empty(shown: Arc<ReceiverLayers>, (watts_per_step, kept): (f64, ForGloss<'a>)) -> Self {
        let zeros = |count: usize| {
            let mut sums = Vec::new();
            sums.resize_with(count, <[AtomicI64; 3]>::default);
            sums
        };
        let for_gloss = zeros(if kept.is_nothing() { 0 } else { shown.len() });
        Self { flux: zeros(shown.len()), for_gloss, kept, shown, watts_per_step }
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

    /// Whether something hides a photon that lands in a texel at the edge of a surface, in a map of what is seen first.
    pub fn is_hidden(&self, photon: &Photon, receiver: impl Fn(Ray) -> Option<Hit>) -> bool {
        let Ok((place, index)) = self.place(photon) else { return false };
        let texel = self.shown.texel(index);
        if texel.part == 1.0 {
            return false;
        }
        let seen = receiver(self.projection().ray(place));
        seen.is_none_or(|hit| hit.position.distance(photon.position) > PHOTON_OFF_RAY * texel.edge)
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

    /// The edge of a square with the area that a whole texel covers on the plane of its receiver, metres.
    pub fn texel_edge(&self, index: usize) -> f32 {
        self.shown.texel(index).edge
    }

    /// The part of a texel in which its receiver is seen.
    pub fn part(&self, index: usize) -> f64 {
        self.shown.texel(index).part.into()
    }

    /// The edge of a texel across its ray at the distance of a point, metres: the same in all faces of a cube.
    pub fn texel_across(&self, point: Vec3) -> f64 {
        let Projection { texel, is_parallel, origin, .. } = *self.projection();
        if is_parallel { texel } else { texel * point.as_dvec3().distance(origin) }
    }

    /// Adds flux of a photon, W.
    pub fn add(&self, index: usize, flux: DVec3, photon: &Photon) {
        self.add_steps(&self.flux[index], flux);
        if let Some(sums) = self.for_gloss.get(index) {
            self.add_steps(sums, self.of_photon(flux, photon));
        }
    }

    /// What glossy receivers have to know of a photon's flux.
    fn of_photon(&self, flux: DVec3, photon: &Photon) -> DVec3 {
        match self.kept {
            ForGloss::Nothing => DVec3::ZERO,
            ForGloss::Directions => photon.direction.as_dvec3() * flux.element_sum(),
            ForGloss::Undeflected => photon.undeflected.as_dvec3() * flux.element_sum(),
            ForGloss::Reflected(materials) => {
                let viewer = -self.projection().direction_to(photon.position);
                let value = materials.value(photon.object, photon.normal, -photon.direction, viewer, 0.0);
                flux * value.as_dvec3()
            }
        }
    }

    /// Adds flux, W, without what glossy receivers have to know of it.
    pub fn add_flux(&self, index: usize, flux: DVec3) {
        self.add_steps(&self.flux[index], flux);
    }

    /// Adds what a texel of a map of the same kind has for glossy receivers, where its flux is multiplied by factors.
    pub fn add_for_gloss(&self, index: usize, (map, other): (&CausticMap, usize), factors: DVec3) {
        if let (Some(sums), Some(given)) = (self.for_gloss.get(index), map.for_gloss.get(other)) {
            let is_of_channels = matches!(self.kept, ForGloss::Reflected(_));
            let factors = if is_of_channels { factors } else { DVec3::splat(factors.element_sum() / 3.0) };
            self.add_steps(sums, map.watts(given) * factors);
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

    /// The texels at most so far from one in columns and rows that show the same surface, and how far they are.
    pub fn around(&self, index: usize, reach: i64) -> impl Iterator<Item = (usize, [i64; 2])> {
        self.shown.around(index, reach)
    }

    /// The irradiance in every texel.
    pub fn resolve(self) -> IrradianceMap {
        let per_area = |sums: &[AtomicI64; 3], index: usize| {
            let texel = self.shown.texel(index);
            if texel.is_there() { self.watts(sums).as_vec3() / texel.area() } else { Vec3::ZERO }
        };
        let direction = |sums: &[AtomicI64; 3]| self.watts(sums).normalize_or_zero().as_vec3();
        let irradiance = parallel::collect(self.flux.len(), &|index| per_area(&self.flux[index], index));
        let gloss = match self.kept {
            ForGloss::Nothing => GlossOfTexels::Unknown,
            ForGloss::Reflected(_) => {
                let sums = &self.for_gloss;
                GlossOfTexels::Reflected(parallel::collect(sums.len(), &|index| per_area(&sums[index], index)))
            }
            ForGloss::Directions | ForGloss::Undeflected => {
                GlossOfTexels::Directions(parallel::map(&self.for_gloss, &direction))
            }
        };
        IrradianceMap { shown: self.shown, irradiance, gloss }
    }
}

/// The step of fixed point for about so much flux, W.
pub fn watts_per_step(total: f64) -> f64 {
    total.max(f64::MIN_POSITIVE * STEPS) / STEPS
}
