//! Photons as points and as Gaussian splats: of one size, of the size that a lens would make, or of their own footprints.
//!
//! The weights of a splat are normalised over the texels that it reaches on its receiver, so that it adds the photon's flux wherever it
//! lies between texels.

use glam::{DVec2, DVec3, Vec3};

use super::caustic_map::CausticMap;
use super::constants::{
    FOOTPRINT_OVERLAP, LENS_SPACINGS, MAX_SPLAT_DIAMETER, MIN_FOOTPRINT_DEVIATION, MIN_SPLAT_DIAMETER, SPLAT_DEVIATION,
    SPLAT_REACH,
};
use super::ledger::{Ledger, Loss};
use super::lens::{Lens, lens_factor};
use super::lights::LightView;
use super::multi_resolution::DIAMETERS;
use super::photons::{Photon, PhotonGrid};
use super::sheet::PhotonSheet;

use crate::parallel;
use crate::scene::Object;

/// A Gaussian in texels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Splat {
    /// The inverse of the covariance: xx, xy, yy.
    inverse: [f64; 3],
    /// Half the width and height of the rectangle that it is cut to.
    reach: DVec2,
}

impl Splat {
    /// A round one with a diameter, in a square of that size.
    fn round(diameter: f64) -> Self {
        let deviation = f64::from(SPLAT_DEVIATION) * diameter;
        let inverse = 1.0 / (deviation * deviation);
        Self { inverse: [inverse, 0.0, inverse], reach: DVec2::splat(0.5 * diameter.max(1.0)) }
    }

    /// With a covariance: xx, xy, yy.
    pub(super) fn elliptical([xx, xy, yy]: [f64; 3]) -> Self {
        let determinant = xx * yy - xy * xy;
        let inverse = [yy, -xy, xx].map(|entry| entry / determinant);
        Self { inverse, reach: f64::from(SPLAT_REACH) * DVec2::new(xx.sqrt(), yy.sqrt()) + 0.5 }
    }

    fn weight(&self, offset: DVec2) -> f64 {
        let [xx, xy, yy] = self.inverse;
        let squared = xx * offset.x * offset.x + 2.0 * xy * offset.x * offset.y + yy * offset.y * offset.y;
        (-0.5 * squared).exp()
    }

    /// Adds a photon at a place of a map.
    fn add(&self, map: &CausticMap, photon: &Photon, place: (DVec2, usize)) {
        self.add_flux(map, (photon, photon.flux.as_dvec3()), place);
    }

    /// Adds flux of a photon, W.
    pub(super) fn add_flux(&self, map: &CausticMap, (photon, flux): (&Photon, DVec3), (place, own): (DVec2, usize)) {
        let size = DVec2::from_array(map.size().map(f64::from));
        let low = (place - self.reach + 0.5).floor().max(DVec2::ZERO);
        let high = (place + self.reach - 0.5).ceil().min(size);
        let rows = low.y as usize..high.y as usize;
        let taps = rows.flat_map(|y| (low.x as usize..high.x as usize).map(move |x| (x, y)));
        let weighted = taps.filter_map(|(x, y)| {
            let middle = DVec2::new(x as f64, y as f64) + 0.5;
            let index = map.surface_of(middle, photon)?;
            Some((index, self.weight(middle - place) * map.part(index)))
        });
        let weighted: Vec<(usize, f64)> = weighted.collect();
        let total: f64 = weighted.iter().map(|(_, weight)| weight).sum();
        if total > 1e-12 {
            for (index, weight) in weighted {
                map.add(index, flux * (weight / total), photon);
            }
        } else {
            map.add(own, flux, photon);
        }
    }
}

