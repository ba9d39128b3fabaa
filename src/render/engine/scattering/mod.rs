//! Light that the medium scatters once towards the camera, along every camera ray: that of caustics, gathered at parts of the ray by the
//! same sums as on surfaces, and direct light with its shafts.
//!
//! A part of a ray is a receiver with a length: what crosses it comes from a strip of the environment, so that even long parts miss no
//! beam. Along rays parts grow with their distance from the mirrors; over the picture every eighth column and row of rays is computed, and
//! those between where the light changes from one to the next.

mod direct;
mod rays;
mod stages;

use std::f32::consts::PI;
use std::sync::Arc;

use glam::{Vec2, Vec3, Vec4};

pub(super) use self::direct::{DirectScattering, unoccluded};
use self::rays::seen_length;
pub(super) use self::rays::{MediumRays, contains};
pub(super) use self::stages::ScatteringStages;
use super::every_other::{AdaptiveLight, CoarserGrid, PixelGrid, is_node};
use super::frame::FrameInputs;
use crate::Error;
use crate::lanes::LANES;
use crate::parallel;
use crate::pinhole::Receivers;
use crate::progress::{Progress, Uncounted};
use crate::stages::CameraRays;
use crate::technique::Sum;
use crate::tracing::Hit;

/// Errors that a part's light may have beyond the sum's tolerance, in tolerances of the mean along all rays: those of a ray's parts
/// average out.
const MORE_TOLERANCES: f32 = 50.0;
/// How many times as much as on surfaces light between rays may be wrong: what rays gather along their way is blurred.
const LENIENCY: f32 = 8.0;
/// The same between rays eight pixels apart, between which a narrow shaft would be missed.
const FIRST_LENIENCY: f32 = 1.0;
/// Parts of rays that are gathered together: as many as fit into 50 MB.
const PARTS_AT_ONCE: usize = 1 << 20;
/// Rays that tell this mean.
const RAYS_OF_MEAN: usize = 32;
/// Light is interpolated between rays along which the visible lengths of the medium differ by no more than this part.
const MAX_NEIGHBOUR_DIFFERENCE: f32 = 0.5;
/// The visible length along a ray differs from what is interpolated between them by no more than this part.
const MAX_LENGTH_DIFFERENCE: f32 = 0.02;

/// Scattered light by camera ray, W/(m²·sr), for an intensity of 1.
#[derive(Debug, Default)]
pub(super) struct Scattered {
    /// Of caustics, with the number of fetches in w; `None` if none are shown.
    pub caustic: Option<Arc<Vec<[f32; 4]>>>,
    /// Direct light; `None` if none is shown.
    pub direct: Option<Arc<Vec<[f32; 4]>>>,
    /// The way through the medium, metres.
    pub lengths: Vec<f32>,
}

impl Scattered {
    /// Light of caustics along a camera ray.
    pub fn caustic_at(&self, index: usize) -> Vec3 {
        self.caustic.as_ref().map_or(Vec3::ZERO, |light| Vec3::from_slice(&light[index]))
    }

    /// Direct light along a camera ray.
    pub fn direct_at(&self, index: usize) -> Vec3 {
        self.direct.as_ref().map_or(Vec3::ZERO, |light| Vec3::from_slice(&light[index]))
    }

    /// Whether there is nothing.
    pub fn is_dark(&self) -> bool {
        self.caustic.is_none() && self.direct.is_none()
    }

    /// Number of fetches of the environment.
    pub fn fetches(&self) -> f64 {
        self.caustic.iter().flat_map(|light| light.iter()).map(|light| f64::from(light[3])).sum()
    }
}

/// Light of caustics along all camera rays, with the number of fetches in w. `beside` is other light from there, which hides
/// differences.
async fn scattered_caustic(
    inputs: &FrameInputs<'_>,
    sum: &Arc<dyn Sum>,
    picture: &PictureRays<'_>,
    beside: &[Vec3],
) -> Result<Vec<[f32; 4]>, Error> {
    let rays = &picture.rays;
    let few = some_of(&rays.within().collect::<Vec<_>>());
    let gather = RayGather { sum: &**sum, rays, progress: inputs.progress };
    let mean = mean_of_parts(&gather.parts(&few, 0.0).await?, rays, &few);
    let error = MORE_TOLERANCES * inputs.options.tolerance * mean;
    let along = async |mut which: Vec<usize>| -> Result<Vec<(usize, Vec4)>, Error> {
        which.sort_by_cached_key(|&index| picture.place_on_curve(index));
        let mut light = Vec::with_capacity(which.len());
        for some in which.chunks((PARTS_AT_ONCE / rays.parts_per_ray()).next_multiple_of(LANES)) {
            let parts = gather.parts(some, error).await?;
            light.extend(some.iter().copied().zip(rays.scattered(some, &parts)));
            inputs.progress.advance(some.len() as u64);
        }
        Ok(light)
    };
    let (light, interpolated) = where_it_changes(picture, beside, along).await?;
    inputs.progress.advance(interpolated as u64);
    Ok(light)
}

