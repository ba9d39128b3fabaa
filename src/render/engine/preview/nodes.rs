//! Light in every pixel from light at nodes some pixels apart: interpolated between nodes on the same surface, weighted by distance
//! in the picture, and computed where there are none or where they differ: first half as far apart, then in every pixel.

use glam::{Vec3, Vec4};
use rustc_hash::FxHashMap;

use super::filled;
use super::views::{Layer, SurfacePoint};
use crate::parallel;
use crate::pinhole::constants::{MAX_CONTRAST, MAX_OFF_PLANE, MIN_NORMAL_COSINE, MIN_WEIGHT};
use crate::tracing::Hit;

/// Nodes along the edge of a square whose light is computed side by side: as many as lanes.
const SQUARE: usize = 4;

/// Points of surfaces, one or none in each pixel, and the light that is known there.
pub struct NodeGrid<'a> {
    points: &'a Layer<SurfacePoint>,
    width: usize,
    /// Pixels from one known pixel to the next, along rows and columns.
    spacing: usize,
    /// The last component is 1 where it is known, else 0.
    light: Vec<Vec4>,
}

/// How far apart pixels are that are looked at next, once those `spacing` apart are known.
pub fn finer_spacing(spacing: u32) -> u32 {
    if spacing.is_multiple_of(2) { spacing / 2 } else { 1 }
}

impl<'a> NodeGrid<'a> {
    pub fn new(points: &'a Layer<SurfacePoint>, width: usize, spacing: usize) -> Self {
        Self { points, width, spacing, light: filled(Vec4::ZERO, points.pixels()) }
    }

    /// Takes over light that is known already.
    pub fn with_known(mut self, known: impl Fn(&SurfacePoint) -> Option<Vec3> + Sync) -> Self {
        parallel::for_each_chunk(&mut self.light, self.width, &|row, light| {
            for (index, light) in (row * self.width..).zip(light) {
                if let Some(known) = self.points.at(index).and_then(&known) {
                    *light = known.extend(1.0);
                }
            }
        });
        self
    }

    /// The pixels that are nodes, as far as their light is not known.
    pub fn nodes(&self) -> Vec<usize> {
        self.unknown(self.spacing).concat()
    }

    fn is_known(&self, index: usize) -> bool {
        self.light[index].w > 0.0
    }

    /// The pixels of a grid whose light is not known, by bands of [`SQUARE`] rows of the grid and square by square: what is near each other
    /// is computed side by side.
    fn unknown(&self, spacing: usize) -> Vec<Vec<usize>> {
        let (width, height) = (self.width, self.points.pixels() / self.width);
        let square = SQUARE * spacing;
        let within = |first: usize, edge: usize| (first..edge.min(first + square)).step_by(spacing);
        let is_unknown = |index: &usize| !self.is_known(*index) && self.points.at(*index).is_some();
        let of_squares = |top: usize| {
            let of_square = move |left: usize| {
                within(top, height).flat_map(move |y| within(left, width).map(move |x| y * width + x))
            };
            (0..width).step_by(square).flat_map(of_square).filter(is_unknown).collect::<Vec<_>>()
        };
        parallel::collect(height.div_ceil(square), &|row| of_squares(row * square))
    }

