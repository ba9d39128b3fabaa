//! Renders what mirrors see of surfaces in the light of lamps and near emitters: views from some of the samples, as many as keep every sample near to a
//! viewpoint, compared with the distance of the nearest surface.

use std::sync::Arc;

use glam::Vec3;

use crate::environment::{CubeMap, FACES, emitter_from, face_direction};
use crate::parallel;
use crate::pinhole::constants::MAX_VIEWPOINTS;
use crate::pinhole::{PinholeSample, SurroundingView, Surroundings, Viewpoint};
use crate::scene::{Lamp, Medium, Mesh, Object, Ray, Scene, Sides, Visibility};
use crate::stages::{DirectNearLight, NearEmitter, PreparedLight};
use crate::technique::Inputs;
use crate::tracing::{Hit, SeenBy, Tracer};

/// Texels along the edge of a view's faces, and the most views. Measured in `colours` with 1, 4, 16 and 64 views: errors of .119, .061,
/// .048 and .045. A view has 1 MB.
const OF_PICTURE: Budget = Budget { size: 64, max_views: MAX_VIEWPOINTS as usize, largest: 512 };
/// The same in previews.
const OF_PREVIEW: Budget = Budget { size: 32, max_views: 4, largest: 128 };
/// Texels across a small emitter, if the budget allows for it.
const ACROSS_EMITTER: f32 = 16.0;
/// There are viewpoints enough if no sample is farther from one than this part of the distance to the nearest surface.
const NEAR_ENOUGH: f32 = 0.1;
/// Viewpoints lie this far before the mirror, as a part of the extent of all samples, so that they do not see the surface that they lie on.
const OFFSET: f32 = 1e-4;

/// Cosines at which planes are met, at least.
const MIN_COSINE: f32 = 1e-3;

/// How large views may be, and how many.
#[derive(Clone, Copy)]
struct Budget {
    /// Texels along the edge of the faces.
    size: u32,
    max_views: usize,
    /// Texels along the edge of the faces of views of small emitters.
    largest: u32,
}

impl Budget {
    fn of(is_preview: bool) -> Self {
        if is_preview { OF_PREVIEW } else { OF_PICTURE }
    }

    /// The size of so many views of something whose angular radius has this sine: larger than usual if it is small and views are few.
    fn size_for(&self, views: usize, sine: f32) -> u32 {
        let mut size = self.size;
        let has_room = |size: u32| size < self.largest && views * (size * size) as usize * 4 <= self.texels();
        while has_room(size) && sine * (size as f32) < ACROSS_EMITTER {
            size *= 2;
        }
        size
    }

    /// Texels of a face of all views together.
    fn texels(&self) -> usize {
        (self.max_views * (self.size * self.size) as usize).max((self.largest * self.largest) as usize)
    }
}

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
    let meshes: Vec<(Mesh, SeenBy)> =
        scene.objects.iter().map(|object| (object.mesh_in_world(), SeenBy::all_but_camera(is_shown(object)))).collect();
    Tracer::of_meshes(meshes.iter().map(|(mesh, seen_by)| (mesh, *seen_by)))
}

fn is_shown(object: &Object) -> bool {
    object.receiver.is_some() && object.reflector.is_none_or(|reflector| reflector.sides != Sides::Both)
}

/// What the samples see in the light of lamps and near emitters; `None` if that is nothing.
pub(super) fn surroundings(inputs: &Inputs, surfaces: &Tracer, samples: &[PinholeSample]) -> Option<Surroundings> {
    let Inputs { scene, prepared, light, options, .. } = *inputs;
    let is_lit = scene.objects.iter().any(|o| o.receiver.as_ref().is_some_and(|r| r.albedo != Vec3::ZERO));
    if samples.is_empty() || !light.has_near_light() || !is_lit {
        return None;
    }
    let Budget { size, max_views, .. } = Budget::of(inputs.is_preview);
    let occluder = (options.visibility == Visibility::Full).then_some(&*prepared.tracer);
    let medium = scene.medium.filter(|_| scene.has_medium_everywhere());
    let viewer = Viewer { scene, light: DirectNearLight::coarse(light, occluder), surfaces, medium, size };
    // Mirrors that show lit mirrors may show themselves, of which each side shows something else.
    let shows_mirrors = scene.objects.iter().any(|object| object.reflector.is_some() && is_shown(object));
    let views = from_viewpoints(samples, (max_views, shows_mirrors), |viewpoint| {
        let view = viewer.view(viewpoint);
        (view.max_nearness, view)
    });
    Some(Surroundings { views })
}

