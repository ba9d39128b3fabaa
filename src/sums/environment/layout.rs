//! How images lay out directions: radiance by direction for every supported layout.
//!
//! Directions here are the map's own, before its rotation. Conventions: the equirectangular image has +Z at
//! its centre and +X to the left of it; angular maps and crosses have −Z at the centre, +X to the right, +Y up;
//! six faces come in WebGPU's order and orientation.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};
use std::sync::Arc;

use fearless_simd::{Select, Simd, SimdBase, SimdFloat, f32x16, u32x16};
use glam::{Vec2, Vec3, Vec3A};

use super::cube::face_of_direction;
use crate::image::RgbImage;
use crate::lanes::{V3, dispatch, level};
use crate::scene::{EnvironmentMap, MapLayout};

/// An image that knows which direction each of its points shows.
#[derive(Clone, Debug)]
pub(super) enum Layout {
    Latlong(Arc<RgbImage>),
    Angular(Arc<RgbImage>),
    /// +X −X +Y −Y +Z −Z.
    Faces(Box<[Arc<RgbImage>; 6]>),
}

impl Layout {
    /// From one image, or six.
    pub fn new(map: &EnvironmentMap) -> Self {
        let images = map.images();
        match map.layout() {
            MapLayout::Latlong => Self::Latlong(images[0].clone()),
            MapLayout::Angular => Self::Angular(images[0].clone()),
            MapLayout::VerticalCross => from_cross(&images[0], images[0].width / 3, true),
            MapLayout::HorizontalCross => from_cross(&images[0], images[0].width / 4, false),
            MapLayout::Faces | MapLayout::Auto => Self::Faces(Box::new([0, 1, 2, 3, 4, 5].map(|k| images[k].clone()))),
        }
    }

    /// Radiance from a unit direction.
    pub fn radiance(&self, d: Vec3) -> Vec3 {
        match self {
            Self::Latlong(image) => {
                let u = (d.x.atan2(-d.z) / TAU).rem_euclid(1.0);
                let v = d.y.clamp(-1.0, 1.0).acos() / PI;
                bilinear(image, Vec2::new(u, v), true)
            }
            Self::Angular(image) => {
                // Debevec: the radius is proportional to the angle from the centre's direction.
                let across = d.truncate().length();
                // Straight behind is the whole rim; any point of it will do.
                let outwards = d.truncate().try_normalize().unwrap_or(Vec2::X);
                let radius = across.atan2(-d.z) / PI;
                bilinear(image, 0.5 * Vec2::new(1.0 + outwards.x * radius, 1.0 - outwards.y * radius), false)
            }
            Self::Faces(faces) => {
                let (face, st) = face_of_direction(d);
                bilinear(&faces[face], 0.5 * (st + Vec2::ONE), false)
            }
        }
    }

    /// Puts the radiance in place of each of many unit directions.
    pub fn radiance_of_all(&self, directions: &mut [Vec3]) {
        let Self::Latlong(image) = self else {
            return directions.iter_mut().for_each(|d| *d = self.radiance(*d));
        };
        let (level, size) = (level(), [image.width as u32, image.height as u32]);
        for directions in directions.chunks_mut(LANES) {
            let mut lanes = [[0.0; LANES]; 3];
            for (k, d) in directions.iter().enumerate() {
                (lanes[0][k], lanes[1][k], lanes[2][k]) = (d.x, d.y, d.z);
            }
            let Taps { pixels, parts: [s, t] } = dispatch!(level, simd => taps_in_latlong(simd, &lanes, size));
            for (k, d) in directions.iter_mut().enumerate() {
                let [a, b, c, e] = pixels.map(|lanes| Vec3A::from(image.pixels[lanes[k] as usize]));
                *d = a.lerp(b, s[k]).lerp(c.lerp(e, s[k]), t[k]).into();
            }
        }
    }

