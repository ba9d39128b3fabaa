//! Light at the ends of paths, other than where camera rays hit.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::{Vec3, Vec4};
use obvhs::ploc::morton::morton_encode_u64;

use super::direct::DirectLight;
use super::edges::{
    Caustic, Direct, DividedPixels, MIN_MIRRORED_CONTRAST, PARTS, Part, SeenCaustic, beside_edges, contrast_of_edges,
};
use super::every_other::{AdaptiveLight, EndGrid};
use super::frame::FrameInputs;
use super::glossy::GlossyLight;
use super::paths::EndPoint;
use super::reprojection::{MIN_NORMAL_COSINE, Reprojection, light_at};
use crate::Error;
use crate::brdf::Materials;
use crate::image::Aov;
use crate::parallel;
use crate::pinhole::{Receivers, ViewDirections};
use crate::stages::{CameraRays, LightStages};
use crate::technique::Sum;
use crate::tracing::Hit;

/// Length of the rows that points are arranged in.
pub(super) const POINTS_IN_A_ROW: u32 = 1024;
/// Points along the curve whose shadows are found together.
pub(super) const POINTS_IN_A_GROUP: usize = 256;
/// Points that a rough mirror blurs share their light within this part of the blur.
const SHARED_BLUR: f32 = 0.25;
/// Cells along an edge of the grid whose Z-order curve points are sorted along.
const CURVE_STEPS: f32 = (1 << 20) as f32;

/// Direct light for the irradiance on surfaces.
pub(super) async fn direct_light<'a>(
    inputs: &FrameInputs<'a>,
    light: &mut LightStages,
    rays: &CameraRays,
) -> Result<DirectLight<'a>, Error> {
    let FrameInputs { options, progress, .. } = *inputs;
    DirectLight::new(inputs.light, light, inputs.ray_source(), (options.visibility, rays), progress).await
}

/// Direct light at the end points of paths.
pub(super) struct EndLight<'a> {
    materials: &'a Materials,
    diffuse: DirectLight<'a>,
    /// Where a path ends on a glossy receiver.
    glossy: Option<GlossyLight<'a>>,
}

impl<'a> EndLight<'a> {
    pub async fn new(
        inputs: &FrameInputs<'a>,
        stages: &mut LightStages,
        points: &[EndPoint],
        rays: &CameraRays,
    ) -> Result<Self, Error> {
        let FrameInputs { light, prepared, options, progress, .. } = *inputs;
        let materials = &*prepared.materials.receivers;
        let diffuse = direct_light(inputs, stages, rays).await?;
        let glossy = points
            .iter()
            .any(|p| is_glossy(materials, p))
            .then(|| GlossyLight::new(light, stages.sampler(light, progress), inputs.ray_source(), options.visibility));
        Ok(Self { materials, diffuse, glossy })
    }

