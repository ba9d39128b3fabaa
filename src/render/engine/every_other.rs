//! Light in every other pixel, in columns and in rows, and between them: mostly it changes little from pixel to pixel.

use glam::{Vec2, Vec3, Vec4};
use obvhs::ploc::morton::morton_encode_u64;

use super::interpolation::{MAX_DEVIATION, bilinear, is_smooth};
use super::paths::EndPoint;
use super::reprojection::MIN_NORMAL_COSINE;
use crate::parallel;
use crate::stages::CameraRays;
use crate::tracing::Hit;

/// Pixels from one to the next.
pub(super) const STEP: usize = 2;
/// From pixel to pixel, interpolated light changes by no more than this part of all light.
const MAX_STEP: f32 = 0.08;

/// Points of surfaces by pixel; where a picture has several points per pixel, by those.
pub(super) trait PixelGrid: Sync {
    /// Pixels in a row.
    fn width(&self) -> usize;

    /// Column and row of a point's pixel.
    fn pixel(&self, index: usize) -> (usize, usize);

    /// The point of the same kind in the pixel at a column and a row.
    fn counterpart(&self, index: usize, column: usize, row: usize) -> Option<usize>;

    /// What is hit at a point.
    fn hit(&self, index: usize) -> Option<&Hit>;

    /// A point's place along a Z-order curve over the picture: points that follow each other on it are close together.
    fn place_on_curve(&self, index: usize) -> u64 {
        let (column, row) = self.pixel(index);
        morton_encode_u64(column as u32, row as u32, 0)
    }

    /// The least light, channel by channel, at the four points around that lie `step` pixels apart; black if one of them is not known or
    /// lies on another surface.
    fn least_around(&self, index: usize, step: usize, light: impl Fn(usize) -> Option<Vec3>) -> Vec3 {
        let (x, y) = self.pixel(index);
        let (left, top) = (x / step * step, y / step * step);
        let corner = |right: bool, below: bool| {
            let column = if right && x > left { left + step } else { left };
            let row = if below && y > top { top + step } else { top };
            let other = self.counterpart(index, column, row).filter(|_| column < self.width())?;
            light(other).filter(|_| self.may_interpolate(index, other))
        };
        let corners = [(false, false), (true, false), (false, true), (true, true)].map(|(r, b)| corner(r, b));
        corners.into_iter().try_fold(Vec3::INFINITY, |least, light| Some(least.min(light?))).unwrap_or_default()
    }

    fn may_interpolate(&self, index: usize, other: usize) -> bool {
        self.hit(index)
            .zip(self.hit(other))
            .is_some_and(|(own, there)| own.object == there.object && own.normal.dot(there.normal) >= MIN_NORMAL_COSINE)
    }

    /// Whether a point lies where the four around it, the upper ones first, lead one to expect it.
    fn lies_between(&self, index: usize, corners: [usize; 4], part: Vec2) -> bool {
        let position = |index: usize| self.hit(index).map(|hit| hit.position);
        let Some(own) = position(index) else { return false };
        let [Some(a), Some(b), Some(c), Some(d)] = corners.map(position) else { return false };
        let spacing = a.distance(b).min(a.distance(c));
        bilinear([a, b, c, d], part).distance(own) <= MAX_DEVIATION * spacing
    }

    /// The light at a point from those around it, four by four, if the inner ones are known, all that are known lie on the same smooth
    /// surface, and they are lit smoothly. `leniency`: how many times as far as on surfaces light may bend.
    fn interpolate_at(
        &self,
        index: usize,
        light: impl Fn(usize) -> Option<Vec3>,
        (beside, leniency): (Vec3, f32),
    ) -> Option<Vec3> {
        let (x, y) = self.pixel(index);
        let (columns, rows) = (places_around(x), places_around(y));
        let node = |i: usize, j: usize| {
            let column = columns[i].filter(|column| *column < self.width())?;
            self.counterpart(index, column, rows[j]?).filter(|node| self.may_interpolate(index, *node))
        };
        let inner = [node(1, 1)?, node(2, 1)?, node(1, 2)?, node(2, 2)?];
        let around = std::array::from_fn(|j| std::array::from_fn(|i| node(i, j).and_then(&light)));
        let [Some(a), Some(b), Some(c), Some(d)] = [around[1][1], around[1][2], around[2][1], around[2][2]] else {
            return None;
        };
        let part = Vec2::new((x % STEP) as f32, (y % STEP) as f32) / STEP as f32;
        let is_smooth = self.lies_between(index, inner, part) && is_smooth(&around, beside, leniency);
        is_smooth.then(|| bilinear([a, b, c, d], part))
    }
}

