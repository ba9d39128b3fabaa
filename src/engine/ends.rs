//! Light at the ends of paths, other than where camera rays hit.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::direct::{DirectLight, SampledLight};
use super::frame::FrameInputs;
use super::paths::EndPoint;
use super::reprojection::Reprojection;
use crate::Error;
use crate::brdf::Materials;
use crate::pinhole::{ReceiverLayout, Receivers, ViewDirections};
use crate::stages::{CameraRays, LightStages};
use crate::technique::Sum;

/// Length of the rows that end points are arranged in.
const ENDS_IN_A_ROW: u32 = 1024;

pub(super) fn direct_light<'a>(inputs: &FrameInputs<'a>, light: &mut LightStages) -> DirectLight<'a> {
    let FrameInputs { prepared, options, progress, .. } = *inputs;
    DirectLight::new(inputs.light, light, &prepared.tracer, options.visibility, progress)
}

/// Direct light at the end points of paths.
pub(super) struct EndLight<'a> {
    materials: &'a Materials,
    diffuse: DirectLight<'a>,
    /// Where a path ends on a glossy receiver.
    glossy: Option<SampledLight<'a>>,
}

impl<'a> EndLight<'a> {
    pub fn new(inputs: &FrameInputs<'a>, stages: &mut LightStages, points: &[EndPoint]) -> Self {
        let FrameInputs { light, prepared, options, progress, .. } = *inputs;
        let materials = &*prepared.materials.receivers;
        let diffuse = direct_light(inputs, stages);
        let glossy = points
            .iter()
            .any(|p| is_glossy(materials, p))
            .then(|| SampledLight::new(light, stages, &prepared.tracer, options.visibility, progress));
        Self { materials, diffuse, glossy }
    }

    /// Irradiance or, on glossy receivers, the radiance reflected towards the viewers.
    pub fn at(&self, points: &[EndPoint], reprojection: &Reprojection, at_hits: &[Vec3]) -> Vec<Vec3> {
        let one = |(index, point): (usize, &EndPoint)| match &self.glossy {
            Some(light) if is_glossy(self.materials, point) => light.reflected(self.materials, &point.hit, point.view),
            _ => reprojection
                .light(index, |hit| at_hits[hit])
                .unwrap_or_else(|| self.diffuse.irradiance(point.hit.position, point.hit.normal)),
        };
        points.par_iter().enumerate().map(one).collect()
    }
}

fn is_glossy(materials: &Materials, point: &EndPoint) -> bool {
    point.receives && materials.is_glossy(point.hit.object)
}

/// The caustic at the end points of paths: irradiance or, on glossy receivers, the radiance reflected towards the
/// viewers.
pub(super) async fn caustic_at(
    inputs: &FrameInputs<'_>,
    sum: &Arc<dyn Sum>,
    points: &[EndPoint],
    rays: &CameraRays,
    at_hits: Option<&Vec<[f32; 4]>>,
) -> Result<Vec<[f32; 4]>, Error> {
    let is_known = |object| at_hits.is_some() && inputs.knows_caustic(object);
    let reprojection = Reprojection::new(rays, points, is_known);
    let interpolated = |index: usize| {
        let of_hit = |hit: usize| at_hits.map_or(Vec3::ZERO, |sums| Vec3::from_slice(&sums[hit]));
        reprojection.light(index, of_hit)
    };
    let materials = &inputs.prepared.materials.receivers;
    let rows = (points.len() as u32).div_ceil(ENDS_IN_A_ROW);
    let mut diffuse = Receivers { layout: ReceiverLayout::Unordered, ..Receivers::empty(ENDS_IN_A_ROW, rows) };
    for (index, point) in points.iter().enumerate().filter(|(_, p)| p.receives && !is_glossy(materials, p)) {
        if interpolated(index).is_none() {
            diffuse.set(index, point.hit.position, point.hit.normal, point.hit.object);
        }
    }
    let mut sums = sum.irradiance(&diffuse, inputs.progress).await?;
    for (index, _) in points.iter().enumerate().filter(|(_, p)| p.receives && !is_glossy(materials, p)) {
        if let Some(light) = interpolated(index) {
            sums[index] = light.extend(0.0).to_array();
        }
    }
    let glossy: Vec<usize> = (0..points.len()).filter(|&k| is_glossy(materials, &points[k])).collect();
    if !glossy.is_empty() {
        let place = |&k: &usize| (points[k].hit.position, points[k].hit.normal, points[k].hit.object);
        let mut receivers = Receivers::from_points(&glossy.iter().map(place).collect::<Vec<_>>(), ENDS_IN_A_ROW);
        let mut directions: Vec<_> = glossy.iter().map(|&k| points[k].view.extend(0.0).to_array()).collect();
        directions.resize(receivers.positions.len(), [0.0; 4]);
        receivers.view_directions = Some(ViewDirections { directions, materials: materials.clone() });
        for (&k, sum) in glossy.iter().zip(sum.irradiance(&receivers, inputs.progress).await?) {
            sums[k] = sum;
        }
    }
    Ok(sums)
}
