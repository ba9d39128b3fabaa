//! The beauty picture: environment behind, mirrors that mirror it and what stands around, receivers lit by the
//! environment and the caustics.
//!
//! Every pixel is shaded from one point, or from 4×4 where surfaces meet or mirror. Paths are traced first; each asks for
//! the light at the diffuse points at its ends; that is found for all together, as for any other receivers; then all is
//! summed. Points of one pixel that end on the same object in the same way share the light of one point.

use glam::{UVec2, Vec2, Vec3};
use rayon::prelude::*;

use super::gbuffer::GBuffer;
use super::gloss;
use super::report::Seconds;
use super::{Renderer, sum_of_fetches, timed};
use crate::Error;
use crate::Progress;
use crate::image::{display, exposed};
use crate::pinhole::{Arrangement, Receivers, Viewers};
use crate::scene::{Object, Ray, Sides};
use crate::tracing::Hit;

/// Points along the edge of a pixel where surfaces meet.
const EDGE_POINTS: u32 = 4;
/// Surfaces that a path meets before it ends in the environment.
const MAX_SURFACES: u32 = 7;
/// Albedo of what neither mirrors nor receives on the side that is seen.
const PLAIN_ALBEDO: f32 = 0.2;
/// Albedo of everything in the plain diffuse view.
const DIFFUSE_VIEW_ALBEDO: f32 = 0.6;

/// Radiance towards the camera and what is shown of it, pixel by pixel.
type Shaded = (Vec3, Vec3);

/// Shades a band and says how many more fetches that took. `own` belongs to the band's points.
pub(super) fn shade(
    renderer: &Renderer,
    gbuffer: &GBuffer,
    own: &Irradiances,
    seconds: &mut Seconds,
    progress: &dyn Progress,
) -> Result<(Vec<Shaded>, f64), Error> {
    let width = renderer.options.size[0];
    let pixels = width * gbuffer.rows;
    let corners = timed(&mut seconds.tracing, || trace_corners(renderer, gbuffer));
    let mut paths: Vec<PixelPaths> = timed(&mut seconds.tracing, || {
        (0..pixels).into_par_iter().map(|k| trace_pixel(renderer, gbuffer, &corners, k % width, k / width)).collect()
    });
    let extra = number_points(&mut paths);
    let caustic = if extra.is_empty() || renderer.options.look.plain_diffuse {
        vec![[0.0; 4]; extra.len()]
    } else {
        timed(&mut seconds.gather, || gather_at(renderer, &extra, progress))?
    };
    let direct = timed(&mut seconds.direct, || extra.par_iter().map(|point| renderer.direct_at(point)).collect());
    let extra = Irradiances { direct, caustic };
    let shaded = paths.par_iter().map(|p| p.sum(renderer, own, &extra)).collect();
    Ok((shaded, sum_of_fetches(&extra.caustic)))
}

/// The caustics at extra points: irradiance, or from glossy receivers the radiance towards their viewers.
fn gather_at(renderer: &Renderer, points: &[ExtraPoint], progress: &dyn Progress) -> Result<Vec<[f32; 4]>, Error> {
    let gather = |receivers: &Receivers| {
        let Renderer { backend, summed, environment, options, .. } = renderer;
        backend.gather(receivers, summed, &environment.cube, &options.params, progress)
    };
    let rows = (points.len() as u32).div_ceil(POINTS_IN_A_ROW);
    let mut diffuse = Receivers { arrangement: Arrangement::List, ..Receivers::empty(POINTS_IN_A_ROW, rows) };
    let is_glossy = |p: &ExtraPoint| p.receives && renderer.materials.is_glossy(p.hit.object);
    for (index, point) in points.iter().enumerate().filter(|(_, p)| p.receives && !is_glossy(p)) {
        diffuse.set(index, point.hit.position, point.hit.normal, point.hit.object);
    }
    let mut sums = gather(&diffuse)?;
    let glossy: Vec<usize> = (0..points.len()).filter(|&k| is_glossy(&points[k])).collect();
    if !glossy.is_empty() {
        let place = |&k: &usize| (points[k].hit.position, points[k].hit.normal, points[k].hit.object);
        let mut receivers = Receivers::from_points(&glossy.iter().map(place).collect::<Vec<_>>(), POINTS_IN_A_ROW);
        let mut directions: Vec<_> = glossy.iter().map(|&k| points[k].view.extend(0.0).to_array()).collect();
        directions.resize(receivers.positions.len(), [0.0; 4]);
        receivers.viewers = Some(Viewers { directions, materials: renderer.materials.clone() });
        for (&k, sum) in glossy.iter().zip(gather(&receivers)?) {
            sums[k] = sum;
        }
    }
    Ok(sums)
}

