//! Photons from the lights' views, and maps of the irradiance where they land: the techniques that came from image-space caustics (Wyman and
//! Davis 2006; Wyman and Dachsbacher 2006).
//!
//! ```text
//! environment ─► segmentation ─┐
//!                   lamps ─────┴► lights ─► views ─► emission ─► photons ─► splats, polygons ─► caustic map ─► irradiance
//! ```
//!
//! Photons find what they meet by rays or in images of what a light sees (`surface_images`). `gpu` does the same on a device.
//!
//! Irradiance is flux over area. All flux is accounted for in a [`Ledger`]. Maps are sums in fixed point: the same bits every time. This module
//! must not know pinhole samples, pictures or files.

mod adaptive;
mod caster_groups;
mod caustic_map;
pub(crate) mod constants;
mod coverage;
mod emission;
#[cfg(feature = "gpu")]
pub mod gpu;
mod hierarchical;
mod irradiance_map;
mod ledger;
mod lens;
mod lights;
mod map_views;
mod maps;
mod multi_resolution;
mod options;
mod photons;
mod polygons;
mod projection;
mod receiver_layers;
mod segmentation;
mod sheet;
mod splats;
mod strips;
mod surface_images;
#[cfg(test)]
mod tests;

use self::caustic_map::{CausticMap, ForGloss};
use self::constants::MAX_RECEIVER_LAYERS;
pub use self::emission::{Kind, Pattern, Surroundings};
use self::irradiance_map::IrradianceMap;
pub use self::irradiance_map::{Incident, MapPicture};
pub use self::ledger::{Ledger, Loss};
pub use self::lights::{PhotonLight, Profile, point_of_sequence};
pub use self::maps::{Draws, MapInputs, Maps};
pub use self::options::{Hits, ImageSpaceOptions, Incidence, MapView, Mode, Traversal};

pub use self::projection::Bounds;
pub use self::segmentation::{Direction as SegmentDirection, Segment, segments};

use std::borrow::Cow;
use std::sync::atomic::{AtomicU32, Ordering};

use self::lens::Lens;
use self::lights::LightView;
use self::multi_resolution::Resolutions;
use self::photons::{Photon, PhotonGrid};
use self::polygons::{Coverage, polygons};
use self::projection::Projection;
use self::receiver_layers::ReceiverLayers;
use self::splats::{gathered, of_clusters, of_diameter, of_footprints, of_lenses, points};
use crate::parallel;
use crate::scene::{Object, Ray};
use crate::tracing::Hit;

/// What a map shows.
pub enum Shows<'a> {
    /// What the camera sees along a ray, if that is a receiver.
    First(Sees<'a>),
    /// The receivers along a ray, one behind the other.
    All(Sees<'a>),
}

/// Tells the first receiver along a ray.
type Sees<'a> = Box<dyn Fn(Ray) -> Option<Hit> + Sync + 'a>;

/// Flux in the texels of a map.
struct Deposits<'a> {
    map: CausticMap<'a>,
    mode: Mode,
    resolutions: Option<Resolutions<'a>>,
    /// Photons in each texel, for the gather.
    counts: Vec<AtomicU32>,
}

/// A map on its way: photons are added to it grid by grid.
pub struct MapBuilder<'a> {
    deposits: Deposits<'a>,
    shows: Shows<'a>,
    splat_diameter: f64,
    /// The distance between photons of all frames that are averaged, relative to that of one frame's.
    frame_spacing: f64,
    is_papers: bool,
}

