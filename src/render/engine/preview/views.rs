//! What each pixel of a preview sees: a surface, what a mirror on it shows or lies behind an interface, or the environment. One ray a pixel:
//! it goes on through interfaces, which reflect the environment only.

use std::f32::consts::FRAC_1_PI;

use glam::{UVec2, Vec2, Vec3};

use super::edges::FirstSurface;
use super::filled;
use super::scattering::SeenMedium;
use crate::engine::paths::{mirrored_direction, surface_albedo, visible_reflectance};
use crate::lanes::{LANES, set_bits};
use crate::parallel;
use crate::pinhole::constants::{MAX_MIRRORS, MAX_PIXELS_APART, MIN_SEEN_COSINE};
use crate::scene::{Camera, Lamp, Ray, Refractor, Scene};
use crate::stages::{PreparedLight, PreparedScene, Refracted, divided};
use crate::tracing::Hit;

/// Edge of a packet of rays, pixels: squares are more coherent than rows.
const PACKET: usize = 4;

/// A lit point of a surface.
#[derive(Clone, Debug)]
pub struct SurfacePoint {
    pub hit: Hit,
    /// Whether it receives caustics.
    pub receives: bool,
    /// The camera sees it directly, and sees a lobe of its BRDF.
    pub is_glossy: bool,
    /// Factor on its irradiance, 1/sr; if it is glossy, on its radiance.
    pub factor: Vec3,
    /// Tells points from each other that are seen by way of different mirrors; 0 without a mirror.
    pub path: u64,
}

/// The environment at the end of a path.
#[derive(Clone, Debug)]
pub struct Escape {
    /// Unit direction in the world.
    pub direction: Vec3,
    /// Factor on its radiance.
    pub factor: Vec3,
    /// GGX width of the roughest mirror on the way.
    pub alpha: f32,
    /// As that of a surface point; 0 where the camera sees the environment directly.
    pub path: u64,
    /// Radiance of an emitter that the camera sees in front of the environment.
    pub emitted: Option<Vec3>,
}

/// Points of one kind, at most one in each pixel, in bands of rows of packets.
#[derive(Debug)]
pub struct Layer<T> {
    bands: Vec<Vec<T>>,
    /// By pixel: the number of its band, shifted by `bits`, and of its point in the band; or [`NO_POINT`].
    of_pixels: Vec<u32>,
    bits: u32,
}

/// The points of a band.
#[derive(Debug)]
struct BandLayer<T> {
    points: Vec<T>,
    /// By pixel: the number of its point, or [`NO_POINT`].
    of_pixels: Vec<u32>,
}

const NO_POINT: u32 = u32::MAX;

impl<T> BandLayer<T> {
    fn new(pixels: usize) -> Self {
        Self { points: Vec::new(), of_pixels: vec![NO_POINT; pixels] }
    }

    fn set(&mut self, pixel: usize, point: Option<T>) {
        if let Some(point) = point {
            self.of_pixels[pixel] = self.points.len() as u32;
            self.points.push(point);
        }
    }
}

impl<T: Send + Sync> Layer<T> {
    /// All bands but the last have the same number of pixels.
    fn of_bands(bands: Vec<BandLayer<T>>) -> Self {
        let pixels_of_band = bands.first().map_or(0, |band| band.of_pixels.len());
        let bits = (pixels_of_band as u32).next_power_of_two().trailing_zeros();
        let mut of_pixels = filled(NO_POINT, bands.iter().map(|band| band.of_pixels.len()).sum());
        parallel::for_each_chunk(&mut of_pixels, pixels_of_band.max(1), &|number, pixels| {
            let placed = |&point: &u32| if point == NO_POINT { NO_POINT } else { (number as u32) << bits | point };
            pixels.iter_mut().zip(&bands[number].of_pixels).for_each(|(pixel, point)| *pixel = placed(point));
        });
        Self { bands: bands.into_iter().map(|band| band.points).collect(), of_pixels, bits }
    }

    /// One point in each pixel.
    #[cfg(test)]
    pub fn of_points(points: impl IntoIterator<Item = T>) -> Self {
        let points: Vec<T> = points.into_iter().collect();
        let of_pixels = (0..points.len() as u32).collect();
        Self::of_bands(vec![BandLayer { points, of_pixels }])
    }

