//! Traces the paths of pixels: one by one or, where rays are traced in batches, surface by surface for many pixels together.

use glam::{UVec2, Vec2, Vec3};

use super::lamps::{Passing, Segment, passed, shows_outline};
use super::{
    EndPoint, Paths, PixelPaths, Source, collect_ends, measure_steps, mirrored_direction, mirrors, share_light,
    surface_albedo, visible_reflectance,
};
use crate::Error;
use crate::engine::edges::{PARTS, PLACES};
use crate::engine::escapes::Escape;
use crate::engine::frame::FrameInputs;
use crate::engine::gloss::likely_facet;
use crate::engine::ray_batches::RayBatches;
use crate::parallel;
use crate::scene::{Medium, Object, Ray, Refractor};
use crate::stages::{CameraRays, Refracted, colours, divided};
use crate::tracing::Hit;

/// Points along the side of a pixel at edges and on mirrors.
const EDGE_POINTS: u32 = 4;
/// Pixels whose paths are traced together, where rays are traced in batches.
const PIXELS_PER_BATCH: usize = 1 << 16;
/// The largest number of surfaces that a path meets before it is taken to end in the environment.
const MAX_SURFACES: u32 = 7;
/// Paths that interfaces have divided end where no more of their light than this would arrive.
const LEAST_THROUGHPUT: f32 = 1e-3;

/// The inputs of path tracing.
pub(in crate::engine) struct PathTracer<'a> {
    pub inputs: &'a FrameInputs<'a>,
    pub rays: &'a CameraRays,
    /// Whether the camera is in the scene's medium.
    pub starts_in_medium: bool,
    /// Treats everything as diffuse, without mirrors.
    pub is_plain: bool,
}