    /// Irradiance or, on glossy receivers, the radiance reflected towards the viewers, at the end points of a picture of this width.
    /// `at_hits` is the irradiance where camera rays hit, if it is known, which is interpolated where the camera sees a point.
    pub async fn at(
        &self,
        inputs: &FrameInputs<'_>,
        points: &[EndPoint],
        rays: &CameraRays,
        at_hits: Option<&Direct>,
    ) -> Result<Direct, Error> {
        let is_known = |object| at_hits.is_some() && inputs.shows_irradiance(Aov::Direct, object);
        let at_hit = |hit: usize| at_hits.map_or(Vec3::ZERO, |direct| direct.light[hit]);
        let reprojection = Reprojection::new(rays, points, is_known);
        let of_point = |index: usize| {
            let is_sharp = !is_glossy(self.materials, &points[index]);
            is_sharp.then(|| reprojection.light(index, at_hit)).flatten()
        };
        let known = parallel::collect(points.len(), &of_point);
        let unknown = (0..points.len()).filter(|&index| known[index].is_none());
        let grid = EndGrid::new(points, rays.view.size[0]);
        let mut light = AdaptiveLight::new(&grid, points.len(), unknown, &[]);
        light.set(known.iter().enumerate().filter_map(|(index, value)| Some((index, (*value)?.extend(0.0)))));
        while let Some(open) = light.next_open() {
            let (glossy, mut diffuse): (Vec<usize>, Vec<usize>) =
                open.into_iter().partition(|&index| is_glossy(self.materials, &points[index]));
            sort_along_curve(&mut diffuse, points);
            let hits = |group: &[usize]| group.iter().map(|&index| &points[index].hit).collect();
            let groups: Vec<Vec<&Hit>> = diffuse.chunks(POINTS_IN_A_GROUP).map(hits).collect();
            let irradiance = self.diffuse.irradiance_of_groups(&groups).await?;
            let radiance = self.reflected(&glossy, points).await?;
            inputs.check_wanted()?;
            let computed = diffuse.into_iter().zip(irradiance).chain(glossy.into_iter().zip(radiance));
            light.set(computed.map(|(index, value)| (index, value.extend(0.0))));
        }
        let light: Vec<Vec3> = light.finish().iter().map(|light| Vec3::from_slice(light)).collect();
        if rays.view.pixel_samples > 1 {
            return Ok(light.into());
        }
        let divided = beside_edges((&grid, points.len()), MIN_MIRRORED_CONTRAST, |point| [light[point]; 2]);
        let parts = parts_of_ends(inputs, rays, (points, &divided), is_known, at_hit).await?;
        let divided = DividedPixels::new(divided, parts);
        let of_parts = self.diffuse.irradiance_of_groups(&divided.open_in_groups()).await?;
        Ok(divided.with_direct(of_parts, light))
    }

    /// The radiance that some of the points, on glossy receivers, reflect towards the viewers.
    async fn reflected(&self, which: &[usize], points: &[EndPoint]) -> Result<Vec<Vec3>, Error> {
        let Some(glossy) = self.glossy.as_ref().filter(|_| !which.is_empty()) else { return Ok(Vec::new()) };
        let points: Vec<&EndPoint> = which.iter().map(|&index| &points[index]).collect();
        let environment = glossy.reflected(self.materials, &points).await?;
        let near_light = self.diffuse.near_light();
        let near = parallel::map(&points, &|point| near_light.reflected(self.materials, &point.hit, point.view));
        Ok(environment.into_iter().zip(near).map(|(environment, near)| environment + near).collect())
    }
}

fn is_glossy(materials: &Materials, point: &EndPoint) -> bool {
    point.receives && materials.is_glossy(point.hit.object)
}

/// The caustic at the end points of paths: irradiance or, on glossy receivers, the radiance reflected towards the
/// viewers. Where the camera sees the same surface, what is known there is interpolated. What the light at the same points is seen
/// `beside` hides errors.
pub(super) async fn caustic_at(
    inputs: &FrameInputs<'_>,
    sum: &Arc<dyn Sum>,
    (points, beside): (&[EndPoint], &[Vec3]),
    rays: &CameraRays,
    at_hits: Option<&Caustic>,
) -> Result<Caustic, Error> {
    let is_known = |object| at_hits.is_some() && inputs.knows_caustic(object);
    let reprojection = Reprojection::new(rays, points, is_known);
    let at_hit = |hit: usize| at_hits.map_or(Vec3::ZERO, |caustic| Vec3::from_slice(&caustic.sums[hit]));
    let materials = &inputs.prepared.materials.receivers;
    let mut sums = vec![[0.0; 4]; points.len()];
    let (mut sharp, mut blurred, mut known) = (Vec::new(), Vec::new(), Vec::new());
    for (index, point) in points.iter().enumerate().filter(|(_, point)| point.receives) {
        if is_glossy(materials, point) {
            sharp.push(index);
        } else if let Some(light) = reprojection.light(index, at_hit) {
            sums[index] = light.extend(0.0).to_array();
            known.push(index);
        } else if point.blur > 0.0 {
            blurred.push(index);
        } else {
            sharp.push(index);
        }
    }
    inputs.progress.advance((points.len() - sharp.len() - blurred.len()) as u64);
    let gather = EndGather { inputs, sum, points };
    gather.add(blurred.clone(), &|index| beside[index], &mut sums).await?;
    known.extend(blurred);
    let grid = EndGrid::new(points, rays.view.size[0]);
    let mut caustic = AdaptiveLight::new(&grid, points.len(), sharp.into_iter(), beside);
    caustic.set(known.into_iter().map(|index| (index, Vec4::from_array(sums[index]))));
    while let Some(open) = caustic.next_open() {
        let light = |index: usize| beside[index] + caustic.least(index);
        let (glossy, diffuse) = open.iter().partition(|&&index| is_glossy(materials, &points[index]));
        gather.add(diffuse, &light, &mut sums).await?;
        gather.reflect(glossy, &light, &mut sums).await?;
        caustic.set(open.into_iter().map(|index| (index, Vec4::from_array(sums[index]))));
    }
    inputs.progress.advance(caustic.interpolated_count() as u64);
    let sums = caustic.finish();
    if rays.view.pixel_samples > 1 {
        return Ok(sums.into());
    }
    let min_contrast = contrast_of_edges(MIN_MIRRORED_CONTRAST, inputs.options.tolerance);
    let light = SeenCaustic { direct: beside, caustic: &sums };
    let mut divided = beside_edges((&grid, sums.len()), min_contrast, |point| light.at(point));
    divided.retain(|&index| points[index].receives);
    let parts = parts_of_ends(inputs, rays, (points, &divided), is_known, at_hit).await?;
    DividedPixels::new(divided, parts).with_caustic((inputs, sum), beside, sums).await
}