    #[inline]
    pub fn at(&self, pixel: usize) -> Option<&T> {
        let number = self.of_pixels[pixel];
        let point =
            |number: u32| &self.bands[(number >> self.bits) as usize][(number & !(u32::MAX << self.bits)) as usize];
        (number != NO_POINT).then(|| point(number))
    }

    pub fn pixels(&self) -> usize {
        self.of_pixels.len()
    }

    pub fn is_empty(&self) -> bool {
        self.bands.iter().all(Vec::is_empty)
    }
}

/// What all pixels see, row by row. A surface may mirror and be lit itself.
#[derive(Debug)]
pub struct Views {
    /// What the camera sees directly.
    pub surfaces: Layer<SurfacePoint>,
    /// What mirrors show.
    pub mirrored: Layer<SurfacePoint>,
    pub escapes: Layer<Escape>,
    /// What the camera sees first, by pixel.
    pub first: Vec<FirstSurface>,
    width: usize,
}

/// What a band of pixels sees.
struct BandViews {
    surfaces: BandLayer<SurfacePoint>,
    mirrored: BandLayer<SurfacePoint>,
    escapes: BandLayer<Escape>,
}

/// What one pixel sees.
#[derive(Default)]
struct PixelView {
    first: Option<Hit>,
    surface: Option<SurfacePoint>,
    mirrored: Option<SurfacePoint>,
    escape: Option<Escape>,
}

impl Views {
    /// Traces a picture of so many pixels; `is_plain` treats everything as diffuse.
    pub fn trace(
        (scene, light, medium): (&Scene, &PreparedLight, Option<SeenMedium>),
        prepared: &PreparedScene,
        size: [u32; 2],
        is_plain: bool,
    ) -> Self {
        let tracer = ViewTracer { scene, light, medium, prepared, is_plain };
        let rays = scene.camera.rays(UVec2::from_array(size).as_vec2());
        let [width, height] = size.map(|edge| edge as usize);
        let nothing = FirstSurface::of(&rays(Vec2::ZERO), None);
        let mut first = filled(nothing, width * height);
        let trace = |band: usize, first: &mut [FirstSurface]| tracer.band((width, PACKET * band), &rays, first);
        let bands = parallel::map_chunks_mut(&mut first, PACKET * width, &trace);
        let (mut surfaces, mut mirrored, mut escapes) = (Vec::new(), Vec::new(), Vec::new());
        for band in bands {
            surfaces.push(band.surfaces);
            mirrored.push(band.mirrored);
            escapes.push(band.escapes);
        }
        let [surfaces, mirrored] = [surfaces, mirrored].map(Layer::of_bands);
        Self { surfaces, mirrored, escapes: Layer::of_bands(escapes), first, width }
    }

    /// For a point of a surface, the pixel that sees the same place directly, if one does.
    pub fn pixels_of(&self, camera: &Camera) -> impl Fn(&Hit) -> Option<usize> + Sync {
        let (width, height) = (self.width, self.surfaces.pixels() / self.width);
        let size = Vec2::new(width as f32, height as f32);
        let (projected, pixel_height) = (camera.projected(size), camera.pixel_heights(size.y));
        move |hit| {
            let (at, depth) = projected(hit.position);
            if depth <= 0.0 || at.min_element() < 0.0 || at.x >= size.x || at.y >= size.y {
                return None;
            }
            let pixel = at.y as usize * width + at.x as usize;
            let point = self.surfaces.at(pixel)?;
            let seen = &point.hit;
            let is_near = seen.position.distance(hit.position) <= MAX_PIXELS_APART * pixel_height(depth);
            let is_same = seen.object == hit.object && seen.front == hit.front && !point.is_glossy;
            (is_near && is_same && seen.normal.dot(hit.normal) >= MIN_SEEN_COSINE).then_some(pixel)
        }
    }

    /// How far the direction in which a pixel's path leaves the scene turns from pixel to pixel, radians: the width of its footprint
    /// on the environment.
    pub fn footprint(&self, pixel: usize, escape: &Escape) -> f32 {
        let x = pixel % self.width;
        let left = (x > 0).then(|| pixel - 1);
        let right = (x + 1 < self.width).then_some(pixel + 1);
        let (above, below) = (pixel.checked_sub(self.width), Some(pixel + self.width));
        let turn = |other: Option<usize>| {
            let other = self.escapes.at(other.filter(|&other| other < self.escapes.pixels())?)?;
            (other.path == escape.path).then(|| other.direction.distance(escape.direction))
        };
        let nearest = |a, b| turn(a).into_iter().chain(turn(b)).reduce(f32::min);
        let turns = [nearest(left, right), nearest(above, below)];
        turns.into_iter().flatten().fold(0.0, f32::max)
    }
}