impl PathTracer<'_> {
    /// Traces the paths of a band.
    pub async fn trace(&self) -> Result<Paths, Error> {
        let width = self.rays.view.size[0];
        let corners = self.trace_corners().await?;
        let points = |k: u32| self.points_of_pixel(&corners, k % width, k / width);
        let mut pixels = self.trace_pixels(width * self.rays.view.rows, points).await?;
        parallel::for_each_mut(&mut pixels, &|_, pixel| pixel.choose_ends());
        measure_steps(&mut pixels, width as usize);
        let ends = collect_ends(&mut pixels);
        Ok(Paths { pixels, ends })
    }

    /// Where the parts of their pixels see what smooth mirrors show at end points. The camera has one ray for each pixel.
    pub async fn parts_of_ends(&self, ends: &[&EndPoint]) -> Result<Vec<[Option<Hit>; PARTS]>, Error> {
        let view = &self.rays.view;
        let point = |k: u32| {
            let pixel = ends[k as usize / PARTS].pixel;
            let (x, row) = (pixel % view.size[0], pixel / view.size[0]);
            let centre = Vec2::new(x as f32, (view.first_row + row) as f32) + 0.5;
            let own = self.rays.index(x, row, 0, 0);
            PixelPoints { pixel, columns: 1, points: vec![(own, centre + PLACES[k as usize % PARTS])] }
        };
        let parts = self.trace_pixels((ends.len() * PARTS) as u32, point).await?;
        let of_ends = ends.iter().zip(parts.as_chunks::<PARTS>().0);
        Ok(of_ends.map(|(end, parts)| parts.each_ref().map(|paths| paths.end_like(end))).collect())
    }

    /// Traces the paths of so many pixels.
    async fn trace_pixels(
        &self,
        count: u32,
        points: impl Fn(u32) -> PixelPoints + Sync,
    ) -> Result<Vec<PixelPaths>, Error> {
        let Some(batches) = self.inputs.batches else {
            let pixel = |k: usize| {
                let is_cancelled = self.inputs.progress.is_cancelled();
                if is_cancelled { PixelPaths::default() } else { self.trace_pixel(&points(k as u32)) }
            };
            return Ok(parallel::collect(count as usize, &pixel));
        };
        let mut all = Vec::with_capacity(count as usize);
        for first in (0..count).step_by(PIXELS_PER_BATCH) {
            let some = PIXELS_PER_BATCH.min((count - first) as usize);
            let started = parallel::collect(some, &|k| PixelOnTheWay::new(self, &points(first + k as u32)));
            all.extend(self.trace_together(started, batches).await?);
        }
        Ok(all)
    }

    fn trace_pixel(&self, points: &PixelPoints) -> PixelPaths {
        let mut pixel = PixelOnTheWay::new(self, points);
        while !pixel.walks.is_empty() {
            let hits: Vec<Option<Hit>> = pixel.walks.iter().map(|walk| self.hit(walk)).collect();
            pixel.advance(self, &hits);
        }
        pixel.finish()
    }

    /// Traces the paths of pixels surface by surface.
    async fn trace_together(
        &self,
        mut pixels: Vec<PixelOnTheWay>,
        batches: &dyn RayBatches,
    ) -> Result<Vec<PixelPaths>, Error> {
        let mut is_first = true;
        loop {
            let rays: Vec<Ray> = pixels.iter().flat_map(|pixel| pixel.walks.iter().map(|walk| walk.ray)).collect();
            if rays.is_empty() {
                return Ok(pixels.into_iter().map(PixelOnTheWay::finish).collect());
            }
            let hits = if is_first { batches.camera_hits(&rays) } else { batches.secondary_hits(&rays) }.await?;
            is_first = false;
            let mut rest = &hits[..];
            let with_hits = pixels.iter_mut().map(|pixel| {
                let (own, others) = rest.split_at(pixel.walks.len());
                rest = others;
                (pixel, own)
            });
            let mut with_hits: Vec<_> = with_hits.collect();
            parallel::for_each_mut(&mut with_hits, &|_, (pixel, hits)| pixel.advance(self, hits));
        }
    }

    fn size(&self) -> Vec2 {
        UVec2::from_array(self.rays.view.size).as_vec2()
    }

    /// The camera's hits at the pixels' corners, which tell pixels with edges from others.
    async fn trace_corners(&self) -> Result<Vec<Option<Hit>>, Error> {
        let view = &self.rays.view;
        if view.pixel_samples > 1 {
            return Ok(Vec::new());
        }
        let columns = view.size[0] + 1;
        let ray = |k: u32| {
            let at = Vec2::new((k % columns) as f32, (k / columns + view.first_row) as f32);
            view.camera.ray(at, self.size())
        };
        let rays: Vec<Ray> = (0..columns * (view.rows + 1)).map(ray).collect();
        self.inputs.camera_hits(&rays).await
    }

    /// The points of a pixel: those of its camera rays or, where there is one, more at edges and on mirrors.
    fn points_of_pixel(&self, corners: &[Option<Hit>], x: u32, row: u32) -> PixelPoints {
        let view = &self.rays.view;
        let (n, y) = (view.pixel_samples, view.first_row + row);
        let pixel = row * view.size[0] + x;
        if n > 1 {
            let point = |sub: u32| {
                let at = Vec2::new((x * n + sub % n) as f32 + 0.5, (y * n + sub / n) as f32 + 0.5);
                (self.rays.index(x, row, sub % n, sub / n), at / n as f32)
            };
            return PixelPoints { pixel, columns: n, points: (0..n * n).map(point).collect() };
        }
        let own = self.rays.index(x, row, 0, 0);
        let is_smooth = self.is_smooth(self.rays.hits[own].as_ref(), self.around(corners, x, row));
        let shows_outline = || {
            let corner = view.camera.ray(Vec2::new(x as f32, y as f32), self.size());
            let rays = [&view.ray(own as u32), &corner];
            shows_outline(&self.inputs.light.lamps, rays, self.rays.hits[own].as_ref())
        };
        let columns = if is_smooth && !shows_outline() { 1 } else { EDGE_POINTS };
        let point = |sub: u32| {
            let within = (Vec2::new((sub % columns) as f32, (sub / columns) as f32) + 0.5) / columns as f32;
            (own, Vec2::new(x as f32, y as f32) + within)
        };
        PixelPoints { pixel, columns, points: (0..columns * columns).map(point).collect() }
    }

    fn around<'h>(&self, corners: &'h [Option<Hit>], x: u32, row: u32) -> [Option<&'h Hit>; 4] {
        let columns = self.rays.view.size[0] + 1;
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| corners[((row + j) * columns + x + i) as usize].as_ref())
    }

    /// Whether one point suffices for a pixel.
    fn is_smooth(&self, centre: Option<&Hit>, around: [Option<&Hit>; 4]) -> bool {
        let Some(centre) = centre else {
            return around.iter().all(Option::is_none);
        };
        let object = &self.inputs.scene.objects[centre.object as usize];
        let is_specular = mirrors(object, centre.front) || object.refractor.is_some();
        (!is_specular || self.is_plain)
            && around
                .iter()
                .all(|corner| corner.is_some_and(|c| c.object == centre.object && c.normal.dot(centre.normal) > 0.98))
    }

    /// What a path meets next, if its rays are traced one by one.
    fn hit(&self, walk: &Walk) -> Option<Hit> {
        let camera = &self.inputs.prepared.camera;
        if walk.bounce == 0 { camera.hit(walk.ray) } else { camera.secondary_hit(walk.ray) }
    }

    /// Takes a path beyond what it met, if it goes on. At an interface it may go on as several ones: the others are added to `branches`.
    fn step(&self, walk: &mut Walk, hit: Option<Hit>, paths: &mut PixelPaths, branches: &mut Vec<Walk>) -> Step {
        if let Some(found) = hit.filter(|_| walk.bounce < MAX_SURFACES) {
            let object = &self.inputs.scene.objects[found.object as usize];
            if let Some(refractor) = object.refractor.as_ref().filter(|_| !self.is_plain) {
                branches.extend(self.divided(refractor, &found, walk));
                return Step::Ends(None);
            }
            let Some(mirrored) = self.meet(&found, walk, paths) else { return Step::Ends(None) };
            walk.ray = Ray { origin: found.position, direction: mirrored };
            walk.beside = None;
            walk.bounce += 1;
            return Step::GoesOn;
        }
        let Walk { alpha, key, throughput, ray: Ray { direction, .. }, .. } = *walk;
        paths.add(walk.point, throughput, Source::Environment { direction, alpha, sides: [Vec3::ZERO; 2] }, key == 0);
        Step::Ends((key != 0 && alpha == 0.0).then(|| Escape { term: paths.terms.len() - 1, key, direction }))
    }

    /// The lamps that a path passes on its way to what it meets.
    fn lamps_passed(&self, walk: &Walk, hit: Option<&Hit>) -> Vec<Passing> {
        let Walk { point, key, ray, beside, throughput, alpha, .. } = *walk;
        let medium = self.inputs.scene.medium.filter(|_| walk.is_in_medium && !self.is_plain);
        passed(&self.inputs.light.lamps, &Segment { point, key, ray, beside, hit, throughput, alpha, medium }).collect()
    }

    /// What a path becomes at an interface: what is reflected there and, colour by colour if it is dispersive, what is refracted.
    fn divided(&self, refractor: &Refractor, found: &Hit, walk: &Walk) -> Vec<Walk> {
        let object = &self.inputs.scene.objects[found.object as usize];
        let mut parts = Vec::new();
        let mut reflected = Walk { throughput: Vec3::ZERO, ..*walk };
        for (throughput, eta) in colours(refractor, walk.throughput) {
            let (reflectance, refracted) = divided(refractor, eta, (found, &walk.ray));
            reflected.throughput += reflectance * throughput;
            if let Some(Refracted { direction, factor }) = refracted {
                let mut part = Walk { throughput: factor * throughput, ..*walk };
                // Colours that part do not meet again in one end point.
                part.meet_surface(found, Some(if refractor.is_dispersive() { eta.to_bits() } else { 1 }));
                part.ray = Ray { origin: found.position, direction };
                // Behind interfaces there is the medium, in front of them none.
                part.is_in_medium = found.front;
                parts.push(part);
            }
        }
        reflected.meet_surface(found, None);
        reflected.ray = Ray { origin: found.position, direction: Self::mirrored(found, object, &mut reflected) };
        parts.push(reflected);
        parts.retain(|part| part.throughput.max_element() > LEAST_THROUGHPUT);
        parts
    }

    /// Adds the light that a surface sends along a path. Returns the direction in which the path continues, on a
    /// mirror.
    fn meet(&self, found: &Hit, walk: &mut Walk, paths: &mut PixelPaths) -> Option<Vec3> {
        let object = &self.inputs.scene.objects[found.object as usize];
        if let Some(emitter) = object.emitter {
            let radiance = self.inputs.light.of_emitters() * emitter.radiance;
            paths.add(walk.point, walk.throughput, Source::Emitter(radiance), true);
            return None;
        }
        walk.note_surface(found);
        let reflectance = visible_reflectance(self.inputs.prepared, self.is_plain, (found, object), &walk.ray);
        self.add_surface(found, object, reflectance.is_some(), walk, paths);
        walk.throughput *= reflectance?;
        Some(Self::mirrored(found, object, walk))
    }

    /// Adds the light that a surface reflects diffusely or glossily.
    fn add_surface(&self, found: &Hit, object: &Object, is_mirror: bool, walk: &Walk, paths: &mut PixelPaths) {
        let is_glossy = !self.is_plain && self.inputs.prepared.materials.receivers.is_glossy(found.object);
        let albedo = surface_albedo(object, self.is_plain, is_mirror);
        if albedo == Vec3::ZERO && !is_glossy {
            return;
        }
        let is_own = |own: &Hit| walk.bounce == 0 && share_light(own, found);
        let source = if !is_glossy && self.rays.hits[walk.own].as_ref().is_some_and(is_own) {
            Source::CameraRay(walk.own as u32)
        } else {
            let receives = !self.is_plain && object.receiver.is_some();
            let view = -walk.ray.direction.normalize();
            // A turn of the microfacet turns the light by twice as much. What is reflected towards a viewer is not shared.
            let blur = if is_glossy { 0.0 } else { 2.0 * walk.alpha * found.distance };
            paths.end_point(EndPoint {
                hit: *found,
                receives,
                view,
                pixel: paths.pixel,
                key: walk.key,
                steps: [Vec3::ZERO; 2],
                blur,
            })
        };
        let factor = if is_glossy { walk.throughput } else { walk.throughput * albedo * std::f32::consts::FRAC_1_PI };
        paths.add(walk.point, factor, source, false);
    }

    /// The direction reflected by a mirror or, on a rough one, by a sampled microfacet.
    fn mirrored(found: &Hit, object: &Object, walk: &mut Walk) -> Vec3 {
        let alpha = object.reflector.map_or(0.0, |r| r.finish.alpha() as f32);
        let mut facet = found.normal;
        if alpha > 0.0 {
            walk.alpha = walk.alpha.max(alpha);
            // Reflections by different microfacets are too far apart to share an end point.
            walk.key = walk.key.wrapping_mul(1_000_003) + u64::from(walk.point);
            // The same microfacets in all pixels: neighbouring ones differ smoothly and without noise.
            let [u, v, ..] = sobol_burley::sample_4d(u32::from(walk.point), 0, walk.bounce);
            facet = likely_facet(found.normal, walk.ray.direction, alpha, [u, v]);
        }
        mirrored_direction(found, &walk.ray, facet)
    }
}