/// Extra points are gathered in rows of so many.
const POINTS_IN_A_ROW: u32 = 1024;

/// The light at points of surfaces; where those are glossy, the radiance that they reflect to their viewers.
pub(super) struct Irradiances {
    /// From the environment, W/m².
    pub direct: Vec<Vec3>,
    /// As gathered; as many or, padded to whole rows, more.
    pub caustic: Vec<[f32; 4]>,
}

/// Where the light on a path's end is known.
#[derive(Clone, Copy)]
enum LitAt {
    /// Nowhere: the path ends in the environment.
    Nowhere,
    /// The band's own point of this index.
    OwnPoint(u32),
    /// The pixel's extra point of this index; after [`number_points`], the band's.
    ExtraPoint(u32),
}

/// A point of a surface that is not the band's own, or that reflects to its viewer more than to others.
pub(super) struct ExtraPoint {
    pub hit: Hit,
    pub receives: bool,
    /// Unit direction towards whoever sees it.
    pub view: Vec3,
}

/// What one path brings to its point.
struct Term {
    /// Which of the pixel's points it belongs to.
    point: u16,
    /// Light from the environment at the path's end.
    radiance: Vec3,
    /// The environment as the camera sees it directly, which has an exposure of its own.
    background: bool,
    /// What the irradiance there is multiplied by: throughput · albedo / π, or the throughput alone where it is radiance;
    factor: Vec3,
    /// and the caustic besides, unless the surface receives none.
    caustic_gain: f32,
    lit: LitAt,
}

#[derive(Default)]
struct PixelPaths {
    points: u16,
    terms: Vec<Term>,
    extra: Vec<ExtraPoint>,
    /// How each extra point was reached: the objects on the way, hashed.
    extra_keys: Vec<u64>,
}

impl PixelPaths {
    fn sum(&self, renderer: &Renderer, own: &Irradiances, extra: &Irradiances) -> Shaded {
        let look = &renderer.options.look;
        let (mut radiance, mut shown) = (Vec3::ZERO, Vec3::ZERO);
        for point in 0..self.points {
            let (mut lit, mut background) = (Vec3::ZERO, Vec3::ZERO);
            for term in self.terms.iter().filter(|t| t.point == point) {
                let irradiance = match term.lit {
                    LitAt::Nowhere => Vec3::ZERO,
                    LitAt::OwnPoint(index) => own.at(index, term.caustic_gain),
                    LitAt::ExtraPoint(index) => extra.at(index, term.caustic_gain),
                };
                let sum = term.radiance + term.factor * irradiance;
                if term.background { background += sum } else { lit += sum }
            }
            radiance += lit + background;
            // Each point is tone-mapped before the mean, so that edges against bright light are smooth, too.
            shown += display(exposed(lit, look.exposure_ev) + exposed(background, look.background_exposure_ev));
        }
        let weight = 1.0 / f32::from(self.points);
        (weight * radiance, weight * shown)
    }

    /// The extra point for a surface reached by way of `key`; the first one stands for all of the pixel's.
    fn extra_point(&mut self, key: u64, point: ExtraPoint) -> LitAt {
        let index = self.extra_keys.iter().position(|k| *k == key).unwrap_or_else(|| {
            self.extra_keys.push(key);
            self.extra.push(point);
            self.extra.len() - 1
        });
        LitAt::ExtraPoint(index as u32)
    }
}

