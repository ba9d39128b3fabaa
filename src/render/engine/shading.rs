//! Shading: from paths and the light at their end points to radiance towards the camera, and to display values.

use std::sync::Arc;

use glam::Vec3;

use super::edges::{Caustic, Direct, NEAREST_PARTS, PARTS, Parts};
use super::gloss::blurred_radiance;
use super::paths::{Paths, PixelPaths, Source, Term};
use super::scattering::Scattered;
use crate::image::{exposed, metered_ev};
use crate::options::{DisplaySettings, Exposures};
use crate::parallel;
use crate::pinhole::{Filter, Probe, cpu};
use crate::stages::PreparedLight;

/// Look-ups along a footprint of the environment in a mirror, at most.
const MIRROR_TAPS: u32 = 16;

/// The light at points of surfaces, for an environment of intensity 1: irradiance or, on glossy surfaces, radiance
/// towards the viewer.
#[derive(Clone, Debug)]
pub(super) struct SurfaceLight {
    /// Direct light; `None` if not requested.
    pub direct: Option<Arc<Direct>>,
    /// The caustic; `None` if not requested.
    pub caustic: Option<Arc<Caustic>>,
}

impl SurfaceLight {
    /// Direct light.
    pub fn direct_at(&self, index: usize) -> Vec3 {
        self.direct.as_ref().map_or(Vec3::ZERO, |direct| direct.light[index])
    }

    /// The caustic.
    pub fn caustic_at(&self, index: usize) -> Vec3 {
        self.caustic.as_ref().map_or(Vec3::ZERO, |caustic| Vec3::from_slice(&caustic.sums[index]))
    }

    /// Whether any light differs between the parts of the point's pixel.
    fn is_divided(&self, index: u32) -> bool {
        self.direct.as_ref().is_some_and(|direct| direct.parts.contains_key(&index))
            || self.caustic.as_ref().is_some_and(|caustic| caustic.parts.contains_key(&index))
    }

    /// All light in a part of the point's pixel.
    fn at(&self, index: u32, part: usize, caustic_gain: f32) -> Vec3 {
        let in_part = |parts: &Parts| parts.get(&index).map(|parts| parts[part]);
        let direct = self.direct.as_ref().and_then(|direct| in_part(&direct.parts));
        let caustic = self.caustic.as_ref().and_then(|caustic| in_part(&caustic.parts));
        direct.unwrap_or_else(|| self.direct_at(index as usize))
            + caustic_gain * caustic.unwrap_or_else(|| self.caustic_at(index as usize))
    }
}

/// Radiance towards the camera for each point.
#[derive(Debug)]
pub(super) struct Shaded {
    /// Index of each pixel's first point, and the number of all points.
    first_point: Vec<u32>,
    points: Vec<ShadedPoint>,
}

/// A picture for display.
#[derive(Debug)]
pub(super) struct Displayed {
    pub exposures: Exposures,
    /// Display-linear values of each pixel.
    pub pixels: Vec<Vec3>,
}

/// Radiance of one point of a pixel, W/(m²·sr).
#[derive(Clone, Copy, Debug, Default)]
struct ShadedPoint {
    surfaces: Vec3,
    /// The environment, where the camera sees it directly.
    background: Vec3,
}

/// The inputs of shading.
pub(super) struct Shader<'a> {
    pub light: &'a PreparedLight,
    /// Light where camera rays hit.
    pub own: &'a SurfaceLight,
    /// Light at the end points of paths.
    pub ends: &'a SurfaceLight,
    /// What a medium scatters towards the camera before its rays hit.
    pub scattered: &'a Scattered,
    /// Camera rays in a row.
    pub width: usize,
    pub caustic_gain: f32,
}

