//! Polygons between neighbouring photons, whose flux is spread evenly: by the centres of the texels that they cover, or by exact areas.
//!
//! Every photon gives a sixth or a third of its flux to each of the triangles around it. What belongs to triangles that do not exist, at
//! silhouettes and where the light is torn, is spread over the photon's footprint. So is all flux accounted for.

use glam::{DVec2, DVec3};

use super::caustic_map::CausticMap;
use super::constants::MIN_DRAWN_AREA;
use super::ledger::{Ledger, Loss, total};
use super::photons::{Photon, PhotonGrid};
use super::sheet::{BEHIND, PhotonSheet};
use super::splats::{Splat, footprint, sides_of};

/// How the flux of a triangle is spread over texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coverage {
    /// Evenly over the texels whose centres it covers, as rasterizers see it (Wyman and Davis 2006, Section 3.2.1).
    Centres {
        /// Nothing else is drawn: what belongs to small triangles, and to those that do not exist, is culled.
        alone: bool,
    },
    /// By the area of each texel that it covers.
    Exact,
}

/// Triangles smaller than this, texels², are points even by exact areas, which are not worth the work.
const MIN_EXACT_AREA: f64 = 1e-9;

/// The corners of a cell's triangles by their place in it: right + 2 · below.
const TRIANGLES: [[usize; 3]; 2] = [[0, 1, 2], [1, 3, 2]];

/// How many triangles of a cell a corner belongs to.
const TRIANGLES_OF_CORNER: [f64; 4] = [1.0, 2.0, 2.0, 1.0];

/// Adds the light between photons to a map.
pub fn polygons(map: &CausticMap, grid: &PhotonGrid, coverage: Coverage) -> Ledger {
    let sheet = PhotonSheet::new(map, grid);
    let columns = i64::from(grid.size[0]) + 1;
    // Cells around the grid, too, so that all photons belong to four: a row of cells goes with the row of photons above it.
    let (first, end) = (grid.strip.first_own_row, grid.strip.first_own_row + grid.strip.own_rows);
    let first = i64::from(first) - i64::from(grid.strip.is_first());
    let rows = i64::from(end) - first;
    let cell = |k: usize| {
        let (x, y) = (k as i64 % columns - 1, k as i64 / columns + first);
        let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| grid.index_at(x + dx, y + dy));
        Cell { map, sheet: &sheet, coverage }.add(corners)
    };
    total(0..(columns * rows) as usize, &cell)
}

struct Cell<'a> {
    map: &'a CausticMap<'a>,
    sheet: &'a PhotonSheet<'a>,
    coverage: Coverage,
}