impl Irradiances {
    fn at(&self, index: u32, caustic_gain: f32) -> Vec3 {
        let [r, g, b, _] = self.caustic[index as usize];
        self.direct[index as usize] + caustic_gain * Vec3::new(r, g, b)
    }
}

/// Collects the pixels' extra points into one list and makes their indices point into it.
fn number_points(paths: &mut [PixelPaths]) -> Vec<ExtraPoint> {
    let mut all = Vec::new();
    for pixel in paths {
        let first = all.len() as u32;
        all.append(&mut pixel.extra);
        for term in &mut pixel.terms {
            if let LitAt::ExtraPoint(index) = &mut term.lit {
                *index += first;
            }
        }
    }
    all
}

/// What the camera sees at the pixels' corners, to find the pixels where surfaces meet.
fn trace_corners(renderer: &Renderer, gbuffer: &GBuffer) -> Vec<Option<Hit>> {
    if gbuffer.per_edge > 1 {
        return Vec::new();
    }
    let columns = renderer.options.size[0] + 1;
    let size = UVec2::from_array(renderer.options.size).as_vec2();
    let corner = |k: u32| {
        let at = Vec2::new((k % columns) as f32, (k / columns + gbuffer.first_row) as f32);
        renderer.tracer.camera_hit(renderer.scene.camera.ray(at, size))
    };
    (0..columns * (gbuffer.rows + 1)).into_par_iter().map(corner).collect()
}

fn trace_pixel(renderer: &Renderer, gbuffer: &GBuffer, corners: &[Option<Hit>], x: u32, row: u32) -> PixelPaths {
    let mut paths = PixelPaths::default();
    let n = gbuffer.per_edge;
    if n > 1 {
        for sub in 0..n * n {
            let index = gbuffer.index(x, row, sub % n, sub / n);
            let at = Vec2::new((x * n + sub % n) as f32 + 0.5, ((gbuffer.first_row + row) * n + sub / n) as f32 + 0.5);
            trace_point(renderer, gbuffer, index, at / n as f32, &mut paths);
        }
        return paths;
    }
    let centre = gbuffer.index(x, row, 0, 0);
    let columns = renderer.options.size[0] + 1;
    let around =
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| corners[((row + j) * columns + x + i) as usize].as_ref());
    let pixel = Vec2::new(x as f32, (gbuffer.first_row + row) as f32);
    if is_smooth(renderer, gbuffer.hits[centre].as_ref(), around) {
        trace_point(renderer, gbuffer, centre, pixel + 0.5, &mut paths);
    } else {
        for sub in 0..EDGE_POINTS * EDGE_POINTS {
            let within = (Vec2::new((sub % EDGE_POINTS) as f32, (sub / EDGE_POINTS) as f32) + 0.5) / EDGE_POINTS as f32;
            trace_point(renderer, gbuffer, centre, pixel + within, &mut paths);
        }
    }
    paths
}

/// Whether one point is enough for a pixel.
fn is_smooth(renderer: &Renderer, centre: Option<&Hit>, around: [Option<&Hit>; 4]) -> bool {
    let Some(centre) = centre else {
        return around.iter().all(Option::is_none);
    };
    let mirrors = mirrors(&renderer.scene.objects[centre.object as usize], centre.front);
    (!mirrors || renderer.options.look.plain_diffuse)
        && around
            .iter()
            .all(|corner| corner.is_some_and(|c| c.object == centre.object && c.normal.dot(centre.normal) > 0.98))
}

fn mirrors(object: &Object, front: bool) -> bool {
    object.reflector.is_some_and(|r| match r.sides {
        Sides::Front => front,
        Sides::Back => !front,
        Sides::Both => true,
    })
}