/// Adds every photon of a grid by a function of its index and its place in the map. Returns what is lost.
pub(super) fn each(map: &CausticMap, grid: &PhotonGrid, add: impl Fn(usize, (DVec2, usize)) + Sync) -> Ledger {
    let account = |index: usize| {
        let mut ledger = Ledger::default();
        let photon = &grid.photons[index];
        match map.place(photon) {
            Ok(place) => {
                add(index, place);
                ledger.deposited = Ledger::sum(photon.flux);
            }
            Err(loss) => ledger[loss] = Ledger::sum(photon.flux),
        }
        ledger
    };
    super::ledger::total(grid.own.clone(), &account)
}

/// As points: all flux goes to the texel that a photon lands in.
pub fn points(map: &CausticMap, grid: &PhotonGrid) -> Ledger {
    each(map, grid, |index, (_, texel)| add_point(map, texel, &grid.photons[index]))
}

fn add_point(map: &CausticMap, texel: usize, photon: &Photon) {
    map.add(texel, photon.flux.as_dvec3(), photon);
}

/// As splats of a diameter, texels.
pub fn of_diameter(map: &CausticMap, grid: &PhotonGrid, diameter: f64) -> Ledger {
    let splat = Splat::round(diameter);
    each(map, grid, |index, place| splat.add(map, &grid.photons[index], place))
}

/// As splats whose size follows from the distances to the light and to the receiver by a lens equation (Wyman and Dachsbacher 2006, Section 4.2).
/// `frame_spacing`: the distance between photons of all frames that are averaged, relative to that of one frame's.
pub fn of_lenses(
    map: &CausticMap,
    (grid, view): (&PhotonGrid, &LightView),
    objects: &[Object],
    (lens, frame_spacing): (Lens, f64),
) -> Ledger {
    each(map, grid, |index, place| {
        let factor = lens_factor(grid, index, objects, lens).unwrap_or(1.0);
        let spacing = frame_spacing * spacing(view, &grid.photons[index]);
        let undistorted = f64::from(LENS_SPACINGS) * spacing / f64::from(map.texel_edge(place.1));
        let diameter = (undistorted * factor).clamp(MIN_SPLAT_DIAMETER.into(), MAX_SPLAT_DIAMETER.into());
        Splat::round(diameter).add(map, &grid.photons[index], place);
    })
}

/// The distance between photons where they would land without mirrors and interfaces, metres.
fn spacing(view: &LightView, photon: &Photon) -> f64 {
    let way = &photon.way;
    let cosine = f64::from(-photon.direction.dot(photon.normal)).max(0.05);
    let length = if view.projection.is_parallel { 1.0 } else { f64::from(way.before + way.within + way.beyond) };
    length * view.projection.texel / cosine.sqrt()
}

/// As splats of their own footprints: the parallelogram between neighbours, as in ray differentials (Igehy 1999), here by finite
/// differences. `frame_spacing`: as for lenses.
pub fn of_footprints(map: &CausticMap, grid: &PhotonGrid, frame_spacing: f64) -> Ledger {
    let sheet = PhotonSheet::new(map, grid);
    each(map, grid, |index, place| match footprint(map, &sheet, index, frame_spacing) {
        Some(covariance) => Splat::elliptical(covariance).add(map, &grid.photons[index], place),
        None => add_point(map, place.1, &grid.photons[index]),
    })
}

/// Photons of clusters in the resolution that fits them: as splats of the least of the four sizes that covers the part of the receiver that a
/// photon stands for, or as points where that is within a texel (Wyman and Nichols 2009, Section 3.2.2).
pub fn of_clusters(map: &CausticMap, grid: &PhotonGrid) -> Ledger {
    let sheet = PhotonSheet::new(map, grid);
    each(map, grid, |index, place| {
        let photon = &grid.photons[index];
        let extent = sides_of(map, &sheet, index).map_or(0.0, |[u, v]| u.length().max(v.length()));
        let wanted = f64::from(LENS_SPACINGS) * extent;
        let sizes = DIAMETERS.map(f64::from);
        if wanted <= 1.0 {
            add_point(map, place.1, photon);
        } else {
            let diameter = sizes.into_iter().find(|size| *size >= wanted).unwrap_or(sizes[sizes.len() - 1]);
            Splat::round(diameter).add(map, photon, place);
        }
    })
}

