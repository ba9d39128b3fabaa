//! Surfaces that a light's view shows, as images of depths and normals, and how rays find them there: the papers' way, which knows only what
//! the light sees (Wyman and Davis 2006, Section 3.1; Wyman 2005, *An Approximate Image-Space Approach for Interactive Refraction*; in
//! images of their own: Wyman and Nichols 2009, Section 3.1).
//!
//! They show the surfaces that photons meet first; the farthest surfaces of each closed object, where photons leave it, and where there are
//! several objects, their nearest ones, where photons enter the next (Section 3.1.1); and the receivers alone, from where the light sees all of
//! them. Rays are marched through an image until they pass behind its surface, and the place is found
//! by a secant search. Knows neither photons nor maps.

use glam::{DVec2, DVec3, Vec3};

use super::constants::{IMAGE_SEARCH_STEPS, MAX_IMAGE_MISS, MAX_IMAGE_STEPS, MIN_IMAGE_STEPS, SAME_SURFACE_COSINE};
use super::projection::Projection;
use crate::parallel;
use crate::scene::Ray;
use crate::tracing::Hit;

/// No surface.
const NOTHING: u32 = u32::MAX;

/// A surface in the middle of a texel.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shown {
    /// Along the view axis, metres.
    depth: f64,
    object: u32,
    /// Interpolated and of the triangle, towards where the rays of the image come from.
    normals: [DVec3; 2],
    front: bool,
}

const NOTHING_SHOWN: Shown = Shown { depth: 0.0, object: NOTHING, normals: [DVec3::ZERO; 2], front: false };

/// The nearest or the farthest surfaces in a view.
#[derive(Clone, Debug)]
pub struct SurfaceImage {
    projection: Projection,
    texels: Vec<Shown>,
}

impl SurfaceImage {
    /// Of what rays meet.
    pub fn new(projection: Projection, meets: impl Fn(Ray) -> Option<Hit> + Sync) -> Self {
        let width = projection.size[0] as usize;
        let texel = |index: usize| {
            let place = DVec2::new((index % width) as f64, (index / width) as f64) + 0.5;
            meets(projection.ray(place)).map_or(NOTHING_SHOWN, |hit| Shown {
                depth: projection.depth(hit.position),
                object: hit.object,
                normals: [hit.normal, hit.face_normal].map(Vec3::as_dvec3),
                front: hit.front,
            })
        };
        Self { projection, texels: parallel::collect(projection.texel_count(), &texel) }
    }

    /// The surface at a place, given as parts of the image's width and height.
    pub fn at(&self, part: DVec2) -> Option<Hit> {
        let place = part * DVec2::from_array(self.projection.size.map(f64::from));
        let shown = self.shown(place, |_| true)?;
        let ray = self.projection.ray(place);
        let position = self.projection.point_at(place, shown.depth);
        Some(hit(&ray, position, &shown))
    }

    /// What a ray meets before an end, metres, of the objects that are wanted. Outside of a closed object its ray has left it: with
    /// `is_within`, the last place inside counts.
    pub fn search(&self, ray: &Ray, end: f64, is_wanted: impl Fn(u32) -> bool + Copy, is_within: bool) -> Option<Hit> {
        let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let gap = |distance: f64| {
            let point = (origin + distance * direction).as_vec3();
            let shown = self.shown(self.projection.project(point)?, is_wanted)?;
            Some((self.projection.depth(point) - shown.depth, shown))
        };
        let place = |distance: f64| self.projection.project((origin + distance * direction).as_vec3());
        let across = place(0.0).zip(place(end)).map_or(f64::INFINITY, |(from, to)| from.distance(to));
        let count = across.clamp(MIN_IMAGE_STEPS.into(), MAX_IMAGE_STEPS.into()).ceil();
        let mut before: Option<f64> = None;
        for step in 0..=count as u32 {
            let distance = end * f64::from(step) / count;
            match gap(distance) {
                Some((gap, _)) if gap < 0.0 => before = Some(distance),
                None if !is_within => before = None,
                passed => {
                    if let Some(near) = before.take()
                        && let Some((distance, shown)) = refined(gap, near, distance, passed.map(|(gap, _)| gap))
                        && let Some(found) = self.on_plane(ray, distance, &shown)
                    {
                        return Some(found);
                    }
                }
            }
        }
        None
    }

    /// The place where a ray meets the plane of a surface that it is near; `None` if that is somewhere else.
    fn on_plane(&self, ray: &Ray, distance: f64, shown: &Shown) -> Option<Hit> {
        let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let place = self.projection.project((origin + distance * direction).as_vec3())?;
        let point = self.projection.point_at(place, shown.depth).as_dvec3();
        let facing = direction.dot(shown.normals[1]);
        // Along surfaces, planes are met anywhere.
        let exact = if facing.abs() > 0.05 { (point - origin).dot(shown.normals[1]) / facing } else { distance };
        let position = (origin + exact * direction).as_vec3();
        let is_near = self.projection.project(position)?.distance(place) <= f64::from(MAX_IMAGE_MISS);
        let depth_apart = (self.projection.depth(position) - shown.depth).abs();
        let texel = self.projection.texel * if self.projection.is_parallel { 1.0 } else { shown.depth };
        let slope = 1.0 / shown.normals[1].dot(self.projection.axes[2]).abs().max(0.05);
        (is_near && depth_apart <= 2.0 * f64::from(MAX_IMAGE_MISS) * texel * slope)
            .then(|| Hit { distance: exact as f32, ..hit(ray, position, shown) })
    }