/// The parts of some end points' pixels that see the same by way of smooth mirrors, if their light is irradiance; it is known on some
/// objects where camera rays hit them.
async fn parts_of_ends(
    inputs: &FrameInputs<'_>,
    rays: &CameraRays,
    (points, divided): (&[EndPoint], &[usize]),
    is_known: impl Fn(u32) -> bool,
    at_hit: impl Fn(usize) -> Vec3,
) -> Result<Vec<[Part; PARTS]>, Error> {
    let materials = &inputs.prepared.materials.receivers;
    let is_sharp = |index: &usize| points[*index].blur == 0.0 && !is_glossy(materials, &points[*index]);
    let sharp: Vec<&EndPoint> = divided.iter().filter(|index| is_sharp(index)).map(|&index| &points[index]).collect();
    let mut hits = inputs.path_tracer(rays).parts_of_ends(&sharp).await?.into_iter();
    let parts = |index: &usize| {
        let (point, hits) = (&points[*index], is_sharp(index).then(|| hits.next()).flatten());
        let is_known = is_known(point.hit.object);
        hits.unwrap_or_default().map(|hit| {
            let Some(hit) = hit else { return Part::Other };
            let known = is_known.then(|| light_at(rays, &EndPoint { hit, ..point.clone() }, &at_hit)).flatten();
            known.map_or(Part::Open(hit), Part::Known)
        })
    };
    Ok(divided.iter().map(parts).collect())
}

/// Sums at end points.
struct EndGather<'a> {
    inputs: &'a FrameInputs<'a>,
    sum: &'a Arc<dyn Sum>,
    points: &'a [EndPoint],
}

impl EndGather<'_> {
    /// Computes the irradiance at some of the points; light that is seen there hides errors.
    async fn add(&self, which: Vec<usize>, light: &dyn Fn(usize) -> Vec3, sums: &mut [[f32; 4]]) -> Result<(), Error> {
        self.gather(which, None, &|index| self.inputs.hidden_error(light(index)), sums).await
    }

    /// Computes the radiance that some of the points reflect towards viewers; radiance that is seen there hides errors.
    async fn reflect(
        &self,
        which: Vec<usize>,
        radiance: &dyn Fn(usize) -> Vec3,
        sums: &mut [[f32; 4]],
    ) -> Result<(), Error> {
        // The error of a sum is that of the irradiance of a white receiver that is as bright.
        let error = |index: usize| PI * self.inputs.hidden_error(radiance(index));
        self.gather(which, Some(&self.inputs.prepared.materials.receivers), &error, sums).await
    }

    async fn gather(
        &self,
        mut which: Vec<usize>,
        materials: Option<&Arc<Materials>>,
        error: &dyn Fn(usize) -> f32,
        sums: &mut [[f32; 4]],
    ) -> Result<(), Error> {
        let Self { inputs, sum, points } = *self;
        if which.is_empty() {
            return Ok(());
        }
        sort_along_curve(&mut which, points);
        let (leaders, leader_of) = share_blurred(&which, points);
        inputs.progress.advance((which.len() - leaders.len()) as u64);
        let mut receivers = receivers_at(points, &leaders, materials);
        leaders.iter().enumerate().for_each(|(place, &index)| receivers.tolerate(place, error(index)));
        let computed = sum.irradiance(&receivers, inputs.progress).await?;
        inputs.check_wanted()?;
        for (index, leader) in which.into_iter().zip(leader_of) {
            sums[index] = computed[leader];
        }
        Ok(())
    }
}

