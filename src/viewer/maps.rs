//! The environment maps that there are to choose from: those that are built in, and those that were opened. Thumbnails are made by a
//! thread; this module does not know the window, which it only wakes.

use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};

use glam::Vec3;

use crate::image::{Image, ToneMap, exposed, metered_ev};
use crate::low_level::environment::{BUILT_IN_MAPS, EnvironmentRadiance};
use crate::scene::Light;

/// Height of thumbnails, pixels; they are twice as wide.
const HEIGHT: u32 = 80;

/// A map that can be chosen.
pub struct MapChoice {
    /// What scene files call it: its name, if it is built in, or its file.
    pub reference: String,
    /// What it shows.
    pub about: String,
    pub light: Light,
}

impl MapChoice {
    /// What it is called beside its thumbnail.
    pub fn name(&self) -> String {
        Path::new(&self.reference).file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }
}

/// All maps that can be chosen, and the thread that makes their thumbnails.
pub struct Maps {
    choices: Vec<MapChoice>,
    /// Of the choices from this one on, no thumbnail has been asked for.
    asked: usize,
    lights: Sender<Light>,
    thumbnails: Receiver<Image>,
}

impl Maps {
    /// The built-in maps. `wake` is called for every thumbnail.
    pub fn new(wake: impl Fn() + Send + 'static) -> Self {
        let (lights, asked) = channel::<Light>();
        let (sender, thumbnails) = channel();
        std::thread::spawn(move || {
            while let Ok(light) = asked.recv() {
                if sender.send(thumbnail(&light)).is_err() {
                    return;
                }
                wake();
            }
        });
        let choice = |map: &crate::low_level::environment::BuiltInMap| MapChoice {
            reference: map.name.to_owned(),
            about: map.about.to_owned(),
            light: Light::BuiltInMap(map.name.to_owned()),
        };
        Self { choices: BUILT_IN_MAPS.iter().map(choice).collect(), asked: 0, lights, thumbnails }
    }

    pub fn choices(&self) -> &[MapChoice] {
        &self.choices
    }

    /// Adds a map that was opened, unless it is there.
    pub fn add(&mut self, reference: &str, light: &Light) {
        if self.choices.iter().all(|choice| choice.reference != reference) {
            let (reference, about) = (reference.to_owned(), reference.to_owned());
            self.choices.push(MapChoice { reference, about, light: light.clone() });
        }
    }

    /// Asks for the thumbnails that are missing. They come in the order of the choices.
    pub fn ask_for_thumbnails(&mut self) {
        for choice in &self.choices[self.asked..] {
            // The thread ends with this.
            let _ = self.lights.send(choice.light.clone());
        }
        self.asked = self.choices.len();
    }

    /// The next thumbnail, if it is finished: display-linear, black if the map cannot be read.
    pub fn thumbnail(&self) -> Option<Image> {
        self.thumbnails.try_recv().ok()
    }
}

/// A light as an equirectangular picture, exposed by itself.
fn thumbnail(light: &Light) -> Image {
    let Ok(environment) = EnvironmentRadiance::new(light) else { return Image::new(2 * HEIGHT, HEIGHT) };
    let finer = environment.equirectangular(2 * HEIGHT);
    let mean = |pixel: u32| {
        let (x, y) = (2 * (pixel % (2 * HEIGHT)), 2 * (pixel / (2 * HEIGHT)));
        let four = (0..4).map(|k| finer.pixels[((y + k / 2) * finer.width + x + k % 2) as usize]);
        0.25 * four.sum::<Vec3>()
    };
    let radiance = Image { width: 2 * HEIGHT, height: HEIGHT, pixels: (0..2 * HEIGHT * HEIGHT).map(mean).collect() };
    let exposure_ev = metered_ev(radiance.pixels.iter().copied());
    radiance.map(|pixel| ToneMap::default().apply(exposed(pixel, exposure_ev)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bright above, as the sky is, and each different from the others.
    #[test]
    fn thumbnails_show_the_maps() {
        let mut maps = Maps::new(|| ());
        maps.add("a/white.hdr", &Light::Constant(Vec3::ONE));
        maps.add("a/white.hdr", &Light::Constant(Vec3::ONE));
        let names: Vec<String> = maps.choices().iter().map(MapChoice::name).collect();
        assert_eq!(names, ["clear-sky", "overcast", "forest", "studio", "city", "white"]);
        maps.ask_for_thumbnails();
        let images: Vec<Image> = maps.thumbnails.iter().take(names.len()).collect();
        for (name, image) in names.iter().zip(&images).take(2) {
            let [above, below] = [0.25, 0.75].map(|part| {
                let row = (part * image.height as f32) as u32 * image.width;
                image.pixels[row as usize..(row + image.width) as usize].iter().sum::<Vec3>().element_sum()
            });
            assert!(above > 1.1 * below, "{name}: {above} {below}");
        }
        assert!(images.iter().enumerate().all(|(k, image)| !images[..k].contains(image)));
        assert!(images[5].pixels.iter().all(|pixel| *pixel == images[5].pixels[0]));
    }
}