struct ViewTracer<'a> {
    scene: &'a Scene,
    light: &'a PreparedLight,
    medium: Option<SeenMedium>,
    prepared: &'a PreparedScene,
    is_plain: bool,
}

/// A ray on its way from mirror to mirror.
#[derive(Clone, Copy)]
struct Walk {
    ray: Ray,
    throughput: Vec3,
    alpha: f32,
    path: u64,
    is_in_medium: bool,
}

impl ViewTracer<'_> {
    /// A band of rows of packets; `first` takes what its pixels see first.
    fn band(&self, (width, top): (usize, usize), ray: &impl Fn(Vec2) -> Ray, first: &mut [FirstSurface]) -> BandViews {
        let (pixels, rows) = (first.len(), first.len() / width);
        let mut of_band = BandViews {
            surfaces: BandLayer::new(pixels),
            mirrored: BandLayer::new(pixels),
            escapes: BandLayer::new(pixels),
        };
        for left in (0..width).step_by(PACKET) {
            let place = |lane: usize| (left + lane % PACKET, lane / PACKET);
            let exists = |lane: &usize| place(*lane).0 < width && place(*lane).1 < rows;
            let rays = std::array::from_fn(|lane| {
                let (x, y) = place(lane);
                ray(Vec2::new(x as f32, (top + y) as f32) + 0.5)
            });
            let lanes = (0..LANES).filter(exists).fold(0, |bits, lane| bits | 1 << lane);
            let views = self.follow(&rays, lanes);
            for (lane, view) in views.into_iter().enumerate().filter(|(lane, _)| exists(lane)) {
                let (x, y) = place(lane);
                let pixel = y * width + x;
                of_band.surfaces.set(pixel, view.surface);
                of_band.mirrored.set(pixel, view.mirrored);
                of_band.escapes.set(pixel, view.escape);
                first[pixel] = FirstSurface::of(&rays[lane], view.first.as_ref());
            }
        }
        of_band
    }

    /// Follows a packet of rays via mirrors to their ends. Of the lit surfaces behind the first one, the first counts.
    fn follow(&self, rays: &[Ray; LANES], mut lanes: u32) -> [PixelView; LANES] {
        let mut views: [PixelView; LANES] = std::array::from_fn(|_| PixelView::default());
        let is_in_medium = self.medium.is_some_and(|seen| seen.starts_within);
        let mut walks = rays.map(|ray| Walk { ray, throughput: Vec3::ONE, alpha: 0.0, path: 0, is_in_medium });
        let mut hits = self.prepared.camera.hits(rays, lanes);
        views.iter_mut().zip(&hits).for_each(|(view, hit)| view.first = *hit);
        for mirror in 0..=MAX_MIRRORS {
            for lane in set_bits(lanes) {
                if !self.meet(hits[lane], &mut walks[lane], &mut views[lane]) {
                    lanes &= !(1 << lane);
                }
            }
            if lanes == 0 || mirror == MAX_MIRRORS {
                break;
            }
            hits = self.prepared.camera.secondary_hits(&walks.map(|walk| walk.ray), lanes);
        }
        views
    }

    /// What a ray meets. Returns whether a mirror sends it on.
    fn meet(&self, hit: Option<Hit>, walk: &mut Walk, view: &mut PixelView) -> bool {
        if let Some(radiance) = self.lamp_met(walk, hit.as_ref()) {
            let Walk { ray, throughput, alpha, path, .. } = *walk;
            let emitted = Some(radiance);
            view.escape = Some(Escape { direction: ray.direction, factor: throughput, alpha, path, emitted });
            return false;
        }
        walk.throughput *= self.passed(walk, hit.as_ref());
        let Walk { ray, throughput, alpha, path, .. } = *walk;
        let Some(found) = hit else {
            view.escape = Some(Escape { direction: ray.direction, factor: throughput, alpha, path, emitted: None });
            return false;
        };
        let object = &self.scene.objects[found.object as usize];
        if let Some(emitter) = object.emitter {
            let emitted = Some(self.light.of_emitters() * emitter.radiance);
            view.escape = Some(Escape { direction: ray.direction, factor: throughput, alpha, path, emitted });
            return false;
        }
        if let Some(refractor) = object.refractor.as_ref().filter(|_| !self.is_plain) {
            self.cross(&found, refractor, walk, view);
            return true;
        }
        let reflectance = visible_reflectance(self.prepared, self.is_plain, (&found, object), &ray);
        let albedo = surface_albedo(object, self.is_plain, reflectance.is_some());
        let receives = !self.is_plain && object.receiver.is_some();
        let is_seen = receives && path == 0 && reflectance.is_none();
        let is_glossy = is_seen && self.prepared.materials.receivers.has_lobe(found.object);
        if albedo != Vec3::ZERO || is_glossy {
            let factor = if is_glossy { throughput } else { throughput * albedo * FRAC_1_PI };
            let kind = if path == 0 { &mut view.surface } else { &mut view.mirrored };
            kind.get_or_insert(SurfacePoint { hit: found, receives, is_glossy, factor, path });
        }
        let Some(reflectance) = reflectance else { return false };
        walk.throughput *= reflectance;
        walk.alpha = alpha.max(object.reflector.map_or(0.0, |r| r.finish.alpha() as f32));
        walk.path = path_via(path, &found);
        walk.ray = Ray { origin: found.position, direction: mirrored_direction(&found, &ray, found.normal) };
        true
    }

    /// The part of light that the medium leaves on the way to a surface, or to nowhere.
    fn passed(&self, walk: &Walk, hit: Option<&Hit>) -> Vec3 {
        let Some(seen) = self.medium.filter(|_| walk.is_in_medium) else { return Vec3::ONE };
        match hit {
            Some(hit) => seen.medium.transmittance(hit.position.distance(walk.ray.origin)),
            None if seen.is_everywhere && walk.path != 0 => Vec3::ONE,
            None => seen.medium.transmittance(seen.medium.sight()),
        }
    }

    /// The radiance of lamps that a ray meets first; `None` if there is nothing to be seen of any.
    fn lamp_met(&self, walk: &Walk, hit: Option<&Hit>) -> Option<Vec3> {
        let ray = &walk.ray;
        let medium = self.medium.filter(|_| walk.is_in_medium);
        let direction = ray.direction.normalize();
        let met = |lamp: &&Lamp| {
            let to = lamp.position - ray.origin;
            let along = to.dot(direction);
            along > 0.0
                && to.length() > lamp.radius
                && to.length_squared() - along * along < lamp.radius * lamp.radius
                && hit.is_none_or(|hit| along < hit.distance * ray.direction.length())
        };
        let radiance = |lamp: &Lamp| {
            let passed = medium.map_or(Vec3::ONE, |seen| seen.medium.transmittance(lamp.position.distance(ray.origin)));
            passed * lamp.radiance_at(ray.origin)
        };
        let radiance: Vec3 = self.light.lamps.iter().filter(met).map(radiance).sum();
        (radiance != Vec3::ZERO).then_some(radiance)
    }

    /// Sends a ray on through an interface, or back from it where all is reflected.
    fn cross(&self, found: &Hit, refractor: &Refractor, walk: &mut Walk, view: &mut PixelView) {
        let eta = refractor.eta.element_sum() / 3.0;
        let (reflectance, refracted) = divided(refractor, eta, (found, &walk.ray));
        let mirrored = mirrored_direction(found, &walk.ray, found.normal);
        walk.path = path_via(walk.path, found);
        let Some(Refracted { direction, factor }) = refracted else {
            walk.ray = Ray { origin: found.position, direction: mirrored };
            return;
        };
        if reflectance > 0.0 {
            let Walk { throughput, alpha, path, .. } = *walk;
            let factor = reflectance * throughput * self.passed(walk, None);
            view.escape.get_or_insert(Escape { direction: mirrored, factor, alpha, path, emitted: None });
        }
        walk.throughput *= factor;
        walk.ray = Ray { origin: found.position, direction };
        // Behind interfaces there is the medium, in front of them none.
        walk.is_in_medium = self.medium.is_some() && found.front;
    }
}

/// The path that goes on from a mirror or an interface.
fn path_via(path: u64, found: &Hit) -> u64 {
    path.wrapping_mul(1_000_003) + u64::from(found.object) + 1
}
