//! From light on surfaces to the picture: radiance of what each pixel sees, exposure and tone mapping.

use glam::Vec3;

use super::edges::FirstSurface;
use super::scattering::ScatteredGrid;
use super::views::{Escape, SurfacePoint, Views};
use super::{Frame, filled};
use crate::engine::gloss::blurred_radiance;
use crate::image::{Image, exposed, metered_ev};
use crate::options::Exposures;
use crate::parallel;

/// A whole picture takes sixteen microfacets for a lobe, a preview one look-up, which is as much wider.
const PREVIEW_BLUR: f32 = 4.0;

impl Frame<'_> {
    pub(super) fn shade(
        &self,
        views: &Views,
        own: &[Vec3],
        mirrored: &[Vec3],
        scattered: Option<&ScatteredGrid>,
    ) -> (Image, Exposures) {
        let [width, height] = self.options.size;
        let mut shaded = filled([Vec3::ZERO; 2], own.len());
        parallel::for_each_chunk(&mut shaded, width as usize, &|y, row| {
            self.shade_row(views, y * width as usize, own, mirrored, row);
            if let Some(scattered) = scattered {
                self.add_scattered(scattered, &views.first[y * width as usize..], y, row);
            }
        });
        let exposures = self.options.display.exposures(|| {
            let surfaces: Vec<Vec3> = shaded.iter().map(|[s, _]| *s).filter(|s| *s != Vec3::ZERO).collect();
            let is_mostly_background = 10 * surfaces.len() < shaded.len();
            if is_mostly_background {
                metered_ev(shaded.iter().map(|[surface, background]| *surface + *background))
            } else {
                metered_ev(surfaces.into_iter())
            }
        });
        let shown = |[surface, background]: &[Vec3; 2]| {
            let background = exposed(*background, exposures.background_exposure_ev);
            self.options.display.tone_map.apply(exposed(*surface, exposures.exposure_ev) + background)
        };
        (Image { width, height, pixels: parallel::map(&shaded, &shown) }, exposures)
    }

    /// Radiance of surfaces, and of the environment where the camera sees it directly, W/(m²·sr), of a row of pixels from `first` on.
    fn shade_row(&self, views: &Views, first: usize, own: &[Vec3], mirrored: &[Vec3], row: &mut [[Vec3; 2]]) {
        let pixels = first..first + row.len();
        let light_from_world = self.light.world_from_light().transpose();
        let is_background = |escape: &&Escape| escape.path == 0 && escape.emitted.is_none();
        let escapes = pixels.clone().filter_map(|pixel| views.escapes.at(pixel)).filter(is_background);
        let mut backgrounds: Vec<Vec3> = escapes.map(|escape| light_from_world * escape.direction).collect();
        self.light.environment.radiance.background_of_all(&mut backgrounds);
        let mut backgrounds = backgrounds.into_iter();
        let factor = |point: Option<&SurfacePoint>| point.map_or(Vec3::ZERO, |point| point.factor);
        let intensity = self.light.intensity;
        let of_pixel = |pixel: usize| {
            let surfaces =
                factor(views.surfaces.at(pixel)) * own[pixel] + factor(views.mirrored.at(pixel)) * mirrored[pixel];
            let Some(escape) = views.escapes.at(pixel) else { return [intensity * surfaces, Vec3::ZERO] };
            if escape.path == 0 {
                let radiance = escape.emitted.or_else(|| backgrounds.next()).unwrap_or_default();
                return [intensity * surfaces, intensity * escape.factor * radiance];
            }
            let direction = light_from_world * escape.direction;
            let escaped =
                escape.factor * self.mirrored_environment(escape, direction, || views.footprint(pixel, escape));
            [intensity * (surfaces + escaped), Vec3::ZERO]
        };
        row.iter_mut().zip(pixels.map(of_pixel)).for_each(|(radiance, found)| *radiance = found);
    }

    /// Adds what the medium scatters before the first surfaces of a row.
    fn add_scattered(&self, scattered: &ScatteredGrid, first: &[FirstSurface], y: usize, row: &mut [[Vec3; 2]]) {
        let sight = self.medium.map_or(f32::INFINITY, |seen| seen.medium.sight());
        for (x, ([surface, _], first)) in row.iter_mut().zip(first).enumerate() {
            *surface += self.light.intensity * scattered.at([x, y], first.distance.min(sight));
        }
    }

    /// The environment at the end of a path via mirrors, in a direction of its own: filtered over the path's footprint, radians, where a
    /// mirror shows it smaller than its texels.
    fn mirrored_environment(&self, escape: &Escape, direction: Vec3, footprint_rad: impl FnOnce() -> f32) -> Vec3 {
        if let Some(radiance) = escape.emitted {
            return radiance;
        }
        let environment = &self.light.environment;
        if escape.alpha > 0.0 {
            return blurred_radiance(&environment.cube, direction, PREVIEW_BLUR * escape.alpha);
        }
        let footprint_rad = footprint_rad();
        // Texels cover a smaller solid angle towards a face's corners.
        let texel_rad = 2.0 / environment.cube.size() as f32 * direction.abs().max_element().powf(1.5);
        if footprint_rad <= texel_rad {
            return environment.radiance.smooth_radiance(direction);
        }
        environment.cube.fetch(direction, (footprint_rad / texel_rad).log2())
    }
}
