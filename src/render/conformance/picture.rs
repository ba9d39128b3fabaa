//! What filters make of a zone plate, side by side: the picture that shows at a glance what a table says.

use glam::Vec3;

use super::Device;
use super::footprints::footprint;
use super::patterns::Pattern;
use super::truth::mean;
use crate::boxed::BoxFuture;
use crate::gpu::GpuError;
use crate::image::Image;
use crate::parallel;
use crate::pinhole::Probe;

/// Pixels along a tile, and between tiles.
const TILE: usize = 192;
const GAP: usize = 8;
/// Footprints: length and width in texels, and the angle of their length.
const TEXELS: [f64; 2] = [16.0, 1.0];
const ANGLE_RAD: f32 = 0.5;

/// The zone plate of one face under footprints of 16 × 1 texels: the exact means, then one tile for every filter of
/// [`Device::filters`]. Display-linear.
pub fn zone_plates(device: Device<'_>) -> BoxFuture<'_, Result<Image, GpuError>> {
    Box::pin(async move {
        let cube = Pattern::ZonePlate.cube();
        let at = |k: usize| 1.9 * ((k as f32 + 0.5) / TILE as f32 - 0.5);
        let probes: Vec<Probe> =
            (0..TILE * TILE).map(|k| footprint(4, at(k % TILE), at(k / TILE), ANGLE_RAD, TEXELS)).collect();
        let mut tiles: Vec<Vec<f32>> = vec![parallel::map(&probes, &|p| mean(cube, p, TEXELS) as f32)];
        for (filter, taps) in device.filters() {
            let got = device.probe(Pattern::ZonePlate, filter, taps, &probes).await?;
            tiles.push(got.iter().map(|g| g[0]).collect());
        }
        let width = tiles.len() * (TILE + GAP) - GAP;
        let mut image = Image::new(width as u32, TILE as u32).map(|_| Vec3::ONE);
        for (k, tile) in tiles.iter().enumerate() {
            for (index, value) in tile.iter().enumerate() {
                let (x, y) = (k * (TILE + GAP) + index % TILE, index / TILE);
                image.pixels[y * width + x] = Vec3::splat(value.clamp(0.0, 1.0));
            }
        }
        Ok(image)
    })
}