    /// Radiance as a smooth picture: magnified, bilinear look-ups show their texels; four of them, half a texel apart, do not.
    pub fn smooth_radiance(&self, d: Vec3) -> Vec3 {
        0.25 * self.smooth_taps(d).map(|tap| self.radiance(tap)).into_iter().sum::<Vec3>()
    }

    /// The directions that are looked up for a smooth picture.
    fn smooth_taps(&self, d: Vec3) -> [Vec3; 4] {
        let texel = std::f32::consts::FRAC_PI_2 / self.texels_per_quarter() as f32;
        let (u, v) = d.any_orthonormal_pair();
        let (a, b) = (0.5 * texel * (u + v), 0.5 * texel * (u - v));
        [d + a, d + b, d - b, d - a].map(Vec3::normalize)
    }

    /// Puts [`Self::smooth_radiance`] in place of each of many unit directions.
    pub fn smooth_radiance_of_all(&self, directions: &mut [Vec3]) {
        let mut taps: Vec<Vec3> = directions.iter().flat_map(|d| self.smooth_taps(*d)).collect();
        self.radiance_of_all(&mut taps);
        for (radiance, taps) in directions.iter_mut().zip(taps.chunks_exact(4)) {
            *radiance = 0.25 * taps.iter().sum::<Vec3>();
        }
    }

    /// The largest radiance of a channel.
    pub fn brightest(&self) -> f32 {
        let images = match self {
            Self::Latlong(image) | Self::Angular(image) => std::slice::from_ref(image),
            Self::Faces(faces) => faces.as_slice(),
        };
        images.iter().flat_map(|image| image.pixels.as_flattened()).copied().fold(0.0, f32::max)
    }

    /// Texels across a quarter of the horizon.
    pub fn texels_per_quarter(&self) -> usize {
        match self {
            Self::Latlong(image) | Self::Angular(image) => image.width.div_ceil(4),
            Self::Faces(faces) => faces[0].width,
        }
    }
}

/// Directions that are looked up together.
const LANES: usize = 16;

/// What bilinear look-ups read: the numbers of the upper two pixels and of the lower two, and how far from the left to the right and
/// from the upper to the lower ones they lie.
struct Taps {
    pixels: [[u32; LANES]; 4],
    parts: [[f32; LANES]; 2],
}

/// Look-ups of directions, component by component, in an equirectangular image of this width and height.
#[inline(always)]
fn taps_in_latlong<S: Simd>(simd: S, directions: &[[f32; LANES]; 3], [width, height]: [u32; 2]) -> Taps {
    let V3([x, y, z]) = V3::load(simd, directions);
    let (w, h) = (width as f32, height as f32);
    let turn = atan2(x, -z) * TAU.recip();
    let column = turn.simd_lt(0.0).select(turn + 1.0, turn) * w - 0.5;
    // Unlike the arc cosine, this is exact near the poles, too.
    let row = (atan2((x * x + z * z).sqrt(), y) * (PI.recip() * h) - 0.5).max(0.0).min(h - 1.0);
    let (left, upper) = (column.floor(), row.floor());
    let (right, lower) = (left + 1.0, (upper + 1.0).min(h - 1.0));
    let from_edge = left.simd_lt(0.0).select(left + w, left).to_int::<u32x16<S>>();
    let over_edge = right.simd_ge(w).select(right - w, right).to_int::<u32x16<S>>();
    let (upper_row, lower_row) = (upper.to_int::<u32x16<S>>() * width, lower.to_int::<u32x16<S>>() * width);
    let above = [(upper_row + from_edge).to_array(), (upper_row + over_edge).to_array()];
    let below = [(lower_row + from_edge).to_array(), (lower_row + over_edge).to_array()];
    Taps {
        pixels: [above[0], above[1], below[0], below[1]],
        parts: [(column - left).to_array(), (row - upper).to_array()],
    }
}