    /// Depth and normals at a place, bilinear between the texels of the nearest one's surface.
    fn shown(&self, place: DVec2, is_wanted: impl Fn(u32) -> bool) -> Option<Shown> {
        let nearest = self.texels[self.projection.index(place)?];
        if nearest.object == NOTHING || !is_wanted(nearest.object) {
            return None;
        }
        let low = (place - 0.5).floor();
        let part = place - 0.5 - low;
        let mut sum = Shown { depth: 0.0, normals: [DVec3::ZERO; 2], ..nearest };
        let mut weights = 0.0;
        for (offset, weight) in [
            (DVec2::ZERO, (1.0 - part.x) * (1.0 - part.y)),
            (DVec2::X, part.x * (1.0 - part.y)),
            (DVec2::Y, (1.0 - part.x) * part.y),
            (DVec2::ONE, part.x * part.y),
        ] {
            let Some(index) = self.projection.index(low + offset + 0.5) else { continue };
            let texel = &self.texels[index];
            let is_same = texel.object == nearest.object
                && texel.front == nearest.front
                && texel.normals[0].dot(nearest.normals[0]) >= f64::from(SAME_SURFACE_COSINE);
            if is_same {
                sum.depth += weight * texel.depth;
                sum.normals = [0, 1].map(|k| sum.normals[k] + weight * texel.normals[k]);
                weights += weight;
            }
        }
        if weights < 1e-6 {
            return Some(nearest);
        }
        Some(Shown { depth: sum.depth / weights, normals: sum.normals.map(DVec3::normalize), ..sum })
    }
}

/// The place between two where a gap closes, and the surface there. Where nothing is shown at the far one, it lies beyond.
fn refined(
    gap: impl Fn(f64) -> Option<(f64, Shown)>,
    near: f64,
    far: f64,
    far_gap: Option<f64>,
) -> Option<(f64, Shown)> {
    let (mut near, mut far, mut far_gap) = (near, far, far_gap);
    let (mut near_gap, mut shown) = gap(near)?;
    for _ in 0..IMAGE_SEARCH_STEPS {
        // A secant step, kept off the ends so that the interval shrinks.
        let part = far_gap.map_or(0.5, |far_gap| (near_gap / (near_gap - far_gap)).clamp(0.1, 0.9));
        let middle = near + part * (far - near);
        match gap(middle) {
            Some((between, here)) if between < 0.0 => (near, near_gap, shown) = (middle, between, here),
            Some((between, here)) => (far, far_gap, shown) = (middle, Some(between), here),
            None => (far, far_gap) = (middle, None),
        }
    }
    Some((near, shown))
}

fn hit(ray: &Ray, position: Vec3, shown: &Shown) -> Hit {
    // Towards the ray's origin.
    let [normal, face_normal] = shown.normals.map(|normal| {
        let normal = normal.as_vec3();
        if normal.dot(ray.direction) > 0.0 { -normal } else { normal }
    });
    let is_turned = shown.normals[1].as_vec3().dot(ray.direction) > 0.0;
    Hit {
        object: shown.object,
        position,
        distance: position.distance(ray.origin),
        normal,
        face_normal,
        front: shown.front != is_turned,
    }
}

/// What photons of a light's view meet, in images.
#[derive(Clone, Debug)]
pub struct SurfaceImages {
    /// What the light sees.
    pub first: SurfaceImage,
    /// The farthest surfaces of each closed object.
    pub last: Vec<(u32, SurfaceImage)>,
    /// The nearest surfaces of each closed object, if there are several.
    pub entries: Vec<(u32, SurfaceImage)>,
    /// Receivers, which may be all around a lamp.
    pub receivers: Vec<SurfaceImage>,
    /// From one end of the scene to the other, metres.
    pub diagonal: f64,
}

impl SurfaceImages {
    /// Where a photon that has entered a closed object leaves it.
    pub fn exit(&self, ray: &Ray, object: u32) -> Option<Hit> {
        let (_, image) = self.last.iter().find(|(of, _)| *of == object)?;
        image.search(ray, self.diagonal, |_| true, true)
    }

    /// The closed object that a photon enters next, which has left one.
    pub fn entry(&self, ray: &Ray, left: u32) -> Option<Hit> {
        let others = self.entries.iter().filter(|(of, _)| *of != left);
        let found = others.filter_map(|(_, image)| image.search(ray, self.diagonal, |_| true, false));
        found.min_by(|a, b| a.distance.total_cmp(&b.distance))
    }

    /// The receiver that a photon meets.
    pub fn landing(&self, ray: &Ray) -> Option<Hit> {
        let found = self.receivers.iter().filter_map(|image| image.search(ray, self.diagonal, |_| true, false));
        found.min_by(|a, b| a.distance.total_cmp(&b.distance))
    }
}
