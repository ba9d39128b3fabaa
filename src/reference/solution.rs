//! How an estimate comes about: what beams bring first, then passes of points, and the ledger of flux in the end.

use std::sync::Arc;

use super::direct::Direct;
use super::domain::{Domain, Lighting};
use super::forward::{ByBeams, Count, Directions, Flux, Rays, Window};
use super::light::Light;
use super::lit_surfaces::LitSurfaces;
use super::passes::{Checkpoint, Passes};
use super::receivers::Receivers;
use super::reflectors::Reflectors;
use super::scattering::Scattering;
use super::sky::Sky;
use super::{Estimate, Ledger, Options, Picture, Quantity, Reference, ReferenceError, StoppingCriterion};
use crate::scene::Visibility;
use crate::{OptionError, Progress};

/// Where light is missing from beams, they are divided so much deeper.
const DEEPER: u32 = 3;
/// Where it is missing from points, their error is to be so many times what it was.
const MORE_EXACT: f64 = 0.5;
/// Light that changes from one pixel to the next by 1 may be missed by so much at points, where the count takes what is around them, or
/// whole pixels.
const BETWEEN_IN_WINDOWS: f64 = 0.07;
const BETWEEN_IN_PIXELS: f64 = 0.29;

impl Reference {
    /// Adds passes to `known` (or starts) until the criterion is met. `checkpoint` is shown what there is from time to time, so
    /// that it can be kept.
    ///
    /// # Errors
    /// Besides options, files and cancelling: [`ReferenceError::Unbalanced`] where a complete estimate and an independent count of the light do
    /// not agree.
    pub fn solve(
        &self,
        criterion: &StoppingCriterion,
        known: Option<Estimate>,
        progress: &dyn Progress,
        checkpoint: &mut dyn FnMut(&Estimate) -> Result<(), ReferenceError>,
    ) -> Result<Estimate, ReferenceError> {
        let estimate = self.solve_in_passes(criterion, known, progress, &mut |estimate, _| checkpoint(estimate))?;
        match estimate.check() {
            Err(unbalanced @ ReferenceError::Unbalanced { .. }) => Err(unbalanced),
            _ => Ok(estimate),
        }
    }

    /// The same, telling the checkpoint where passes end, and leaving it to the caller to check the estimate.
    pub(super) fn solve_in_passes(
        &self,
        criterion: &StoppingCriterion,
        known: Option<Estimate>,
        progress: &dyn Progress,
        checkpoint: &mut Checkpoint,
    ) -> Result<Estimate, ReferenceError> {
        let rel_error = criterion.rel_error;
        if !(rel_error > 0.0 && rel_error.is_finite()) {
            let message = format!("is {rel_error}, but must be a number greater than 0");
            return Err(OptionError::invalid("rel_error", message).into());
        }
        let flux = std::cell::OnceCell::new();
        let (mut known, mut rel_error) = (known, rel_error);
        loop {
            let had = known.as_ref().map(|known| known.statistics);
            let criterion = StoppingCriterion { rel_error, ..*criterion };
            let mut estimate = self.solve_once(&criterion, known, progress, checkpoint)?;
            let count = || flux.get_or_init(|| self.count(&criterion));
            estimate.ledger =
                (self.keeps_ledger() && estimate.coverage() == 1.0).then(|| self.ledger(count(), &estimate));
            let is_right = estimate.ledger.as_ref().is_none_or(Ledger::closes);
            if is_right || criterion.is_over() || had == Some(estimate.statistics) {
                return Ok(estimate);
            }
            // Coarse passes may find little of the light, and know little of their error.
            rel_error = MORE_EXACT * rel_error.min(estimate.rel_error()).max(f64::MIN_POSITIVE);
            known = Some(estimate);
        }
    }

    /// An estimate as exact as it says itself.
    fn solve_once(
        &self,
        criterion: &StoppingCriterion,
        known: Option<Estimate>,
        progress: &dyn Progress,
        checkpoint: &mut Checkpoint,
    ) -> Result<Estimate, ReferenceError> {
        if self.shares.is_empty() {
            self.solve_by_points(criterion, known, progress, checkpoint)
        } else {
            self.solve_with_beams(criterion, known, progress, checkpoint)
        }
    }

    /// The light of some by beams, and all other by points.
    fn solve_with_beams(
        &self,
        criterion: &StoppingCriterion,
        known: Option<Estimate>,
        progress: &dyn Progress,
        checkpoint: &mut Checkpoint,
    ) -> Result<Estimate, ReferenceError> {
        let is_all = !self.has_other_light();
        if is_all && let Some(known) = known.as_ref().filter(|known| known.coverage() == 1.0) {
            return Ok(known.clone());
        }
        let beams = self.beams(criterion, progress)?;
        let mut others = match known {
            Some(joined) => beams.without(&joined),
            None => Estimate::unknown(self.options.size),
        };
        if is_all {
            return Ok(beams.joined(&others.made_certain()));
        }
        others.beside = Some(Arc::new(beams.image(self.options.size)));
        let others = self.solve_by_points(criterion, Some(others), progress, &mut |others, ends_pass| {
            checkpoint(&beams.joined(others), ends_pass)
        })?;
        Ok(Estimate { beside: None, ..beams.joined(&others) })
    }

