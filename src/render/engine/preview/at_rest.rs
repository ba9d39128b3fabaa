//! The light on surfaces in the last whole picture, for previews in which only the camera has moved since: light on diffuse surfaces does
//! not depend on who looks at it. Knows neither techniques nor how previews find light elsewhere.

use std::sync::{Arc, OnceLock};

use glam::{Vec2, Vec3};

use crate::engine::paths::Paths;
use crate::engine::shading::SurfaceLight;
use crate::options::{DisplaySettings, Options, Overlay};
use crate::pinhole::constants::{MAX_PIXELS_APART, MIN_SEEN_COSINE};
use crate::sampling::PointTree;
use crate::scene::Scene;
use crate::stages::CameraRays;
use crate::tracing::Hit;

/// Of the four pixels around a place, those that see its surface have at least this weight, if the light there is known.
const MIN_SEEN_WEIGHT: f32 = 0.25;
/// Light is the mean over so many ends of paths.
const NEAREST_ENDS: usize = 4;

/// Light that was found while everything was at rest.
#[derive(Debug)]
pub struct LightAtRest {
    scene: Scene,
    /// Without what does not matter to the light.
    options: Options,
    rays: Arc<CameraRays>,
    light: SurfaceLight,
    ends: LightAtEnds,
    /// By object: whether its irradiance is known.
    is_known: Vec<bool>,
}

/// Light at the ends of paths via mirrors and interfaces.
#[derive(Debug)]
struct LightAtEnds {
    paths: Arc<Paths>,
    light: SurfaceLight,
    /// Of the ends' positions, once it is asked for.
    tree: OnceLock<PointTree>,
}

impl LightAtRest {
    /// The light where the camera rays of a beauty picture hit, and at the ends of its paths, for an environment of intensity 1.
    pub fn new(
        (scene, options): (&Scene, &Options),
        (rays, light): (&Arc<CameraRays>, &SurfaceLight),
        (paths, ends): &(Arc<Paths>, SurfaceLight),
        is_known: Vec<bool>,
    ) -> Self {
        let ends = LightAtEnds { paths: paths.clone(), light: ends.clone(), tree: OnceLock::new() };
        Self {
            scene: scene.clone(),
            options: of_light(options),
            rays: rays.clone(),
            light: light.clone(),
            ends,
            is_known,
        }
    }

    /// Whether a scene and its options have the same light, but for the number of samples and the error that were allowed in a draft.
    pub fn is_that_of(&self, scene: &Scene, options: &Options) -> bool {
        let mut seen_from_there = self.scene.clone();
        seen_from_there.camera = scene.camera;
        let is_of = |options: &Options| of_light(options) == self.options;
        seen_from_there == *scene && (is_of(options) || options.coarse_to_fine().iter().any(is_of))
    }

    /// The light at points of surfaces, as far as the camera saw them there.
    pub fn seen(&self, caustic_gain: f32) -> impl Fn(&Hit) -> Option<Vec3> + Sync {
        let view = &self.rays.view;
        let size = Vec2::new(view.size[0] as f32, view.size[1] as f32);
        let per_edge = view.pixel_samples as f32;
        let (projected, pixel_height) = (view.camera.projected(size), view.camera.pixel_heights(size.y));
        let (width, height) = (self.rays.width as usize, self.rays.hits.len() / self.rays.width.max(1) as usize);
        move |hit| {
            if !self.is_known[hit.object as usize] {
                return None;
            }
            let (pixel, depth) = projected(hit.position);
            let at = per_edge * pixel - 0.5;
            let last = Vec2::new(width as f32 - 1.0, height as f32 - 1.0);
            if depth <= 0.0 || at.cmplt(Vec2::ZERO).any() || !at.cmplt(last).all() {
                return None;
            }
            let (first, part) = (at.y as usize * width + at.x as usize, at.fract());
            let most_apart = MAX_PIXELS_APART * pixel_height(depth) / per_edge;
            let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
            for (index, weight) in [
                (first, (1.0 - part.x) * (1.0 - part.y)),
                (first + 1, part.x * (1.0 - part.y)),
                (first + width, (1.0 - part.x) * part.y),
                (first + width + 1, part.x * part.y),
            ] {
                let is_near = |seen: &Hit| seen.position.distance(hit.position) <= most_apart && lie_on_same(seen, hit);
                if self.rays.hits[index].as_ref().is_some_and(is_near) {
                    let light = self.light.direct_at(index) + caustic_gain * self.light.caustic_at(index);
                    (sum, weights) = (sum + weight * light, weights + weight);
                }
            }
            (weights > MIN_SEEN_WEIGHT).then(|| sum / weights)
        }
    }

    /// The light at a point that is seen in a mirror or behind an interface, as far as it was seen so before.
    pub fn seen_on_paths(&self, hit: &Hit, caustic_gain: f32) -> Option<Vec3> {
        let LightAtEnds { paths, light, tree } = &self.ends;
        if paths.ends.is_empty() || !self.is_known[hit.object as usize] {
            return None;
        }
        let tree = tree.get_or_init(|| PointTree::of_positions(paths.ends.iter().map(|end| end.hit.position)));
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
        for (distance2, index) in tree.nearest(hit.position, NEAREST_ENDS) {
            let end = &paths.ends[index];
            let spacing2 = end.steps.iter().map(|step| step.length_squared()).fold(0.0, f32::max);
            if distance2 <= spacing2 && lie_on_same(&end.hit, hit) {
                let weight = 1.0 / (distance2 + 0.1 * spacing2);
                sum += weight * (light.direct_at(index) + caustic_gain * light.caustic_at(index));
                weights += weight;
            }
        }
        (weights > 0.0).then(|| sum / weights)
    }
}

/// Whether two hits lie on the same side of a smooth surface.
fn lie_on_same(one: &Hit, other: &Hit) -> bool {
    one.object == other.object && one.front == other.front && one.normal.dot(other.normal) >= MIN_SEEN_COSINE
}

/// Options without what the light on surfaces does not depend on.
fn of_light(options: &Options) -> Options {
    let mut options = options.clone().with_size([1; 2]).with_pixel_samples(1).with_aovs(Vec::new());
    options = options.with_overlay(Overlay::None).with_caustic_gain(1.0);
    options.display = DisplaySettings::default();
    options
}