/// The points of a pixel whose paths are traced: the index of the camera ray where the light is known, and the place in the picture.
struct PixelPoints {
    pixel: u32,
    columns: u32,
    points: Vec<(usize, Vec2)>,
}

/// A pixel while its paths are traced.
struct PixelOnTheWay {
    paths: PixelPaths,
    /// Those that go on.
    walks: Vec<Walk>,
    /// By point, where paths left the scene by way of smooth mirrors and interfaces.
    escapes: Vec<Vec<Escape>>,
    /// Where paths came near lamps.
    lamps: Vec<Passing>,
    columns: u32,
}

impl PixelOnTheWay {
    fn new(tracer: &PathTracer, of_pixel: &PixelPoints) -> Self {
        let PixelPoints { pixel, columns, points } = of_pixel;
        let camera = &tracer.rays.view.camera;
        let has_lamps = !tracer.inputs.light.lamps.is_empty();
        let walk = |(point, &(own, at)): (usize, &(usize, Vec2))| Walk {
            point: point as u16,
            own,
            ray: camera.ray(at, tracer.size()),
            beside: has_lamps.then(|| [Vec2::X, Vec2::Y].map(|d| camera.ray(at + d / *columns as f32, tracer.size()))),
            throughput: Vec3::ONE,
            key: 0,
            alpha: 0.0,
            bounce: 0,
            is_in_medium: tracer.starts_in_medium,
        };
        Self {
            paths: PixelPaths { pixel: *pixel, points: points.len() as u16, ..PixelPaths::default() },
            walks: points.iter().enumerate().map(walk).collect(),
            escapes: vec![Vec::new(); points.len()],
            lamps: Vec::new(),
            columns: *columns,
        }
    }