/// Direct light along all camera rays.
async fn scattered_direct(
    inputs: &FrameInputs<'_>,
    direct: &DirectScattering<'_>,
    picture: &PictureRays<'_>,
    beside: &[Vec3],
) -> Result<Vec<[f32; 4]>, Error> {
    let along = async |which: Vec<usize>| {
        let found = direct.along(&picture.rays, &which, inputs.progress);
        Ok(which.into_iter().zip(found.into_iter().map(|light| light.extend(0.0))).collect())
    };
    Ok(where_it_changes(picture, beside, along).await?.0)
}

/// Light along all rays of a picture: computed in every eighth column and row, in every fourth where it changes between these, and so on to
/// every one. Returns the number of rays that were interpolated, too. `beside` is other light from there, which hides differences.
async fn where_it_changes(
    picture: &PictureRays<'_>,
    beside: &[Vec3],
    along: impl AsyncFnMut(Vec<usize>) -> Result<Vec<(usize, Vec4)>, Error>,
) -> Result<(Vec<[f32; 4]>, usize), Error> {
    let rays = || picture.rays.within();
    let coarser = CoarserGrid(picture);
    let in_other = |index: &usize| is_node(picture, *index);
    let in_fourth = |index: &usize| in_other(index) && is_node(&coarser, *index);
    let mut refined = RefinedLight { beside, along, light: None, count: picture.rays.len(), interpolated: 0 };
    refined.refine(&CoarserGrid(&coarser), rays().filter(in_fourth), FIRST_LENIENCY).await?;
    refined.refine(&coarser, rays().filter(in_other), LENIENCY).await?;
    refined.refine(picture, rays(), LENIENCY).await?;
    Ok((refined.light.unwrap_or_default(), refined.interpolated))
}

/// Light along the rays of a picture, which is computed by `along` or interpolated, on finer and finer grids.
struct RefinedLight<'a, A> {
    beside: &'a [Vec3],
    along: A,
    /// On the grid before; `None` on the first one.
    light: Option<Vec<[f32; 4]>>,
    /// Rays of the picture.
    count: usize,
    /// How many of them were interpolated so far.
    interpolated: usize,
}

impl<A: AsyncFnMut(Vec<usize>) -> Result<Vec<(usize, Vec4)>, Error>> RefinedLight<'_, A> {
    /// Finds the light of some rays; that of every other one of them, in columns and rows, is known from the grid before.
    async fn refine(
        &mut self,
        grid: &impl PixelGrid,
        rays: impl Iterator<Item = usize>,
        leniency: f32,
    ) -> Result<(), Error> {
        let mut finer = AdaptiveLight::new(grid, self.count, rays, self.beside).leniently(leniency);
        if let Some(known) = &self.light {
            finer.set_nodes(|index| Vec4::from_array(known[index]));
        }
        while let Some(open) = finer.next_open() {
            finer.set((self.along)(open).await?);
        }
        self.interpolated += finer.interpolated_count();
        self.light = Some(finer.finish());
        Ok(())
    }
}

/// Some of the rays, from all over the picture: even steps could coincide with its columns, golden-ratio steps do not.
fn some_of(rays: &[usize]) -> Vec<usize> {
    let place = |k: usize| ((k as f64 * 0.618_033_988_749_894_9).fract() * rays.len() as f64) as usize;
    (0..RAYS_OF_MEAN.min(rays.len())).map(|k| rays[place(k)]).collect()
}

/// The mean over the parts of some rays, as far as they are seen through the medium, W/m².
fn mean_of_parts(parts: &[[f32; 4]], rays: &MediumRays, which: &[usize]) -> f32 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for (place, &index) in which.iter().enumerate() {
        for (part, weight) in rays.weights(index).enumerate() {
            let light = Vec3::from_slice(&parts[place_in_list(place, part, rays.parts_per_ray())]);
            sum += weight.element_sum() / 3.0 * light.element_sum() / 3.0;
            weights += weight.element_sum() / 3.0;
        }
    }
    if weights > 0.0 { sum / weights } else { 0.0 }
}

/// Where in a list of receivers a part of a ray is: packets of sixteen rays, part by part.
fn place_in_list(ray: usize, part: usize, parts_per_ray: usize) -> usize {
    (ray / LANES * parts_per_ray + part) * LANES + ray % LANES
}

/// Sums along rays.
struct RayGather<'a> {
    sum: &'a dyn Sum,
    rays: &'a MediumRays,
    progress: &'a dyn Progress,
}

