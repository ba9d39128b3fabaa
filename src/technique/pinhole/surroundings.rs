//! Renders what mirrors see of surfaces in the light of lamps and near emitters: views from some of the samples, as many as keep every sample near to a
//! viewpoint, compared with the distance of the nearest surface.

use glam::Vec3;
use rayon::prelude::*;

use crate::environment::{CubeMap, FACES, emitter_from, face_direction};
use crate::pinhole::constants::MAX_VIEWPOINTS;
use crate::pinhole::{PinholeSample, SurroundingView, Surroundings};
use crate::scene::{Medium, Mesh, Object, Ray, Scene, Sides, Visibility};
use crate::stages::{DirectNearLight, NearEmitter};
use crate::technique::Inputs;
use crate::tracing::{Hit, SeenBy, Tracer};

/// Texels along the edge of a view's faces, and the most views. Measured in `colours` with 1, 4, 16 and 64 views: errors of .119, .061,
/// .048 and .045. A view has 1 MB.
const OF_PICTURE: (u32, usize) = (64, MAX_VIEWPOINTS as usize);
/// The same in previews.
const OF_PREVIEW: (u32, usize) = (32, 4);
/// There are viewpoints enough if no sample is farther from one than this part of the distance to the nearest surface.
const NEAR_ENOUGH: f32 = 0.1;
/// Viewpoints lie this far before the mirror, as a part of the extent of all samples, so that they do not see the surface that they lie on.
const OFFSET: f32 = 1e-4;

/// Cosines at which planes are met, at least.
const MIN_COSINE: f32 = 1e-3;

/// What is seen in a direction; zero if that is nothing.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    radiance: Vec3,
    /// As in [`SurroundingView`].
    plane: Vec3,
    /// One over the distance.
    nearness: f32,
}

/// The scene as it is seen by mirrors.
struct Viewer<'a> {
    scene: &'a Scene,
    light: DirectNearLight<'a>,
    /// What receives light: mirrors alone show none of their own.
    surfaces: &'a Tracer,
    /// Between surfaces and mirrors.
    medium: Option<Medium>,
    size: u32,
}

/// What mirrors can show: everything that receives light, but for mirrors on both sides, whose back would show the light on their front.
pub(super) fn lit_surfaces(scene: &Scene) -> Tracer {
    let is_shown = |object: &Object| {
        object.receiver.is_some() && object.reflector.is_none_or(|reflector| reflector.sides != Sides::Both)
    };
    let meshes: Vec<(Mesh, SeenBy)> =
        scene.objects.iter().map(|object| (object.mesh_in_world(), SeenBy::all_but_camera(is_shown(object)))).collect();
    Tracer::of_meshes(meshes.iter().map(|(mesh, seen_by)| (mesh, *seen_by)))
}

/// What the samples see in the light of lamps and near emitters; `None` if that is nothing.
pub(super) fn surroundings(inputs: &Inputs, surfaces: &Tracer, samples: &[PinholeSample]) -> Option<Surroundings> {
    let Inputs { scene, prepared, light, options, .. } = *inputs;
    let is_lit = scene.objects.iter().any(|o| o.receiver.as_ref().is_some_and(|r| r.albedo != Vec3::ZERO));
    if samples.is_empty() || !light.has_near_light() || !is_lit {
        return None;
    }
    let (size, max_views) = if inputs.is_preview { OF_PREVIEW } else { OF_PICTURE };
    let occluder = (options.visibility == Visibility::Full).then_some(&*prepared.tracer);
    let medium = scene.medium.filter(|_| scene.has_medium_everywhere());
    let viewer = Viewer { scene, light: DirectNearLight::coarse(light, occluder), surfaces, medium, size };
    Some(from_viewpoints(samples, max_views, |viewpoint| viewer.view(viewpoint)))
}