    /// Takes its paths beyond what they met.
    fn advance(&mut self, tracer: &PathTracer, hits: &[Option<Hit>]) {
        let Self { paths, walks, escapes, lamps, .. } = self;
        if !tracer.inputs.light.lamps.is_empty() {
            lamps.extend(walks.iter().zip(hits).flat_map(|(walk, hit)| tracer.lamps_passed(walk, hit.as_ref())));
        }
        if let Some(medium) = tracer.inputs.scene.medium.filter(|_| !tracer.is_plain) {
            let is_everywhere = tracer.inputs.scene.has_medium_everywhere();
            for (walk, hit) in walks.iter_mut().zip(hits) {
                if walk.bounce == 0 {
                    let length = hit.map_or(medium.sight(), |hit| hit.position.distance(walk.ray.origin));
                    paths.first_legs.push((walk.own as u32, length));
                }
                walk.pass_medium(&medium, is_everywhere, hit.as_ref());
            }
        }
        let mut hits = hits.iter();
        let mut branches = Vec::new();
        walks.retain_mut(|walk| match tracer.step(walk, hits.next().copied().flatten(), paths, &mut branches) {
            Step::GoesOn => true,
            Step::Ends(escape) => {
                escapes[usize::from(walk.point)].extend(escape);
                false
            }
        });
        walks.append(&mut branches);
    }

