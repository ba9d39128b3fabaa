//! An equirectangular image: directions and texels, supersampled evaluation of
//! a radiance field, and compact lossless OpenEXR output.
//!
//! World: right-handed, Y up. For a direction d towards the light,
//! u = atan2(d.x, -d.z) / 2 pi and v = acos(d.y) / pi, (0, 0) at the top left;
//! the middle column looks along +Z.

use std::error::Error;
use std::f64::consts::PI;
use std::io::Cursor;

use exr::prelude::{Blocks, Compression, Encoding, Image, LineOrder, SpecificChannels, Vec2, WritableImage};
use glam::Vec3;
use half::f16;
use rayon::prelude::*;

/// How the numbers of one file are stored.
#[derive(Clone, Copy)]
pub struct Storage {
    /// Mantissa bits kept; fewer compress better, too few show as bands.
    pub mantissa_bits: u32,
    /// 32-bit channels, for values that 16 bits cannot hold.
    pub wide: bool,
}

/// Values above this keep every bit: light sources must keep their energy.
const EXACT_ABOVE: f32 = 2000.0;

pub struct Canvas {
    pub width: usize,
    pub height: usize,
    texels: Vec<Vec3>,
}

/// The direction of image position (u, v).
pub fn direction(u: f64, v: f64) -> Vec3 {
    let (sin_polar, cos_polar) = (PI * v).sin_cos();
    let (sin_turn, cos_turn) = (2.0 * PI * u).sin_cos();
    glam::DVec3::new(sin_polar * sin_turn, cos_polar, -sin_polar * cos_turn).as_vec3()
}

impl Canvas {
    /// Evaluates `radiance` over every texel; `samples` tells how many samples
    /// per side the texel around a direction gets.
    pub fn render(
        (width, height): (usize, usize),
        samples: impl Fn(Vec3) -> usize + Sync,
        radiance: impl Fn(Vec3) -> Vec3 + Sync,
    ) -> Self {
        let mean_over = |index: usize| {
            let (column, row) = (index % width, index / width);
            let at = |x: f64, y: f64| {
                let u = (column as f64 + x) / width as f64;
                direction(u, (row as f64 + y) / height as f64)
            };
            texel_mean(samples(at(0.5, 0.5)), at, &radiance)
        };
        let texels = (0..width * height).into_par_iter().map(mean_over).collect();
        Self { width, height, texels }
    }

    /// The largest channel value.
    pub fn peak(&self) -> f32 {
        let largest = |peak: f32, t: &Vec3| peak.max(t.max_element());
        self.texels.iter().fold(0.0, largest)
    }

    /// Encodes the image with whichever lossless method gives the smaller file.
    pub fn encode(&self, storage: Storage) -> Result<Vec<u8>, Box<dyn Error>> {
        if !self.texels.iter().all(|t| t.is_finite()) {
            return Err("the image holds a value that is not finite".into());
        }
        if !storage.wide && self.peak() > f16::MAX.to_f32() {
            return Err("the image is too bright for 16-bit channels".into());
        }
        let zip = self.encode_as(storage, Compression::ZIP16)?;
        let piz = self.encode_as(storage, Compression::PIZ)?;
        Ok(if piz.len() < zip.len() { piz } else { zip })
    }

    fn encode_as(&self, storage: Storage, compression: Compression) -> Result<Vec<u8>, exr::error::Error> {
        let texel = |at: Vec2<usize>| {
            let t = self.texels[at.y() * self.width + at.x()];
            t.to_array().map(|x| rounded(x, storage.mantissa_bits))
        };
        let encoding = Encoding { compression, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
        let size = (self.width, self.height);
        let mut bytes = Cursor::new(Vec::new());
        if storage.wide {
            let channels = SpecificChannels::rgb(|at| <(f32, f32, f32)>::from(texel(at)));
            let image = Image::from_encoded_channels(size, encoding, channels);
            image.write().to_buffered(&mut bytes)?;
        } else {
            let half = |at| <(f16, f16, f16)>::from(texel(at).map(f16::from_f32));
            let image = Image::from_encoded_channels(size, encoding, SpecificChannels::rgb(half));
            image.write().to_buffered(&mut bytes)?;
        }
        Ok(bytes.into_inner())
    }
}

/// Mean radiance over one texel. Each sample counts by the solid angle it
/// stands for, which keeps the energy exact near the poles too.
fn texel_mean(side: usize, at: impl Fn(f64, f64) -> Vec3, radiance: impl Fn(Vec3) -> Vec3) -> Vec3 {
    let (mut sum, mut weight) = (glam::DVec3::ZERO, 0.0);
    for k in 0..side * side {
        let place = |step: usize| (step as f64 + 0.5) / side as f64;
        let d = at(place(k % side), place(k / side));
        let solid_angle = f64::from(d.x.hypot(d.z));
        sum += radiance(d).as_dvec3() * solid_angle;
        weight += solid_angle;
    }
    (sum / weight).as_vec3()
}

/// Rounds to `bits` bits of mantissa.
fn rounded(x: f32, bits: u32) -> f32 {
    if x > EXACT_ABOVE {
        return x;
    }
    let dropped = 23 - bits;
    let half_step = 1u32 << (dropped - 1);
    f32::from_bits((x.to_bits() + half_step) >> dropped << dropped)
}