/// The four places along an axis between whose inner ones a place lies.
fn places_around(place: usize) -> [Option<usize>; 4] {
    let before = place / STEP * STEP;
    std::array::from_fn(|k| (before + k * STEP).checked_sub(STEP))
}

/// Every other pixel of a grid, in columns and in rows.
#[derive(Debug)]
pub(super) struct CoarserGrid<'g, G>(pub &'g G);

impl<G: PixelGrid> PixelGrid for CoarserGrid<'_, G> {
    fn width(&self) -> usize {
        self.0.width().div_ceil(STEP)
    }

    fn pixel(&self, index: usize) -> (usize, usize) {
        let (column, row) = self.0.pixel(index);
        (column / STEP, row / STEP)
    }

    fn counterpart(&self, index: usize, column: usize, row: usize) -> Option<usize> {
        self.0.counterpart(index, STEP * column, STEP * row)
    }

    fn hit(&self, index: usize) -> Option<&Hit> {
        self.0.hit(index)
    }

    fn may_interpolate(&self, index: usize, other: usize) -> bool {
        self.0.may_interpolate(index, other)
    }

    fn lies_between(&self, index: usize, corners: [usize; 4], part: Vec2) -> bool {
        self.0.lies_between(index, corners, part)
    }
}

/// Light at points of a grid, which are computed a few at a time: first every other one, then those between which cannot be
/// interpolated, until no computed point contradicts its neighbours.
#[derive(Debug)]
pub(super) struct AdaptiveLight<'g, G> {
    grid: &'g G,
    /// Other light at the points, which hides differences.
    beside: &'g [Vec3],
    /// How many times as much as on surfaces light between points may be wrong.
    leniency: f32,
    /// By point: the light, and the number of fetches. Zero where nothing is known.
    light: Vec<Vec4>,
    is_computed: Vec<bool>,
    /// Computed next.
    nodes: Vec<usize>,
    /// Interpolated, or else computed, once the nodes are known.
    others: Vec<usize>,
    interpolated: Vec<usize>,
}

impl<'g, G: PixelGrid> AdaptiveLight<'g, G> {
    /// Light at some of `count` points, in ascending order; no other light is beside it where `beside` is empty.
    pub fn new(grid: &'g G, count: usize, points: impl Iterator<Item = usize>, beside: &'g [Vec3]) -> Self {
        let (nodes, others) = points.partition(|&index| is_node(grid, index));
        let (light, is_computed) = (vec![Vec4::ZERO; count], vec![false; count]);
        Self { grid, beside, leniency: 1.0, light, is_computed, nodes, others, interpolated: Vec::new() }
    }

    /// The same for light that may be so many times as wrong between points.
    pub fn leniently(self, leniency: f32) -> Self {
        Self { leniency, ..self }
    }

    /// The points that are to be computed next, in ascending order; `None` once all light is known.
    pub fn next_open(&mut self) -> Option<Vec<usize>> {
        let mut open = std::mem::take(&mut self.nodes);
        if open.is_empty() {
            open = self.interpolate();
        }
        if open.is_empty() {
            let refuted = parallel::filter(self.interpolated.len(), &|k| self.is_refuted(self.interpolated[k]));
            open = refuted.into_iter().map(|k| self.interpolated[k]).collect();
            self.interpolated.retain(|index| open.binary_search(index).is_err());
        }
        (!open.is_empty()).then_some(open)
    }

    /// Sets the light in every other column and row, where it is known already.
    pub fn set_nodes(&mut self, light: impl Fn(usize) -> Vec4) {
        let nodes = std::mem::take(&mut self.nodes);
        self.set(nodes.into_iter().map(|index| (index, light(index))));
    }