    pub fn point(&self, index: usize) -> Option<&'a SurfacePoint> {
        self.points.at(index)
    }

    pub fn hit(&self, index: usize) -> Option<&'a Hit> {
        self.points.at(index).map(|point| &point.hit)
    }

    /// Groups of places in a list of pixels that lie in the same square of the picture, on the same object.
    pub fn groups(&self, which: &[usize], edge: usize) -> Vec<Vec<usize>> {
        let edge = edge * self.spacing;
        let mut groups: FxHashMap<(usize, usize, u32), Vec<usize>> = FxHashMap::default();
        for (place, &index) in which.iter().enumerate() {
            if let Some(hit) = self.hit(index) {
                let (x, y) = (index % self.width, index / self.width);
                groups.entry((y / edge, x / edge, hit.object)).or_default().push(place);
            }
        }
        groups.into_values().collect()
    }

    /// Takes what was computed at pixels. Returns those that have to be computed next.
    pub fn set(&mut self, which: &[usize], light: Vec<Vec3>) -> Vec<usize> {
        for (&index, light) in which.iter().zip(light) {
            self.light[index] = light.extend(1.0);
        }
        let mut open = Vec::new();
        while open.is_empty() && self.spacing > 1 {
            let finer = finer_spacing(self.spacing as u32) as usize;
            open = self.interpolate(finer);
            self.spacing = finer;
        }
        open
    }

    /// Interpolates in the pixels of a finer grid. Returns those in which it cannot be.
    fn interpolate(&mut self, spacing: usize) -> Vec<usize> {
        let between = self.unknown(spacing);
        let of_band = |band: &Vec<usize>| band.iter().map(|&index| self.interpolated(index)).collect();
        let found: Vec<Vec<Option<Vec3>>> = parallel::map(&between, &of_band);
        let pixels = SQUARE * spacing * self.width;
        let take = |band: usize, light: &mut [Vec4]| {
            let mut open = Vec::new();
            for (&index, found) in between[band].iter().zip(&found[band]) {
                match found {
                    Some(found) => light[index - band * pixels] = found.extend(1.0),
                    None => open.push(index),
                }
            }
            open
        };
        parallel::map_chunks_mut(&mut self.light, pixels, &take).concat()
    }

    /// The light in all pixels.
    pub fn finish(self) -> Vec<Vec3> {
        self.light.into_iter().map(Vec4::truncate).collect()
    }

    /// The light in a pixel from the nodes around it, if there are enough on the same surface and they agree; from nodes one step
    /// farther, if the four around it lie on other surfaces.
    fn interpolated(&self, index: usize) -> Option<Vec3> {
        let own = self.points.at(index)?;
        match self.between_nodes(index, own) {
            Found::Light(light) => Some(light),
            Found::Edge => None,
            Found::Nothing => self.beyond_nodes(index, own),
        }
    }

    /// The mean over the nodes of the same surface in the square of four by four around a pixel.
    fn beyond_nodes(&self, index: usize, own: &SurfacePoint) -> Option<Vec3> {
        let (x, y) = (index % self.width / self.spacing, index / self.width / self.spacing);
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
        for row in y.saturating_sub(1)..=y + 2 {
            for column in x.saturating_sub(1)..=x + 2 {
                let (column, row) = (column * self.spacing, row * self.spacing);
                let node = row * self.width + column;
                if column >= self.width || node >= self.points.pixels() || !self.is_known(node) {
                    continue;
                }
                if let Some(other) = self.points.at(node).filter(|other| is_same_surface(own, other)) {
                    let weight = 1.0 / (1e-12 + own.hit.position.distance_squared(other.hit.position));
                    sum += weight * self.light[node].truncate();
                    weights += weight;
                }
            }
        }
        (weights > 0.0).then(|| sum / weights)
    }

    fn between_nodes(&self, index: usize, own: &SurfacePoint) -> Found {
        let (x, y) = (index % self.width, index / self.width);
        let (left, top) = (x / self.spacing * self.spacing, y / self.spacing * self.spacing);
        let part = |along: usize, first: usize| (along - first) as f32 / self.spacing as f32;
        let (u, v) = (part(x, left), part(y, top));
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
        let (mut least, mut most) = (f32::INFINITY, 0.0f32);
        for (dx, dy, weight) in [
            (0, 0, (1.0 - u) * (1.0 - v)),
            (self.spacing, 0, u * (1.0 - v)),
            (0, self.spacing, (1.0 - u) * v),
            (self.spacing, self.spacing, u * v),
        ] {
            let (column, row) = (left + dx, top + dy);
            let node = row * self.width + column;
            if column >= self.width || node >= self.points.pixels() || weight == 0.0 {
                continue;
            }
            let is_known = |other: &SurfacePoint| self.is_known(node) && is_same_surface(own, other);
            if !self.points.at(node).is_some_and(is_known) {
                continue;
            }
            let light = self.light[node].truncate();
            sum += weight * light;
            weights += weight;
            let brightness = light.element_sum();
            (least, most) = (least.min(brightness), most.max(brightness));
        }
        if weights < MIN_WEIGHT {
            return Found::Nothing;
        }
        if most - least > MAX_CONTRAST * most {
            return Found::Edge;
        }
        Found::Light(sum / weights)
    }
}

/// What lies between four nodes.
enum Found {
    Light(Vec3),
    /// Light that differs too much from node to node.
    Edge,
    /// Other surfaces.
    Nothing,
}

fn is_same_surface(own: &SurfacePoint, other: &SurfacePoint) -> bool {
    let (a, b) = (&own.hit, &other.hit);
    let step = b.position - a.position;
    a.object == b.object
        && a.front == b.front
        && own.path == other.path
        && a.normal.dot(b.normal) >= MIN_NORMAL_COSINE
        && step.dot(a.normal).abs() <= MAX_OFF_PLANE * step.length()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(object: impl Fn(usize, usize) -> u32) -> Vec<SurfacePoint> {
        let point = |k: usize| {
            let (x, y) = (k % 9, k / 9);
            let position = Vec3::new(x as f32, 0.0, y as f32);
            let hit = Hit {
                object: object(x, y),
                position,
                distance: 1.0,
                normal: Vec3::Y,
                face_normal: Vec3::Y,
                front: true,
            };
            SurfacePoint { hit, receives: true, is_glossy: false, factor: Vec3::ONE, path: 0 }
        };
        (0..81).map(point).collect()
    }

    fn solve(points: &[SurfacePoint], spacing: usize, light: impl Fn(usize) -> Vec3) -> (Vec<Vec3>, usize) {
        let layer = Layer::of_points(points.iter().cloned());
        let mut grid = NodeGrid::new(&layer, 9, spacing);
        let (mut open, mut computed) = (grid.nodes(), 0);
        while !open.is_empty() {
            computed += open.len();
            open = grid.set(&open, open.iter().map(|&index| light(index)).collect());
        }
        (grid.finish(), computed)
    }

    #[test]
    fn light_that_changes_evenly_is_interpolated() {
        let light = |index: usize| Vec3::splat(100.0 + (index % 9) as f32 + 2.0 * (index / 9) as f32);
        let (found, computed) = solve(&plane(|_, _| 0), 4, light);
        assert_eq!(computed, 9);
        assert!((0..81).all(|index| (found[index] - light(index)).abs().max_element() < 1e-3));
    }

    #[test]
    fn edges_of_surfaces_and_of_light_stay_sharp() {
        let by_column = |index: usize| Vec3::splat(if index % 9 < 3 { 1.0 } else { 10.0 });
        for object in [|x, _| u32::from(x >= 3), |_, _| 0] {
            let (found, computed) = solve(&plane(object), 4, by_column);
            assert!((0..81).all(|index| found[index] == by_column(index)), "{found:?}");
            assert!(computed < 81);
        }
    }
}
