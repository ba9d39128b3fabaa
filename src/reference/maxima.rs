//! Bounds of an environment image: the largest values over boxes of azimuth and polar angle, from a pyramid of maxima.

use std::f64::consts::{PI, TAU};

use super::cone::AngleBox;
use crate::image::RgbImage;

/// Ranges of values are as wide as about two cells of the level that they are first read from. So many levels below, their edges are known
/// to a tenth of that; exact ones would take most of the time of wide ranges.
const FINER: usize = 2;

/// Upper bounds of the radiance over boxes of azimuth and polar angle: a grid of values and, above it, maxima over 2×2.
#[derive(Debug, Default)]
pub(super) struct Maxima {
    levels: Vec<Level>,
    /// Whether the grid is an image that is read bilinearly; else its values hold over whole cells.
    interpolated: bool,
}

#[derive(Debug)]
struct Level {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Maxima {
    pub fn blank(width: usize, height: usize, interpolated: bool) -> Self {
        Self { levels: vec![Level { width, height, values: vec![0.0; width * height] }], interpolated }
    }

    pub fn of_latlong(image: &RgbImage) -> Self {
        let mut maxima = Self::blank(image.width, image.height, true);
        maxima.levels[0].values = image.pixels.iter().map(|p| p.iter().sum()).collect();
        maxima.build();
        maxima
    }

    /// Makes the levels above the first.
    pub fn build(&mut self) {
        self.levels.truncate(1);
        while let Some(below) = self.levels.last().filter(|l| l.width > 1 || l.height > 1) {
            let (width, height) = (below.width.div_ceil(2), below.height.div_ceil(2));
            let mut values = Vec::with_capacity(width * height);
            for (j, i) in (0..height).flat_map(|j| (0..width).map(move |i| (j, i))) {
                let (right, lower) = ((2 * i + 1).min(below.width - 1), (2 * j + 1).min(below.height - 1));
                let at = |i: usize, j: usize| below.values[j * below.width + i];
                values.push(at(2 * i, 2 * j).max(at(right, 2 * j)).max(at(2 * i, lower)).max(at(right, lower)));
            }
            self.levels.push(Level { width, height, values });
        }
    }

    /// The range of cells [first, last] along both axes that a box may read; columns may lie outside the grid and wrap.
    fn cells(&self, around: &AngleBox) -> ([i64; 2], [i64; 2], [f64; 4]) {
        let (w, h) = (self.levels[0].width as f64, self.levels[0].height as f64);
        let x = |azimuth: f64| azimuth / TAU * w - 0.5;
        let y = |polar: f64| (polar / PI * h - 0.5).clamp(0.0, h - 1.0);
        let (x0, x1) = (x(around.azimuth - around.half_azimuth), x(around.azimuth + around.half_azimuth));
        let (y0, y1) = (y(around.polar[0]), y(around.polar[1]));
        // A cell's value holds within half a cell of its centre; bilinear reads reach a whole one. A trace more for rounding.
        let reach = if self.interpolated { 0.0 } else { 0.5 };
        let range = |a: f64, b: f64| {
            let first = (a + reach - 1e-9).floor() as i64;
            let last = (b + reach + 1e-9).floor() as i64;
            [first, if self.interpolated { last + 1 } else { last }]
        };
        let [first, last] = range(y0, y1);
        let bottom = self.levels[0].height as i64 - 1;
        (range(x0, x1), [first.max(0), last.min(bottom)], [x0, x1, y0, y1])
    }

    pub fn within(&self, around: &AngleBox) -> f64 {
        let (columns, rows, [x0, x1, y0, y1]) = self.cells(around);
        let base = &self.levels[0];
        if self.interpolated && columns[1] - columns[0] == 1 && rows[1] - rows[0] <= 1 {
            // Within four texels the largest of a bilinear function is at a corner.
            let corner = |x, y| self.bilinear(x, y);
            return corner(x0, y0).max(corner(x1, y0)).max(corner(x0, y1)).max(corner(x1, y1)) * (1.0 + 1e-9);
        }
        let columns =
            if columns[1] - columns[0] + 1 >= base.width as i64 { [0, base.width as i64 - 1] } else { columns };
        let wide = (columns[1] - columns[0] + 1).max(rows[1] - rows[0] + 1);
        let level = (0..self.levels.len() - 1).find(|k| wide <= 3 << k).unwrap_or(self.levels.len() - 1);
        f64::from(self.largest(level, columns, rows))
    }

    /// At least the largest value in a range of cells, from cells of a level and, where those reach beyond the range, of the
    /// [`FINER`] levels below.
    fn largest(&self, level: usize, columns: [i64; 2], rows: [i64; 2]) -> f32 {
        let base_width = self.levels[0].width as i64;
        let (first, last) = (columns[0].rem_euclid(base_width), columns[1].rem_euclid(base_width));
        let mut largest = 0.0;
        let levels = [level.saturating_sub(FINER), level];
        if first <= last {
            self.raise(&mut largest, levels, [first, last], rows);
        } else {
            self.raise(&mut largest, levels, [first, base_width - 1], rows);
            self.raise(&mut largest, levels, [0, last], rows);
        }
        largest
    }

    /// Raises a value to the largest of a range that does not wrap; `finest` is the lowest level that is read.
    fn raise(&self, largest: &mut f32, [finest, level]: [usize; 2], columns: [i64; 2], rows: [i64; 2]) {
        let grid = &self.levels[level];
        for j in rows[0] >> level..=rows[1] >> level {
            for i in columns[0] >> level..=columns[1] >> level {
                let value = grid.values[j as usize * grid.width + i as usize];
                if value <= *largest {
                    continue;
                }
                let part = |k: i64, [first, last]: [i64; 2]| {
                    [first.max(k << level), last.min((k << level) + (1 << level) - 1)]
                };
                let (inner_columns, inner_rows) = (part(i, columns), part(j, rows));
                let whole = |[first, last]: [i64; 2]| last - first + 1 == 1 << level;
                if level == finest || whole(inner_columns) && whole(inner_rows) {
                    *largest = value;
                } else {
                    self.raise(largest, [finest, level - 1], inner_columns, inner_rows);
                }
            }
        }
    }

    fn bilinear(&self, x: f64, y: f64) -> f64 {
        let Level { width, height, values } = &self.levels[0];
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let column = |i: i64| i.rem_euclid(*width as i64) as usize;
        let (left, right) = (column(x0 as i64), column(x0 as i64 + 1));
        let (upper, lower) = (y0 as usize, (y0 as usize + 1).min(height - 1));
        let at = |i: usize, j: usize| f64::from(values[j * width + i]);
        let row = |j: usize| (1.0 - fx) * at(left, j) + fx * at(right, j);
        (1.0 - fy) * row(upper) + fy * row(lower)
    }

    /// Raises every cell of a box to at least a value.
    pub fn spread(&mut self, around: &AngleBox, value: f32) {
        let (columns, rows, _) = self.cells(around);
        let grid = &mut self.levels[0];
        let width = grid.width as i64;
        for j in rows[0]..=rows[1] {
            for i in columns[0]..=columns[1].min(columns[0] + width - 1) {
                let cell = &mut grid.values[(j * width + i.rem_euclid(width)) as usize];
                *cell = cell.max(value);
            }
        }
    }
}