    /// Sets what was computed at points.
    pub fn set(&mut self, computed: impl IntoIterator<Item = (usize, Vec4)>) {
        for (index, light) in computed {
            (self.light[index], self.is_computed[index]) = (light, true);
        }
    }

    /// Light that there is at a point at least, as far as the points around show.
    pub fn least(&self, index: usize) -> Vec3 {
        let known = |other: usize| self.is_computed[other].then(|| self.light[other].truncate());
        self.grid.least_around(index, STEP, known)
    }

    /// The number of points that were interpolated.
    pub fn interpolated_count(&self) -> usize {
        self.interpolated.len()
    }

    /// The light at all points, and the number of fetches.
    pub fn finish(self) -> Vec<[f32; 4]> {
        self.light.into_iter().map(Into::into).collect()
    }

    fn beside(&self, index: usize) -> Vec3 {
        self.beside.get(index).copied().unwrap_or_default()
    }

    /// Interpolates where that is possible; returns the points where it is not.
    fn interpolate(&mut self) -> Vec<usize> {
        let others = std::mem::take(&mut self.others);
        let known = |index: usize| self.is_computed[index].then(|| self.light[index].truncate());
        let between = |&index: &usize| self.grid.interpolate_at(index, known, (self.beside(index), self.leniency));
        let values: Vec<Option<Vec3>> = parallel::map(&others, &between);
        let mut open = Vec::new();
        for (index, value) in others.into_iter().zip(values) {
            let Some(value) = value else {
                open.push(index);
                continue;
            };
            self.light[index] = value.extend(0.0);
            self.interpolated.push(index);
        }
        open
    }

    /// Whether interpolated light differs from what was computed in a neighbouring pixel: something narrow runs there, which the
    /// points around have missed.
    fn is_refuted(&self, index: usize) -> bool {
        let (x, y) = self.grid.pixel(index);
        let columns = x.saturating_sub(1)..(x + 2).min(self.grid.width());
        let neighbours = (y.saturating_sub(1)..y + 2).flat_map(|row| columns.clone().map(move |column| (column, row)));
        neighbours.filter_map(|(column, row)| self.grid.counterpart(index, column, row)).any(|other| {
            self.is_computed[other] && self.grid.may_interpolate(index, other) && self.differ(index, other)
        })
    }

    fn differ(&self, index: usize, other: usize) -> bool {
        let (own, there) = (self.light[index].truncate(), self.light[other].truncate());
        (own - there).abs().max_element()
            > self.leniency * MAX_STEP * (own.max(there) + self.beside(index)).max_element()
    }
}

/// Whether a point lies in every other column and row.
pub(super) fn is_node(grid: &impl PixelGrid, index: usize) -> bool {
    let (column, row) = grid.pixel(index);
    column % STEP == 0 && row % STEP == 0
}

/// Ends of paths, in the order of their pixels.
#[derive(Debug)]
pub(super) struct EndGrid<'a> {
    points: &'a [EndPoint],
    width: usize,
}

impl<'a> EndGrid<'a> {
    /// `points` are those of a picture of this width.
    pub fn new(points: &'a [EndPoint], width: u32) -> Self {
        Self { points, width: width as usize }
    }
}

impl PixelGrid for EndGrid<'_> {
    fn width(&self) -> usize {
        self.width
    }

    fn pixel(&self, index: usize) -> (usize, usize) {
        let pixel = self.points[index].pixel as usize;
        (pixel % self.width, pixel / self.width)
    }

    /// The end of the same kind of path.
    fn counterpart(&self, index: usize, column: usize, row: usize) -> Option<usize> {
        let (pixel, key) = ((row * self.width + column) as u32, self.points[index].key);
        let first = self.points.partition_point(|point| point.pixel < pixel);
        let own = self.points[first..].iter().take_while(|point| point.pixel == pixel);
        own.enumerate().find(|(_, point)| point.key == key).map(|(offset, _)| first + offset)
    }

    fn hit(&self, index: usize) -> Option<&Hit> {
        Some(&self.points[index].hit)
    }
}