impl Shader<'_> {
    pub fn shade(&self, paths: &Paths) -> Shaded {
        let points: Vec<Vec<ShadedPoint>> = parallel::map(&paths.pixels, &|pixel| self.shade_pixel(pixel));
        let mut first_point = vec![0];
        first_point.extend(points.iter().scan(0, |sum, points| {
            *sum += points.len() as u32;
            Some(*sum)
        }));
        Shaded { first_point, points: points.concat() }
    }

    /// For each end of a path, how much light there would be as bright to the viewer as all that the points of the pixel show which see
    /// this end, for an environment of intensity 1: irradiance or, on glossy surfaces, radiance. Beside it, errors of the end's light
    /// are judged.
    pub fn seen_beside(&self, paths: &Paths) -> Vec<f32> {
        let of_pixels: Vec<Vec<(u32, f32)>> = parallel::map(&paths.pixels, &|pixel| self.ends_seen_beside(pixel));
        let mut beside = vec![0.0; paths.ends.len()];
        of_pixels.into_iter().flatten().for_each(|(end, light)| beside[end as usize] = light);
        beside
    }

    /// The ends of a pixel's paths, and what each is seen beside: the harmonic mean over the points that show it, so that what some
    /// of them show clearly counts.
    fn ends_seen_beside(&self, pixel: &PixelPaths) -> Vec<(u32, f32)> {
        let is_end = |term: &Term| matches!(term.source, Source::EndPoint(_));
        if self.light.intensity == 0.0 || !pixel.terms.iter().any(is_end) {
            return Vec::new();
        }
        let shaded = self.shade_pixel(pixel);
        let parts = shaded.len() / usize::from(pixel.points);
        let brightness = |point: u16| {
            let of_point = shaded.iter().skip(usize::from(point) * parts).take(parts);
            let surfaces = of_point.map(|p| p.surfaces.element_sum()).sum::<f32>();
            surfaces / (parts as f32 * self.light.intensity)
        };
        // Of each end: the sum of the relative changes of its points with its light, and the number of its terms.
        let mut changes: Vec<(u32, f32, f32)> = Vec::new();
        for term in &pixel.terms {
            let Source::EndPoint(end) = term.source else { continue };
            let change = term.factor.element_sum() / brightness(term.point);
            match changes.iter_mut().find(|(other, ..)| *other == end) {
                Some((_, sum, count)) => (*sum, *count) = (*sum + change, *count + 1.0),
                None => changes.push((end, change, 1.0)),
            }
        }
        changes.into_iter().map(|(end, sum, count)| (end, if sum > 0.0 { count / sum } else { 0.0 })).collect()
    }

    fn shade_pixel(&self, pixel: &PixelPaths) -> Vec<ShadedPoint> {
        let parts = if pixel.points == 1 && self.is_divided(pixel) { PARTS } else { 1 };
        let mut points = vec![ShadedPoint::default(); usize::from(pixel.points) * parts];
        let mut mirrored = self.mirrored_light(pixel).into_iter();
        for term in &pixel.terms {
            let filtered = match term.source {
                Source::Environment { sides, .. } if self.is_wide(sides) => mirrored.next(),
                _ => None,
            };
            for copy in 0..parts {
                let point = usize::from(term.point) * parts + copy;
                let part = if parts == PARTS { copy } else { NEAREST_PARTS[point % NEAREST_PARTS.len()] };
                let light = filtered.unwrap_or_else(|| self.light_of(term, part));
                let radiance = self.light.intensity * term.factor * light;
                let point = &mut points[point];
                if term.is_background { point.background += radiance } else { point.surfaces += radiance }
            }
        }
        if !self.scattered.is_dark() {
            for (k, point) in points.iter_mut().enumerate() {
                let ray = pixel.medium_ray(k / parts, &self.scattered.lengths, self.width);
                let light = self.scattered.direct_at(ray) + self.caustic_gain * self.scattered.caustic_at(ray);
                point.surfaces += self.light.intensity * light;
            }
        }
        points
    }

    /// Whether light differs between the parts of a pixel.
    fn is_divided(&self, pixel: &PixelPaths) -> bool {
        let has_parts = |term: &Term| match term.source {
            Source::CameraRay(index) => self.own.is_divided(index),
            Source::EndPoint(index) => self.ends.is_divided(index),
            Source::Environment { .. } | Source::Emitter(_) => false,
        };
        pixel.terms.iter().any(has_parts)
    }

    /// The environment over all of a pixel's footprints that are wide enough to be filtered, in the order of their terms.
    fn mirrored_light(&self, pixel: &PixelPaths) -> Vec<Vec3> {
        let probe = |term: &Term| match term.source {
            Source::Environment { direction, sides, .. } if self.is_wide(sides) => Some(Probe {
                direction: self.light.light_from_world(direction),
                sides: sides.map(|side| self.light.light_from_world(side)),
            }),
            _ => None,
        };
        let probes: Vec<Probe> = pixel.terms.iter().filter_map(probe).collect();
        if probes.is_empty() {
            return Vec::new();
        }
        // Only the hardware filter does not exist on the CPU.
        let means = cpu::probe(&self.light.environment.cube, Filter::Anisotropic, MIRROR_TAPS, &probes);
        means.unwrap_or_default().iter().map(|mean| Vec3::from_slice(mean)).collect()
    }

    /// Whether a footprint is wider than the texels that filters start from; narrower ones see the map itself.
    fn is_wide(&self, sides: [Vec3; 2]) -> bool {
        let texel_rad = 2.0 / self.light.environment.cube.size() as f32;
        sides.iter().any(|side| side.length_squared() > texel_rad * texel_rad)
    }

    fn light_of(&self, term: &Term, part: usize) -> Vec3 {
        match term.source {
            Source::CameraRay(index) => self.own.at(index, part, self.caustic_gain),
            Source::EndPoint(index) => self.ends.at(index, part, self.caustic_gain),
            Source::Emitter(radiance) => radiance,
            Source::Environment { direction, alpha, .. } => {
                let direction = self.light.light_from_world(direction);
                let environment = &self.light.environment;
                if alpha > 0.0 {
                    blurred_radiance(&environment.cube, direction, alpha)
                } else if term.is_background {
                    environment.radiance.background(direction)
                } else {
                    environment.radiance.smooth_radiance(direction)
                }
            }
        }
    }
}

