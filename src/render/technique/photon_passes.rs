//! Photons in passes, until two halves of them agree: how they become irradiance, and how many there are, follow from the difference of the
//! halves.
//!
//! Each pass draws other directions and points out of the lights, and other rays out of their views. Where all light comes from single points
//! and directions there is nothing to draw but rays: then finer and finer grids of photons are compared instead. What passes cost is counted in
//! photons, so that a picture does not depend on the machine. Knows neither scenes nor how maps are made.

use glam::Mat3;

use crate::Error;
use crate::image_space::{
    Draws, ImageSpaceOptions, MapInputs, Maps, Mode, Pattern, PhotonLight, Segment, point_of_sequence,
};
use crate::progress::NoProgress;

/// Photons of a picture, about, at most: so many grids as the options say.
const MOST_GRIDS: u64 = 256;
/// Where there is nothing to draw, grids have at most so many times as many photons along an edge as the options say.
const FINEST: u32 = 4;
/// The polygon of a photon takes about so many times as long as a point: measured from 2 to 18.
const POLYGON_WORK: f64 = 6.0;
/// Another way is tried where the first one seems to need more than this part of these photons.
const WORTH_ANOTHER_WAY: f64 = 0.25;
/// Passes of polygons, of which each direction shows a whole caustic, have so many times fewer photons along an edge, and directions of a light.
const COARSER: u32 = 2;
const FEWER: u32 = 4;

/// A light, and the part of the environment that it stands for, if it is one, with its rotation.
pub(super) type Source = (PhotonLight, Option<(Segment, Mat3)>);

/// Maps whose halves agree, as far as photons were allowed.
pub(super) struct Passes {
    pub maps: Maps,
    /// How photons became irradiance.
    pub mode: Mode,
    pub count: u32,
    /// About the root of the mean squared error of the maps, relative to that of the irradiance.
    pub error: f64,
}

/// How the photons of a pass become irradiance, and how many there are.
#[derive(Clone, Copy, Debug)]
struct Way {
    mode: Mode,
    photons: u32,
    light_directions: u32,
}

impl Way {
    fn options(self, options: &ImageSpaceOptions) -> ImageSpaceOptions {
        let Self { mode, photons, light_directions } = self;
        ImageSpaceOptions { mode, photons, light_directions, ..*options }
    }
}

/// Two halves of the photons.
#[derive(Debug)]
struct Halves {
    way: Way,
    maps: [Maps; 2],
    /// Of each half.
    passes: u32,
}

/// Sends photons until the error is at most `tolerance`, or there are too many of them. `is_done` is told which part of the work is.
pub(super) async fn until_halves_agree(
    inputs: &MapInputs<'_>,
    (segments, tolerance): (&[Option<(Segment, Mat3)>], f64),
    mut send: impl AsyncFnMut(&MapInputs<'_>) -> Result<Maps, Error>,
    is_done: &dyn Fn(f64),
) -> Result<Passes, Error> {
    let options = inputs.options;
    let most_photons = MOST_GRIDS * u64::from(options.photons).pow(2);
    // The error falls with the root of the number of photons.
    let tell = |halves: &Halves| {
        let by_error = (tolerance / halves.error().max(f64::MIN_POSITIVE)).powi(2);
        is_done(by_error.max(halves.photons() as f64 / most_photons as f64).min(1.0));
    };
    let of_pass = |pass: u32| MapInputs { draws: Some(Draws { segments, pass }), ..*inputs };
    // They show where all photons will land, whatever is drawn.
    let few = of_pass(0).few_photons(&NoProgress);
    let mut send = async |way: Way, pass: u32| {
        let [seed, seeds] = [inputs.pattern.seed, u64::from(pass).wrapping_mul(0x9e37_79b9)];
        let pattern =
            Pattern { seed: seed.wrapping_add(seeds), offset: point_of_sequence(pass).as_dvec2(), ..inputs.pattern };
        let options = way.options(options);
        send(&MapInputs { options: &options, pattern, few: Some(&few), ..of_pass(pass) }).await
    };
    let is_drawn = segments.iter().any(Option::is_some) || inputs.lights.iter().any(PhotonLight::is_extended);
    let (first, mut others) = ways(options, is_drawn);
    if segments.iter().any(Option::is_some) {
        // Of so many directions, polygons cover whole maps again and again: a sky that a ball reflects takes 18 times as long as points do.
        others.clear();
    }
    let mut try_way = async |way: Way| {
        let maps = [send(way, 0).await?, send(way, 1).await?];
        Ok::<_, Error>(Halves { way, maps, passes: 1 })
    };
    let mut found = try_way(first).await?;
    tell(&found);
    for way in others {
        let needed = found.photons() as f64 * (found.error() / tolerance).powi(2);
        let is_long = needed > WORTH_ANOTHER_WAY * most_photons as f64 && found.photons() < most_photons;
        if found.error() <= tolerance || is_drawn && !is_long {
            break;
        }
        let tried = try_way(way).await?;
        if !is_drawn || tried.effort() < found.effort() {
            found = tried;
        }
        tell(&found);
    }
    while is_drawn && found.error() > tolerance && found.photons() < most_photons {
        for half in 0..2 {
            let more = send(found.way, 2 * found.passes + half).await?;
            found.maps[half as usize].mix(&more, 1.0 / (found.passes + 1) as f32);
        }
        found.passes += 1;
        tell(&found);
    }
    Ok(found.together())
}

/// What is tried: grids of photons that become finer or, where directions and points are drawn out of lights, points and polygons.
fn ways(options: &ImageSpaceOptions, is_drawn: bool) -> (Way, Vec<Way>) {
    let ImageSpaceOptions { photons, light_directions, .. } = *options;
    if !is_drawn {
        let way = |times: u32| Way { mode: Mode::ExactPolygons, photons: times * photons, light_directions };
        let finer = std::iter::successors(Some(2), |times| Some(2 * times)).take_while(|times| *times <= FINEST);
        let finer = finer.map(way).filter(|way| way.options(options).check().is_ok()).collect();
        return (way(1), finer);
    }
    let coarse = (photons / COARSER).max(16);
    let few = (light_directions / FEWER).max(1);
    let polygons = Way { mode: Mode::ExactPolygons, photons: coarse, light_directions: few };
    (Way { mode: Mode::Points, photons, light_directions }, vec![polygons])
}

impl Halves {
    /// That of their mean is half of their difference.
    fn error(&self) -> f64 {
        let [one, other] = &self.maps;
        0.5 * one.relative_difference(other)
    }

    fn photons(&self) -> u64 {
        self.maps.iter().map(|maps| maps.photons).sum()
    }

    /// Work times squared error, in photons of points: more passes leave it as it is.
    fn effort(&self) -> f64 {
        let work = if self.way.mode == Mode::ExactPolygons { POLYGON_WORK } else { 1.0 };
        self.error().powi(2) * work * self.photons() as f64
    }

    fn together(self) -> Passes {
        let (mode, count, error) = (self.way.mode, 2 * self.passes, self.error());
        let [mut maps, other] = self.maps;
        maps.mix(&other, 0.5);
        Passes { maps, mode, count, error }
    }
}
