//! Photons from the lights' views, and maps of the irradiance where they land: the techniques that came from image-space caustics (Wyman and
//! Davis 2006; Wyman and Dachsbacher 2006).
//!
//! ```text
//! environment ─► segmentation ─┐
//!                   lamps ─────┴► lights ─► views ─► emission ─► photons ─► splats, polygons, layers ─► caustic map ─► irradiance
//! ```
//!
//! Irradiance is flux over area. All flux is accounted for in a [`Ledger`]. Maps are sums in fixed point: the same bits every time. This module
//! must not know pinhole samples, pictures or files.

mod caustic_map;
mod emission;
mod ledger;
mod lens;
mod lights;
mod maps;
mod multi_resolution;
mod options;
mod photons;
mod polygons;
mod projection;
mod segmentation;
mod sheet;
mod splats;

use self::caustic_map::{CausticMap, IrradianceMap};
pub use self::emission::{Kind, Surroundings};
pub use self::ledger::{Ledger, Loss};
pub use self::lights::PhotonLight;
pub use self::maps::{MapInputs, Maps};
pub use self::options::{ImageSpaceOptions, MapView, Mode};

pub use self::projection::Bounds;
pub use self::segmentation::{Direction, segmented};

use rayon::prelude::*;

use self::lens::Lens;
use self::lights::LightView;
use self::multi_resolution::Layers;
use self::photons::{Photon, PhotonGrid};
use self::polygons::{Coverage, polygons};
use self::splats::{gathered, of_diameter, of_footprints, of_lenses, points};
use crate::scene::Object;

/// A map on its way: photons are added to it grid by grid.
#[derive(Debug)]
pub struct MapInTheMaking {
    map: CausticMap,
    mode: Mode,
    splat_diameter: f64,
    layers: Option<Layers>,
    /// Photons in each texel, for the gather.
    counts: Vec<u32>,
    /// The account of what was added, without what was cast.
    pub ledger: Ledger,
}

impl MapInTheMaking {
    /// Begins with an empty map.
    pub fn new(map: CausticMap, options: &ImageSpaceOptions) -> Self {
        let layers = (options.mode == Mode::MultiResolution).then(|| Layers::like(&map));
        let texels = map.size()[0] as usize * map.size()[1] as usize;
        let counts = vec![0; if options.mode == Mode::Gather { texels } else { 0 }];
        let splat_diameter = f64::from(options.splat_diameter);
        Self { map, mode: options.mode, splat_diameter, layers, counts, ledger: Ledger::default() }
    }

    /// Whether a photon lands in the map's window.
    fn is_in_window(&self, photon: &Photon) -> bool {
        self.map.place(photon) != Err(Loss::OffMap)
    }

    /// Adds photons.
    pub fn add(&mut self, grid: &PhotonGrid, view: &LightView, objects: &[Object]) {
        let map = &self.map;
        self.ledger += match self.mode {
            Mode::Points => points(map, grid),
            Mode::Gather => {
                let texels: Vec<usize> =
                    grid.photons.par_iter().filter_map(|photon| Some(map.place(photon).ok()?.1)).collect();
                texels.into_iter().for_each(|texel| self.counts[texel] += 1);
                points(map, grid)
            }
            Mode::Splats => of_diameter(map, grid, self.splat_diameter),
            Mode::MultiResolution => self.layers.as_ref().map_or_else(Ledger::default, |layers| layers.add(grid)),
            Mode::ThinLens => of_lenses(map, (grid, view), objects, Lens::Thin),
            Mode::ThickLens => of_lenses(map, (grid, view), objects, Lens::Thick),
            Mode::Footprints => of_footprints(map, grid),
            Mode::Polygons => polygons(map, grid, Coverage::Centres),
            Mode::ExactPolygons => polygons(map, grid, Coverage::Exact),
        };
    }

    /// The finished map, and its account.
    pub fn finish(self) -> (IrradianceMap, Ledger) {
        let Self { map, mode, layers, counts, mut ledger, .. } = self;
        if let Some(layers) = layers {
            ledger += layers.resolve(&map);
        }
        if mode == Mode::Gather {
            let smooth = map.emptied();
            ledger.deposited = 0.0;
            ledger += gathered(&map, &counts, &smooth);
            return (smooth.resolve(), ledger);
        }
        (map.resolve(), ledger)
    }
}