/// What is seen from so many viewpoints as keep every sample near to one, compared with the distance of the nearest surface. `see` says what
/// that is, after one over this distance. Where sides matter, samples are near only to viewpoints on their own.
fn from_viewpoints<T>(
    samples: &[PinholeSample],
    (max_views, sides_matter): (usize, bool),
    see: impl Fn(Viewpoint) -> (f32, T),
) -> Vec<T> {
    let extent = samples.iter().map(|s| s.position().distance(samples[0].position())).fold(0.0, f32::max);
    let viewpoint = |sample: &PinholeSample| Viewpoint {
        position: sample.position() + OFFSET * extent * sample.normal(),
        normal: if sides_matter { sample.normal() } else { Vec3::ZERO },
    };
    // The sample that is farthest from all viewpoints gets the next one.
    let mut distances = vec![f32::INFINITY; samples.len()];
    let (mut next, mut max_nearness) = (0, 0.0f32);
    let mut all = Vec::new();
    loop {
        let new = viewpoint(&samples[next]);
        let (nearness, seen) = see(new);
        max_nearness = max_nearness.max(nearness);
        all.push(seen);
        let distance = |sample: &PinholeSample| new.distance_squared(sample.position(), sample.normal()).sqrt();
        distances.iter_mut().zip(samples).for_each(|(d, sample)| *d = d.min(distance(sample)));
        next = (0..samples.len()).max_by(|a, b| distances[*a].total_cmp(&distances[*b])).unwrap_or(0);
        if all.len() == max_views || distances[next] * max_nearness <= NEAR_ENOUGH {
            return all;
        }
    }
}

/// What samples see of near emitters: lamps in place of those that look alike, and views of the other ones.
pub(super) fn emitters_seen(
    scene: &Scene,
    light: &PreparedLight,
    samples: &[PinholeSample],
    is_preview: bool,
) -> (Vec<Lamp>, Vec<Arc<Surroundings>>) {
    let positions: Vec<Vec3> = samples.iter().map(PinholeSample::position).collect();
    let (mut lamps, mut views) = (Vec::new(), Vec::new());
    for (near, factor) in light.near_emitters.iter().filter(|_| !samples.is_empty()) {
        for emitter in &near.emitters {
            match emitter.as_lamp(*factor, &positions) {
                Some(lamp) => lamps.push(lamp),
                None => views.push(Arc::new(views_of_emitter(scene, (emitter, *factor), samples, is_preview))),
            }
        }
    }
    (lamps, views)
}

/// What the samples see of an emitter, whose radiance is scaled by a factor.
fn views_of_emitter(
    scene: &Scene,
    (emitter, factor): (&NearEmitter, f32),
    samples: &[PinholeSample],
    is_preview: bool,
) -> Surroundings {
    let budget = Budget::of(is_preview);
    let viewpoints = from_viewpoints(samples, (budget.max_views, false), |viewpoint| {
        let nearness = 1.0 / emitter.distance_from(viewpoint.position);
        (nearness, (viewpoint, nearness))
    });
    let sine =
        viewpoints.iter().map(|(viewpoint, _)| emitter.angular_sine(viewpoint.position)).fold(f32::INFINITY, f32::min);
    let size = budget.size_for(viewpoints.len(), sine);
    let medium = scene.medium.filter(|_| scene.has_medium_everywhere());
    let view = |(viewpoint, nearness): (Viewpoint, f32)| {
        let passed = medium.map_or(Vec3::ONE, |medium| medium.transmittance(1.0 / nearness));
        let radiance = emitter_from(&emitter.mesh, factor * passed * emitter.radiance, viewpoint.position, size);
        // One texel a face is enough for a plane that is the same in all directions.
        let planes = CubeMap::from_texels(1, &[emitter.plane_from(viewpoint.position); FACES], false);
        SurroundingView::new(viewpoint, radiance, planes, nearness)
    };
    Surroundings { views: viewpoints.into_iter().map(view).collect() }
}

impl Viewer<'_> {
    fn view(&self, viewpoint: Viewpoint) -> SurroundingView {
        let texels: Vec<Vec3> = (0..FACES).flat_map(|face| self.directions(face)).collect();
        let seen: Vec<Seen> = parallel::map(&texels, &|direction| self.seen(viewpoint.position, *direction));
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
