//! What of a light's view shows anything that casts caustics: a pyramid of texels, so that thin objects are not missed between rays.

use glam::{DVec2, Vec3};

use super::projection::Projection;

/// The finest level has at most so many texels along an edge.
const FINEST: u32 = 1024;

/// Whether each texel shows a caster, from coarse to fine levels; each has twice as many texels along an edge as the one before.
#[derive(Clone, Debug)]
pub struct Coverage {
    levels: Vec<Vec<bool>>,
}

impl Coverage {
    /// Draws triangles into a view; texels that they touch count. `spread`: how far from there they may appear, in the plane's unit.
    pub fn new(view: &Projection, spread: f64, triangles: impl Iterator<Item = [Vec3; 3]>) -> Self {
        let size = view.size[0].next_power_of_two().min(FINEST);
        let view = view.resized(size);
        let mut texels = vec![false; size as usize * size as usize];
        for triangle in triangles {
            match triangle.map(|corner| view.project(corner)) {
                [Some(a), Some(b), Some(c)] => draw(&mut texels, size, [a, b, c]),
                [None, None, None] => (),
                // It passes behind the light.
                _ => texels.fill(true),
            }
        }
        let reach = (spread / view.texel).ceil() as usize;
        let mut levels =
            vec![dilated(&dilated(&texels, size as usize, (reach, 1)), size as usize, (reach, size as usize))];
        let mut size = size as usize;
        while size > 1 {
            size /= 2;
            let finer = &levels[levels.len() - 1];
            let any = |k: usize| {
                let (x, y) = (2 * (k % size), 2 * (k / size));
                [(0, 0), (1, 0), (0, 1), (1, 1)].iter().any(|(dx, dy)| finer[(y + dy) * 2 * size + x + dx])
            };
            levels.push((0..size * size).map(any).collect());
        }
        levels.reverse();
        Self { levels }
    }

    /// The number of levels, and a bit for each of their texels, level after level, in words from the lowest bit up.
    #[cfg(feature = "gpu")]
    pub fn bits(&self) -> (u32, Vec<u32>) {
        let texels: Vec<bool> = self.levels.iter().flatten().copied().collect();
        let word = |bits: &[bool]| (0..).zip(bits).fold(0, |word, (k, bit)| word | u32::from(*bit) << k);
        (self.levels.len() as u32, texels.chunks(32).map(word).collect())
    }

    /// The texels of a grid that may show a caster.
    #[cfg(feature = "gpu")]
    pub fn texels_of(&self, grid: u32) -> Vec<[u32; 2]> {
        let all = (0..grid).flat_map(|y| (0..grid).map(move |x| [x, y]));
        all.filter(|texel| self.has(*texel, grid)).collect()
    }

    /// Whether a texel of a grid of so many along an edge, a power of two, may show a caster.
    pub fn has(&self, [x, y]: [u32; 2], grid: u32) -> bool {
        let level = (grid.ilog2() as usize).min(self.levels.len() - 1);
        let shift = grid.ilog2() - level as u32;
        self.levels[level][((y >> shift) << level) as usize + (x >> shift) as usize]
    }
}

/// With all texels up to `reach` before and after each one, `stride` apart: along rows or columns.
fn dilated(texels: &[bool], size: usize, (reach, stride): (usize, usize)) -> Vec<bool> {
    if reach == 0 {
        return texels.to_vec();
    }
    let mut wider = vec![false; texels.len()];
    for (index, _) in texels.iter().enumerate().filter(|(_, is_covered)| **is_covered) {
        let place = index / stride % size;
        let (first, last) = (place.saturating_sub(reach), (place + reach).min(size - 1));
        (first..=last).for_each(|other| wider[index + other * stride - place * stride] = true);
    }
    wider
}

fn draw(texels: &mut [bool], size: u32, triangle: [DVec2; 3]) {
    let [a, b, c] = triangle;
    let last = DVec2::splat(f64::from(size) - 1.0);
    let (low, high) = (a.min(b).min(c).floor().max(DVec2::ZERO), a.max(b).max(c).floor().min(last));
    let mut y = low.y;
    while y <= high.y {
        let mut x = low.x;
        while x <= high.x {
            if touches(triangle, DVec2::new(x, y)) {
                texels[(y * f64::from(size) + x) as usize] = true;
            }
            x += 1.0;
        }
        y += 1.0;
    }
}

/// Whether a triangle touches a texel within its bounding box: no side of it separates the two.
fn touches(triangle: [DVec2; 3], texel: DVec2) -> bool {
    let [a, b, c] = triangle;
    let turn = (b - a).perp_dot(c - a);
    (0..3).all(|k| {
        let (from, along) = (triangle[k], triangle[(k + 1) % 3] - triangle[k]);
        let corners = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE].map(|offset| along.perp_dot(texel + offset - from));
        turn == 0.0 || corners.iter().any(|side| side * turn >= 0.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image_space::projection::Bounds;

    /// A wall that is much thinner than a texel is in the pyramid on every level.
    #[test]
    fn thin_walls_are_covered() {
        let corners = [Vec3::new(-1.0, 0.0, 0.3), Vec3::new(1.0, 0.0, 0.31), Vec3::new(-1.0, 0.001, 0.3)];
        let bounds = Bounds { corners: [Vec3::splat(-1.0), Vec3::splat(1.0)] };
        let view = Projection::parallel(Vec3::new(0.0, -0.8, -0.6), bounds.corners(), &bounds, 512);
        let coverage = Coverage::new(&view, 0.0, [corners].into_iter());
        for grid in [1, 32, 64, 512, 2048] {
            let place = view.resized(grid).project(Vec3::new(-0.5, 0.0005, 0.3025)).unwrap();
            assert!(coverage.has([place.x as u32, place.y as u32], grid), "{grid}");
        }
        let covered = coverage.levels.last().unwrap().iter().filter(|texel| **texel).count();
        assert!(covered < 3000, "{covered}");
        let wider = Coverage::new(&view, 10.0 * view.texel, [corners].into_iter());
        let count = wider.levels.last().unwrap().iter().filter(|texel| **texel).count();
        assert!(count > 10 * covered && count < 40 * covered, "{count} {covered}");
    }
}