impl Shaded {
    /// What becomes of the points of each pixel.
    fn of_pixels<T: Send>(&self, of: &(dyn Fn(&[ShadedPoint]) -> T + Sync)) -> Vec<T> {
        let points =
            |pixel: usize| &self.points[self.first_point[pixel] as usize..self.first_point[pixel + 1] as usize];
        parallel::collect(self.first_point.len() - 1, &|pixel| of(points(pixel)))
    }

    /// The mean radiance of each pixel.
    pub fn radiance(&self) -> Vec<Vec3> {
        let mean = |points: &[ShadedPoint]| {
            points.iter().map(|p| p.surfaces + p.background).sum::<Vec3>() / points.len().max(1) as f32
        };
        self.of_pixels(&mean)
    }

    /// The picture for display. Points are tone-mapped before they are averaged, so that edges against bright light are
    /// anti-aliased, too.
    pub fn displayed(&self, settings: &DisplaySettings) -> Displayed {
        let exposures = settings.exposures(|| self.metered_ev());
        let shown = |p: &ShadedPoint| {
            let background = exposed(p.background, exposures.background_exposure_ev);
            settings.tone_map.apply(exposed(p.surfaces, exposures.exposure_ev) + background)
        };
        let mean = |points: &[ShadedPoint]| points.iter().map(shown).sum::<Vec3>() / points.len().max(1) as f32;
        Displayed { exposures, pixels: self.of_pixels(&mean) }
    }

    /// Metered on the pixels that show surfaces, or light from a medium, or, where there are hardly any, on all.
    fn metered_ev(&self) -> f32 {
        let mean =
            |points: &[ShadedPoint]| points.iter().map(|p| p.surfaces).sum::<Vec3>() / points.len().max(1) as f32;
        let mut surfaces: Vec<Vec3> = self.of_pixels(&mean);
        surfaces.retain(|surface| *surface != Vec3::ZERO);
        if 10 * surfaces.len() < self.first_point.len() {
            surfaces = self.radiance();
        }
        metered_ev(surfaces.into_iter())
    }
}