/// Views from so many viewpoints as keep every sample near to one, compared with the distance of the nearest surface that is seen.
fn from_viewpoints(
    samples: &[PinholeSample],
    max_views: usize,
    view: impl Fn(Vec3) -> SurroundingView,
) -> Surroundings {
    let extent = samples.iter().map(|s| s.position().distance(samples[0].position())).fold(0.0, f32::max);
    let viewpoint = |sample: &PinholeSample| sample.position() + OFFSET * extent * sample.normal();
    // The sample that is farthest from all viewpoints gets the next one.
    let mut distances = vec![f32::INFINITY; samples.len()];
    let mut next = 0;
    let mut views: Vec<SurroundingView> = Vec::new();
    loop {
        views.push(view(viewpoint(&samples[next])));
        let new = samples[next].position();
        distances.iter_mut().zip(samples).for_each(|(d, sample)| *d = d.min(sample.position().distance(new)));
        next = (0..samples.len()).max_by(|a, b| distances[*a].total_cmp(&distances[*b])).unwrap_or(0);
        let max_nearness = views.iter().map(|view| view.max_nearness).fold(0.0, f32::max);
        if views.len() == max_views || distances[next] * max_nearness <= NEAR_ENOUGH {
            return Surroundings { views };
        }
    }
}

/// What the samples see of a near emitter, whose radiance is scaled by a factor.
pub(super) fn views_of_emitter(
    inputs: &Inputs,
    (emitter, factor): (&NearEmitter, f32),
    samples: &[PinholeSample],
) -> Surroundings {
    let (size, max_views) = if inputs.is_preview { OF_PREVIEW } else { OF_PICTURE };
    let medium = inputs.scene.medium.filter(|_| inputs.scene.has_medium_everywhere());
    let view = |viewpoint: Vec3| {
        let (plane, nearest) = (emitter.plane_from(viewpoint), emitter.distance_from(viewpoint));
        let passed = medium.map_or(Vec3::ONE, |medium| medium.transmittance(nearest));
        let radiance = emitter_from(&emitter.mesh, factor * passed * emitter.radiance, viewpoint, size);
        let planes = CubeMap::from_texels(size, &vec![plane; FACES * (size * size) as usize], false);
        SurroundingView::new(viewpoint, radiance, planes, 1.0 / nearest)
    };
    from_viewpoints(samples, max_views, view)
}

impl Viewer<'_> {
    fn view(&self, viewpoint: Vec3) -> SurroundingView {
        let texels: Vec<Vec3> = (0..FACES).flat_map(|face| self.directions(face)).collect();
        let seen: Vec<Seen> = texels.par_iter().map(|direction| self.seen(viewpoint, *direction)).collect();
        let cube = |of: fn(&Seen) -> Vec3, mips: bool| {
            CubeMap::from_texels(self.size, &seen.iter().map(of).collect::<Vec<_>>(), mips)
        };
        let max_nearness = seen.iter().map(|seen| seen.nearness).fold(0.0, f32::max);
        SurroundingView::new(viewpoint, cube(|seen| seen.radiance, true), cube(|seen| seen.plane, false), max_nearness)
    }

    /// The unit directions of the middles of a face's texels, row by row.
    fn directions(&self, face: usize) -> impl Iterator<Item = Vec3> + use<> {
        let size = self.size;
        let at = move |k: u32| (2 * k + 1) as f32 / size as f32 - 1.0;
        let direction = move |k: u32| face_direction(face, at(k % size), at(k / size)).normalize();
        (0..size * size).map(direction)
    }

    /// What is seen from a point in a unit direction.
    fn seen(&self, from: Vec3, direction: Vec3) -> Seen {
        let Some(hit) = self.surfaces.secondary_hit(Ray { origin: from, direction }) else { return Seen::default() };
        let nearness = 1.0 / hit.distance;
        // At grazing angles a plane passes the point too closely to say where others see it.
        let approach = (-hit.face_normal.dot(direction)).max(MIN_COSINE);
        let passed = self.medium.map_or(Vec3::ONE, |medium| medium.transmittance(hit.distance));
        Seen { radiance: passed * self.radiance(&hit), plane: -hit.face_normal * (nearness / approach), nearness }
    }

    fn radiance(&self, hit: &Hit) -> Vec3 {
        let albedo = self.scene.objects[hit.object as usize].receiver.as_ref().map_or(Vec3::ZERO, |r| r.albedo);
        albedo * std::f32::consts::FRAC_1_PI * self.light.irradiance(hit)
    }
}