impl Cell<'_> {
    fn add(&self, corners: [Option<usize>; 4]) -> Ledger {
        let mut ledger = Ledger::default();
        if let [Some(a), Some(b), Some(c), Some(d)] = corners
            && [(a, b), (c, d), (a, c), (b, d)].into_iter().all(|(one, other)| self.sheet.are_connected(one, other))
        {
            for triangle in TRIANGLES {
                ledger += self.add_triangle(triangle.map(|k| [a, b, c, d][k]));
            }
            return ledger;
        }
        for (corner, triangles) in corners.into_iter().zip(TRIANGLES_OF_CORNER) {
            let Some(corner) = corner else { continue };
            let photon = &self.sheet.grid.photons[corner];
            let flux = photon.flux.as_dvec3() * (triangles / 6.0);
            if self.coverage == (Coverage::Centres { alone: true }) {
                ledger[Loss::Culled] += flux.element_sum();
            } else {
                ledger += self.add_footprint(corner, flux);
            }
        }
        ledger
    }

    /// Adds flux of a photon over its footprint, as far as that is known and larger than a texel: what is smaller would only leave its edge.
    fn add_footprint(&self, index: usize, flux: DVec3) -> Ledger {
        let (photon, place) = (&self.sheet.grid.photons[index], self.sheet.places[index]);
        let own = self.map.surface_of(place, photon).filter(|_| self.map.has(place));
        let is_large =
            sides_of(self.map, self.sheet, index).is_some_and(|[u, v]| u.length_squared() + v.length_squared() > 1.0);
        match own.zip(footprint(self.map, self.sheet, index, 1.0)).filter(|_| is_large) {
            Some((own, covariance)) => {
                Splat::elliptical(covariance).add_flux(self.map, (photon, flux), (place, own));
                Ledger { deposited: flux.element_sum(), ..Ledger::default() }
            }
            None => self.add_point(photon, place, flux),
        }
    }

    /// Adds flux at a place of the surface that a photon lands on.
    fn add_point(&self, photon: &Photon, place: DVec2, flux: DVec3) -> Ledger {
        let mut ledger = Ledger::default();
        let amount = flux.element_sum();
        if !self.map.has(place) {
            ledger[Loss::OffMap] = amount;
        } else if let Some(index) = self.map.surface_of(place, photon) {
            self.map.add(index, flux, photon);
            ledger.deposited = amount;
        } else {
            ledger[Loss::Hidden] = amount;
        }
        ledger
    }

    fn add_triangle(&self, corners: [usize; 3]) -> Ledger {
        let photons = corners.map(|index| &self.sheet.grid.photons[index]);
        let flux: DVec3 = photons.iter().map(|photon| photon.flux.as_dvec3() / 6.0).sum();
        let triangle = corners.map(|index| self.sheet.places[index]);
        let [a, b, c] = triangle;
        if triangle.contains(&BEHIND) {
            return Ledger { off_map: flux.element_sum(), ..Ledger::default() };
        }
        let area = 0.5 * (b - a).perp_dot(c - a).abs();
        let least = match self.coverage {
            Coverage::Centres { alone: false } => f64::from(MIN_DRAWN_AREA),
            Coverage::Centres { alone: true } | Coverage::Exact => MIN_EXACT_AREA,
        };
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let is_within_texel = self.coverage == Coverage::Exact && low.floor() == high.floor();
        if area < least || is_within_texel {
            return self.add_point(photons[0], (a + b + c) / 3.0, flux);
        }
        match self.coverage {
            Coverage::Centres { .. } => self.add_centres(photons[0], triangle, area, flux),
            Coverage::Exact => self.add_areas(photons[0], triangle, area, flux),
        }
    }

    /// As a rasterizer does: every texel whose centre is covered gets the triangle's irradiance. Small triangles have too much or too little.
    fn add_centres(&self, photon: &Photon, triangle: [DVec2; 3], area: f64, flux: DVec3) -> Ledger {
        let mut ledger = Ledger::default();
        let (part, amount) = (flux / area, flux.element_sum() / area);
        let [a, b, c] = triangle;
        let size = DVec2::from_array(self.map.size().map(f64::from));
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let (first, last) = ((low - 0.5).ceil().max(DVec2::ZERO), (high - 0.5).floor().min(size - 1.0));
        let mut y = first.y;
        while y <= last.y {
            let mut x = first.x;
            while x <= last.x {
                let centre = DVec2::new(x, y) + 0.5;
                if covers(triangle, centre) {
                    let index = self.map.surface_of(centre, photon);
                    let seen = index.map_or(0.0, |index| self.map.part(index));
                    if let Some(index) = index {
                        self.map.add(index, part * seen, photon);
                    }
                    ledger.deposited += amount * seen;
                    ledger[Loss::Hidden] += amount * (1.0 - seen);
                }
                x += 1.0;
            }
            y += 1.0;
        }
        if low.cmplt(DVec2::ZERO).any() || high.cmpgt(size).any() {
            // Across the map's edge, what is not inside is outside.
            ledger[Loss::OffMap] += (flux.element_sum() - ledger.deposited - ledger[Loss::Hidden]).max(0.0);
        }
        ledger
    }

    fn add_areas(&self, photon: &Photon, triangle: [DVec2; 3], area: f64, flux: DVec3) -> Ledger {
        let mut ledger = Ledger::default();
        let amount = flux.element_sum();
        let mut rest = 1.0;
        for_each_texel(triangle, self.map.size(), |centre, covered| {
            rest -= covered / area;
            let index = self.map.surface_of(centre, photon);
            // What is larger than the part that is seen lies behind something.
            let seen = covered.min(index.map_or(0.0, |index| self.map.part(index)));
            if let Some(index) = index {
                self.map.add(index, flux * (seen / area), photon);
            }
            ledger.deposited += amount * (seen / area);
            ledger[Loss::Hidden] += amount * ((covered - seen) / area);
        });
        ledger[Loss::OffMap] += amount * rest;
        ledger
    }
}

/// Whether a triangle covers a point; of two triangles with a common edge, one covers points on it.
fn covers(triangle: [DVec2; 3], point: DVec2) -> bool {
    let [a, b, c] = triangle;
    let side = (b - a).perp_dot(c - a).signum();
    (0..3).all(|k| {
        let (from, to) = (triangle[k], triangle[(k + 1) % 3]);
        let across = side * (to - from).perp_dot(point - from);
        let along = side * (to - from);
        across > 0.0 || across == 0.0 && (along.y > 0.0 || along.y == 0.0 && along.x < 0.0)
    })
}