/// Sorts points so that those which follow each other are close, as gathers want them.
fn sort_along_curve(which: &mut [usize], points: &[EndPoint]) {
    let position = |index: &usize| points[*index].hit.position;
    let low = which.iter().map(position).fold(Vec3::INFINITY, Vec3::min);
    let high = which.iter().map(position).fold(Vec3::NEG_INFINITY, Vec3::max);
    let steps = CURVE_STEPS / (high - low).max_element().max(f32::MIN_POSITIVE);
    which.sort_by_cached_key(|index| {
        let [x, y, z] = (steps * (position(index) - low)).to_array().map(|c| c as u32);
        morton_encode_u64(x, y, z)
    });
}

/// Points whose light is computed, out of a list along the curve, and for each of the list which of them it takes: where a rough
/// mirror blurs what it shows, points that are much closer than its blur share their light.
fn share_blurred(which: &[usize], points: &[EndPoint]) -> (Vec<usize>, Vec<usize>) {
    let mut leaders: Vec<usize> = Vec::new();
    let leader_of = which.iter().map(|&index| {
        let point = &points[index];
        let is_shared = leaders.last().is_some_and(|&leader| {
            let leader = &points[leader];
            leader.hit.object == point.hit.object
                && leader.hit.normal.dot(point.hit.normal) > MIN_NORMAL_COSINE
                && leader.hit.position.distance(point.hit.position) < SHARED_BLUR * point.blur.min(leader.blur)
        });
        if !is_shared {
            leaders.push(index);
        }
        leaders.len() - 1
    });
    let leader_of = leader_of.collect();
    (leaders, leader_of)
}

/// Receivers at some of the points; with the materials of the scene, they reflect towards the viewers.
fn receivers_at(points: &[EndPoint], which: &[usize], materials: Option<&Arc<Materials>>) -> Receivers {
    let chosen = || which.iter().map(|&index| &points[index]);
    let places: Vec<_> = chosen().map(|p| (p.hit.position, p.hit.normal, p.hit.object)).collect();
    let mut receivers = Receivers::from_points(&places, POINTS_IN_A_ROW);
    receivers.view_directions = materials.map(|materials| {
        let mut directions: Vec<_> = chosen().map(|p| p.view.extend(0.0).to_array()).collect();
        directions.resize(receivers.positions.len(), [0.0; 4]);
        ViewDirections { directions, materials: materials.clone() }
    });
    receivers
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracing::Hit;

    #[test]
    fn points_share_their_light_within_their_blur() {
        let at = |x: f32, blur: f32| {
            let position = Vec3::new(x, 0.0, 0.0);
            let hit = Hit { object: 0, position, distance: 1.0, normal: Vec3::Y, face_normal: Vec3::Y, front: true };
            EndPoint { hit, receives: true, view: Vec3::Y, pixel: 0, key: 0, steps: [Vec3::ZERO; 2], blur }
        };
        let points = [at(0.0, 0.1), at(0.02, 0.1), at(0.04, 0.1), at(0.05, 0.1), at(0.051, 0.0), at(0.051, 0.0)];
        let (leaders, leader_of) = share_blurred(&[0, 1, 2, 3, 4, 5], &points);
        assert_eq!(leaders, [0, 2, 4, 5]);
        assert_eq!(leader_of, [0, 0, 1, 1, 2, 3]);
    }
}