/// How far a photon is from its neighbours along both axes of the view, or how large the cluster is that it stands for; texels.
pub(super) fn sides_of(map: &CausticMap, sheet: &PhotonSheet, index: usize) -> Option<[DVec2; 2]> {
    if let Some(sides) = sheet.grid.sides.get(index) {
        let middle = sheet.grid.photons[index].position;
        let place = |side: Vec3| Some(map.project(middle + 0.5 * side)? - map.project(middle - 0.5 * side)?);
        let [a, b] = (*sides)?;
        return Some([place(a)?, place(b)?]);
    }
    let is_neighbour = |one: usize, other: usize| sheet.are_connected(one, other);
    let [u, v] = sheet.grid.differences(index, is_neighbour, |index| sheet.places[index]);
    Some([u?, v?])
}

/// The covariance of a photon's footprint, texels²: that of a parallelogram with even density, and a little more.
pub(super) fn footprint(map: &CausticMap, sheet: &PhotonSheet, index: usize, frame_spacing: f64) -> Option<[f64; 3]> {
    let [u, v] = sides_of(map, sheet, index)?.map(|side| frame_spacing * side);
    let scale = f64::from(FOOTPRINT_OVERLAP * FOOTPRINT_OVERLAP) / 12.0;
    let largest = f64::from(SPLAT_REACH) * (scale * (u * u + v * v).max_element()).sqrt();
    // Very large footprints are hardly seen: they are cut.
    let scale = scale * (0.5 * f64::from(MAX_SPLAT_DIAMETER) / largest).min(1.0).powi(2);
    let least = f64::from(MIN_FOOTPRINT_DEVIATION * MIN_FOOTPRINT_DEVIATION);
    let entry = |a: f64, b: f64, c: f64, d: f64| scale * (a * b + c * d);
    Some([entry(u.x, u.x, v.x, v.x) + least, entry(u.x, u.y, v.x, v.y), entry(u.y, u.y, v.y, v.y) + least])
}

/// A 7×7 Gaussian over the texels of a map to which photons were added as points (Wyman and Davis 2006, Section 3.2.2). Texels with fewer
/// than three photons around become black; what they had is culled.
pub fn gathered(points: &CausticMap, counts: &[u32], smooth: &CausticMap) -> Ledger {
    const REACH_OF_GATHER: i64 = 3;
    const DEVIATION_OF_GATHER: f64 = 1.75;
    const LEAST_PHOTONS: u32 = 3;
    let weight = |[dx, dy]: [i64; 2]| (-((dx * dx + dy * dy) as f64) / (2.0 * DEVIATION_OF_GATHER.powi(2))).exp();
    let is_kept =
        |index: usize| points.around(index, REACH_OF_GATHER).map(|(k, _)| counts[k]).sum::<u32>() >= LEAST_PHOTONS;
    let kept: Vec<bool> = parallel::collect(counts.len(), &is_kept);
    let spread = |index: usize| {
        let mut ledger = Ledger::default();
        let flux = points.flux(index);
        if flux == DVec3::ZERO {
            return ledger;
        }
        let weight = |other: usize, offset| weight(offset) * points.part(other);
        let total: f64 = points.around(index, REACH_OF_GATHER).map(|(other, offset)| weight(other, offset)).sum();
        for (other, offset) in points.around(index, REACH_OF_GATHER) {
            let factor = weight(other, offset) / total;
            let part = flux * factor;
            if kept[other] {
                smooth.add_flux(other, part);
                smooth.add_for_gloss(other, (points, index), DVec3::splat(factor));
                ledger.deposited += part.element_sum();
            } else {
                ledger[Loss::Culled] += part.element_sum();
            }
        }
        ledger
    };
    super::ledger::total(0..counts.len(), &spread)
}