impl<'a> MapBuilder<'a> {
    /// Begins with an empty map of a projection. `total`: about the flux that is to be added, W.
    pub fn new(
        projection: Projection,
        (total, kept): (f64, ForGloss<'a>),
        shows: Shows<'a>,
        options: &ImageSpaceOptions,
    ) -> Self {
        let receivers = match &shows {
            Shows::First(sees) => ReceiverLayers::visible(projection, sees),
            Shows::All(sees) => ReceiverLayers::all(projection, MAX_RECEIVER_LAYERS, sees),
        };
        let map = CausticMap::new(receivers, (total, kept));
        let has_resolutions = options.mode == Mode::MultiResolution && options.traversal == Traversal::Dense;
        let resolutions = has_resolutions.then(|| Resolutions::like(&map));
        let counted = if options.mode == Mode::Gather { map.len() } else { 0 };
        let counts = (0..counted).map(|_| AtomicU32::new(0)).collect();
        let splat_diameter = f64::from(options.splat_diameter);
        let deposits = Deposits { map, mode: options.mode, resolutions, counts };
        let frame_spacing = f64::from(options.frame_spacing());
        Self { deposits, shows, splat_diameter, frame_spacing, is_papers: options.paper }
    }

    /// The map so far.
    fn map(&self) -> &CausticMap<'a> {
        &self.deposits.map
    }

    /// Adds photons. Returns the account of their flux; where more than one photon decides what a texel gets, what is deposited is known
    /// in the end.
    pub fn add(&self, grid: &PhotonGrid, view: &LightView, objects: &[Object]) -> Ledger {
        let Deposits { map, mode, resolutions, counts } = &self.deposits;
        let is_hidden = |photon: &Photon| match &self.shows {
            Shows::First(sees) => map.is_hidden(photon, sees),
            Shows::All(_) => false,
        };
        let hidden: Vec<bool> = parallel::map(&grid.photons, &is_hidden);
        let lost = grid.own_photons().iter().zip(&hidden[grid.own.clone()]).filter(|(_, is_hidden)| **is_hidden);
        let lost = lost.map(|(photon, _)| Ledger::sum(photon.flux)).sum::<f64>();
        let grid = &if hidden.contains(&true) { Cow::Owned(grid.without(&hidden)) } else { Cow::Borrowed(grid) };
        let mut ledger = match mode {
            Mode::Points => points(map, grid),
            Mode::Gather => {
                let photons = grid.own_photons();
                parallel::for_each(photons.len(), &|photon| {
                    if let Ok((_, texel)) = map.place(&photons[photon]) {
                        counts[texel].fetch_add(1, Ordering::Relaxed);
                    }
                });
                Ledger { deposited: 0.0, ..points(map, grid) }
            }
            Mode::Splats => of_diameter(map, grid, self.splat_diameter),
            Mode::MultiResolution => {
                resolutions.as_ref().map_or_else(|| of_clusters(map, grid), |resolutions| resolutions.add(grid))
            }
            Mode::ThinLens => of_lenses(map, (grid, view), objects, (Lens::Thin, self.frame_spacing)),
            Mode::ThickLens => of_lenses(map, (grid, view), objects, (Lens::Thick, self.frame_spacing)),
            Mode::Footprints => of_footprints(map, grid, self.frame_spacing),
            Mode::Polygons => polygons(map, grid, Coverage::Centres { alone: self.is_papers }),
            Mode::Auto | Mode::ExactPolygons => polygons(map, grid, Coverage::Exact),
        };
        ledger[Loss::Hidden] += lost;
        ledger
    }

    /// The finished map, and what is left of the account.
    pub fn finish(self) -> (IrradianceMap, Ledger) {
        self.deposits.finish()
    }
}

impl Deposits<'_> {
    /// Chooses between several resolutions or smoothes points, as the mode asks for. Returns the finished map, and what is left of the account.
    fn finish(self) -> (IrradianceMap, Ledger) {
        let Self { map, mode, resolutions, counts } = self;
        let mut ledger = Ledger::default();
        if let Some(resolutions) = resolutions {
            ledger = resolutions.resolve(&map);
        }
        if mode == Mode::Gather {
            let smooth = map.emptied();
            let counts: Vec<u32> = counts.into_iter().map(AtomicU32::into_inner).collect();
            let ledger = gathered(&map, &counts, &smooth);
            return (smooth.resolve(), ledger);
        }
        (map.resolve(), ledger)
    }
}
