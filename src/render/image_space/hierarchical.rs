//! Photons that are all followed, and then put together from fine to coarse where the map does not tell them apart: the hierarchical caustic maps
//! with which Wyman and Nichols 2009 compare theirs (Table 1). Their order is that of a Z-order curve, so that four neighbours, or the four
//! quarters of a larger square, always lie side by side, and no grid has to be kept.

use std::ops::Range;

use super::adaptive::{Effort, FIRST_MERGED_GRID, are_one, merged};
use super::caustic_map::CausticMap;
use super::emission::{Emission, Kind, Traced};
use super::ledger::Ledger;
use super::photons::{Photon, PhotonGrid};
use crate::lanes::{ALL, LANES};
use crate::parallel;

/// All photons of a light's view.
pub struct Hierarchy<'a> {
    /// Rays from the light, and what they meet.
    pub emission: Emission<'a>,
    /// The way that counts.
    pub kind: Kind,
    /// Where photons land: the map tells how far they lie from each other.
    pub map: &'a CausticMap<'a>,
    /// Photons along an edge of the grid; a power of two.
    pub photons: u32,
    /// Photons of a batch at most.
    pub batch: usize,
}

impl Hierarchy<'_> {
    /// Follows all photons, and hands what becomes of them over batch by batch. Returns the account of their flux, as far as it is not deposited.
    pub fn run(&self, add: &mut dyn FnMut(&PhotonGrid)) -> (Ledger, Effort) {
        let view = self.emission.view.resized(self.photons);
        let emission = Emission { view: &view, ..self.emission };
        let all = u64::from(self.photons).pow(2);
        let (mut ledger, mut effort) = (Ledger::default(), Effort { evaluations: all, photons: 0 });
        let part = photons_of_square(self.photons).max(LANES as u64);
        let parts: Vec<u64> = (0..all / part).map(|k| part * k).collect();
        for batch in parts.chunks((self.batch / part as usize).max(1)) {
            let mut photons = Vec::new();
            let of_batch: Vec<_> = parallel::map(batch, &|first| self.part(&emission, *first..first + part));
            for (of_part, cast) in of_batch {
                photons.extend(of_part);
                ledger += cast;
            }
            effort.photons += photons.len() as u64;
            add(&PhotonGrid::scattered(photons.into_iter().map(|photon| (photon, None)).collect()));
        }
        (ledger, effort)
    }

    /// Follows a part of the photons, and puts those of each square together.
    fn part(&self, emission: &Emission<'_>, part: Range<u64>) -> (Vec<Photon>, Ledger) {
        let mut ledger = Ledger::default();
        let mut photons = Vec::new();
        for packet in part.step_by(LANES) {
            let texels = std::array::from_fn(|lane| texel_at(packet + lane as u64));
            let mut traced = [Traced::default(); LANES];
            emission.trace(&[self.kind], &texels, ALL, |_, lane, one| traced[lane] = one);
            for one in traced {
                ledger += one.ledger;
                photons.push(one.photon);
            }
        }
        for square in photons.chunks_exact_mut(photons_of_square(self.photons) as usize) {
            merge(square, &|four| are_one(self.map, four));
        }
        (photons.into_iter().flatten().collect(), ledger)
    }
}

/// The photons of the largest square that may become one.
pub fn photons_of_square(photons: u32) -> u64 {
    u64::from((2 * photons / FIRST_MERGED_GRID).max(2)).pow(2)
}

/// The column and row of a place on the curve: its even and its odd bits.
pub fn texel_at(place: u64) -> [u32; 2] {
    let even = |bits: u64| (0..32).fold(0, |sum, k| sum | ((bits >> (2 * k) & 1) as u32) << k);
    [even(place), even(place >> 1)]
}

/// Puts photons of a square together, four at a time, then four of the results, as long as they are one. What stands for several is in the place
/// of the first.
fn merge(square: &mut [Option<Photon>], are_one: &dyn Fn(&[Option<Photon>; 4]) -> bool) {
    let mut is_whole = vec![true; square.len()];
    let mut stride = 1;
    while 4 * stride <= square.len() {
        for first in (0..square.len()).step_by(4 * stride) {
            let places = [0, 1, 2, 3].map(|k| first + k * stride);
            let four = places.map(|place| square[place]);
            is_whole[first] = places.iter().all(|place| is_whole[*place]) && are_one(&four);
            if let (true, [Some(a), Some(b), Some(c), Some(d)]) = (is_whole[first], four) {
                for place in places {
                    square[place] = None;
                }
                square[first] = Some(merged(&[a, b, c, d]));
            }
        }
        stride *= 4;
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use glam::Vec3;

    use super::*;
    use crate::image_space::photons::{SurfacePoint, Way};

    fn photon(x: f32) -> Photon {
        let point = SurfacePoint { position: Vec3::ZERO, normal: Vec3::Y };
        let way = Way { before: 1.0, within: 0.0, beyond: 1.0, first: point, last: point };
        let (position, down) = (Vec3::X * x, Vec3::NEG_Y);
        let (normal, flux) = (Vec3::Y, Vec3::ONE);
        Photon { position, normal, direction: down, undeflected: down, flux, object: 0, caster: 1, way }
    }

    /// The curve visits each texel of a square once, quarter after quarter.
    #[test]
    fn squares_are_visited_whole() {
        let square: HashSet<[u32; 2]> = (3 * 64..4 * 64).map(texel_at).collect();
        let expected = (8..16).flat_map(|y| (8..16).map(move |x| [x, y])).collect();
        assert_eq!(square, expected);
        assert_eq!([texel_at(1), texel_at(2), texel_at(4)], [[1, 0], [0, 1], [2, 0]]);
    }

    /// A square whose photons all land together is one photon with all of their flux; one that is missing keeps its own square and those around it
    /// apart, and no others.
    #[test]
    fn squares_are_merged_from_fine_to_coarse() {
        let near = |four: &[Option<Photon>; 4]| four.iter().all(|photon| photon.is_some_and(|at| at.position.x < 1.0));
        let together = |photons: &[Option<Photon>]| photons.iter().flatten().copied().collect::<Vec<_>>();
        let mut all: Vec<Option<Photon>> = (0..64).map(|k| Some(photon(k as f32 / 64.0))).collect();
        let mut with_gap = all.clone();
        with_gap[17] = None;
        merge(&mut all, &near);
        let [one] = together(&all)[..] else { panic!("several") };
        assert_eq!(one.flux, Vec3::splat(64.0));
        assert!((one.position.x - 31.5 / 64.0).abs() < 1e-6);
        merge(&mut with_gap, &near);
        let fluxes: Vec<f32> = together(&with_gap).iter().map(|photon| photon.flux.x).collect();
        assert_eq!(fluxes, [16.0, 1.0, 1.0, 1.0, 4.0, 4.0, 4.0, 16.0, 16.0]);
    }
}
