//! Environment images for the ground truth: bilinear look-ups in the original image, and bounds from a pyramid of maxima.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use glam::DVec3;

use super::cone::AngleBox;
use super::maxima::Maxima;
use crate::image::RgbImage;
use crate::scene::{EnvironmentMap, MapLayout};

/// One image of a map and which part of it shows what.
#[derive(Debug)]
pub(super) struct Map {
    images: Vec<Arc<RgbImage>>,
    projection: Projection,
    /// Bounds by azimuth and polar angle.
    maxima: Maxima,
}

#[derive(Debug)]
enum Projection {
    Latlong,
    Angular,
    /// Six squares, each somewhere in an image.
    Faces(Box<[Face; 6]>),
}

/// A face of a cube: looking along `forward`, `right` points to the square's right and `down` to its bottom.
#[derive(Clone, Copy, Debug)]
struct Face {
    image: usize,
    column: usize,
    row: usize,
    forward: DVec3,
    right: DVec3,
    down: DVec3,
}

impl Map {
    /// From one image, or six.
    pub fn new(source: &EnvironmentMap) -> Self {
        let projection = match source.layout() {
            MapLayout::Latlong => Projection::Latlong,
            MapLayout::Angular => Projection::Angular,
            MapLayout::VerticalCross => Projection::Faces(Box::new(cross(true))),
            MapLayout::HorizontalCross => Projection::Faces(Box::new(cross(false))),
            MapLayout::Faces | MapLayout::Auto => Projection::Faces(Box::new(six_faces())),
        };
        let images = source.images().to_vec();
        let mut map = Self { images, projection, maxima: Maxima::default() };
        map.maxima = match map.projection {
            Projection::Latlong => Maxima::of_latlong(&map.images[0]),
            Projection::Angular | Projection::Faces(_) => map.maxima_by_texels(),
        };
        map
    }

    /// Radiance from a unit direction in the map's own frame.
    pub fn radiance(&self, d: DVec3) -> DVec3 {
        let (image, x, y) = self.place(d);
        match &self.projection {
            Projection::Latlong => {
                let width = self.images[0].width as i64;
                bilinear(&self.images[0], x, y, |i| i.rem_euclid(width) as usize, [0, self.images[0].height - 1])
            }
            Projection::Angular => {
                let last = self.images[0].width as i64 - 1;
                bilinear(&self.images[0], x, y, |i| i.clamp(0, last) as usize, [0, last as usize])
            }
            Projection::Faces(faces) => {
                let face = faces[image];
                let size = self.face_size();
                let (first, last) = ((face.column * size) as i64, ((face.column + 1) * size - 1) as i64);
                let rows = [face.row * size, (face.row + 1) * size - 1];
                bilinear(&self.images[face.image], x, y, |i| i.clamp(first, last) as usize, rows)
            }
        }
    }

    /// At least the largest sum of channels within an angle of an axis.
    pub fn bound(&self, axis: DVec3, half_angle: f64) -> f64 {
        self.maxima.within(&AngleBox::around(axis, half_angle))
    }

    /// Where a direction is: the face, if there are any, and texel coordinates in its image (0 is a first texel's centre).
    fn place(&self, d: DVec3) -> (usize, f64, f64) {
        let (w, h) = (self.images[0].width as f64, self.images[0].height as f64);
        match &self.projection {
            Projection::Latlong => {
                let azimuth = d.x.atan2(-d.z).rem_euclid(TAU);
                let polar = d.x.hypot(d.z).atan2(d.y);
                (0, azimuth / TAU * w - 0.5, polar / PI * h - 0.5)
            }
            Projection::Angular => {
                // Debevec's light probe: −Z in the middle, the distance from it proportional to the angle.
                let across = d.x.hypot(d.y);
                let radius = across.atan2(-d.z) / PI;
                let (x, y) = if across > 0.0 { (d.x / across, d.y / across) } else { (1.0, 0.0) };
                (0, 0.5 * (1.0 + radius * x) * w - 0.5, 0.5 * (1.0 - radius * y) * h - 0.5)
            }
            Projection::Faces(faces) => {
                let along = |face: &Face| face.forward.dot(d);
                let index = (0..6).max_by(|a, b| along(&faces[*a]).total_cmp(&along(&faces[*b]))).unwrap_or(0);
                let face = &faces[index];
                let size = self.face_size() as f64;
                let texel =
                    |tile: usize, side: DVec3| (tile as f64 + 0.5 * (1.0 + side.dot(d) / along(face))) * size - 0.5;
                (index, texel(face.column, face.right), texel(face.row, face.down))
            }
        }
    }

