//! Light at the ends of paths, other than where camera rays hit.

use std::sync::Arc;

use glam::Vec3;
use obvhs::ploc::morton::morton_encode_u64;
use rayon::prelude::*;

use super::direct::DirectLight;
use super::frame::FrameInputs;
use super::glossy::GlossyLight;
use super::paths::EndPoint;
use super::reprojection::Reprojection;
use crate::Error;
use crate::brdf::Materials;
use crate::pinhole::{Receivers, ViewDirections};
use crate::stages::{CameraRays, LightStages};
use crate::technique::Sum;
use crate::tracing::Hit;

/// Length of the rows that points are arranged in.
const POINTS_IN_A_ROW: u32 = 1024;
/// Points along the curve whose shadows are found together.
const POINTS_IN_A_GROUP: usize = 64;
/// Cells along an edge of the grid whose Z-order curve points are sorted along.
const CURVE_STEPS: f32 = (1 << 20) as f32;

/// Direct light for the irradiance on surfaces.
pub(super) fn direct_light<'a>(inputs: &FrameInputs<'a>, light: &mut LightStages) -> DirectLight<'a> {
    let FrameInputs { prepared, options, progress, .. } = *inputs;
    DirectLight::new(inputs.light, light, &prepared.tracer, options.visibility, progress)
}

/// Direct light at the end points of paths.
pub(super) struct EndLight<'a> {
    materials: &'a Materials,
    diffuse: DirectLight<'a>,
    /// Where a path ends on a glossy receiver.
    glossy: Option<GlossyLight<'a>>,
}

impl<'a> EndLight<'a> {
    pub fn new(inputs: &FrameInputs<'a>, stages: &mut LightStages, points: &[EndPoint]) -> Self {
        let FrameInputs { light, prepared, options, progress, .. } = *inputs;
        let materials = &*prepared.materials.receivers;
        let diffuse = direct_light(inputs, stages);
        let glossy = points
            .iter()
            .any(|p| is_glossy(materials, p))
            .then(|| GlossyLight::new(light, stages, &prepared.tracer, options.visibility, progress));
        Self { materials, diffuse, glossy }
    }

    /// Irradiance or, on glossy receivers, the radiance reflected towards the viewers. `at_hits` is the irradiance where camera
    /// rays hit, which is interpolated where the reprojection finds a point.
    pub fn at(&self, points: &[EndPoint], reprojection: &Reprojection, at_hits: &[Vec3]) -> Vec<Vec3> {
        let known = |(index, point): (usize, &EndPoint)| match &self.glossy {
            Some(light) if is_glossy(self.materials, point) => {
                Some(light.reflected(self.materials, &point.hit, point.view))
            }
            _ => reprojection.light(index, |hit| at_hits[hit]),
        };
        let known: Vec<Option<Vec3>> = points.par_iter().enumerate().map(known).collect();
        let mut unknown: Vec<usize> = (0..points.len()).filter(|&index| known[index].is_none()).collect();
        sort_along_curve(&mut unknown, points);
        let of_group = |group: &[usize]| {
            let hits: Vec<&Hit> = group.iter().map(|&index| &points[index].hit).collect();
            self.diffuse.irradiance(&hits)
        };
        let computed: Vec<Vec3> = unknown.par_chunks(POINTS_IN_A_GROUP).flat_map_iter(of_group).collect();
        let mut light: Vec<Vec3> = known.into_iter().map(Option::unwrap_or_default).collect();
        unknown.into_iter().zip(computed).for_each(|(index, irradiance)| light[index] = irradiance);
        light
    }
}

fn is_glossy(materials: &Materials, point: &EndPoint) -> bool {
    point.receives && materials.is_glossy(point.hit.object)
}

/// The caustic at the end points of paths: irradiance or, on glossy receivers, the radiance reflected towards the
/// viewers. Where the camera sees the same surface, what is known there is interpolated.
pub(super) async fn caustic_at(
    inputs: &FrameInputs<'_>,
    sum: &Arc<dyn Sum>,
    points: &[EndPoint],
    rays: &CameraRays,
    at_hits: Option<&Vec<[f32; 4]>>,
) -> Result<Vec<[f32; 4]>, Error> {
    let is_known = |object| at_hits.is_some() && inputs.knows_caustic(object);
    let reprojection = Reprojection::new(rays, points, is_known);
    let at_hit = |hit: usize| at_hits.map_or(Vec3::ZERO, |sums| Vec3::from_slice(&sums[hit]));
    let materials = &inputs.prepared.materials.receivers;
    let mut sums = vec![[0.0; 4]; points.len()];
    let (mut diffuse, mut glossy) = (Vec::new(), Vec::new());
    for (index, point) in points.iter().enumerate().filter(|(_, point)| point.receives) {
        if is_glossy(materials, point) {
            glossy.push(index);
        } else if let Some(light) = reprojection.light(index, at_hit) {
            sums[index] = light.extend(0.0).to_array();
        } else {
            diffuse.push(index);
        }
    }
    inputs.progress.advance((points.len() - diffuse.len() - glossy.len()) as u64);
    for (mut which, reflects) in [(diffuse, false), (glossy, true)] {
        if which.is_empty() {
            continue;
        }
        sort_along_curve(&mut which, points);
        let receivers = receivers_at(points, &which, reflects.then_some(materials));
        for (index, computed) in which.into_iter().zip(sum.irradiance(&receivers, inputs.progress).await?) {
            sums[index] = computed;
        }
    }
    Ok(sums)
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