/// Follows the camera's ray through a point of the picture. `own` is the pixel's receiver, whose caustic is known.
fn trace_point(renderer: &Renderer, gbuffer: &GBuffer, own: usize, at: Vec2, paths: &mut PixelPaths) {
    let size = UVec2::from_array(renderer.options.size).as_vec2();
    let mut ray = renderer.scene.camera.ray(at, size);
    let mut hit = renderer.tracer.camera_hit(ray);
    let mut throughput = Vec3::ONE;
    let mut key = 0u64;
    let mut roughest = 0.0f32;
    let plain = renderer.options.look.plain_diffuse;
    for bounce in 0..MAX_SURFACES {
        let Some(found) = hit else { break };
        let object = &renderer.scene.objects[found.object as usize];
        key = key.wrapping_mul(1_000_003) + 2 * u64::from(found.object) + u64::from(found.front) + 1;
        let cosine = ray.direction.dot(found.normal).abs();
        let curve = renderer.curves[found.object as usize].as_ref();
        let reflectance =
            curve.filter(|_| !plain && mirrors(object, found.front)).map(|c| c.at(cosine.into()).as_vec3());
        let albedo = match &object.receiver {
            _ if plain => Vec3::splat(DIFFUSE_VIEW_ALBEDO),
            Some(receiver) => receiver.albedo,
            None if reflectance.is_some() => Vec3::ZERO,
            None => Vec3::splat(PLAIN_ALBEDO),
        };
        if albedo != Vec3::ZERO || renderer.materials.is_glossy(found.object) {
            let is_own = |o: &Hit| bounce == 0 && o.object == found.object && o.front == found.front;
            let glossy = !plain && renderer.materials.is_glossy(found.object);
            let lit = if !glossy && gbuffer.hits[own].as_ref().is_some_and(is_own) {
                LitAt::OwnPoint(own as u32)
            } else {
                let receives = !plain && object.receiver.is_some();
                paths.extra_point(key, ExtraPoint { hit: found, receives, view: -ray.direction.normalize() })
            };
            paths.terms.push(Term {
                point: paths.points,
                radiance: Vec3::ZERO,
                background: false,
                factor: if glossy { throughput } else { throughput * albedo * std::f32::consts::FRAC_1_PI },
                caustic_gain: if plain { 0.0 } else { renderer.options.look.caustic_gain },
                lit,
            });
        }
        let Some(reflectance) = reflectance else {
            paths.points += 1;
            return;
        };
        throughput *= reflectance;
        let alpha = object.reflector.map_or(0.0, |r| r.finish.alpha() as f32);
        let facet = if alpha > 0.0 {
            roughest = roughest.max(alpha);
            // What facets mirror lies too far apart to share a point.
            key = key.wrapping_mul(1_000_003) + u64::from(paths.points);
            let seed = (own as u32).wrapping_mul(0x9E37_79B9) ^ bounce;
            let [u, v, ..] = sobol_burley::sample_4d(u32::from(paths.points), 0, seed);
            gloss::facet(found.normal, alpha, [u, v])
        } else {
            found.normal
        };
        let mirrored = ray.direction.reflect(facet);
        // A facet may throw light into the surface; then the smooth mirror stands for it.
        let outwards = mirrored.dot(found.normal) * ray.direction.dot(found.normal) < 0.0;
        let direction = if outwards { mirrored } else { ray.direction.reflect(found.normal) };
        ray = Ray { origin: found.position, direction: direction.normalize() };
        hit = renderer.tracer.secondary_hit(ray);
    }
    let background = key == 0;
    let environment = if roughest > 0.0 {
        gloss::blurred_radiance(&renderer.environment.cube, ray.direction, roughest)
    } else {
        renderer.environment.field.smooth_radiance(ray.direction)
    };
    let radiance = throughput * environment;
    paths.terms.push(Term {
        point: paths.points,
        radiance,
        background,
        factor: Vec3::ZERO,
        caustic_gain: 0.0,
        lit: LitAt::Nowhere,
    });
    paths.points += 1;
}