impl RayGather<'_> {
    /// The light at the parts of some rays, W/m², in a list of receivers; it may be wrong by so much more than the sum's tolerance.
    async fn parts(&self, which: &[usize], error: f32) -> Result<Vec<[f32; 4]>, Error> {
        let Self { sum, rays, progress } = *self;
        let per_ray = rays.parts_per_ray();
        let mut receivers = Receivers::of_rays(LANES as u32, (which.len().div_ceil(LANES) * per_ray) as u32);
        for (place, &index) in which.iter().enumerate() {
            let ray = rays.ray(index);
            let weights: Vec<f32> = rays.weights(index).map(Vec3::max_element).collect();
            let mean_weight = weights.iter().sum::<f32>() / per_ray as f32;
            for (part, [start, end]) in rays.parts(index).enumerate() {
                let at = place_in_list(place, part, per_ray);
                receivers.set_part(at, ray.origin + 0.5 * (start + end) * ray.direction, -ray.direction, end - start);
                // Errors of all parts weigh the same in the picture.
                receivers.tolerate(at, error * mean_weight / weights[part].max(f32::MIN_POSITIVE));
            }
        }
        let uncounted = Uncounted(progress);
        sum.irradiance(&receivers, &uncounted).await
    }
}

impl MediumRays {
    /// What the medium scatters along some rays, from the light at their parts.
    fn scattered(&self, which: &[usize], parts: &[[f32; 4]]) -> Vec<Vec4> {
        let of_ray = |(place, &index): (usize, &usize)| {
            let light = self.weights(index).enumerate().map(|(part, weight)| {
                let light = Vec4::from(parts[place_in_list(place, part, self.parts_per_ray())]);
                weight.extend(1.0) * light
            });
            let sum: Vec4 = light.sum();
            (self.medium().sigma_s / (4.0 * PI)).extend(1.0) * sum
        };
        which.iter().enumerate().map(of_ray).collect()
    }
}

/// All camera rays of a picture.
struct PictureRays<'a> {
    camera_rays: &'a CameraRays,
    rays: MediumRays,
    /// By ray: the visible length of the medium, which is the integral of the transmittance to the camera, metres.
    seen: Vec<f32>,
}

impl<'a> PictureRays<'a> {
    fn new(camera_rays: &'a CameraRays, rays: MediumRays) -> Self {
        let seen = |index: usize| seen_length(rays.medium(), [0.0, rays.length(index)]).max_element();
        let seen = parallel::collect(rays.len(), &seen);
        Self { camera_rays, rays, seen }
    }
}

impl PixelGrid for PictureRays<'_> {
    fn width(&self) -> usize {
        self.camera_rays.width as usize
    }

    fn pixel(&self, index: usize) -> (usize, usize) {
        PixelGrid::pixel(self.camera_rays, index)
    }

    fn counterpart(&self, index: usize, column: usize, row: usize) -> Option<usize> {
        CameraRays::counterpart(self.camera_rays, index, column, row)
    }

    fn hit(&self, index: usize) -> Option<&Hit> {
        self.rays.end(index)
    }

    /// What a ray hits does not matter, only the visible length of the medium before it.
    fn may_interpolate(&self, index: usize, other: usize) -> bool {
        let are_within = [index, other].iter().all(|&index| self.hit(index).is_some());
        are_within && are_alike((self.seen[index], self.seen[other]), MAX_NEIGHBOUR_DIFFERENCE)
    }

    fn lies_between(&self, index: usize, corners: [usize; 4], part: Vec2) -> bool {
        let [a, b, c, d] = corners.map(|index| self.seen[index]);
        let expected = (a + (b - a) * part.x) * (1.0 - part.y) + (c + (d - c) * part.x) * part.y;
        are_alike((self.seen[index], expected), MAX_LENGTH_DIFFERENCE)
    }
}

/// Whether lengths differ by no more than a part of them.
fn are_alike((one, other): (f32, f32), part: f32) -> bool {
    (one - other).abs() <= part * one.max(other)
}

/// What is scattered along a few camera rays, without differences between neighbours: light of caustics, without any if there is no sum,
/// and direct light, W/(m²·sr).
pub(super) async fn scattered_along(
    rays: &MediumRays,
    sum: Option<&dyn Sum>,
    direct: &DirectScattering<'_>,
    progress: &dyn Progress,
) -> Result<[Vec<Vec3>; 2], Error> {
    let within: Vec<usize> = rays.within().collect();
    let mut caustic = vec![Vec3::ZERO; rays.len()];
    if let Some(sum) = sum {
        let gather = RayGather { sum, rays, progress };
        for some in within.chunks((PARTS_AT_ONCE / rays.parts_per_ray()).next_multiple_of(LANES)) {
            let parts = gather.parts(some, 0.0).await?;
            let scattered = rays.scattered(some, &parts);
            some.iter().zip(scattered).for_each(|(&index, light)| caustic[index] = light.truncate());
        }
    }
    let mut of_direct = vec![Vec3::ZERO; rays.len()];
    let found = direct.along(rays, &within, progress);
    within.iter().zip(found).for_each(|(&index, light)| of_direct[index] = light);
    Ok([caustic, of_direct])
}