    /// What beams bring, divided more finely if light is missing.
    fn beams(&self, criterion: &StoppingCriterion, progress: &dyn Progress) -> Result<ByBeams, ReferenceError> {
        let rays = self.rays();
        let solve = |depth| ByBeams::solve(&rays, (&self.scene, &self.lamps, &self.shares), depth, criterion, progress);
        let beams = solve(0)?;
        let lamps = self.lamps.only(&self.shares.lamps);
        let dark = Light::dark();
        let light = if self.shares.spot { &self.light } else { &dark };
        let environment = Directions::new(&self.scene.environment, light);
        let (geometry, emitters, size) = (&self.geometry, &self.emitters, self.options.size);
        let (lamps, window) = (&lamps, Window::Pixels);
        let count = Count { rays: &rays, geometry, lamps, emitters, environment, surfaces: None, size, window };
        let flux = count.flux(self.options.seed, &|| criterion.is_over());
        let alone = beams.joined(&Estimate::unknown(size).made_certain());
        if Ledger::new(&flux, &alone, 0.0).closes() { Ok(beams) } else { solve(DEEPER) }
    }

    fn rays(&self) -> Rays<'_> {
        Rays::new(&self.scene, (&self.geometry, &self.emitters), self.options.size, self.options.chains)
    }

    /// Whether there is light beside that which is left to beams.
    fn has_other_light(&self) -> bool {
        let surfaces = LitSurfaces::new(&self.scene, &self.geometry, (&self.lamps, &self.emitters), Visibility::Full);
        self.shares.lamps.len() < self.lamps.sources().len()
            || !self.shares.spot && !self.light.is_dark()
            || self.emitters.brightest() > 0.0
            || surfaces.brightest > 0.0
    }

    /// Light that is not left to beams.
    fn solve_by_points(
        &self,
        criterion: &StoppingCriterion,
        known: Option<Estimate>,
        progress: &dyn Progress,
        checkpoint: &mut Checkpoint,
    ) -> Result<Estimate, ReferenceError> {
        let Self { geometry, light, lamps, emitters, options, .. } = self;
        let passes = Work { options, criterion, progress };
        if !options.quantity.is_caustic() {
            let sky = Sky { geometry, light, emitters, visibility: options.visibility };
            return self.solve_for(Direct { sky, lamps }, &passes, known, checkpoint);
        }
        let mut domain = Reflectors::new(&self.scene, geometry, (light, lamps, emitters), options);
        let (dark, others) = (Light::dark(), lamps.without(&self.shares.lamps));
        if !self.shares.is_empty() {
            domain.set_light(if self.shares.spot { &dark } else { light }, &others);
        }
        self.solve_for(domain, &passes, known, checkpoint)
    }

    fn solve_for<D: Lighting>(
        &self,
        light: D,
        work: &Work,
        known: Option<Estimate>,
        checkpoint: &mut Checkpoint,
    ) -> Result<Estimate, ReferenceError> {
        match &self.picture {
            Picture::Surfaces(receivers) => work.passes(&light, receivers).solve(work.criterion, known, checkpoint),
            Picture::Medium(medium, sights) => {
                let domain = Scattering { medium, light };
                work.passes(&domain, sights).solve(work.criterion, known, checkpoint)
            }
        }
    }

    /// Whether an account of the flux is kept: not of other light than caustics on surfaces, nor of light that does not exist, without attenuation
    /// or occlusion.
    fn keeps_ledger(&self) -> bool {
        let Options { quantity, visibility, attenuation, .. } = self.options;
        quantity == Quantity::Caustic && visibility == Visibility::Full && attenuation
    }

    /// All light that arrives in the picture, counted.
    fn count(&self, criterion: &StoppingCriterion) -> Flux {
        let Options { visibility, pixel_samples, size, seed, .. } = self.options;
        let (rays, geometry, lamps, emitters) = (self.rays(), &self.geometry, &self.lamps, &self.emitters);
        let environment = Directions::new(&self.scene.environment, &self.light);
        let surfaces = Some(LitSurfaces::new(&self.scene, geometry, (lamps, emitters), visibility));
        let window = if self.uses_beams() { Window::Pixels } else { Window::Points(pixel_samples) };
        let count = Count { rays: &rays, geometry, lamps, emitters, environment, surfaces, size, window };
        count.flux(seed, &|| criterion.is_over())
    }

    /// The account of a complete estimate.
    fn ledger(&self, flux: &Flux, estimate: &Estimate) -> Ledger {
        let between = match (self.uses_beams(), self.has_other_light()) {
            (false, _) => BETWEEN_IN_WINDOWS,
            (true, true) => BETWEEN_IN_PIXELS,
            (true, false) => 0.0,
        };
        Ledger::new(flux, estimate, between / f64::from(self.options.pixel_samples))
    }
}

/// What all passes of a solution have in common.
struct Work<'a> {
    options: &'a Options,
    criterion: &'a StoppingCriterion<'a>,
    progress: &'a dyn Progress,
}

impl<'a> Work<'a> {
    fn passes<D: Domain>(&self, domain: &'a D, receivers: &'a Receivers<D::Receiver>) -> Passes<'a, D> {
        Passes { domain, receivers, options: self.options, progress: self.progress }
    }
}
