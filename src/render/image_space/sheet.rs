//! Which photons of a grid are neighbours where they land: the sheet of light that they sample, and where it is torn.

use glam::DVec2;

use super::caustic_map::CausticMap;
use super::constants::{LEAST_TEAR, PHOTON_OFF_PLANE, SAME_SURFACE_COSINE, TEAR_STRETCH};
use super::photons::PhotonGrid;

/// The photons of a grid, and where they are in a map.
pub struct PhotonSheet<'a> {
    /// The photons.
    pub grid: &'a PhotonGrid,
    /// Of each photon, in texels of the map; [`BEHIND`] those that a central one cannot show.
    pub places: Vec<DVec2>,
    map: &'a CausticMap<'a>,
}

/// Where photons appear that lie behind the point that the map's rays leave.
pub const BEHIND: DVec2 = DVec2::splat(-1e9);

impl<'a> PhotonSheet<'a> {
    /// Projects photons into a map.
    pub fn new(map: &'a CausticMap<'a>, grid: &'a PhotonGrid) -> Self {
        let place = |position| map.project(position).unwrap_or(BEHIND);
        let places = grid.photons.iter().map(|photon| place(photon.position)).collect();
        Self { grid, places, map }
    }

    /// Whether light is continuous between two photons next to each other in a row or column.
    pub fn are_connected(&self, one: usize, other: usize) -> bool {
        if !self.are_alike(one, other) {
            return false;
        }
        let [[x, y], [z, w]] = [one, other].map(|index| self.grid.texels[index].map(i64::from));
        let (dx, dy) = (z - x, w - y);
        let position = |index: usize| self.grid.photons[index].position;
        let length = |a: usize, b: usize| f64::from(position(a).distance(position(b)));
        let beyond = |from: usize, x: i64, y: i64| {
            self.grid.index_at(x, y).filter(|&index| self.are_alike(from, index)).map(|index| length(from, index))
        };
        let next = [beyond(one, x - dx, y - dy), beyond(other, z + dx, w + dy)];
        let longest =
            next.into_iter().flatten().fold(None, |most: Option<f64>, length| Some(most.unwrap_or(0.0).max(length)));
        longest.is_none_or(|longest| {
            length(one, other)
                <= f64::from(TEAR_STRETCH) * longest + f64::from(LEAST_TEAR) * self.map.texel_across(position(one))
        })
    }

    /// Whether two photons came by way of one object to one surface, which may be of several objects in one plane.
    fn are_alike(&self, one: usize, other: usize) -> bool {
        let [one, other] = [one, other].map(|index| &self.grid.photons[index]);
        let is_one_surface = one.object == other.object || {
            let height = f64::from((other.position - one.position).dot(one.normal).abs());
            height <= f64::from(PHOTON_OFF_PLANE) * self.map.texel_across(one.position)
        };
        one.caster == other.caster && is_one_surface && one.normal.dot(other.normal) >= SAME_SURFACE_COSINE
    }
}
