//! Shading: from paths and the light at their end points to radiance towards the camera, and to display values.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::gloss::blurred_radiance;
use super::paths::{Paths, PixelPaths, Source, Term};
use crate::image::{display, exposed, metered_ev};
use crate::options::{DisplaySettings, Exposures};
use crate::pinhole::{Filter, Probe, cpu};
use crate::stages::PreparedLight;

/// Look-ups along a footprint of the environment in a mirror, at most.
const MIRROR_TAPS: u32 = 16;

/// The light at points of surfaces, for an environment of intensity 1: irradiance or, on glossy surfaces, radiance
/// towards the viewer.
#[derive(Debug)]
pub(super) struct SurfaceLight {
    /// Direct light; `None` if not requested.
    pub direct: Option<Arc<Vec<Vec3>>>,
    /// The caustic, with the number of fetches in w; may be padded to whole rows. `None` if not requested.
    pub caustic: Option<Arc<Vec<[f32; 4]>>>,
}

impl SurfaceLight {
    /// Direct light.
    pub fn direct_at(&self, index: usize) -> Vec3 {
        self.direct.as_ref().map_or(Vec3::ZERO, |direct| direct[index])
    }

    /// The caustic.
    pub fn caustic_at(&self, index: usize) -> Vec3 {
        self.caustic.as_ref().map_or(Vec3::ZERO, |caustic| Vec3::from_slice(&caustic[index]))
    }

    fn at(&self, index: u32, caustic_gain: f32) -> Vec3 {
        self.direct_at(index as usize) + caustic_gain * self.caustic_at(index as usize)
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
    pub caustic_gain: f32,
}

impl Shader<'_> {
    pub fn shade(&self, paths: &Paths) -> Shaded {
        let mut first_point = vec![0];
        first_point.extend(paths.pixels.iter().scan(0, |sum, pixel| {
            *sum += u32::from(pixel.points);
            Some(*sum)
        }));
        let points: Vec<Vec<ShadedPoint>> = paths.pixels.par_iter().map(|pixel| self.shade_pixel(pixel)).collect();
        Shaded { first_point, points: points.concat() }
    }

    fn shade_pixel(&self, pixel: &PixelPaths) -> Vec<ShadedPoint> {
        let mut points = vec![ShadedPoint::default(); usize::from(pixel.points)];
        let mut mirrored = self.mirrored_light(pixel).into_iter();
        for term in &pixel.terms {
            let light = match term.source {
                Source::Environment { sides, .. } if self.is_wide(sides) => mirrored.next().unwrap_or(Vec3::ZERO),
                _ => self.light_of(term),
            };
            let radiance = self.light.intensity * term.factor * light;
            let point = &mut points[usize::from(term.point)];
            if term.is_background { point.background += radiance } else { point.surfaces += radiance }
        }
        points
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

    fn light_of(&self, term: &Term) -> Vec3 {
        match term.source {
            Source::CameraRay(index) => self.own.at(index, self.caustic_gain),
            Source::EndPoint(index) => self.ends.at(index, self.caustic_gain),
            Source::Environment { direction, alpha, .. } => {
                let direction = self.light.light_from_world(direction);
                let environment = &self.light.environment;
                if alpha > 0.0 {
                    blurred_radiance(&environment.cube, direction, alpha)
                } else {
                    environment.radiance.smooth_radiance(direction)
                }
            }
        }
    }
}

impl Shaded {
    fn pixels(&self) -> impl IndexedParallelIterator<Item = &[ShadedPoint]> {
        self.first_point.par_windows(2).map(|ends| &self.points[ends[0] as usize..ends[1] as usize])
    }

    /// The mean radiance of each pixel.
    pub fn radiance(&self) -> Vec<Vec3> {
        let mean = |points: &[ShadedPoint]| {
            points.iter().map(|p| p.surfaces + p.background).sum::<Vec3>() / points.len().max(1) as f32
        };
        self.pixels().map(mean).collect()
    }

    /// The picture for display. Points are tone-mapped before they are averaged, so that edges against bright light are
    /// anti-aliased, too.
    pub fn displayed(&self, settings: &DisplaySettings) -> Displayed {
        let exposures = settings.exposures(|| self.metered_ev());
        let shown = |p: &ShadedPoint| {
            let background = exposed(p.background, exposures.background_exposure_ev);
            display(exposed(p.surfaces, exposures.exposure_ev) + background)
        };
        let mean = |points: &[ShadedPoint]| points.iter().map(shown).sum::<Vec3>() / points.len().max(1) as f32;
        Displayed { exposures, pixels: self.pixels().map(mean).collect() }
    }

    /// Metered on the pixels that show surfaces or, where there are hardly any, on all.
    fn metered_ev(&self) -> f32 {
        let mean =
            |points: &[ShadedPoint]| points.iter().map(|p| p.surfaces).sum::<Vec3>() / points.len().max(1) as f32;
        let mut surfaces: Vec<Vec3> = self.pixels().map(mean).collect();
        surfaces.retain(|surface| *surface != Vec3::ZERO);
        if 10 * surfaces.len() < self.first_point.len() {
            surfaces = self.radiance();
        }
        metered_ev(surfaces.into_iter())
    }
}