impl PixelGrid for CameraRays {
    fn width(&self) -> usize {
        self.width as usize
    }

    fn pixel(&self, index: usize) -> (usize, usize) {
        (index % self.width as usize, index / self.width as usize)
    }

    fn counterpart(&self, _: usize, column: usize, row: usize) -> Option<usize> {
        Some(row * self.width as usize + column).filter(|&index| index < self.hits.len())
    }

    fn hit(&self, index: usize) -> Option<&Hit> {
        self.hits[index].as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One end point in each pixel of a picture of 10×10, on a plane.
    fn ends(lift: impl Fn(f32, f32) -> f32) -> Vec<EndPoint> {
        let end = |pixel: u32| {
            let (x, z) = ((pixel % 10) as f32, (pixel / 10) as f32);
            let position = Vec3::new(x, lift(x, z), z);
            let hit = Hit { object: 0, position, distance: 1.0, normal: Vec3::Y, face_normal: Vec3::Y, front: true };
            EndPoint { hit, receives: true, view: Vec3::Y, pixel, key: 7, steps: [Vec3::X, Vec3::Z], blur: 0.0 }
        };
        (0..100).map(end).collect()
    }

    #[test]
    fn smooth_light_is_interpolated_on_smooth_surfaces() {
        let light = |index: usize| Some(Vec3::splat(20.0 + (index % 10) as f32 - 0.5 * (index / 10) as f32));
        let plane = ends(|_, _| 0.0);
        let grid = EndGrid::new(&plane, 10);
        let interpolated =
            |light: &dyn Fn(usize) -> Option<Vec3>, index| grid.interpolate_at(index, light, (Vec3::ZERO, 1.0));
        assert_eq!(interpolated(&light, 55), light(55));
        assert_eq!(interpolated(&light, 1), light(1), "at the edge");
        assert_eq!(interpolated(&light, 9), None, "a node would lie outside");
        assert_eq!(interpolated(&|index| light(index).filter(|_| index != 44), 55), None, "a node is not known");
        let ridge = |index: usize| Some(Vec3::splat(if index % 10 == 4 { 2.0 } else { 1.0 }));
        assert_eq!(interpolated(&ridge, 55), None);
        assert!(grid.interpolate_at(55, ridge, (Vec3::splat(100.0), 1.0)).is_some(), "not seen beside more light");
        let step = ends(|x, z| if x == 5.0 && z == 5.0 { 3.0 } else { 0.0 });
        assert_eq!(
            EndGrid::new(&step, 10).interpolate_at(55, light, (Vec3::ZERO, 1.0)),
            None,
            "off its neighbours' surface"
        );
    }

    /// A line of light one pixel wide, of which the nodes show every other pixel only.
    #[test]
    fn narrow_lines_are_followed() {
        let plane = ends(|_, _| 0.0);
        let grid = EndGrid::new(&plane, 10);
        let light = |index: usize| Vec4::splat(if index / 10 == index % 10 { 2.0 } else { 1.0 });
        let mut adaptive = AdaptiveLight::new(&grid, 100, 0..100, &[]);
        while let Some(open) = adaptive.next_open() {
            adaptive.set(open.into_iter().map(|index| (index, light(index))));
        }
        let found = adaptive.finish();
        assert!((0..100).all(|index| found[index][..3] == light(index).to_array()[..3]));
    }

    #[test]
    fn even_light_is_computed_in_a_few_points() {
        let plane = ends(|_, _| 0.0);
        let grid = EndGrid::new(&plane, 10);
        let mut adaptive = AdaptiveLight::new(&grid, 100, 0..100, &[]);
        let mut count = 0;
        while let Some(open) = adaptive.next_open() {
            count += open.len();
            adaptive.set(open.into_iter().map(|index| (index, Vec4::ONE)));
        }
        assert_eq!((count, adaptive.interpolated_count()), (52, 48), "nodes, and the last two columns and rows");
        assert!(adaptive.finish().iter().all(|light| light[..3] == [1.0; 3]));
    }
}