/// The angles of the directions (`x`, `y`), from −π to π, within 3e-7. Reduction and polynomial are those of Cephes' `atanf`.
#[inline(always)]
fn atan2<S: Simd>(y: f32x16<S>, x: f32x16<S>) -> f32x16<S> {
    const TAN_PI_8: f32 = 0.414_213_56;
    let (low, high) = (x.abs().min(y.abs()), x.abs().max(y.abs()).max(f32::MIN_POSITIVE));
    let is_steep = low.simd_gt(high * TAN_PI_8);
    let t = is_steep.select(low - high, low) / is_steep.select(low + high, high);
    let t2 = t * t;
    let series = ((t2 * 8.053_744_5e-2 - 1.387_768_5e-1) * t2 + 1.997_771_1e-1) * t2 - 3.333_295e-1;
    let reduced = series * t2 * t + t;
    let angle = is_steep.select(reduced + FRAC_PI_4, reduced);
    let in_quadrant = x.abs().simd_lt(y.abs()).select(FRAC_PI_2 - angle, angle);
    let in_half = x.simd_lt(0.0).select(PI - in_quadrant, in_quadrant);
    in_half.copysign(y)
}

/// Bilinear look-up; texel (i, j)'s centre is at ((i + ½)/W, (j + ½)/H), v clamps and u clamps or wraps.
fn bilinear(image: &RgbImage, uv: Vec2, wrap_u: bool) -> Vec3 {
    let (w, h) = (image.width as i32, image.height as i32);
    let x = uv.x * w as f32 - 0.5;
    let y = (uv.y * h as f32 - 0.5).clamp(0.0, (h - 1) as f32);
    let (x0, y0) = (x.floor(), y.floor());
    let column = |i: i32| if wrap_u { i.rem_euclid(w) } else { i.clamp(0, w - 1) } as usize;
    let row = |j: i32| j.min(h - 1) as usize;
    let (i, j) = (x0 as i32, y0 as i32);
    let upper = image.pixel(column(i), row(j)).lerp(image.pixel(column(i + 1), row(j)), x - x0);
    let lower = image.pixel(column(i), row(j + 1)).lerp(image.pixel(column(i + 1), row(j + 1)), x - x0);
    upper.lerp(lower, y - y0)
}

/// Cuts a cross into faces, each turned into WebGPU's orientation by looking its own directions up in the cross.
fn from_cross(image: &RgbImage, size: usize, vertical: bool) -> Layout {
    let faces = [0, 1, 2, 3, 4, 5].map(|face| {
        let mut pixels = Vec::with_capacity(size * size);
        for j in 0..size {
            for i in 0..size {
                let centre = |k: usize| 2.0 * (k as f32 + 0.5) / size as f32 - 1.0;
                let (tile, st) = place_in_cross(super::face_direction(face, centre(i), centre(j)), vertical);
                let texel = |s: f32| (((0.5 * (s + 1.0)) * size as f32) as usize).min(size - 1);
                pixels.push(image.pixel(tile[0] * size + texel(st.x), tile[1] * size + texel(st.y)).to_array());
            }
        }
        Arc::new(RgbImage { width: size, height: size, pixels })
    });
    Layout::Faces(Box::new(faces))
}

