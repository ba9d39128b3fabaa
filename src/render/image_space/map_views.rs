//! Views for maps of what the camera does not see: windows around where a few photons say that all of them land.

use glam::{DVec2, DVec3, Vec3};

use super::adaptive::FIRST_GRID;
use super::lights::PhotonLight;
use super::maps::{Emitted, FewPhotons, MapInputs};
use super::photons::PhotonGrid;
use super::projection::Projection;
use crate::scene::Chain;

/// The part of the photons at each edge of a light's map that may lie outside of it.
const OUTLIERS: f64 = 0.002;

/// The part of a light's map at each edge for photons between the few that tell where all of them land.
const MARGIN: f64 = 1.0 / FIRST_GRID as f64;

impl MapInputs<'_> {
    /// Views of receivers for what the camera does not see: one for each chain, along the mean direction of its photons, in which few
    /// receivers hide others that they reach.
    pub fn projections_of_chains(&self, few: &[FewPhotons]) -> Vec<(Chain, Projection)> {
        let few: Vec<&Emitted> = few.iter().flatten().collect();
        let of_chain = |chain: Chain| {
            let kinds = self.kinds.iter().enumerate().filter(|(_, kind)| kind.chain == chain).map(|(k, _)| k);
            let grids: Vec<&PhotonGrid> = kinds.flat_map(|k| few.iter().map(move |(_, grids)| &grids[k])).collect();
            let landed = || grids.iter().flat_map(|grid| &grid.photons);
            let mean: Vec3 = landed().map(|photon| photon.direction * photon.flux.element_sum()).sum();
            let direction = mean.try_normalize()?;
            let (right, down) = direction.as_dvec3().any_orthonormal_pair();
            let kept = without_outliers(landed().map(|photon| photon.position), right, down);
            let size = self.options.caustic_map_size;
            Some((chain, with_margin(Projection::parallel(direction, kept.into_iter(), &self.bounds, size))))
        };
        Chain::ALL.into_iter().filter_map(of_chain).collect()
    }

    /// Views from a light around where its photons land: one, or six around a lamp that they surround.
    pub fn projections_of_light(&self, light: &PhotonLight, emitted: &FewPhotons) -> Vec<Projection> {
        let grids = || emitted.iter().flat_map(|(_, grids)| grids);
        let landed = || grids().flat_map(|grid| grid.photons.iter().map(|photon| photon.position));
        let Some((view, _)) = emitted.first().filter(|_| landed().next().is_some()) else { return Vec::new() };
        let size = self.options.caustic_map_size;
        match light {
            PhotonLight::Directional { towards, .. } => {
                let axes = view.projection.axes;
                let kept = without_outliers(landed(), axes[0], axes[1]);
                vec![with_margin(Projection::parallel(-*towards, kept.into_iter(), &self.bounds, size))]
            }
            PhotonLight::Lamp(lamp) => {
                let points: Vec<Vec3> = landed().collect();
                let one = Projection::central(lamp.position, points.iter().copied(), size);
                one.map_or_else(|| Projection::cube(lamp.position, size, 0).to_vec(), |view| vec![with_margin(view)])
            }
        }
    }
}

/// A window that is as much wider as a few photons may miss of what all of them reach.
fn with_margin(window: Projection) -> Projection {
    window.widened(MARGIN * window.texel * f64::from(window.size[0]))
}

/// Points between whose extremes along two axes nearly all of them lie.
fn without_outliers(points: impl Iterator<Item = Vec3> + Clone, right: DVec3, down: DVec3) -> Vec<Vec3> {
    let within = |axis: DVec3| {
        let mut places: Vec<f64> = points.clone().map(|p| p.as_dvec3().dot(axis)).collect();
        places.sort_by(f64::total_cmp);
        let outliers = (OUTLIERS * places.len() as f64) as usize;
        [places[outliers], places[places.len() - 1 - outliers]]
    };
    let [left, top] = [right, down].map(within);
    let (low, high) = (DVec2::new(left[0], top[0]), DVec2::new(left[1], top[1]));
    let place = |p: &Vec3| DVec2::new(p.as_dvec3().dot(right), p.as_dvec3().dot(down));
    points.filter(|p| place(p).cmpge(low).all() && place(p).cmple(high).all()).collect()
}
