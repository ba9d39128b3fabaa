//! The film: pictures that are filled band by band.

use std::sync::Arc;

use glam::Vec3;

use super::frame::{Band, Beauty, FrameInputs};
use super::overlay::{self, Mark};
use super::report::Report;
use super::shading::Shaded;
use crate::image::{Aov, Image, exposed, metered_ev};
use crate::options::{DisplaySettings, Exposures, Options};

/// The result of a render.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// The requested pictures, in the requested order.
    pub layers: Vec<(Aov, Image)>,
    /// The beauty picture for display: exposed, tone-mapped and then anti-aliased; display-linear.
    displayed: Option<Image>,
    /// The radiance of the beauty picture's points, if it is small enough for them to be kept.
    shaded: Option<Arc<Shaded>>,
    /// What was rendered, and how.
    pub report: Report,
}

impl Rendered {
    /// A picture by name.
    pub fn layer(&self, aov: Aov) -> Option<&Image> {
        self.layers.iter().find(|(a, _)| *a == aov).map(|(_, image)| image)
    }

    /// The picture that a PNG shows, display-linear: beauty if it was requested, else the first picture at this
    /// exposure.
    pub fn displayed(&self, settings: &DisplaySettings) -> Image {
        match (&self.displayed, self.layers.first()) {
            (Some(beauty), _) => beauty.clone(),
            (None, Some((_, first))) => displayed_layer(first, settings).0,
            (None, None) => Image::new(0, 0),
        }
    }

    /// The same picture with other display settings, and the exposures that follow from them; without an overlay's marks. `None` if it
    /// has to be rendered again: beauty of more than 8 million points (3840×2160 pixels of one point), whose radiance is not kept.
    pub fn displayed_again(&self, settings: &DisplaySettings) -> Option<(Image, Exposures)> {
        let Some(beauty) = &self.displayed else { return Some(displayed_layer(&self.layers.first()?.1, settings)) };
        let again = self.shaded.as_ref()?.displayed(settings);
        Some((Image { pixels: again.pixels, ..*beauty }, again.exposures))
    }
}

fn displayed_layer(layer: &Image, settings: &DisplaySettings) -> (Image, Exposures) {
    let exposures = settings.exposures(|| metered_ev(layer.pixels.iter().copied()));
    (layer.map(|p| settings.tone_map.apply(exposed(p, exposures.exposure_ev))), exposures)
}

/// The pictures, as far as they are filled.
pub(super) struct Film {
    /// All pictures except beauty.
    data: Vec<(Aov, Image)>,
    /// Radiance, and its display image.
    beauty: Option<(Image, Image)>,
    /// The points of a beauty picture that is one band.
    shaded: Option<Arc<Shaded>>,
}

impl Film {
    pub fn new(options: &Options) -> Self {
        let blank = || Image::new(options.size[0], options.size[1]);
        let data = options.aovs.iter().filter(|a| **a != Aov::Beauty).map(|a| (*a, blank())).collect();
        Self { data, beauty: options.aovs.contains(&Aov::Beauty).then(|| (blank(), blank())), shaded: None }
    }

    /// Copies a band into its place.
    pub fn add(&mut self, inputs: &FrameInputs, band: &Band) {
        let view = &band.rays.view;
        let (first, count) = ((view.first_row * view.size[0]) as usize, (view.rows * view.size[0]) as usize);
        for (aov, image) in &mut self.data {
            for (k, pixel) in image.pixels[first..first + count].iter_mut().enumerate() {
                *pixel = mean_of_pixel(inputs, band, *aov, k as u32);
            }
        }
        if let (Some((radiance, shown)), Some(Beauty { radiance: band_radiance, shaded, displayed, .. })) =
            (&mut self.beauty, &band.beauty)
        {
            self.shaded = (view.rows == view.size[1]).then(|| shaded.clone());
            radiance.pixels[first..first + count].copy_from_slice(band_radiance);
            shown.pixels[first..first + count].copy_from_slice(&displayed.pixels);
        }
    }

    pub fn finish(mut self, aovs: &[Aov], marks: &[Mark], report: Report) -> Rendered {
        let (beauty, mut displayed) = self.beauty.unzip();
        if let Some(displayed) = &mut displayed {
            overlay::draw(displayed, marks);
        }
        self.data.extend(beauty.map(|b| (Aov::Beauty, b)));
        self.data.sort_by_key(|(aov, _)| aovs.iter().position(|a| a == aov));
        Rendered { layers: self.data, displayed, shaded: self.shaded, report }
    }
}

/// The mean over a pixel's points, for all pictures except beauty.
fn mean_of_pixel(inputs: &FrameInputs, band: &Band, aov: Aov, pixel: u32) -> Vec3 {
    let (width, n) = (band.rays.view.size[0], band.rays.view.pixel_samples);
    let weight = 1.0 / (n * n) as f32;
    let index = |sub: u32| band.rays.index(pixel % width, pixel / width, sub % n, sub / n);
    (0..n * n).map(|sub| weight * value(inputs, band, aov, index(sub))).sum()
}

fn value(inputs: &FrameInputs, band: &Band, aov: Aov, index: usize) -> Vec3 {
    let intensity = inputs.light.intensity;
    match aov {
        Aov::Scattered => return intensity * band.scattered.caustic_at(index),
        Aov::ScatteredDirect => return intensity * band.scattered.direct_at(index),
        _ => {}
    }
    let Some(hit) = &band.rays.hits[index] else {
        return if aov == Aov::Depth { Vec3::NEG_ONE } else { Vec3::ZERO };
    };
    let receiver = inputs.scene.objects[hit.object as usize].receiver.as_ref();
    let camera = &inputs.scene.camera;
    match aov {
        Aov::Caustic => intensity * band.light.caustic_at(index),
        Aov::CausticR | Aov::CausticT | Aov::CausticTT | Aov::CausticTTTT => {
            let own = band.of_chains.iter().find(|(chain, _)| aov.chain() == Some(*chain));
            own.map_or(Vec3::ZERO, |(_, caustic)| intensity * Vec3::from_slice(&caustic.sums[index]))
        }
        Aov::Direct => receiver.map_or(Vec3::ZERO, |_| intensity * band.light.direct_at(index)),
        Aov::Albedo => receiver.map_or(Vec3::ZERO, |r| r.albedo),
        Aov::Normal => hit.normal,
        Aov::Position => hit.position,
        Aov::Depth => Vec3::splat((hit.position - camera.position).dot(camera.forward)),
        // Beauty is the mean over points of its own; scattered light needs no surface.
        Aov::Beauty | Aov::Scattered | Aov::ScatteredDirect => Vec3::ZERO,
    }
}