/// The cross's tile (column, row) that shows a direction, and where on it, in [−1, 1]², t downwards.
fn place_in_cross(d: Vec3, vertical: bool) -> ([usize; 2], Vec2) {
    let a = d.abs();
    if a.x >= a.y && a.x >= a.z {
        let p = d / a.x;
        if d.x > 0.0 { ([2, 1], Vec2::new(p.z, -p.y)) } else { ([0, 1], Vec2::new(-p.z, -p.y)) }
    } else if a.y >= a.z {
        let p = d / a.y;
        if d.y > 0.0 { ([1, 0], Vec2::new(p.x, -p.z)) } else { ([1, 2], Vec2::new(p.x, p.z)) }
    } else {
        let p = d / a.z;
        match (d.z < 0.0, vertical) {
            (true, _) => ([1, 1], Vec2::new(p.x, -p.y)),
            (false, true) => ([1, 3], Vec2::new(p.x, p.y)),
            (false, false) => ([3, 1], Vec2::new(-p.x, -p.y)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One colour for each of the six axes.
    const SIX: [(Vec3, Vec3); 6] = [
        (Vec3::X, Vec3::new(1.0, 0.0, 0.0)),
        (Vec3::NEG_X, Vec3::new(0.0, 1.0, 1.0)),
        (Vec3::Y, Vec3::new(0.0, 1.0, 0.0)),
        (Vec3::NEG_Y, Vec3::new(1.0, 0.0, 1.0)),
        (Vec3::Z, Vec3::new(0.0, 0.0, 1.0)),
        (Vec3::NEG_Z, Vec3::new(1.0, 1.0, 0.0)),
    ];

    fn one(image: RgbImage, layout: MapLayout) -> Layout {
        Layout::new(&EnvironmentMap::new(vec![("map".into(), Arc::new(image))], layout).unwrap())
    }

    fn blank(width: usize, height: usize) -> RgbImage {
        RgbImage { width, height, pixels: vec![[0.5; 3]; width * height] }
    }

    /// Paints a block of texels around a point given in fractions of the picture.
    fn paint(image: &mut RgbImage, at: [f32; 2], colour: Vec3) {
        let (x, y) = ((at[0] * image.width as f32) as i32, (at[1] * image.height as f32) as i32);
        for j in y - 2..=y + 2 {
            for i in x - 2..=x + 2 {
                let i = i.rem_euclid(image.width as i32) as usize;
                let j = j.clamp(0, image.height as i32 - 1) as usize;
                image.pixels[j * image.width + i] = colour.to_array();
            }
        }
    }

    fn check(layout: &Layout, what: &str) {
        for (direction, colour) in SIX {
            let got = layout.radiance(direction);
            assert!(got.abs_diff_eq(colour, 1e-4), "{what}: {direction} gives {got}, not {colour}");
        }
    }

    #[test]
    fn six_coloured_directions_in_an_equirectangular_image() {
        // By the contract: the centre is +Z, +X lies to its left, the edges are −Z, the top +Y.
        let mut image = blank(64, 32);
        for (at, axis) in [([0.25, 0.5], 0), ([0.75, 0.5], 1), ([0.5, 0.5], 4), ([0.0, 0.5], 5)] {
            paint(&mut image, at, SIX[axis].1);
        }
        for i in 0..64 {
            image.pixels[i] = SIX[2].1.to_array();
            image.pixels[31 * 64 + i] = SIX[3].1.to_array();
        }
        check(&one(image, MapLayout::Auto), "latlong");
    }

    #[test]
    fn six_coloured_directions_in_an_angular_map() {
        // 90° from the centre is half way out; the rim is +Z all around.
        let mut image = blank(128, 128);
        for (at, axis) in [([0.75, 0.5], 0), ([0.25, 0.5], 1), ([0.5, 0.25], 2), ([0.5, 0.75], 3), ([0.5, 0.5], 5)] {
            paint(&mut image, at, SIX[axis].1);
        }
        let layout = one(image.clone(), MapLayout::Auto);
        for axis in [0, 1, 2, 3, 5] {
            assert!(layout.radiance(SIX[axis].0).abs_diff_eq(SIX[axis].1, 1e-4), "axis {axis}");
        }
        paint(&mut image, [0.999, 0.5], SIX[4].1);
        let layout = one(image, MapLayout::Angular);
        check(&layout, "angular");
    }

    #[test]
    fn six_coloured_directions_in_crosses() {
        let third = |k: f32| (k + 0.5) / 3.0;
        let quarter = |k: f32| (k + 0.5) / 4.0;
        let mut image = blank(48, 64);
        for (at, axis) in
            [([2.0, 1.0], 0), ([0.0, 1.0], 1), ([1.0, 0.0], 2), ([1.0, 2.0], 3), ([1.0, 3.0], 4), ([1.0, 1.0], 5)]
        {
            paint(&mut image, [third(at[0]), quarter(at[1])], SIX[axis].1);
        }
        check(&one(image, MapLayout::Auto), "vertical cross");
        let mut image = blank(64, 48);
        for (at, axis) in
            [([2.0, 1.0], 0), ([0.0, 1.0], 1), ([1.0, 0.0], 2), ([1.0, 2.0], 3), ([3.0, 1.0], 4), ([1.0, 1.0], 5)]
        {
            paint(&mut image, [quarter(at[0]), third(at[1])], SIX[axis].1);
        }
        check(&one(image, MapLayout::Auto), "horizontal cross");
    }

    #[test]
    fn crosses_are_continuous_across_their_folds() {
        // Paint the radiance r = (d + 1)/2 into each cross by its definition at the tile centres' neighbourhood, and
        // look between the tiles: neighbouring directions on either side of a fold must have neighbouring colours.
        for vertical in [true, false] {
            for (a, b) in [
                (Vec3::Z, Vec3::X),
                (Vec3::Z, -Vec3::Y),
                (Vec3::Y, -Vec3::Z),
                (-Vec3::Z, Vec3::X),
                (-Vec3::Y, -Vec3::Z),
            ] {
                let third = a.cross(b) * 0.4;
                let (tile_a, st_a) = place_in_cross(a * 1.001 + b + third, vertical);
                let (tile_b, st_b) = place_in_cross(a + b * 1.001 + third, vertical);
                let at =
                    |tile: [usize; 2], st: Vec2| Vec2::new(tile[0] as f32, tile[1] as f32) + 0.5 * (st + Vec2::ONE);
                let apart = (at(tile_a, st_a) - at(tile_b, st_b)).length();
                let neighbours = tile_a[0].abs_diff(tile_b[0]) + tile_a[1].abs_diff(tile_b[1]) == 1;
                assert!(
                    !neighbours || apart < 0.01,
                    "{a} {b} vertical {vertical}: {tile_a:?} {st_a} {tile_b:?} {st_b}"
                );
            }
        }
    }

    #[test]
    fn six_coloured_directions_in_six_faces() {
        let faces = SIX.map(|(_, colour)| {
            let mut face = blank(16, 16);
            paint(&mut face, [0.5, 0.5], colour);
            ("face".into(), Arc::new(face))
        });
        check(&Layout::new(&EnvironmentMap::new(faces.to_vec(), MapLayout::Faces).unwrap()), "faces");
    }

    #[test]
    fn many_look_ups_are_as_many_single_ones() {
        let mut image = blank(64, 32);
        for (k, pixel) in image.pixels.iter_mut().enumerate() {
            *pixel = [0.0, 0.3, 0.6].map(|phase| ((k as f32) * 0.618_034 + phase).fract());
        }
        let layout = Layout::Latlong(image.into());
        // A spiral over the sphere, an incomplete group of lanes, and the axes but for the poles, where any column will do.
        let mut directions: Vec<Vec3> = (0..10_001)
            .map(|k| {
                let (y, turn) = (1.0 - (k as f32 + 0.5) / 5_000.5, k as f32 * 2.4);
                ((1.0 - y * y).sqrt() * Vec3::new(turn.cos(), 0.0, turn.sin())).with_y(y)
            })
            .collect();
        directions.extend(SIX.map(|(axis, _)| axis).into_iter().filter(|axis| axis.y == 0.0));
        let single: Vec<Vec3> = directions.iter().map(|d| layout.radiance(*d)).collect();
        let mut all = directions.clone();
        layout.radiance_of_all(&mut all);
        for ((d, one), other) in directions.iter().zip(single).zip(all) {
            // The arc cosine of the single look-up is rough near the poles.
            let tolerance = if d.y.abs() > 0.999 { 1e-2 } else { 1e-4 };
            assert!(one.abs_diff_eq(other, tolerance), "{d}: {one} {other}");
        }
    }
}
