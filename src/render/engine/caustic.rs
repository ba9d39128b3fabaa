//! The caustic where camera rays hit. Where it is a picture of its own, it is computed in every pixel. Where it is seen together with
//! direct light, every other pixel is computed, what lies between is interpolated where nothing of that can be seen, and pixels at
//! edges of light are divided.

use std::sync::Arc;

use glam::{Vec3, Vec4};

use super::edges::{
    Caustic, DividedPixels, MIN_CONTRAST, SeenCaustic, beside_edges, contrast_of_edges, parts_of_pixels,
};
use super::ends::POINTS_IN_A_ROW;
use super::every_other::{AdaptiveLight, PixelGrid, STEP};
use super::frame::FrameInputs;
use crate::Error;
use crate::pinhole::Receivers;
use crate::progress::{Progress, Uncounted};
use crate::stages::CameraRays;
use crate::technique::Sum;
use crate::tracing::Hit;

/// Pixels from one point to the next whose light first tells how exact the others have to be.
const COARSE_STEP: usize = 8;

/// What a caustic is computed from.
pub(super) struct CausticAtHits<'a> {
    pub inputs: &'a FrameInputs<'a>,
    pub sum: &'a Arc<dyn Sum>,
    pub rays: &'a CameraRays,
    /// Where it is wanted, by object.
    pub wanted: &'a [bool],
}

impl CausticAtHits<'_> {
    /// In every pixel.
    pub async fn everywhere(&self) -> Result<Vec<[f32; 4]>, Error> {
        let receivers = self.rays.receivers(|object| self.wanted[object as usize]);
        self.sum.irradiance(&receivers, self.inputs.progress).await
    }

    /// As exactly as it can be seen beside direct light.
    pub async fn beside(&self, direct: &[Vec3]) -> Result<Caustic, Error> {
        let Self { inputs, rays, .. } = *self;
        let caustic = self.every_other(direct).await?;
        if rays.view.pixel_samples > 1 {
            return Ok(caustic.into());
        }
        let min_contrast = contrast_of_edges(MIN_CONTRAST, inputs.options.tolerance);
        let light = SeenCaustic { direct, caustic: &caustic };
        let points = beside_edges((rays, caustic.len()), min_contrast, |point| light.at(point));
        let parts = parts_of_pixels(inputs, rays, &points).await?;
        let divided = DividedPixels::new(points, parts);
        divided.with_caustic((inputs, self.sum), direct, caustic).await
    }

    /// In every other pixel, and between these where it cannot be interpolated. What is known around a point tells how large an error
    /// its own light hides.
    async fn every_other(&self, direct: &[Vec3]) -> Result<Vec<[f32; 4]>, Error> {
        let Self { inputs, rays, .. } = *self;
        let is_wanted = |hit: &Option<Hit>| hit.is_some_and(|hit| self.wanted[hit.object as usize]);
        let wanted = (0..rays.hits.len()).filter(|&index| is_wanted(&rays.hits[index]));
        let coarse = self
            .on_grid((COARSE_STEP, &Uncounted(inputs.progress)), |index| inputs.hidden_error(direct[index]))
            .await?;
        let least =
            |index: usize| rays.least_around(index, COARSE_STEP, |other| Some(Vec3::from_slice(&coarse[other])));
        let fine =
            self.on_grid((STEP, inputs.progress), |index| inputs.hidden_error(direct[index] + least(index))).await?;
        let mut caustic = AdaptiveLight::new(rays, rays.hits.len(), wanted, direct);
        caustic.set_nodes(|index| Vec4::from_array(fine[index]));
        while let Some(open) = caustic.next_open() {
            let sums = self.at(&open, |index| inputs.hidden_error(direct[index] + caustic.least(index))).await?;
            caustic.set(sums);
        }
        inputs.progress.advance(caustic.interpolated_count() as u64);
        Ok(caustic.finish())
    }

    /// At wanted hits that are this many pixels apart along rows and columns: a grid of receivers. Returns sums for all camera rays,
    /// zero elsewhere.
    async fn on_grid(
        &self,
        (step, progress): (usize, &dyn Progress),
        error: impl Fn(usize) -> f32,
    ) -> Result<Vec<[f32; 4]>, Error> {
        let mut receivers = self.rays.receivers_of_every(step as u32, |object| self.wanted[object as usize]);
        let (width, across) = (self.rays.width as usize, receivers.width as usize);
        let index = |place: usize| place / across * step * width + place % across * step;
        let places = 0..receivers.positions.len();
        places.clone().for_each(|place| receivers.tolerate(place, error(index(place))));
        let sums = self.sum.irradiance(&receivers, progress).await?;
        self.inputs.check_wanted()?;
        let mut all = vec![[0.0; 4]; self.rays.hits.len()];
        places.for_each(|place| all[index(place)] = sums[place]);
        Ok(all)
    }

    /// At any hits; returns their indices, too.
    async fn at(&self, which: &[usize], error: impl Fn(usize) -> f32) -> Result<Vec<(usize, Vec4)>, Error> {
        let mut ordered = which.to_vec();
        ordered.sort_by_cached_key(|&index| self.rays.place_on_curve(index));
        let hits = ordered.iter().filter_map(|&index| self.rays.hits[index].as_ref());
        let points: Vec<_> = hits.map(|hit| (hit.position, hit.normal, hit.object)).collect();
        let mut receivers = Receivers::from_points(&points, POINTS_IN_A_ROW);
        ordered.iter().enumerate().for_each(|(place, &index)| receivers.tolerate(place, error(index)));
        let sums = self.sum.irradiance(&receivers, self.inputs.progress).await?;
        self.inputs.check_wanted()?;
        Ok(ordered.into_iter().zip(sums.into_iter().map(Vec4::from_array)).collect())
    }
}
