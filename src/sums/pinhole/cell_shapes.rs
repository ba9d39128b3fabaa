//! Over which part of the surface small lights are blurred: the same for neighbouring cells, whatever their own shapes.
//!
//! A sum of cells is even where each is spread over its own moments and, beyond that, all are blurred alike. Blurred in proportion to its own
//! sides, each would leave its neighbours' light uneven, however wide the blur. This module must not know lights.

use glam::Vec3;

use super::constants::{BLURRED_REACH, MAX_EVEN_ASPECT, MIN_EVEN_PART};

/// What the cells of samples have in common.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CellShapes {
    /// Cells are about as wide as long in the directions that receivers at this distance see in them, metres; 0: on the surface.
    pub reach: f32,
    /// The mean area of the smallest cells, m²; 0 where the density of samples varies.
    pub area: f32,
}

impl CellShapes {
    /// Samples lie evenly if at least this part of them
    const EVEN_PART: f64 = 0.9;
    /// has areas that are at most so many times the median, or its reciprocal.
    const EVEN_RATIO: f32 = 2.0;

    /// Of samples with these areas, m², each of which is divided into so many leaves.
    pub fn new(mut areas: Vec<f32>, leaves: u32, reach: f32) -> Self {
        areas.retain(|area| *area > 0.0);
        let all = areas.len();
        if all == 0 {
            return Self { reach, area: 0.0 };
        }
        let median = *areas.select_nth_unstable_by(all / 2, f32::total_cmp).1;
        areas.retain(|area| area.max(median) <= Self::EVEN_RATIO * area.min(median));
        let even = areas.len() as f64;
        let mean = areas.iter().map(|area| f64::from(*area)).sum::<f64>() / even / f64::from(leaves);
        Self { reach, area: if even >= Self::EVEN_PART * all as f64 { mean as f32 } else { 0.0 } }
    }

    /// The mean area, m², of the cells of the level to which one of this area belongs. Levels differ by powers of four.
    /// Its own area where the density varies.
    #[inline]
    pub fn typical_area(&self, area: f32) -> f32 {
        if self.area <= 0.0 {
            return area;
        }
        // Rounded off the middle, where groups of two cells are.
        self.area * (2.0 * (0.5 * (area / self.area).log2() + 0.4).floor()).exp2()
    }

    /// How much farther than the footprint of a cell of this area its blur reaches.
    #[inline]
    pub fn blurred_reach(&self, area: f32) -> f32 {
        1.0 + (BLURRED_REACH - 1.0) * (self.typical_area(area) / area.max(f32::MIN_POSITIVE)).sqrt()
    }
}

/// The sides of an even cell in place of those of a cell, as combinations of these: as wide as long in the directions that receivers at
/// [`CellShapes::reach`] see in it, and of the [`CellShapes::typical_area`].
#[derive(Clone, Copy, Debug)]
pub struct EvenSides {
    /// What the first one has of either side.
    pub first: [f32; 2],
    /// What the second one has of the second side.
    pub second: f32,
}

impl EvenSides {
    /// For a cell of this area, m², with these sides on the surface and these changes of its normal along them.
    pub fn new(area: f32, [a, b]: [Vec3; 2], [c, d]: [Vec3; 2], shapes: CellShapes) -> Self {
        // A turn of the normal turns reflected directions twice as far.
        let turn = 4.0 * shapes.reach * shapes.reach;
        let g11 = a.length_squared() + turn * c.length_squared();
        let g12 = a.dot(b) + turn * c.dot(d);
        let g22 = b.length_squared() + turn * d.length_squared();
        let root = (g11 * g22 - g12 * g12).max(0.0).sqrt();
        let root = root.max((g11 + g22) / MAX_EVEN_ASPECT).max(f32::MIN_POSITIVE);
        // The parallelogram has the cell's moments, but not its area.
        let parallelogram = a.cross(b).length().max(MIN_EVEN_PART * area).max(f32::MIN_POSITIVE);
        let scale = shapes.typical_area(area) / parallelogram / root;
        // Cholesky's factor of scale · det G · G⁻¹.
        let first = (g22 * scale).sqrt().max(f32::MIN_POSITIVE);
        let mixed = -g12 * scale / first;
        Self { first: [first, mixed], second: (g11 * scale - mixed * mixed).max(0.0).sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cells of other shapes and areas, on a plane and on a cylinder, have the same even sides: those of a square, or of a rectangle that is
    /// longer along the cylinder by what receivers see in it.
    #[test]
    fn even_sides_depend_on_the_surface_alone() {
        let shapes = CellShapes::new(vec![1.0; 9], 1, 2.0);
        for curvature in [0.0, 0.5] {
            for sides in [[[1.0, 0.0], [0.0, 1.0]], [[1.2, 0.3], [-0.2, 0.8]], [[0.8, -0.1], [0.5, 0.9]]] {
                let sides = sides.map(|[x, y]| Vec3::new(x, 0.0, y));
                let changes = sides.map(|side| curvature * side.x * Vec3::X);
                let even = EvenSides::new(0.9, sides, changes, shapes);
                let [a, b] = [even.first[0] * sides[0] + even.first[1] * sides[1], even.second * sides[1]];
                // Their moments.
                let [xx, xz, zz] = [a.x * a.x + b.x * b.x, a.x * a.z + b.x * b.z, a.z * a.z + b.z * b.z];
                let aspect = (1.0 + 16.0 * curvature * curvature).sqrt();
                for (found, expected) in [(xx, 1.0 / aspect), (xz, 0.0), (zz, aspect)] {
                    assert!((found - expected).abs() < 1e-4, "{curvature} {sides:?}: {xx} {xz} {zz}");
                }
            }
        }
    }

    #[test]
    fn areas_are_those_of_levels() {
        let shapes = CellShapes::new(vec![0.7, 0.9, 1.0, 1.1, 1.3, 1.0, 1.0, 1.0, 1.0, 1.0, 0.1], 4, 0.0);
        let leaf = shapes.area;
        assert!((leaf - 0.25).abs() < 1e-6, "{leaf}");
        for (area, expected) in [(0.25, leaf), (0.3, leaf), (0.02, leaf / 16.0), (1.2, 4.0 * leaf), (13.0, 64.0 * leaf)]
        {
            assert!((shapes.typical_area(area) / expected - 1.0).abs() < 1e-5, "{area}");
        }
        let uneven = CellShapes::new(vec![1.0, 4.0, 9.0, 16.0], 1, 0.0);
        assert_eq!((uneven.area, uneven.typical_area(3.0)), (0.0, 3.0));
    }
}