    fn face_size(&self) -> usize {
        match &self.projection {
            Projection::Faces(faces) if faces[5].image == 0 => {
                self.images[0].width / (1 + faces.iter().map(|f| f.column).max().unwrap_or(0))
            }
            _ => self.images[0].width,
        }
    }

    /// Bounds for layouts whose texels are no boxes of azimuth and polar angle: each texel's largest neighbour is spread
    /// over the boxes that hold all directions which read it.
    fn maxima_by_texels(&self) -> Maxima {
        let quarter = match self.projection {
            Projection::Faces(_) => self.face_size(),
            _ => self.images[0].width.div_ceil(4),
        };
        let mut maxima = Maxima::blank(4 * quarter, 2 * quarter, false);
        // A texel's reach: bilinear look-ups up to one texel away read it. The angular map's texels are widest along its
        // rim, the faces' in their centres.
        let reach = match self.projection {
            Projection::Angular => 2.0 * TAU / self.images[0].width as f64,
            _ => 2.0 * 2f64.sqrt() / quarter as f64,
        };
        self.for_each_texel(|direction, value| maxima.spread(&AngleBox::around(direction, reach), value));
        if matches!(self.projection, Projection::Angular) {
            // Straight behind the centre is the whole rim, where directions change faster than texels do.
            let rim = self.images[0].pixels.iter().map(sum).fold(0.0, f32::max);
            maxima.spread(&AngleBox::around(DVec3::Z, 3.0 * reach), rim);
        }
        maxima.build();
        maxima
    }

    fn for_each_texel(&self, mut visit: impl FnMut(DVec3, f32)) {
        if let Projection::Faces(faces) = &self.projection {
            let size = self.face_size();
            for face in faces.iter() {
                for (j, i) in (0..size).flat_map(|j| (0..size).map(move |i| (j, i))) {
                    let at = |k: usize| (2 * k + 1) as f64 / size as f64 - 1.0;
                    let d = (face.forward + at(i) * face.right + at(j) * face.down).normalize();
                    let image = &self.images[face.image];
                    let index = (face.row * size + j) * image.width + face.column * size + i;
                    visit(d, sum(&image.pixels[index]));
                }
            }
            return;
        }
        let image = &self.images[0];
        let size = image.width as f64;
        for (k, pixel) in image.pixels.iter().enumerate() {
            let x = (2 * (k % image.width) + 1) as f64 / size - 1.0;
            let y = 1.0 - (2 * (k / image.width) + 1) as f64 / size;
            // The picture's corners lie beyond the rim; the texels just beyond it are still read.
            let angle = (PI * x.hypot(y)).min(PI);
            let (sin, cos) = angle.sin_cos();
            let length = x.hypot(y).max(1e-12);
            visit(DVec3::new(sin * x / length, sin * y / length, -cos), sum(pixel));
        }
    }
}

fn sum(pixel: &[f32; 3]) -> f32 {
    pixel.iter().sum()
}

/// Bilinear interpolation at texel coordinates; columns go through `column`, rows clamp to a range.
fn bilinear(image: &RgbImage, x: f64, y: f64, column: impl Fn(i64) -> usize, rows: [usize; 2]) -> DVec3 {
    let y = y.clamp(rows[0] as f64, rows[1] as f64);
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = (x - x0, y - y0);
    let columns = [column(x0 as i64), column(x0 as i64 + 1)];
    let texel = |i: usize, j: usize| DVec3::from_array(image.pixels[j * image.width + i].map(f64::from));
    let row = |j: usize| (1.0 - fx) * texel(columns[0], j) + fx * texel(columns[1], j);
    let upper = y0 as usize;
    (1.0 - fy) * row(upper) + fy * row((upper + 1).min(rows[1]))
}

/// A vertical cross hangs +Y −Z −Y +Z below each other, with −X and +X beside −Z; a horizontal one has +Z at the right end.
fn cross(vertical: bool) -> [Face; 6] {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let face = |column, row, forward, right, down| Face { image: 0, column, row, forward, right, down };
    let behind = if vertical { face(1, 3, z, x, y) } else { face(3, 1, z, -x, -y) };
    [
        face(1, 1, -z, x, -y),
        face(2, 1, x, z, -y),
        face(0, 1, -x, -z, -y),
        face(1, 0, y, x, -z),
        face(1, 2, -y, x, z),
        behind,
    ]
}

/// Six images in WebGPU's order and orientation.
fn six_faces() -> [Face; 6] {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let sides = [(x, -z, -y), (-x, z, -y), (y, x, z), (-y, x, -z), (z, x, -y), (-z, -x, -y)];
    let mut image = 0;
    sides.map(|(forward, right, down)| {
        image += 1;
        Face { image: image - 1, column: 0, row: 0, forward, right, down }
    })
}