    fn finish(mut self) -> PixelPaths {
        self.paths.set_footprints(&self.escapes, self.columns);
        if !self.lamps.is_empty() {
            self.paths.add_lamps(&self.lamps, self.columns);
        }
        self.paths
    }
}

/// What becomes of a path where it met a surface, or nothing.
enum Step {
    GoesOn,
    /// Where it left the scene, if it did by way of smooth mirrors or interfaces.
    Ends(Option<Escape>),
}

/// The state of a path while it is traced.
#[derive(Clone)]
struct Walk {
    /// Which of the pixel's points it belongs to.
    point: u16,
    /// The index of the pixel's camera ray.
    own: usize,
    /// The ray to what it meets next.
    ray: Ray,
    /// From the camera, where there are lamps: the rays through the points on the right and below.
    beside: Option<[Ray; 2]>,
    throughput: Vec3,
    /// Hash of the objects met and of how interfaces refracted it; 0 if it met none.
    key: u64,
    /// GGX width of the roughest mirror so far.
    alpha: f32,
    bounce: u32,
    /// Whether its ray runs through the scene's medium.
    is_in_medium: bool,
}

impl Walk {
    /// Loses the light that the medium takes on the way to a surface, or to nowhere.
    fn pass_medium(&mut self, medium: &Medium, is_everywhere: bool, hit: Option<&Hit>) {
        // What mirrors show of the environment is as bright as what they cast of it.
        let is_cast = is_everywhere && self.bounce > 0 && hit.is_none();
        if self.is_in_medium && !is_cast {
            let distance = hit.map_or(medium.sight(), |hit| hit.position.distance(self.ray.origin));
            self.throughput *= medium.transmittance(distance);
        }
    }

    /// Notes that the path met a surface.
    fn note_surface(&mut self, found: &Hit) {
        self.key = self.key.wrapping_mul(1_000_003) + 2 * u64::from(found.object) + u64::from(found.front) + 1;
    }

    /// Goes on from an interface; paths that were refracted differently have keys of their own.
    fn meet_surface(&mut self, found: &Hit, refracted: Option<u64>) {
        self.note_surface(found);
        self.beside = None;
        if let Some(how) = refracted {
            self.key = self.key.wrapping_mul(1_000_003) ^ how;
        }
        self.bounce += 1;
    }
}