/// Calls with the centre and the covered area of every texel of a map that a triangle covers.
fn for_each_texel(triangle: [DVec2; 3], [width, height]: [u32; 2], mut call: impl FnMut(DVec2, f64)) {
    let [a, b, c] = triangle;
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let end = |high: f64, size: u32| high.ceil().min(f64::from(size));
    let mut row = Polygon::new(&triangle);
    let (mut strip, mut piece) = (Polygon::default(), Polygon::default());
    let mut y = low.y.floor().max(0.0);
    while y < end(high.y, height) {
        row.clipped_between(DVec2::Y, [y, y + 1.0], &mut strip);
        if let Some((left, right)) = strip.extent_x() {
            let mut x = left.floor().max(0.0);
            while x < end(right, width) {
                strip.clipped_between(DVec2::X, [x, x + 1.0], &mut piece);
                let area = piece.area();
                if area > 0.0 {
                    call(DVec2::new(x, y) + 0.5, area);
                }
                x += 1.0;
            }
        }
        y += 1.0;
    }
}

/// A convex polygon in texels.
#[derive(Default)]
struct Polygon {
    corners: Vec<DVec2>,
    /// Clipped once.
    half: Vec<DVec2>,
}

impl Polygon {
    fn new(corners: &[DVec2]) -> Self {
        Self { corners: corners.to_vec(), half: Vec::new() }
    }

    /// What lies between two lines across an axis.
    fn clipped_between(&mut self, axis: DVec2, [low, high]: [f64; 2], into: &mut Self) {
        clip(&self.corners, &mut self.half, |p| p.dot(axis) - low);
        clip(&self.half, &mut into.corners, |p| high - p.dot(axis));
    }

    fn extent_x(&self) -> Option<(f64, f64)> {
        let xs = self.corners.iter().map(|p| p.x);
        (self.corners.len() >= 3).then(|| xs.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x))))
    }

    fn area(&self) -> f64 {
        let Some((first, others)) = self.corners.split_first() else { return 0.0 };
        let fan = others.windows(2).map(|pair| (pair[0] - *first).perp_dot(pair[1] - *first));
        0.5 * fan.sum::<f64>().abs()
    }
}

/// The part of a polygon on the side of a line where the distance is positive (Sutherland and Hodgman 1974).
fn clip(polygon: &[DVec2], into: &mut Vec<DVec2>, distance: impl Fn(DVec2) -> f64) {
    into.clear();
    for (k, &from) in polygon.iter().enumerate() {
        let to = polygon[(k + 1) % polygon.len()];
        let (near, far) = (distance(from), distance(to));
        if near >= 0.0 {
            into.push(from);
        }
        if near > 0.0 && far < 0.0 || near < 0.0 && far > 0.0 {
            into.push(from.lerp(to, near / (near - far)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Areas add up to the triangle's, and centres to about as much; two halves of a square cover each texel once.
    #[test]
    fn triangles_cover_their_area() {
        for k in 0..200u32 {
            let [a, b, c, d] = sobol_burley::sample_4d(k, 0, 1).map(f64::from);
            let [e, f, ..] = sobol_burley::sample_4d(k, 1, 1).map(f64::from);
            let triangle = [DVec2::new(a, b), DVec2::new(c, d), DVec2::new(e, f)].map(|p| 12.0 * p + 2.0);
            let expected = 0.5 * (triangle[1] - triangle[0]).perp_dot(triangle[2] - triangle[0]).abs();
            let mut area = 0.0;
            for_each_texel(triangle, [16, 16], |_, covered| area += covered);
            assert!((area - expected).abs() < 1e-9, "{area} {expected}");
        }
        // Centres lie on its edges: those of two sides count.
        let square = [DVec2::new(1.5, 1.5), DVec2::new(6.5, 1.5), DVec2::new(1.5, 6.5), DVec2::new(6.5, 6.5)];
        let covering = |k: u32| {
            let centre = DVec2::new(f64::from(k % 8), f64::from(k / 8)) + 0.5;
            TRIANGLES.iter().filter(|t| covers(t.map(|corner| square[corner]), centre)).count()
        };
        assert!((0..64).all(|k| covering(k) <= 1));
        assert_eq!((0..64).map(covering).sum::<usize>(), 25);
    }
}
